"""Edges, facets, neighbours and measures of a mesh, against slow twins."""

from collections import Counter
from itertools import combinations, permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from adaptsize import SimplexMesh
from adaptsize.background._mesh_arrays import centroids, lengths
from adaptsize.background.topology import any_of

KINDS = {"segments": (2, 2), "plane": (3, 2), "surface": (3, 3), "volume": (4, 3), "line": (2, 1)}


@st.composite
def any_meshes(draw):
    """Random cells over few nodes: non-manifold, repeated and unused ones included."""
    width, dim = KINDS[draw(st.sampled_from(sorted(KINDS)))]
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n_points = draw(st.integers(width, 12))
    n_cells = draw(st.integers(1, 30))
    cells = np.array([rng.choice(n_points, width, replace=False) for _ in range(n_cells)])
    return SimplexMesh(rng.normal(size=(n_points, dim)), cells)


def _subsets(mesh, width):
    return [
        tuple(sorted(subset))
        for cell in mesh.cells.tolist()
        for subset in combinations(cell, width)
    ]


@given(any_meshes())
def test_edges_are_the_sorted_set_of_pairs(mesh):
    pairs = sorted(set(_subsets(mesh, 2)))
    assert [tuple(edge) for edge in mesh.edges.tolist()] == pairs
    lengths = [np.linalg.norm(mesh.points[i] - mesh.points[j]) for i, j in pairs]
    assert_allclose(mesh.edge_lengths, lengths, rtol=1e-15)


@given(any_meshes())
def test_facets_are_the_sorted_set_of_sides_and_counted(mesh):
    sides = Counter(_subsets(mesh, mesh.cell_dim))
    assert [tuple(facet) for facet in mesh.facets.tolist()] == sorted(sides)
    assert mesh.facet_cell_counts.tolist() == [sides[side] for side in sorted(sides)]
    assert mesh.is_closed == (1 not in sides.values())


@given(any_meshes())
def test_cell_facets_lie_opposite_to_their_vertices(mesh):
    assert mesh.cell_facets.shape == mesh.cells.shape
    for cell, facets in zip(mesh.cells.tolist(), mesh.cell_facets.tolist(), strict=True):
        for vertex, facet in zip(cell, facets, strict=True):
            assert mesh.facets[facet].tolist() == sorted(set(cell) - {vertex})


@given(any_meshes())
def test_rings_list_the_cells_of_each_node_in_order(mesh):
    ring_ptr, ring = mesh.rings
    assert len(ring_ptr) == mesh.n_points + 1
    for i in range(mesh.n_points):
        around = [c for c, cell in enumerate(mesh.cells.tolist()) if i in cell]
        assert ring[ring_ptr[i] : ring_ptr[i + 1]].tolist() == around


# Measures.


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_signed_measures_change_sign_with_odd_renumbering(dim):
    corners = np.vstack([np.zeros(dim), np.eye(dim)])
    for order in permutations(range(dim + 1)):
        sign = np.linalg.det(np.eye(dim + 1)[list(order)])
        mesh = SimplexMesh(corners, [order])
        assert_allclose(mesh.signed_measures, [sign / np.prod(range(1, dim + 1))], rtol=1e-15)
        assert_allclose(mesh.measures, np.abs(mesh.signed_measures), rtol=1e-14)


@pytest.mark.parametrize("n", [20, 40, 3000])
def test_rows_of_a_hub_are_sorted_as_others(n):
    rng = np.random.default_rng(n)
    ring = 1 + rng.permutation(n)
    cells = np.column_stack([np.zeros(n, int), ring, np.roll(ring, 1)])
    turned = np.take_along_axis(cells, rng.permuted(np.tile([0, 1, 2], (n, 1)), axis=1), axis=1)
    twice = np.concatenate([turned, cells[: n // 2]])[rng.permutation(n + n // 2)]
    mesh = SimplexMesh(rng.random((n + 1, 2)), twice)
    pairs = np.sort(twice[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, number = np.unique(pairs, axis=0, return_inverse=True)
    assert np.array_equal(mesh.edges, edges)
    assert np.array_equal(np.bincount(number.ravel()), mesh.facet_cell_counts)


@given(any_meshes())
def test_what_is_done_column_by_column_is_what_numpy_does_by_rows(mesh):
    """To the last bit."""
    points, cells = mesh.points, mesh.cells
    assert np.array_equal(centroids(points, cells), points[cells].mean(axis=1))
    ends = cells[:, :2]
    norms = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
    assert np.array_equal(lengths(points, ends), norms)
    flags = points[:, 0] > 1.0
    assert np.array_equal(any_of(flags, cells), flags[cells].any(axis=1))
