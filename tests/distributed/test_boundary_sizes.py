"""Sizes from curvature and width on parts of a mesh equal those on the whole, bit by bit."""

import domains
import numpy as np
import pytest
from meshes import jittered_cube, random_sphere
from partitions import KINDS, SIZE, on_ranks, partition
from scipy.spatial import Delaunay

from adaptsize import SimplexMesh, size_from_curvature, size_from_feature
from adaptsize.background.migration import whole_boundary


def tagged_disc():
    """Return a disc of triangles of both orientations, some of its edges tagged, a node unused."""
    mesh = domains.disc(8, radius=3.0, seed=881)[0]
    cells = mesh.cells.copy()
    cells[::3] = cells[::3, ::-1]
    edges = mesh.facets[mesh.facet_cell_counts == 1][::2]
    points = np.concatenate([mesh.points, [[9.0, 9.0]]])
    return SimplexMesh(points, cells, tagged_facets=edges, facet_tags=np.full(len(edges), 4))


def ball():
    sphere = random_sphere(80, 882)
    points = np.concatenate([sphere.points, [[0.0, 0.0, 0.0]]])
    return SimplexMesh(points, Delaunay(points).simplices)


MESHES = {"disc": tagged_disc(), "cube": jittered_cube(4, 883), "ball": ball()}
OPTIONS = {"crease_angle": 50.0, "hmax": 30.0}


@pytest.mark.parametrize("name", MESHES)
def test_equal_to_serial_for_every_partition(name):
    mesh, rng = MESHES[name], np.random.default_rng(884)
    curvature = size_from_curvature(mesh, **OPTIONS)
    feature = size_from_feature(mesh, **OPTIONS)
    whole = mesh.boundary()
    for kind in KINDS:

        def work(part):
            found = size_from_curvature(part, **OPTIONS), size_from_feature(part, **OPTIONS)
            return *found, whole_boundary(part)

        results, parts = on_ranks(mesh, partition(mesh, kind, SIZE, rng), SIZE, work)
        for (by_curvature, by_feature, boundary), part in zip(results, parts, strict=True):
            np.testing.assert_array_equal(by_curvature, curvature[part.global_ids])
            np.testing.assert_array_equal(by_feature, feature[part.global_ids])
            np.testing.assert_array_equal(boundary.ids, whole.nodes)
            np.testing.assert_array_equal(boundary.mesh.cells, whole.mesh.cells)
            np.testing.assert_array_equal(boundary.mesh.points, whole.mesh.points)
            if name == "disc":
                np.testing.assert_array_equal(boundary.mesh.cell_tags, whole.mesh.cell_tags)


def test_number_of_exchanges():
    """Shared nodes are found in two exchanges, the boundary in two more and one gather."""

    def work(part):
        counts = []
        for _ in range(2):
            before = part.ranks.traffic.exchanges
            part.minimum(np.zeros(part.n_points))
            counts.append(part.ranks.traffic.exchanges - before)
        for _ in range(2):
            before = part.ranks.traffic.exchanges, part.ranks.traffic.reductions
            size_from_curvature(part)
            counts.append(part.ranks.traffic.exchanges - before[0])
            counts.append(part.ranks.traffic.reductions - before[1])
        return counts

    # One reduction is the agreement on errors.
    assert on_ranks(MESHES["disc"], None, SIZE, work)[0] == [[3, 1, 2, 2, 0, 1]] * SIZE


def test_surfaces_and_curves_are_collected():
    sphere, rng = random_sphere(40, 885), np.random.default_rng(886)
    circle = MESHES["disc"].boundary().mesh
    for mesh in (sphere, circle):
        curvature = size_from_curvature(mesh, **OPTIONS)
        feature = size_from_feature(mesh, **OPTIONS)
        results, parts = on_ranks(
            mesh,
            partition(mesh, "some empty", SIZE, rng),
            SIZE,
            lambda part: (size_from_curvature(part, **OPTIONS), size_from_feature(part, **OPTIONS)),
        )
        for (by_curvature, by_feature), part in zip(results, parts, strict=True):
            np.testing.assert_array_equal(by_curvature, curvature[part.global_ids])
            np.testing.assert_array_equal(by_feature, feature[part.global_ids])


def test_the_boundary_is_found_once():
    def work(part):
        counts = []
        for _ in range(2):
            before = part.ranks.traffic.exchanges
            size_from_curvature(part)
            counts.append(part.ranks.traffic.exchanges - before)
        return counts

    results, _ = on_ranks(MESHES["cube"], None, SIZE, work)
    assert {again for _, again in results} == {0}


def test_bad_input_on_one_rank_is_reported_by_all():
    def work(part):
        bad = -1.0 if part.ranks.rank == 1 else 4.0
        with pytest.raises(ValueError, match=r"^rank 1: elements_per_radian must be"):
            size_from_curvature(part, elements_per_radian=bad)
        with pytest.raises(ValueError, match=r"^rank 0: elements_across must be"):
            size_from_feature(part, elements_across=-1.0)

    on_ranks(MESHES["cube"], None, SIZE, work)
