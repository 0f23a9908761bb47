"""Bisection until sizes are resolved: conforming meshes, no missed size, tags, frozen edges."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial import Delaunay

from adaptsize import SimplexMesh
from adaptsize.background.bisection import resolved
from adaptsize.background.topology import are_among
from adaptsize.quality.elements import minimum_angles

G = 0.25


def box(dim, n, seed):
    """Return the unit box in cells of random nodes, every corner of it a node."""
    rng = np.random.default_rng(seed)
    corners = np.array(list(np.ndindex(*[2] * dim)), float)
    points = np.concatenate([corners, 0.05 + 0.9 * rng.random((n, dim))])
    return SimplexMesh(points, Delaunay(points).simplices if dim > 1 else _segments(points))


def _segments(points):
    order = np.argsort(points[:, 0])
    return np.column_stack([order[:-1], order[1:]])


def cone(place, least):
    return lambda x: least + G * np.linalg.norm(x - place, axis=1)


@given(st.integers(1, 3), st.integers(0, 2**32 - 1), st.sampled_from([0.3, 0.03, 1e-3, 1e-5]))
@settings(deadline=None, max_examples=20)
def test_a_cone_anywhere_is_resolved_in_a_conforming_mesh(dim, seed, least):
    mesh = box(dim, 8, seed)
    place = np.random.default_rng(seed).random(dim)
    size = cone(place, least)
    found = resolved(mesh, size, g=G)
    fine = found.mesh
    assert found.is_complete
    # Between the nodes, linear sizes are at most twice the smallest one that may be there.
    at_tip = fine.locator.interpolate(size(fine.points), place[None])[0]
    assert at_tip <= 2.0 * least * (1.0 + 1e-9)
    assert_allclose(fine.measures.sum(), 1.0, rtol=1e-9)
    assert (fine.signed_measures * mesh.signed_measures[found.parents] > 0.0).all()
    # Conforming: the facets that have one cell are those on the boundary of the box.
    x = fine.points[fine.facets]
    on_boundary = ((x == 0.0).all(axis=1) | (x == 1.0).all(axis=1)).any(axis=1)
    assert np.array_equal(fine.facet_cell_counts == 1, on_boundary)
    assert fine.facet_cell_counts.max() <= 2
    assert (fine.points[: mesh.n_points] == mesh.points).all()
    middles = fine.points[found.node_parents].mean(axis=1)
    assert_allclose(fine.points[mesh.n_points :], middles, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("least", [1e-2, 1e-3])
def test_angles_of_triangles_stay_above_half_of_the_smallest_one(least):
    # Rosenberg and Stenger (1975) for longest-edge bisection in the plane.
    mesh = box(2, 30, 20260101)
    fine = resolved(mesh, cone(np.array([0.4, 0.7]), least), g=G).mesh
    assert minimum_angles(fine).min() >= 0.5 * minimum_angles(mesh).min()


@pytest.mark.parametrize("dim", [2, 3])
def test_few_nodes_are_needed_for_a_point(dim):
    # The number grows with the logarithm of the size: each halving of it adds as many.
    mesh = box(dim, 0, 1)
    counts = [
        resolved(mesh, cone(np.full(dim, 0.3), least), g=G).mesh.n_points
        for least in (1e-2, 1e-3, 1e-4, 1e-5)
    ]
    steps = np.diff(counts)
    assert (np.abs(steps - steps.mean()) < 0.35 * steps.mean()).all(), counts


@pytest.mark.parametrize("dim", [2, 3])
def test_numbers_of_nodes_and_cells_do_not_matter(dim):
    mesh, size = box(dim, 20, 5), cone(np.full(dim, 0.37), 1e-2)
    rng = np.random.default_rng(6)
    nodes, cells = rng.permutation(mesh.n_points), rng.permutation(mesh.n_cells)
    place = np.argsort(nodes)
    other = SimplexMesh(mesh.points[nodes], place[mesh.cells][cells])
    one, two = (resolved(m, size, g=G).mesh for m in (mesh, other))
    assert _corner_sets(one) == _corner_sets(two)


def _corner_sets(mesh):
    return {frozenset(map(tuple, cell)) for cell in mesh.points[mesh.cells]}


@pytest.mark.parametrize("dim", [2, 3])
def test_tags_and_curves_are_divided_with_the_cells(dim):
    mesh = box(dim, 12, 8)
    facets = np.asarray(mesh.facets[::3])
    tags = np.arange(len(facets)) + 1
    mesh = SimplexMesh(
        mesh.points, mesh.cells, cell_tags=np.arange(mesh.n_cells) % 3, tagged_facets=facets,
        facet_tags=tags, tag_names={(dim, 1): "steel"},
    )  # fmt: skip
    edges = mesh.edges[::2]
    found = resolved(mesh, cone(np.full(dim, 0.4), 0.01), g=G, curves=edges)
    fine = found.mesh
    for tag in range(3):
        measures = [m.measures[m.cell_tags == tag].sum() for m in (mesh, fine)]
        assert_allclose(*measures, rtol=1e-12)
    old, new = (SimplexMesh(m.points, m.tagged_facets) for m in (mesh, fine))
    sums = [np.bincount(m.facet_tags, s.measures) for m, s in ((mesh, old), (fine, new))]
    assert_allclose(*sums, rtol=1e-9, atol=1e-15)
    rows = np.sort(fine.tagged_facets, axis=1)
    assert set(map(tuple, rows)) <= set(map(tuple, np.sort(fine.facets, axis=1)))
    assert are_among(found.curves, fine.edges).all()
    lengths = [np.linalg.norm(np.diff(p[e], axis=1), axis=2).sum()
               for p, e in ((mesh.points, edges), (fine.points, found.curves))]  # fmt: skip
    assert_allclose(*lengths, rtol=1e-12)
    assert fine.tag_names == mesh.tag_names


@pytest.mark.parametrize("dim", [2, 3])
def test_a_size_at_a_sample_is_not_missed(dim):
    # The function is small in a ball of radius 1e-4 around one sample of a thousand.
    rng = np.random.default_rng(11)
    samples = rng.random((1000, dim))
    place = samples[500]

    def size(x):
        return np.where(np.linalg.norm(x - place, axis=1) < 1e-4, 1e-3, 1.0)

    mesh = box(dim, 5, 12)
    fine = resolved(mesh, size, samples=samples).mesh
    at = fine.locator.nearest(place[None])[0]
    assert np.ptp(fine.points[fine.cells[at[0]]], axis=0).max() <= 2e-3
    assert resolved(mesh, size).mesh.n_points == mesh.n_points  # nobody looks there


def test_division_ends_at_the_number_of_nodes_with_the_largest_cells_first():
    mesh = box(2, 5, 13)
    found = resolved(mesh, cone(np.array([0.2, 0.6]), 1e-4), g=0.0, max_points=200)
    assert not found.is_complete
    assert found.mesh.n_points < 500


def test_a_surface_and_both_sides_of_a_slit_are_divided():
    # Two triangles on each side of a slit: nodes 1, 4 and 2, 5 coincide.
    points = [[0, 0], [1, 0], [1, 1], [0, 1], [1, 0], [1, 1], [2, 0], [2, 1]]
    cells = [[0, 1, 2], [0, 2, 3], [4, 6, 7], [4, 7, 5]]
    plane = resolved(SimplexMesh(points, cells), lambda x: np.full(len(x), 0.2), g=0.0).mesh
    assert plane.facet_cell_counts.max() == 2
    left, right = plane.cells[:, 0] * 0 == 0, plane.points[plane.cells].mean(axis=1)[:, 0] > 1
    assert not np.intersect1d(plane.cells[left & ~right], plane.cells[right]).size
    corners = np.eye(4, 3) + [[0, 0, 0]] * 4
    skin = SimplexMesh(corners, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    fine = resolved(skin, lambda x: np.full(len(x), 0.1), g=0.0).mesh
    assert fine.is_closed
    assert_allclose(fine.measures.sum(), skin.measures.sum(), rtol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_cells_with_linear_sizes_are_divided_only_as_far_as_a_small_one_could_hide(dim):
    mesh = box(dim, 10, 14)
    fine = resolved(mesh, lambda x: 0.02 + 0.0 * x[:, 0], g=G).mesh
    # The lower bound of the size is half of it where corners are at 2 / G half sizes.
    corners = fine.points[fine.cells]
    away = np.linalg.norm(corners - corners.mean(axis=1)[:, None], axis=2).max(axis=1)
    assert away.max() <= 0.5 * 0.02 / G * (1 + 1e-12)
    assert np.median(away) > 0.2 * 0.02 / G
    plain = resolved(mesh, lambda x: 0.02 + 0.1 * x[:, 0]).mesh
    assert plain.n_points < 20 * mesh.n_points
