"""Sizes from the curvature of boundaries."""

import numpy as np
import pytest
from curved_shapes import sliver_cylinder, uneven_angles
from meshes import random_sphere
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import Delaunay

from adaptsize import Octree, SimplexMesh, size_from_curvature, size_from_feature, size_function


def disk(n, seed, *, radius=1.0):
    """Triangles in an uneven polygon, with some nodes inside; those on the circle come first."""
    angle = uneven_angles(n, seed)
    rim = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    inner = 0.5 * rim[::3]
    points = np.concatenate([rim, inner])
    return SimplexMesh(points, Delaunay(points).simplices)


def ball(n, seed, *, radius=1.0):
    """Tetrahedra from the centre to a random sphere; the centre is the last node."""
    sphere = random_sphere(n, seed, radius=radius)
    centre = np.full((sphere.n_cells, 1), n)
    return SimplexMesh(np.vstack([sphere.points, np.zeros(3)]), np.hstack([sphere.cells, centre]))


def test_disk_gets_two_pi_k_elements_around():
    mesh = disk(40, 19, radius=3.0)
    h0 = size_from_curvature(mesh, elements_per_radian=5.0)
    assert_allclose(2.0 * np.pi * 3.0 / h0[:40], 2.0 * np.pi * 5.0, rtol=1e-10)
    assert np.isinf(h0[40:]).all()


def test_ball_of_tetrahedra_by_its_surface():
    h0 = size_from_curvature(ball(300, 71, radius=2.0), crease_angle=90.0)
    assert_allclose(h0[:-1], 2.0 / 4.0, rtol=1e-9)
    assert np.isinf(h0[-1])


def test_surface_by_itself_and_its_rim():
    # A flat disk in space has no curvature but that of its boundary line.
    flat = disk(40, 19, radius=3.0)
    plate = SimplexMesh(np.column_stack([flat.points, np.zeros(flat.n_points)]), flat.cells)
    h0 = size_from_curvature(plate)
    assert_allclose(h0[:40], 3.0 / 4.0, rtol=1e-10)
    assert np.isinf(h0[40:]).all()


def test_curved_creases_count_where_the_faces_are_flat():
    # The rim of a narrow cone is sharper curved than the cone itself: kappa = cos(slope) / r
    # against 1 / r of the rim.
    n = 40
    angle = uneven_angles(n, 41)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    points = np.vstack([np.column_stack([circle, np.zeros(n)]), [0, 0, 0], [0, 0, 1.0]])
    after = (np.arange(n) + 1) % n
    base = np.column_stack([after, np.arange(n), np.full(n, n)])
    side = np.column_stack([np.arange(n), after, np.full(n, n + 1)])
    h0 = size_from_curvature(SimplexMesh(points, np.concatenate([base, side])))
    assert_allclose(h0[:n], 0.25, rtol=1e-10)


def dish(slope, n_rings=6, n_around=48):
    """A flat disc of radius 1 and the cone around it up to radius 2, and the edges between them."""
    radius = np.linspace(0.0, 2.0, 2 * n_rings + 1)[1:]
    angle = 2.0 * np.pi * np.arange(n_around) / n_around
    height = np.tan(np.radians(slope)) * np.maximum(radius - 1.0, 0.0)
    rings = [np.column_stack([r * np.cos(angle), r * np.sin(angle), 0.0 * angle + z])
             for r, z in zip(radius, height, strict=True)]  # fmt: skip
    k, after = np.arange(n_around), (np.arange(n_around) + 1) % n_around
    cells = [np.column_stack([0 * k, 1 + k, 1 + after])]
    for i in range(1, len(radius)):
        inner, outer = 1 + (i - 1) * n_around, 1 + i * n_around
        cells.append(np.column_stack([inner + k, outer + k, outer + after]))
        cells.append(np.column_stack([inner + k, outer + after, inner + after]))
    first = 1 + (n_rings - 1) * n_around
    points = np.concatenate([np.zeros((1, 3)), *rings])
    return points, np.concatenate(cells), first + np.column_stack([k, after])


@pytest.mark.parametrize("slope", [3.0, 14.0, 41.0])
def test_tagged_edges_are_feature_edges_at_any_angle(slope):
    points, cells, rim = dish(slope)
    tagged = SimplexMesh(points, cells, tagged_facets=rim, facet_tags=np.ones(len(rim), int))
    nodes = np.unique(rim)
    h = size_from_curvature(tagged, elements_per_radian=3.0)
    assert_allclose(h[nodes], 1.0 / 3.0, rtol=1e-12)
    sizes = size_function(
        tagged, elements_per_radian=3.0, elements_across=0.0, hmax=9.0, tolerance=np.inf
    ).values
    assert_allclose(sizes[nodes], 1.0 / 3.0, rtol=1e-12)
    # Without a tag, or with tag 0, the cone alone counts below the crease angle.
    untagged = SimplexMesh(points, cells, tagged_facets=rim, facet_tags=np.zeros(len(rim), int))
    h = size_from_curvature(untagged, elements_per_radian=3.0)
    assert (h[nodes] < 0.34).all() == (slope > 40.0)
    assert_array_equal(h, size_from_curvature(SimplexMesh(points, cells), elements_per_radian=3.0))


def test_boundary_mesh_gives_its_curvature_to_the_nodes_on_it():
    # Nodes on a finer cylinder mesh: rim, mantle and the flat of the caps.
    boundary = sliver_cylinder(24, 9, radius=2.0)
    nodes = [
        boundary.points[0],  # on the rim
        0.5 * (boundary.points[0] + boundary.points[24]),  # on a long edge of the mantle
        [0.0, 0.0, 0.0],  # in a cap
        [0.0, 0.0, 1.0],  # inside
        0.5 * (boundary.points[3] + boundary.points[4]),  # on the rim, between two nodes
    ]
    background = SimplexMesh(nodes, [[0, 1, 2, 3], [1, 2, 3, 4]])
    h0 = size_from_curvature(background, boundary)
    assert_allclose(h0, [0.5, 0.5, np.inf, np.inf, 0.5], rtol=1e-10)


def test_nodes_of_large_and_small_leaves_that_the_boundary_passes_have_sizes():
    def near(centres, sizes):
        return np.linalg.norm(centres - [1.0, 0.0], axis=1) < sizes[:, 0]

    tree = Octree.build([-1.5, -1.6], [1.7, 1.6], near, max_level=7, root_shape=(8, 8))
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    ends = np.arange(400)
    circle = SimplexMesh(
        np.column_stack([np.cos(angle), np.sin(angle)]), np.column_stack([ends, (ends + 1) % 400])
    )
    inside = np.linalg.norm(tree.points, axis=1) < 1.0
    cells = tree.mesh.cells
    passed = np.unique(cells[inside[cells].any(axis=1) & ~inside[cells].all(axis=1)])
    assert_allclose(size_from_curvature(tree, circle)[passed], 0.25, rtol=1e-3)
    assert_allclose(size_from_feature(tree, circle, elements_across=4.0)[passed], 0.5, rtol=1e-3)


def test_bad_arguments_are_named():
    mesh = disk(20, 3)
    with pytest.raises(ValueError, match="boundary must consist of segments in 2-D"):
        size_from_curvature(mesh, random_sphere(20, 3))
    far = SimplexMesh([[5, 5], [6, 5]], [[0, 1]])
    with pytest.raises(ValueError, match="boundary must pass through nodes of the background"):
        size_from_curvature(mesh, far)
    with pytest.raises(ValueError, match="background must lie in 2-D or 3-D"):
        size_from_curvature(SimplexMesh([[0.0], [1.0]], [[0, 1]]))


def test_options_without_effect_are_refused():
    mesh, line = disk(20, 3), SimplexMesh([[0, 0], [1, 0], [1, 1]], [[0, 1], [1, 2]])
    with pytest.raises(ValueError, match=r"tolerance needs boundary, got 0\.1 without"):
        size_from_curvature(mesh, tolerance=0.1)
    with pytest.raises(ValueError, match=r"g is for a boundary that is given by distances, got g="):
        size_from_curvature(mesh, g=0.3)
    for arguments in ((line,), (mesh,), (mesh, mesh.boundary().mesh)):
        with pytest.raises(ValueError, match="smoothing must be 0 for segments"):
            size_from_curvature(*arguments, smoothing=1)
    assert size_from_curvature(mesh, g=0.25, smoothing=0, tolerance=None).shape == (27,)


def test_with_a_tolerance_of_0_nodes_exactly_on_the_boundary_count():
    mesh = disk(20, 3)
    boundary = mesh.boundary().mesh
    bound = size_from_curvature(mesh, boundary, tolerance=0.0)
    assert np.count_nonzero(np.isfinite(bound)) == 20
    assert_array_equal(bound, size_from_curvature(mesh, boundary))
