"""Plane domains with very many corners: triangular expansion, or fast marching."""

import pickle

import domains
import numpy as np
import pytest
from meshes import jittered_square
from numpy.testing import assert_allclose, assert_array_equal
from partitions import SIZE, on_ranks, partition

import adaptsize as ads
from adaptsize import limit_gradient
from adaptsize.geometry.boundary import flat_boundary
from adaptsize.geometry.convexity import count_corners
from adaptsize.limiting import Exact
from adaptsize.limiting.exact import expansion, solve
from adaptsize.limiting.exact import obstacles_in_plane as plane

G = 0.3


def porous(n_side, n_holes):
    """Return a square without some of its triangles, with a bound at one node."""
    mesh, _ = domains.with_removed_cells(jittered_square(n_side, 2301), 2302, n_holes)
    h0 = np.full(mesh.n_points, np.inf)
    h0[mesh.cells[0, 0]] = 1.0
    return mesh, h0


MANY = porous(30, 150)
FEW = porous(30, 12)


def corners_of(mesh):
    return count_corners(mesh.points, flat_boundary(mesh))


def by_sight(monkeypatch, *args, **options):
    with monkeypatch.context() as patched:
        patched.setattr(solve, "favours_expansion", lambda *_: False)
        return limit_gradient.with_info(*args, **options)


def punched(n_side, share, seed):
    """Return a square without a share of its triangles: pinched nodes, islands, deep bays."""
    mesh = jittered_square(n_side, seed)
    rng = np.random.default_rng(seed)
    kept = rng.random(mesh.n_cells) >= share
    return ads.SimplexMesh(mesh.points, mesh.cells[kept])


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("bounds", ["few", "many"])
def test_expansion_gives_the_sizes_of_lines_of_sight(bounds, seed, monkeypatch):
    rng = np.random.default_rng(seed)
    mesh = punched(24, rng.uniform(0.1, 0.3), seed)
    h0 = np.full(mesh.n_points, np.inf)
    if bounds == "few":
        h0[rng.choice(mesh.n_points, 4, replace=False)] = rng.uniform(0.01, 0.3, 4)
    else:
        h0 = rng.uniform(0.1, 0.3, mesh.n_points)
    method = Exact(face_sources=False)
    expected, _ = by_sight(monkeypatch, mesh, h0, G, method=method)
    monkeypatch.setattr(solve, "favours_expansion", lambda *_: True)
    h, info = limit_gradient.with_info(mesh, h0, G, method=method)
    assert_allclose(h, expected, rtol=1e-12)
    reached = np.isfinite(h)
    root = info.sources.nodes[reached, 0]
    straight = h[root] + G * np.linalg.norm(mesh.points[reached] - mesh.points[root], axis=1)
    assert_allclose(h[reached], straight, rtol=1e-12)


def test_many_corners_are_solved_exactly_from_single_bounds(monkeypatch):
    mesh, h0 = MANY
    n = corners_of(mesh)
    assert n > 64
    assert n * n > 40 * mesh.n_points
    monkeypatch.setattr(solve, "plane_of", None)  # no lines of sight
    h, info = limit_gradient.with_info(mesh, h0, G)
    monkeypatch.undo()
    assert info.method == "exact"
    assert info.n_proved == mesh.n_points
    expected, same = by_sight(monkeypatch, mesh, h0, G)
    assert_allclose(h, expected, rtol=1e-12)
    assert_array_equal(info.sources.roots(), same.sources.roots())


@pytest.mark.parametrize(("domain", "most"), [(MANY, 9), (porous(70, 4), 5)])
def test_windows_end_where_sizes_are_better_and_are_merged_behind_nodes(domain, most, monkeypatch):
    mesh, h0 = domain
    monkeypatch.setattr(solve, "favours_expansion", lambda *_: True)
    monkeypatch.setattr(expansion, "_AT_ONCE", mesh.n_points)
    n_reports = 0

    def count(text, share):
        nonlocal n_reports
        n_reports += share is None

    limit_gradient(mesh, h0, G, progress=count)
    assert 0 < n_reports < most  # windows per node


def test_fast_marching_is_taken_where_edges_are_sources_among_many_corners():
    mesh, _ = MANY
    h0 = np.random.default_rng(2307).uniform(0.1, 1.0, mesh.n_points)
    h, info = limit_gradient.with_info(mesh, h0, G)
    assert info.method == "fast-marching"
    assert info.n_proved is None
    assert_array_equal(h, limit_gradient(mesh, h0, G, method="fast-marching"))
    assert limit_gradient.with_info(mesh, h0, G, method="exact")[1].method == "exact"


def test_sizes_between_the_nodes_are_exact_where_expansion_found_those_at_the_nodes(monkeypatch):
    mesh, _ = domains.holes(3000, 10, 12)
    n = corners_of(mesh)
    assert plane.favours_expansion(n, mesh.n_points)
    assert not plane.has_many_corners(n, mesh.n_points)
    h0, _ = domains.point_sources(mesh, [(-45.0, 45.0), (40.0, -30.0)], (1.0, 5.0))
    places = mesh.points[mesh.cells].mean(axis=1)
    size = [
        ads.SizeFunction(mesh, h, sources=pickle.loads(pickle.dumps(info.sources)))(places)
        for h, info in (limit_gradient.with_info(mesh, h0, G), by_sight(monkeypatch, mesh, h0, G))
    ]
    assert_allclose(*size, rtol=1e-12)


def test_the_exact_method_is_taken_where_they_are_few():
    mesh, h0 = FEW
    assert 0 < corners_of(mesh) <= 64
    assert limit_gradient.with_info(mesh, h0, G)[1].method == "exact"


@pytest.mark.parametrize(
    ("n_corners", "n_nodes", "too_many"),
    [(64, 1, False), (257, 1651, True), (257, 1652, False), (2000, 100_000, False)],
)
def test_the_limit_is_the_documented_one(n_corners, n_nodes, too_many):
    assert plane.has_many_corners(n_corners, n_nodes) == too_many


def test_bounds_at_points_are_solved_exactly_at_any_price():
    mesh, h0 = MANY
    place = mesh.points[mesh.cells[7]].mean(axis=0, keepdims=True)
    _, info = limit_gradient.with_info(mesh, h0, G, point_sources=(place, [0.5]))
    assert info.method == "exact"


def test_all_ranks_take_one_method():
    mesh, h0 = MANY
    expected = limit_gradient(mesh, h0, G, method="fast-marching")

    def limit(part):
        found, own = limit_gradient.with_info(part, h0[part.global_ids], G)
        return found, own.method

    ranks = partition(mesh, "strips", SIZE, np.random.default_rng(2304))
    results, parts = on_ranks(mesh, ranks, SIZE, limit)
    for (h, own), part in zip(results, parts, strict=True):
        assert own == "fast-marching"
        assert_allclose(h, expected[part.global_ids], rtol=1e-12)
