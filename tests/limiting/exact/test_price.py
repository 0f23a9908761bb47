"""Plane domains with very many corners: triangular expansion, or fast marching."""

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
from adaptsize.limiting.exact import expansion, plane

G = 0.3


def porous(n_side, n_holes):
    """Return a square without some of its triangles, with a bound at one node."""
    mesh, _ = domains.with_removed_cells(jittered_square(n_side, 2301), 2302, n_holes)
    h0 = np.full(mesh.n_points, np.inf)
    h0[mesh.cells[0, 0]] = 1.0
    return mesh, h0


MANY = porous(30, 150)
FEW = porous(30, 60)


def corners_of(mesh):
    return count_corners(mesh.points, flat_boundary(mesh))


def by_sight(monkeypatch, *args, **options):
    with monkeypatch.context() as patched:
        patched.setattr(plane, "_FEW", 10**9)
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
    monkeypatch.setattr(plane, "_FEW", -1)
    monkeypatch.setattr(plane, "_MOST", 0)
    h, info = limit_gradient.with_info(mesh, h0, G, method=method)
    assert_allclose(h, expected, rtol=1e-12)
    reached = np.isfinite(h)
    root = info.sources.nodes[reached, 0]
    straight = h[root] + G * np.linalg.norm(mesh.points[reached] - mesh.points[root], axis=1)
    assert_allclose(h[reached], straight, rtol=1e-12)


def test_many_corners_are_solved_exactly_from_single_bounds(monkeypatch):
    mesh, h0 = MANY
    n = corners_of(mesh)
    assert n > 256
    assert n * n > 40 * mesh.n_points
    monkeypatch.setattr(plane, "plane_of", None)  # no lines of sight
    h, info = limit_gradient.with_info(mesh, h0, G)
    monkeypatch.undo()
    assert info.method == "exact"
    assert info.n_proved == mesh.n_points
    expected, same = by_sight(monkeypatch, mesh, h0, G)
    assert_allclose(h, expected, rtol=1e-12)
    assert_array_equal(info.sources.roots(), same.sources.roots())


def test_windows_end_where_sizes_are_better(monkeypatch):
    mesh, h0 = MANY
    monkeypatch.setattr(expansion, "_AT_ONCE", mesh.n_points)
    n_reports = 0

    def count(text, share):
        nonlocal n_reports
        n_reports += share is None

    limit_gradient(mesh, h0, G, progress=count)
    assert 0 < n_reports < 30  # windows per node


def test_fast_marching_is_taken_where_edges_are_sources_among_many_corners():
    mesh, _ = MANY
    h0 = np.random.default_rng(2307).uniform(0.1, 1.0, mesh.n_points)
    h, info = limit_gradient.with_info(mesh, h0, G)
    assert info.method == "fast-marching"
    assert info.n_proved is None
    assert_array_equal(h, limit_gradient(mesh, h0, G, method="fast-marching"))
    assert limit_gradient.with_info(mesh, h0, G, method="exact")[1].method == "exact"


def test_sizes_between_the_nodes_are_interpolated_among_many_corners():
    mesh, h0 = MANY
    h, info = limit_gradient.with_info(mesh, h0, G)
    middle = mesh.points[mesh.cells].mean(axis=1)
    size = ads.SizeFunction(mesh, h, sources=info.sources)
    assert_allclose(size(middle), h[mesh.cells].mean(axis=1), rtol=1e-12)


def test_the_exact_method_is_taken_where_they_are_few():
    mesh, h0 = FEW
    assert 0 < corners_of(mesh) <= 256
    assert limit_gradient.with_info(mesh, h0, G)[1].method == "exact"


@pytest.mark.parametrize(
    ("n_corners", "n_nodes", "too_many"),
    [(256, 1, False), (257, 1651, True), (257, 1652, False), (2000, 100_000, False)],
)
def test_the_limit_is_the_documented_one(n_corners, n_nodes, too_many):
    assert plane.has_many_corners(n_corners, n_nodes) == too_many


def test_nodes_of_walls_that_are_straight_to_noise_do_not_count():
    mesh, _ = domains.maze(6000, seed=2305)
    assert corners_of(mesh) == 23
    rng = np.random.default_rng(2306)
    noisy = ads.SimplexMesh(mesh.points + rng.uniform(-1e-6, 1e-6, mesh.points.shape), mesh.cells)
    assert corners_of(noisy) == 23


def test_bounds_at_points_are_solved_exactly_at_any_price():
    mesh, h0 = MANY
    place = mesh.points[mesh.cells[7]].mean(axis=0, keepdims=True)
    _, info = limit_gradient.with_info(mesh, h0, G, point_sources=(place, [0.5]))
    assert info.method == "exact"


@pytest.mark.parametrize("domain", [MANY, FEW])
def test_a_warm_start_takes_the_same_method(domain):
    mesh, h0 = domain
    _, info = limit_gradient.with_info(mesh, h0, G)
    changed = h0.copy()
    changed[mesh.cells[-1, 0]] = 2.0
    h, again = limit_gradient.with_info(mesh, changed, G, initial=info)
    assert again.method == info.method
    assert_array_equal(h, limit_gradient(mesh, changed, G))


def test_grids_with_many_inactive_nodes_are_solved_exactly(monkeypatch):
    active = np.random.default_rng(2303).random((60, 60)) > 0.1
    active[0, 0] = True
    grid = ads.CartesianGrid([0.0, 0.0], spacing=1.0, shape=(60, 60), active=active)
    h0 = np.full(grid.shape, np.inf)
    h0[0, 0] = 1.0
    h, info = limit_gradient.with_info(grid, h0, G)
    assert info.method == "exact"
    assert_allclose(h, by_sight(monkeypatch, grid, h0, G)[0], rtol=1e-12)


@pytest.mark.parametrize(("domain", "method"), [(MANY, "fast-marching"), (FEW, "exact")])
def test_all_ranks_take_one_method(domain, method):
    mesh, h0 = domain
    expected = limit_gradient(mesh, h0, G, method=method)

    def limit(part):
        found, own = limit_gradient.with_info(part, h0[part.global_ids], G)
        return found, own.method

    ranks = partition(mesh, "strips", SIZE, np.random.default_rng(2304))
    results, parts = on_ranks(mesh, ranks, SIZE, limit)
    for (h, own), part in zip(results, parts, strict=True):
        assert own == method
        assert_allclose(h, expected[part.global_ids], rtol=1e-12)
