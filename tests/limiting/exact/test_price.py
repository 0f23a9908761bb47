"""Plane domains with very many corners: triangular expansion, or fast marching."""

import gc
import pickle
import weakref

import domains
import numba
import numpy as np
import pytest
from jagged_solids import jagged_solid
from meshes import jittered_square
from numpy.testing import assert_allclose, assert_array_equal
from partitions import SIZE, on_ranks, partition

import adaptsize as ads
from adaptsize import limit_gradient
from adaptsize.geometry.boundary import flat_boundary
from adaptsize.geometry.convexity import count_corners
from adaptsize.limiting import Exact
from adaptsize.limiting.exact import expansion, kept, solve
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
    monkeypatch.setattr(solve, "plane_in", None)  # no lines of sight
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


def points_in(mesh, count, rng):
    """Return points inside cells, on edges and at nodes."""
    weights = rng.dirichlet((1.0, 1.0, 1.0), count)
    kind = rng.integers(0, 3, count)
    weights[kind == 1], weights[kind == 2] = (0.5, 0.5, 0.0), (1.0, 0.0, 0.0)
    cells = mesh.cells[rng.integers(0, mesh.n_cells, count)]
    return np.einsum("iv,ivd->id", weights, mesh.points[cells])


@pytest.mark.parametrize("seed", range(8))
def test_expansion_starts_at_points_between_the_nodes(seed, monkeypatch):
    rng = np.random.default_rng(2310 + seed)
    mesh = punched(24, rng.uniform(0.1, 0.3), seed)
    count = int(rng.integers(1, 30))
    given = points_in(mesh, count, rng), rng.uniform(0.01, 0.3, count)
    h0 = np.full(mesh.n_points, np.inf)
    if seed % 2:
        h0[rng.choice(mesh.n_points, 4, replace=False)] = rng.uniform(0.01, 0.3, 4)
    expected, same = by_sight(monkeypatch, mesh, h0, G, point_sources=given)
    monkeypatch.setattr(solve, "favours_expansion", lambda *_: True)
    monkeypatch.setattr(solve, "has_many_corners", lambda *_: False)
    monkeypatch.setattr(solve, "solve_by_sight", None)
    h, info = limit_gradient.with_info(mesh, h0, G, point_sources=given)
    assert_allclose(h, expected, rtol=1e-12)
    assert_array_equal(info.sources.roots(), same.sources.roots())
    places = mesh.points[mesh.cells].mean(axis=1)
    sizes = (ads.SizeFunction(mesh, h, sources=own.sources)(places) for own in (info, same))
    assert_allclose(*sizes, rtol=1e-12)


def test_bounds_at_points_take_the_kernel_that_is_compiled_for_those_at_nodes(monkeypatch):
    mesh, h0 = MANY
    expand, calls = expansion.kernels.expand, []
    monkeypatch.setattr(
        expansion.kernels, "expand", lambda *args: calls.append(numba.typeof(args)) or expand(*args)
    )
    place = mesh.points[mesh.cells[7]].mean(axis=0, keepdims=True)
    for given in (None, (place, [0.01])):
        limit_gradient(mesh, h0, G, point_sources=given)
    assert len(calls) > 1
    assert len(set(calls)) == 1


def test_bounds_at_points_among_many_corners_need_no_lines_of_sight(monkeypatch):
    mesh, h0 = MANY
    place = mesh.points[mesh.cells[7]].mean(axis=0, keepdims=True)
    expected, _ = by_sight(monkeypatch, mesh, h0, G, point_sources=(place, [0.01]))
    with monkeypatch.context() as patched:
        patched.setattr(solve, "plane_in", None)
        h, info = limit_gradient.with_info(mesh, h0, G, point_sources=(place, [0.01]))
    assert info.method == "exact"
    assert_allclose(h, expected, rtol=1e-12)
    # Between the nodes, sizes are interpolated, and lowered by the sources that are seen.
    assert_allclose(ads.SizeFunction(mesh, h, sources=info.sources)(place), 0.01, rtol=1e-9)
    assert ads.SizeFunction(mesh, h)(place) > 0.02


def test_marching_takes_bounds_at_points_where_edges_are_sources_among_many_corners():
    mesh, _ = MANY
    h0 = np.random.default_rng(2307).uniform(0.1, 1.0, mesh.n_points)
    cell = mesh.cells[7]
    place = mesh.points[cell].mean(axis=0)
    h, info = limit_gradient.with_info(mesh, h0, G, point_sources=(place[None], [0.01]))
    assert info.method == "fast-marching"
    assert info.n_changed == np.count_nonzero(h < h0)
    lowered = h0.copy()
    lowered[cell] = 0.01 + G * np.linalg.norm(mesh.points[cell] - place, axis=1)
    assert (lowered < h0)[cell].any()
    expected = limit_gradient(mesh, np.minimum(h0, lowered), G, method="fast-marching")
    assert_array_equal(h, expected)


def test_the_search_ends_as_soon_as_edges_are_sources(monkeypatch):
    mesh = punched(40, 0.2, 3)
    away = np.linalg.norm(mesh.points - mesh.points.min(axis=0), axis=1)
    noise = np.random.default_rng(2308).uniform(1.0, 3.0, mesh.n_points)
    h0 = np.where(away < 20.0, noise, 3.0 + 0.2 * away)
    monkeypatch.setattr(expansion, "_AT_ONCE", mesh.n_points // 8)
    calls = []
    given = expansion.kernels.expand

    def counted(*args):
        calls.append(given(*args))
        return calls[-1]

    monkeypatch.setattr(expansion.kernels, "expand", counted)
    assert limit_gradient.with_info(mesh, h0, G)[1].method == "fast-marching"
    assert len(calls) < 4
    assert calls[-1]


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


def test_ranks_take_bounds_at_points_to_the_nodes_where_they_march():
    mesh, h0 = MANY
    place = mesh.points[mesh.cells[7]].mean(axis=0, keepdims=True)
    given = place, [0.01]
    lowered = h0.copy()
    cell = mesh.cells[7]
    lowered[cell] = 0.01 + G * np.linalg.norm(mesh.points[cell] - place, axis=1)
    expected = limit_gradient(mesh, np.minimum(h0, lowered), G, method="fast-marching")
    ranks = partition(mesh, "strips", SIZE, np.random.default_rng(2304))

    def limit(part):
        return limit_gradient(part, h0[part.global_ids], G, point_sources=given)

    results, parts = on_ranks(mesh, ranks, SIZE, limit)
    for h, part in zip(results, parts, strict=True):
        assert_allclose(h, expected[part.global_ids], rtol=1e-12)


@pytest.mark.parametrize("g", [0.0, 1e-20, 1e-18])
@pytest.mark.parametrize("least", ["node", "point"])
def test_tiny_limits_give_the_least_bound_everywhere(g, least):
    mesh, _ = domains.spiral(800)
    rng = np.random.default_rng(2309)
    h0 = np.where(rng.random(mesh.n_points) < 0.1, rng.uniform(0.2, 1.0, mesh.n_points), np.inf)
    places, sizes = points_in(mesh, 3, rng), np.array([0.5, 0.1 if least == "point" else 0.4, 0.6])
    if least == "node":
        h0[77] = 0.1
    h, info = limit_gradient.with_info(mesh, h0, g, point_sources=(places, sizes))
    assert_allclose(h, 0.1, rtol=1e-12)
    assert (info.sources.roots() == (77 if least == "node" else mesh.n_points + 1)).all()
    size = ads.SizeFunction(mesh, h, sources=info.sources)
    assert_allclose(size(mesh.points[mesh.cells].mean(axis=1)), 0.1, rtol=1e-12)
    ranks = partition(mesh, "strips", SIZE, rng)

    def limit(part):
        return limit_gradient(part, h0[part.global_ids], g, point_sources=(places, sizes))

    results, parts = on_ranks(mesh, ranks, SIZE, limit)
    for own, part in zip(results, parts, strict=True):
        assert_allclose(own, h[part.global_ids], rtol=1e-14)


@pytest.mark.parametrize("make", [lambda: domains.maze(400)[0], lambda: jagged_solid(3)])
def test_what_is_found_out_about_a_mesh_is_kept_as_long_as_the_mesh(make, monkeypatch):
    mesh = make()
    h0 = np.where(np.arange(mesh.n_points) == 5, 1.0, np.inf)
    first = limit_gradient(mesh, h0, G)
    with monkeypatch.context() as patched:
        for name in ("flat_boundary", "plane_of", "solid_of"):
            patched.setattr(kept, name, None)
        assert_array_equal(limit_gradient(mesh, h0, G), first)
        lower = np.minimum(h0, 2.0)
        second = limit_gradient(mesh, lower, G)
    assert_array_equal(second, limit_gradient(make(), lower, G))
    known = weakref.ref(mesh)
    del mesh
    gc.collect()
    assert known() is None
