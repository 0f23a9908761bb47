"""Laws that every limiting scheme keeps on any mesh."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay

from adaptsize import SimplexMesh, limit_gradient
from meshes import random_sphere

# Add a scheme here and it has to keep every law below.
SCHEMES = ("fast-marching", "positive-coefficient", "edge-based", "exact")
KINDS = ("segments", "plane", "surface", "volume")


def _mesh(kind, n, rng):
    if kind == "segments":
        order = rng.permutation(n)
        return SimplexMesh(rng.random((n, 2)), np.column_stack([order[:-1], order[1:]]))
    if kind == "surface":
        return random_sphere(max(n, 8), int(rng.integers(2**31)))
    dim = 2 if kind == "plane" else 3
    points = rng.random((max(n, 8), dim))
    points[-1] = points[0]  # a doubled point: Delaunay leaves it in no cell
    return SimplexMesh(points, Delaunay(points).simplices)


def _flatten(mesh, rng):
    """Move a node onto another one: cells of no volume and edges of no length."""
    i, j = mesh.cells[rng.integers(mesh.n_cells), :2]
    points = mesh.points.copy()
    points[i] = points[j]
    return SimplexMesh(points, mesh.cells)


@st.composite
def problems(draw, scheme):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    kinds = ("plane", "volume") if scheme == "exact" else KINDS
    mesh = _mesh(draw(st.sampled_from(kinds)), draw(st.integers(4, 40)), rng)
    if scheme != "exact" and draw(st.booleans()):
        mesh = _flatten(mesh, rng)
    bounded = rng.random(mesh.n_points) < draw(st.sampled_from([0.1, 0.5, 1.0]))
    bounded[rng.integers(mesh.n_points)] = True
    h0 = np.where(bounded, rng.uniform(0.01, 2.0, mesh.n_points), np.inf)
    scale = draw(st.sampled_from([0.0, 0.1, 0.3, 1.0]))
    places = {"number": (), "nodes": mesh.n_points, "cells": mesh.n_cells}
    where = "number" if scheme == "exact" else draw(st.sampled_from(sorted(places)))
    return mesh, h0, scale * rng.uniform(0.5, 1.0, places[where])


def _g_of_cells(mesh, g):
    if np.ndim(g) == 0:
        return np.full(mesh.n_cells, g)
    return g[mesh.cells].mean(axis=1) if len(g) == mesh.n_points else g


def _largest_excess(mesh, h, g):
    """Return max over cell edges of (h_i - h_j) - g length; -inf where only inf meet."""
    worst = -np.inf
    for v in range(mesh.cells.shape[1]):
        for w in range(mesh.cells.shape[1]):
            i, j = mesh.cells[:, v], mesh.cells[:, w]
            length = np.linalg.norm(mesh.points[i] - mesh.points[j], axis=1)
            allowed = h[j] + _g_of_cells(mesh, g) * length
            finite = np.isfinite(allowed)
            assert np.isfinite(h[i][finite]).all(), "inf beside a finite size"
            excess = h[i][finite] - allowed[finite]
            worst = max(worst, excess.max(initial=-np.inf))
    return worst


def law(check):
    """Run ``check(scheme, data)`` over drawn problems for each scheme."""

    @given(data=st.data())
    def test(scheme, data):
        check(scheme, *data.draw(problems(scheme)), data)

    return pytest.mark.parametrize("scheme", SCHEMES)(test)


@law
def test_stays_below_h0_and_within_g_along_every_edge(scheme, mesh, h0, g, data):
    h = limit_gradient(mesh, h0, g, method=scheme)
    assert (h <= h0).all()
    assert _largest_excess(mesh, h, g) <= 1e-12


@law
def test_limiting_twice_changes_nothing(scheme, mesh, h0, g, data):
    once = limit_gradient(mesh, h0, g, method=scheme)
    assert_allclose(limit_gradient(mesh, once, g, method=scheme), once, rtol=1e-12)


@law
def test_lower_bounds_give_lower_sizes(scheme, mesh, h0, g, data):
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    lower = h0 * rng.uniform(0.2, 1.0, len(h0))
    h = limit_gradient(mesh, h0, g, method=scheme)
    assert (limit_gradient(mesh, lower, g, method=scheme) <= h * (1 + 1e-12)).all()


@law
def test_larger_g_gives_larger_sizes(scheme, mesh, h0, g, data):
    h = limit_gradient(mesh, h0, g, method=scheme)
    assert (limit_gradient(mesh, h0, 1.5 * g + 0.01, method=scheme) >= h * (1 - 1e-12)).all()


@law
def test_scales_with_the_unit_of_length(scheme, mesh, h0, g, data):
    scale = data.draw(st.sampled_from([1e-6, 0.3, 1e5]))
    h = limit_gradient(mesh, h0, g, method=scheme)
    scaled = SimplexMesh(scale * mesh.points, mesh.cells)
    assert_allclose(limit_gradient(scaled, scale * h0, g, method=scheme), scale * h, rtol=1e-11)


@law
def test_a_constant_passes_through(scheme, mesh, h0, g, data):
    h = limit_gradient(mesh, h0, g, method=scheme)
    shifted = limit_gradient(mesh, h0 + 3.0, g, method=scheme)
    assert_allclose(shifted, h + 3.0, rtol=1e-12)


@law
def test_numbering_and_orientation_do_not_matter(scheme, mesh, h0, g, data):
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    old_of_new = rng.permutation(mesh.n_points)
    new_of_old = np.argsort(old_of_new)
    cell_order = rng.permutation(mesh.n_cells)
    turned = rng.permuted(new_of_old[mesh.cells[cell_order]], axis=1)
    renumbered = SimplexMesh(mesh.points[old_of_new], turned)
    new_order = old_of_new if np.shape(g) == (mesh.n_points,) else cell_order
    g_new = g[new_order] if np.ndim(g) > 0 else g
    h = limit_gradient(mesh, h0, g, method=scheme)
    h_new = limit_gradient(renumbered, h0[old_of_new], g_new, method=scheme)
    assert_allclose(h_new[new_of_old], h, rtol=1e-11)


@law
def test_is_free_only_in_components_without_a_bound(scheme, mesh, h0, g, data):
    h = limit_gradient(mesh, h0, g, method=scheme)
    if scheme == "exact":  # knows no components
        assert np.isfinite(h).all()
        return
    i, j = mesh.edges.T
    graph = coo_matrix((np.ones(len(i)), (i, j)), shape=(mesh.n_points, mesh.n_points))
    component = connected_components(graph, directed=False)[1]
    bounded = np.isin(component, component[np.isfinite(h0)])
    assert (np.isfinite(h) == bounded).all()


@law
def test_leaves_its_inputs_alone(scheme, mesh, h0, g, data):
    h0_before, g_before = h0.copy(), np.copy(g)
    h = limit_gradient(mesh, h0, g, method=scheme)
    assert (h0 == h0_before).all()
    assert (g == g_before).all()
    assert not np.shares_memory(h, h0)


@law
def test_info_agrees_with_the_field(scheme, mesh, h0, g, data):
    h, info = limit_gradient(mesh, h0, g, method=scheme, full_output=True)
    assert info.method == scheme
    assert info.n_changed == (h < h0).sum()
    assert info.n_free == np.isinf(h).sum()
    assert info.converged
    assert info.residual <= (1e-3 if scheme == "positive-coefficient" else 1e-12)
    if np.max(g) > 0.0 and info.largest_edge_slope != np.inf:
        assert info.largest_edge_slope <= 1.0 + 1e-9


@law
def test_is_the_largest_solution_of_its_own_equations(scheme, mesh, h0, g, data):
    """Lowering the result at one node and limiting again must not be undone elsewhere."""
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    h = limit_gradient(mesh, h0, g, method=scheme)
    node = int(rng.choice(np.flatnonzero(np.isfinite(h))))
    lowered = h0.copy()
    lowered[node] = min(0.5 * h[node], h0[node])
    again = limit_gradient(mesh, lowered, g, method=scheme)
    assert again[node] <= lowered[node]
    assert (again <= h * (1 + 1e-12)).all()
