"""Solids with many reflex edges: paths over one edge are found, and the result is one function."""

import numpy as np
import pytest
from exact_oracle import fine_graph_sizes
from jagged_solids import jagged_solid, oracle, random_bounds
from numpy.testing import assert_allclose
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from solids_of_cubes import solid_of_cubes

from adaptsize import SimplexMesh, limit_gradient
from adaptsize.limiting.exact import Exact, paths_in_space

G = 0.3

SEEDS = range(12)


@pytest.mark.parametrize("seed", range(6))
def test_sizes_are_those_of_shortest_paths(seed):
    mesh = jagged_solid(seed)
    h0 = random_bounds(seed, mesh.n_points)
    straight, one_bend, more = oracle(mesh, h0, G, parts=5)
    h = limit_gradient(mesh, h0, G, method=Exact(face_sources=False))
    assert (one_bend < straight * (1.0 - 1e-6)).any()
    assert (h <= one_bend * (1.0 + 1e-9)).all()
    assert (h <= more * (1.0 + 1e-9)).all()
    assert (h >= more * (1.0 - 0.01)).all()  # not all of its paths are shortest
    assert (np.abs(h / more - 1.0) < 1e-9).mean() > 0.9
    in_cells = fine_graph_sizes(mesh, h0, G, 4)
    assert (h <= in_cells * (1.0 + 1e-12)).all()
    assert (h >= in_cells * (1.0 - 0.06)).all()  # its paths turn at few places of each cell


def test_paths_over_two_edges_that_do_not_meet_are_shortest():
    """A corridor turns from y to x, and then from x to z."""
    mesh = solid_of_cubes(
        lambda m: (m[:, 1:] < 1).all(axis=1) | ((m[:, [0, 2]] < 1).all(axis=1))
        | ((m[:, 0] > 3) & (m[:, 1] < 1)),
        (4, 3, 3), 2704,
    )  # fmt: skip
    turn = Rotation.random(random_state=2705).as_matrix()
    start = np.flatnonzero((mesh.points == [0.0, 3.0, 0.0]).all(axis=1))
    h0 = np.full(mesh.n_points, np.inf)
    h0[start] = 0.1
    h, info = limit_gradient.with_info(SimplexMesh(mesh.points @ turn.T, mesh.cells), h0, G)
    assert info.method == "exact"
    ends = np.flatnonzero(mesh.points[:, 2] > 1.5)
    assert len(ends) == 8

    def length(places, end):
        bends = np.array([[1.0, 1.0, places[0]], [3.0, places[1], 1.0]])
        path = np.concatenate([mesh.points[start], bends, [end]])
        return np.linalg.norm(np.diff(path, axis=0), axis=1).sum()

    for node in ends:
        found = minimize(length, [0.5, 0.5], mesh.points[node], bounds=[(0, 1), (0, 1)], tol=1e-15)
        assert_allclose(h[node], 0.1 + G * found.fun, rtol=1e-9)


@pytest.mark.parametrize("method", ["auto", Exact(face_sources=False)])
def test_sizes_do_not_depend_on_place_unit_and_numbers(method):
    for seed in SEEDS:
        mesh = jagged_solid(seed)
        h0, points = random_bounds(seed, mesh.n_points), mesh.points
        h = limit_gradient(mesh, h0, G, method=method)
        turn = Rotation.random(random_state=seed).as_matrix()
        moved = SimplexMesh(points @ turn.T + [3.0, -7.0, 11.0], mesh.cells)
        np.testing.assert_allclose(limit_gradient(moved, h0, G, method=method), h, rtol=1e-9)
        larger = SimplexMesh(1e3 * points, mesh.cells)
        scaled = limit_gradient(larger, 1e3 * h0, G, method=method)
        np.testing.assert_allclose(scaled, 1e3 * h, rtol=1e-9)
        order = np.random.default_rng(seed).permutation(mesh.n_points)
        other = SimplexMesh(points[order], np.argsort(order)[mesh.cells])
        renumbered = limit_gradient(other, h0[order], G, method=method)
        np.testing.assert_allclose(renumbered, h[order], rtol=1e-9)


def test_a_further_bound_raises_no_size():
    for seed in SEEDS:
        mesh, rng = jagged_solid(seed), np.random.default_rng(seed)
        h0 = random_bounds(seed, mesh.n_points)
        h = limit_gradient(mesh, h0, G)
        more = h0.copy()
        nodes = rng.choice(mesh.n_points, 3, replace=False)
        more[nodes] = np.minimum(more[nodes], rng.uniform(0.1, 1.5, 3))
        assert (limit_gradient(mesh, more, G) <= h * (1.0 + 1e-12)).all()


def test_bounds_inside_faces_raise_no_size():
    for seed in SEEDS:
        mesh = jagged_solid(seed)
        h0 = random_bounds(seed, mesh.n_points)
        at_nodes = limit_gradient(mesh, h0, G, method=Exact(face_sources=False))
        assert (limit_gradient(mesh, h0, G) <= at_nodes * (1.0 + 1e-12)).all()


def _comb():
    """Teeth of two cubes, turned so that no wall is along an axis."""
    mesh = solid_of_cubes(lambda x: (x[:, 1] < 2) | (x[:, 0] // 2 % 2 == 0), (10, 6, 3), 2606)
    turn = Rotation.random(random_state=2607).as_matrix()
    return SimplexMesh(mesh.points @ turn.T, mesh.cells)


def _cases():
    comb = _comb()
    one = np.where(np.arange(comb.n_points) == 5, 0.1, np.inf)
    yield comb, one
    yield comb, random_bounds(2608, comb.n_points)
    for seed in SEEDS:
        mesh = jagged_solid(seed)
        yield mesh, random_bounds(seed, mesh.n_points)


def test_paths_propagated_are_never_too_small_and_nearly_shortest(monkeypatch):
    every = []
    for mesh, h0 in _cases():
        h = limit_gradient(mesh, h0, G, method="exact")
        with monkeypatch.context() as patch:
            patch.setattr(paths_in_space, "_DEAR", -1)
            handed, info = limit_gradient.with_info(mesh, h0, G)
        assert info.method == "exact (propagated)"
        assert (handed >= h * (1.0 - 1e-12)).all()
        every.append(handed / h - 1.0)
    above = np.concatenate(every)
    assert np.concatenate(every[:2]).max() < 1e-3, "the comb, whose edges are straight"
    assert above.mean() < 2e-3
    assert above.max() < 0.15


def test_paths_propagated_around_one_straight_edge_are_those_by_search(monkeypatch):
    mesh = solid_of_cubes(lambda m: (m[:, 0] < 1) | (m[:, 1] < 1), (3, 3, 1), 2741)
    start = np.flatnonzero((mesh.points == [0.0, 3.0, 0.0]).all(axis=1))
    h0 = np.full(mesh.n_points, np.inf)
    h0[start] = 0.1
    every = []
    for dear, method in ((1e9, "exact"), (-1, "exact (propagated)")):
        monkeypatch.setattr(paths_in_space, "_DEAR", dear)
        h, info = limit_gradient.with_info(mesh, h0, G)
        assert info.method == method
        assert (info.sources.roots() == start).all()
        every.append(h)
    assert np.count_nonzero(every[0] > 0.1 + G * 3.2) > 2, "nodes behind the edge"
    assert_allclose(every[1], every[0], rtol=1e-12)


@pytest.mark.parametrize("node", [46, 69, 138])
def test_paths_propagated_over_several_edges_bend_between_nodes(node, monkeypatch):
    mesh = _comb()
    h0 = np.where(np.arange(mesh.n_points) == node, 0.1, np.inf)
    monkeypatch.setattr(paths_in_space, "_DEAR", 1e9)
    h = limit_gradient(mesh, h0, G)
    monkeypatch.setattr(paths_in_space, "_DEAR", -1)
    above = limit_gradient(mesh, h0, G) / h - 1.0
    assert above.min() > -1e-12
    assert above.max() < 8e-3
    assert above.mean() < 1e-3


def test_the_price_decides_what_the_default_does(monkeypatch):
    comb = _comb()
    h0 = np.where(np.arange(comb.n_points) == 5, 0.1, np.inf)
    monkeypatch.setattr(paths_in_space, "_DEAR", 1e9)
    assert limit_gradient.with_info(comb, h0, G)[1].method == "exact"
    monkeypatch.setattr(paths_in_space, "_DEAR", 1e-9)
    assert limit_gradient.with_info(comb, h0, G)[1].method == "exact (propagated)"
