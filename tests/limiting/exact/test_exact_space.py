"""Exact limiting of nodal bounds among tetrahedra, in domains that are not convex.

Where the place that a size comes from is seen the result is exact, elsewhere at least the length of
a path that exists.  Walls and corridors have exact lengths, jagged parts of a cube bounds.
"""

import domains
import numpy as np
import pytest
from exact_oracle import edge_sizes, fine_graph_sizes, straight_sizes
from geodesics import _bent_in_rectangle, prism_sizes, window_sizes
from meshes import jittered_cube
from numpy.testing import assert_allclose
from solids_of_cubes import solid_of_cubes

from adaptsize import SimplexMesh, limit_gradient
from adaptsize.errors import ConvergenceWarning
from adaptsize.limiting import Exact
from adaptsize.limiting.exact import paths_in_space as space

G = 0.3

#: Below the exact sizes, which are up to 60: rounding, and that of the references.
TOO_SMALL = 1e-9
#: Over one reflex edge, or the two of a wall, which are straight: the exact sizes themselves.
WALL_TOLERANCE = 1e-9
#: Paths over two edges of a window that meet in a corner are not exact: share of the nodes, and by
#: how much with about 5 000 nodes.
WINDOW_SHARE, WINDOW_ERROR = 0.02, 0.25
#: Paths over edges and faces cut in eight are longer than straight ones by 1.4 % at most.
GRAPH_EXCESS = 0.02


def limit(mesh, h0):
    return limit_gradient(mesh, h0, G, method=Exact(face_sources=False))


def assert_between_bounds(mesh, h0):
    """Limit; compare with straight lines, paths along edges, and the info."""
    h, info = limit_gradient.with_info(mesh, h0, G, method=Exact(face_sources=False))
    lower, upper = straight_sizes(mesh.points, h0, G), edge_sizes(mesh, h0, G)
    assert np.isfinite(upper).all()
    assert (h >= lower * (1.0 - 1e-12)).all()
    assert (h <= upper * (1.0 + 1e-12)).all()
    gap = h - lower
    assert 0 < info.n_proved <= np.count_nonzero(gap <= 1e-12 * h)
    assert info.largest_gap == pytest.approx(gap.max(), rel=1e-9, abs=1e-12)
    if info.n_proved == mesh.n_points:
        assert info.largest_gap == 0.0
    return h, info


def some_bounds(mesh, rng, share, *, low=1.0, high=20.0):
    h0 = np.where(rng.random(mesh.n_points) < share, rng.uniform(low, high, mesh.n_points), np.inf)
    h0[rng.integers(mesh.n_points)] = low
    return h0


def exact_of(reference, domain, mesh, h0):
    sources = np.flatnonzero(np.isfinite(h0))
    return reference(domain, mesh.points, G, mesh.points[sources], h0[sources])


def test_sizes_behind_a_wall_are_exact():
    case = domains.CASES["wall"]
    mesh, domain = case.make(4000, seed=2401)
    h0, _ = domains.point_sources(mesh, case.places, case.sizes)
    h, _ = assert_between_bounds(mesh, h0)
    exact = exact_of(prism_sizes, domain, mesh, h0)
    assert_allclose(h, exact, rtol=0.0, atol=WALL_TOLERANCE)
    assert (exact > straight_sizes(mesh.points, h0, G) + 1.0).mean() > 0.1


@pytest.mark.parametrize("share", [0.01, 1.0])
def test_bounds_at_many_nodes_beside_a_wall(share):
    mesh, domain = domains.wall_box(3000, seed=2403)
    h0 = some_bounds(mesh, np.random.default_rng(2404), share)
    h, _ = assert_between_bounds(mesh, h0)
    some = np.random.default_rng(2405).choice(mesh.n_points, 100, replace=False)
    sources = np.flatnonzero(h0 <= h.max())
    if share == 1.0:  # others are too large to matter
        sources = sources[h[sources] == h0[sources]]
    exact = prism_sizes(domain, mesh.points[some], G, mesh.points[sources], h0[sources])
    error = h[some] - exact
    assert error.min() > -TOO_SMALL
    assert np.mean(error > WALL_TOLERANCE) <= 0.01


def test_sizes_behind_a_window_are_nearly_exact():
    case = domains.CASES["window"]
    mesh, domain = case.make(4400, seed=2406)
    h0, _ = domains.point_sources(mesh, case.places, case.sizes)
    h, _ = assert_between_bounds(mesh, h0)
    error = h - exact_of(window_sizes, domain, mesh, h0)
    assert error.min() > -TOO_SMALL
    assert np.mean(error > 1e-9) <= WINDOW_SHARE
    assert error.max() <= WINDOW_ERROR


def around_two_edges(source, points):
    """Least lengths |a - p| + |p - q| + |q - b|, p and q in the cuts y = 4 and z = 4, 4 < x < 8.

    A smooth convex function, because p and q are 4 apart or more: as `geodesics.window_sizes` does,
    minimise it over p and q in turn.
    """
    q = np.tile([6.0, 10.0, 4.0], (len(points), 1))
    for _ in range(200):
        p = bent_in_cut([1, 0, 2], source, q, (4.0, (4.0, 0.0), (8.0, 4.0)))
        q = bent_in_cut([2, 0, 1], p, points, (4.0, (4.0, 8.0), (8.0, 12.0)))
    return sum(np.linalg.norm(v, axis=1) for v in (p - source, q - p, points - q))


def bent_in_cut(axes, a, b, rectangle):
    """Return where in a rectangle across the first of ``axes`` paths from a to b are shortest."""
    place = _bent_in_rectangle(a[..., axes], b[:, axes], rectangle)[0]
    return place[:, np.argsort(axes)]


def corridor(width, height, seed):
    """A corridor along x to 2 widths, along y to 3, and up along z."""

    def keep(x):
        (x, y, z), w = x.T, width
        return ((y < w) & (z < w)) | ((x > w) & (z < w)) | ((x > w) & (y > 2 * w))

    return solid_of_cubes(keep, (2 * width, 3 * width, height), seed)


def test_sizes_in_a_corridor_around_two_bends():
    # The reflex edges are x = y = 4, and y = 8, z = 4.
    mesh = corridor(4, 10, 2410)
    source = int(np.argmin(np.linalg.norm(mesh.points - [0.0, 1.0, 1.0], axis=1)))
    h0 = np.full(mesh.n_points, np.inf)
    h0[source] = 1.0
    h, _ = assert_between_bounds(mesh, h0)
    assert (h <= fine_graph_sizes(mesh, h0, G, 2) * (1.0 + 1e-12)).mean() > 0.99
    at_end = mesh.points[:, 2] > 4.5
    exact = 1.0 + G * around_two_edges(mesh.points[source], mesh.points[at_end])
    error = h[at_end] - exact
    assert error.min() > -TOO_SMALL
    assert error.max() <= WALL_TOLERANCE


def cracked_box(seed):
    """The box (0, 6)^3 with a crack of no width: z = 3, x > 3; and the nodes of its two faces."""
    mesh = solid_of_cubes(lambda x: x[:, 0] > 0, (6, 6, 6), seed)
    points = mesh.points.copy()
    corners = np.argwhere(np.ones((7, 7, 7), bool))
    on_plane = corners[:, 2] == 3
    points[on_plane] = corners[on_plane]
    on_crack = np.flatnonzero(on_plane & (corners[:, 0] > 3))
    twin = np.arange(len(points))
    twin[on_crack] = len(points) + np.arange(len(on_crack))
    above = corners[mesh.cells].mean(axis=1)[:, 2] > 3.0
    cells = np.where(above[:, None], twin[mesh.cells], mesh.cells)
    points = np.concatenate([points, points[on_crack]]) - 3.0
    return SimplexMesh(points, cells), twin[on_crack], on_crack


def test_the_two_faces_of_a_crack_are_seen_from_their_own_side_only():
    mesh, upper, lower = cracked_box(2441)
    source = int(np.argmin(np.linalg.norm(mesh.points - [1.0, 1.0, 2.0], axis=1)))
    h0 = np.full(mesh.n_points, np.inf)
    h0[source] = 1.0
    h = limit(mesh, h0)
    x, y, z = mesh.points[source]
    near, far = mesh.points[upper], mesh.points[lower]
    assert_allclose(h[upper], 1.0 + G * np.linalg.norm(near - [x, y, z], axis=1), rtol=1e-12)
    # Around the edge x = z = 0, turned into one plane.
    around = np.hypot(far[:, 1] - y, np.hypot(x, z) + far[:, 0])
    assert_allclose(h[lower], 1.0 + G * around, rtol=1e-9)


def test_a_search_for_paths_that_stops_early_warns_and_says_so_in_the_info(monkeypatch):
    mesh = corridor(2, 4, 2412)
    h0 = np.where(np.arange(mesh.n_points) == 0, 1.0, np.inf)
    h, info = limit_gradient.with_info(mesh, h0, G)
    assert info.converged
    monkeypatch.setattr(space, "_ROUNDS", 1)
    with pytest.warns(ConvergenceWarning, match="the exact method stopped its search"):
        cut_short, info = limit_gradient.with_info(mesh, h0, G)
    assert not info.converged
    assert (cut_short >= h * (1.0 - 1e-12)).all()


def parts_of_cube(seed, n_side=14):
    """Cut a jittered cube in 8 by where the middles of cells are, along planes askew to it."""
    mesh = jittered_cube(n_side, seed)
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    middles = mesh.points[mesh.cells].mean(axis=1)
    part = (middles @ axes > rng.uniform(-8.0, 8.0, 3)) @ [1, 2, 4]
    for k in range(8):
        used, cells = np.unique(mesh.cells[part == k], return_inverse=True)
        yield SimplexMesh(mesh.points[used], cells.reshape(-1, 4))


@pytest.mark.parametrize(("seed", "share"), [(2412, 0.0), (2413, 0.02), (2413, 1.0)])
def test_sizes_in_jagged_parts_are_between_their_bounds(seed, share):
    n_bent = 0
    for mesh in parts_of_cube(seed):
        h0 = some_bounds(mesh, np.random.default_rng(seed), share)
        _, info = assert_between_bounds(mesh, h0)
        n_bent += mesh.n_points - info.n_proved
    assert n_bent > 100


@pytest.mark.parametrize("share", [0.0, 0.05])
def test_sizes_in_a_jagged_part_are_near_those_of_paths_over_a_fine_graph(share):
    mesh = min(parts_of_cube(2414, 9), key=lambda part: part.n_points)
    h0 = some_bounds(mesh, np.random.default_rng(2414), share)
    h, _ = assert_between_bounds(mesh, h0)
    fine = fine_graph_sizes(mesh, h0, G, 8)
    assert (h >= fine / (1.0 + GRAPH_EXCESS)).all()
    assert np.mean(h <= fine * (1.0 + 1e-12)) > 0.85
