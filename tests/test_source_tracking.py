"""Source tracking against closed forms, and on meshes of any kind."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial import Delaunay

from adaptsize import SimplexMesh, SizeFunction, limit_gradient
from adaptsize.limiting.source_tracking import solve_source_tracking
from domains import CASES, point_sources, star_holes
from meshes import jittered_square, random_square, structured_square

G = 0.3


def solve(mesh, h0, g=G, **options):
    h0 = np.asarray(h0, float)
    solution = solve_source_tracking(
        mesh, h0, g, residual=True, report=lambda text, share: None, **options
    )
    assert (solution.h <= h0).all()
    assert solution.residual < 1e-12
    return solution


def at_nodes(mesh, nodes, sizes):
    h0 = np.full(mesh.n_points, np.inf)
    h0[nodes] = sizes
    return h0


def nearest(mesh, place):
    return int(np.argmin(np.linalg.norm(mesh.points - place, axis=1)))


def jittered_box(n, seed, dim=3, keep=None):
    """Tetrahedra around the diagonals of n^3 jittered cubes of edge 1; ``keep`` of their cells."""
    from itertools import permutations

    rng = np.random.default_rng(seed)
    node = np.arange((n + 1) ** dim).reshape((n + 1,) * dim)
    points = np.stack(np.meshgrid(*[np.arange(n + 1.0)] * dim, indexing="ij"), -1).reshape(-1, dim)
    corner_of_box = points.reshape(*node.shape, dim)[(slice(n),) * dim].reshape(-1, dim)
    kept = np.ones(len(corner_of_box), bool) if keep is None else keep(corner_of_box + 0.5)
    cells = []
    for way in permutations(range(dim)):
        corner = np.zeros(dim, int)
        path = [node[(slice(n),) * dim].ravel()[kept]]
        for axis in way:
            corner[axis] = 1
            path.append(node[tuple(slice(c, n + c) for c in corner)].ravel()[kept])
        cells.append(np.column_stack(path))
    cells = np.concatenate(cells)
    facets = SimplexMesh(points, cells)
    outer = np.zeros(len(points), bool)
    outer[facets.facets[facets.facet_cell_counts == 1]] = True
    points = points + np.where(outer[:, None], 0.0, rng.uniform(-0.15, 0.15, points.shape))
    return SimplexMesh(points, cells)


@pytest.mark.parametrize("sight", ["auto", False])
def test_point_sources_in_a_convex_domain_are_exact(sight):
    rng = np.random.default_rng(911)
    for mesh in (random_square(2000, 912, half_width=50.0), jittered_square(30, 913)):
        nodes = rng.choice(mesh.n_points, 12, replace=False)
        h0 = at_nodes(mesh, nodes, rng.uniform(1.0, 5.0, 12))
        solution = solve(mesh, h0, domain_is_convex=sight)
        assert solution.is_convex == (sight == "auto")
        assert_allclose(solution.h, limit_gradient(mesh, h0, G, method="exact"), rtol=1e-13)


def test_point_sources_among_tetrahedra_are_exact():
    mesh = jittered_box(9, 914)
    h0 = at_nodes(mesh, [17, 400, 900], [0.2, 0.5, 0.1])
    exact = limit_gradient(mesh, h0, G, method="exact")
    for sight in ("auto", False):
        assert_allclose(solve(mesh, h0, domain_is_convex=sight).h, exact, rtol=1e-13)


def test_g_zero_and_segments():
    mesh = random_square(200, 915)
    h0 = np.random.default_rng(916).uniform(1.0, 2.0, 200)
    assert (solve(mesh, h0, 0.0).h == h0.min()).all()
    # Two pieces of a line, the second with a branch back over itself.
    line = SimplexMesh([[0.0], [1.0], [3.0], [4.0], [6.0], [5.0]], [[0, 1], [2, 1], [3, 4], [4, 5]])
    h = solve(line, [1.0, np.inf, np.inf, 2.0, np.inf, np.inf], 0.5).h
    assert_allclose(h, [1.0, 1.5, 2.5, 2.0, 3.0, 3.5], rtol=1e-15)


def test_linear_data_on_a_boundary_are_met_by_polishing():
    # 5 + 4 sin(3 theta) on a circle; the reference samples its chords 200 times each.
    rng = np.random.default_rng(917)
    n = 90
    circle = np.column_stack([np.cos(a := np.arange(n) * 2.0 * np.pi / n), np.sin(a)])
    inside = rng.uniform(-1.0, 1.0, (900, 2))
    inside = inside[np.linalg.norm(inside, axis=1) < 0.95]
    points = np.concatenate([circle, inside])
    mesh = SimplexMesh(points, Delaunay(points).simplices)
    h0 = at_nodes(mesh, np.arange(n), 0.06 * (5.0 + 4.0 * np.sin(3.0 * a)))
    t = np.linspace(0.0, 1.0, 200)[:, None, None]
    on_chords = ((1.0 - t) * circle + t * np.roll(circle, -1, axis=0)).reshape(-1, 2)
    sizes = ((1.0 - t[..., 0]) * h0[:n] + t[..., 0] * np.roll(h0[:n], -1)).ravel()
    distance = np.linalg.norm(points[:, None] - on_chords, axis=2)
    exact = (sizes + G * distance).min(axis=1)
    for sight in ("auto", False):
        error = solve(mesh, h0, domain_is_convex=sight).h - exact
        # A sample is at most 1/400 of a chord (0.07) from the best point, where the
        # candidate is stationary: less than g (0.07/400)^2 / (2 * 0.05) too large.
        assert error.max() < 1e-12
        assert error.min() > -1e-7
    assert (solve(mesh, h0, polish=0).h - exact).max() > 1e-5


def test_smooth_full_field_is_met_to_more_than_first_order():
    def bound(x, y):
        return 0.5 + 0.2 * np.sin(4.0 * x) * np.cos(3.0 * y)

    def limited(x):  # the best of a coarse grid, and then of a fine one around that
        centre, half = np.zeros(2), 1.0
        for _ in range(2):
            axes = np.clip(np.linspace(centre - half, centre + half, 101).T, -1.0, 1.0)
            grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
            sizes = bound(*grid.T) + G * np.linalg.norm(grid - x, axis=1)
            centre, half = grid[np.argmin(sizes)], 0.03
        return sizes.min()

    errors = []
    for n_side in (21, 41):
        mesh = jittered_square(n_side, 918, half_width=1.0)
        h = solve(mesh, bound(*mesh.points.T)).h
        some = np.arange(0, mesh.n_points, n_side**2 // 150)
        exact = [limited(x) for x in mesh.points[some]]
        errors.append(np.abs(h[some] - exact).mean())
    assert errors[1] < 0.4 * errors[0], errors
    assert errors[1] < 1e-3


def walled_square(n_side):
    """(-50, 50)^2 without a wall of one row of squares, from the upper side to y = -20."""
    mesh = structured_square(n_side)
    x, y = mesh.points[mesh.cells].mean(axis=1).T
    width = 100.0 / n_side
    inside = (x > 0.0) & (x < width) & (y > -20.0)
    return SimplexMesh(mesh.points, mesh.cells[~inside]), width


def around_wall(points, source, width):
    """Shortest path from a source left of the wall, bending at its two lower corners."""
    corners = np.array([[0.0, -20.0], [width, -20.0]])
    x, y = points.T
    share = (corners[:, :1] - source[0]) / np.where(x > 0.0, x - source[0], np.nan)
    crossing = source[1] + share * (y - source[1])  # height of the straight line at both sides
    reaches = np.array([x > 0.0, x > width])
    blocked = (reaches & (crossing > -20.0 + 1e-9)).any(axis=0)
    blocked |= (x > 0.0) & (x <= width) & (y > -20.0)
    first = np.linalg.norm(source - corners[0])
    over_both = first + width + np.linalg.norm(points - corners[1], axis=1)
    over_one = first + np.linalg.norm(points - corners[0], axis=1)
    bent = np.where((x >= width) & (y > -20.0), over_both, over_one)
    return np.where(blocked, bent, np.linalg.norm(points - source, axis=1))


@pytest.mark.parametrize("n_side", [20, 60])
def test_sizes_around_a_wall_are_exact(n_side):
    mesh, width = walled_square(n_side)
    used = np.unique(mesh.cells)
    source = nearest(mesh, [-20.0, 30.0])
    solution = solve(mesh, at_nodes(mesh, source, 1.0))
    exact = 1.0 + G * around_wall(mesh.points, mesh.points[source], width)
    assert not solution.is_convex
    assert_allclose(solution.h[used], exact[used], rtol=1e-12)
    assert np.isinf(np.delete(solution.h, used)).all()  # in no cell
    # Taking the domain for convex would look through the wall.
    trusting = solve(mesh, at_nodes(mesh, source, 1.0), domain_is_convex=True).h
    assert (exact - trusting)[used].max() > 5.0


def test_sources_tell_where_sizes_come_from():
    mesh, _ = walled_square(20)
    source = nearest(mesh, [-20.0, 30.0])
    solution = solve(mesh, at_nodes(mesh, source, 1.0))
    reached = np.isfinite(solution.h)
    p = solution.source[reached, 0]
    assert (solution.source[reached, 1] == -1).all()
    path = solution.source_sizes[reached, 0] + G * np.linalg.norm(
        mesh.points[reached] - mesh.points[p], axis=1
    )
    assert_allclose(path, solution.h[reached], rtol=1e-13)
    corners = [nearest(mesh, place) for place in ([0.0, -20.0], [5.0, -20.0])]
    assert set(p) == {source, *corners}


def test_sizes_beyond_reflex_edges_in_space():
    # An L of height 4; the shortest path bends on the edge x = y = 4, where unfolding
    # makes it straight: its length is the hypotenuse over (r_1 + r_2, z_1 - z_2).
    for n in (4, 8):
        mesh = jittered_box(2 * n, 919, keep=lambda c: ~((c[:, 0] > n) & (c[:, 1] > n)))  # noqa: B023
        used = np.unique(mesh.cells)
        points = mesh.points / n
        mesh = SimplexMesh(points, mesh.cells)
        source = nearest(mesh, [1.75, 0.5, 0.5])
        solution = solve(mesh, at_nodes(mesh, source, 1.0))
        assert not solution.is_convex
        s = points[source]
        beyond = (s[0] - 1.0) * (points[:, 1] - 1.0) - (s[1] - 1.0) * (points[:, 0] - 1.0) > 1e-9
        hidden = beyond & (points[:, 0] < 1.0 + 1e-9) & (points[:, 1] > 1.0 - 1e-9)
        radii = np.hypot(*(s[:2] - 1.0)) + np.hypot(*(points[:, :2] - 1.0).T)
        crosses = (s[0] - 1.0) * (points[:, 1] - 1.0) - (s[1] - 1.0) * (points[:, 0] - 1.0) > 0
        length = np.where(
            hidden & crosses,
            np.hypot(radii, s[2] - points[:, 2]),
            np.linalg.norm(points - s, axis=1),
        )
        assert_allclose(solution.h[used], (1.0 + G * length)[used], rtol=1e-12)
        # Some of the paths bend within an edge.
        assert len(solution.bent) == mesh.n_points
        assert np.isfinite(solution.bent[:, 3]).sum() > 20


@pytest.mark.parametrize("name", [*CASES])
@pytest.mark.parametrize("seed", [2027, 2028])
def test_point_sources_beside_obstacles_are_exact(name, seed):
    case = CASES[name]
    mesh, domain = case.make(3000, seed=seed)
    h0, nodes = point_sources(mesh, case.places, case.sizes)
    used = np.unique(mesh.cells)
    some = np.random.default_rng(seed).choice(used, 600, replace=False)
    h = solve(mesh, h0).h[some]
    error = h - case.exact(domain, mesh.points[some], G, mesh.points[nodes], case.sizes)
    assert error.min() > -1e-11
    if name == "window":
        # Paths over two edges of the frame that meet in a corner are not exact.
        assert np.mean(error > 1e-9) < 0.05
        assert error.mean() < 3e-3
    else:
        assert error.max() < 1e-11


def test_sizes_between_nodes_behind_a_reflex_edge_come_over_the_edge():
    case = CASES["wall"]
    mesh, domain = case.make(3000, seed=2029)
    h0, nodes = point_sources(mesh, case.places, case.sizes)
    h, info = limit_gradient(mesh, h0, G, full_output=True)
    inside = mesh.points[mesh.cells].mean(axis=1)[::37]
    exact = case.exact(domain, inside, G, mesh.points[nodes], case.sizes)
    error = info.sources.evaluate(inside) - exact
    # Where the nodes around have different sources sizes are interpolated; most cells lie in
    # the region of one source, some of them behind the edge.
    known = np.abs(error) < 1e-11
    assert np.mean(known) > 0.6
    around = mesh.cells[::37][known]
    assert np.isfinite(info.sources.bent[around, 3]).all(axis=1).mean() > 0.02
    assert np.median(np.abs(SizeFunction(mesh, h)(inside) - exact)) > 1e-2


def test_lines_that_stay_clear_of_the_boundary_need_no_walk(monkeypatch):
    mesh, _ = star_holes(3000, seed=923)
    h0 = 6.0 + np.random.default_rng(924).uniform(0.0, 4.0, mesh.n_points)
    h = solve(mesh, h0).h
    assert np.mean(h < h0) > 0.5
    monkeypatch.setattr(
        "adaptsize.limiting.source_tracking.clearance_of",
        lambda points, facets: np.zeros(len(points)),
    )
    assert (solve(mesh, h0).h == h).all()


def test_two_components_do_not_see_each_other():
    one = structured_square(5, half_width=1.0)
    points = np.vstack([one.points, one.points + np.array([2.1, 0.0])])
    mesh = SimplexMesh(points, np.concatenate([one.cells, one.cells + one.n_points]))
    h = solve(mesh, at_nodes(mesh, 0, 0.1)).h
    assert np.isfinite(h[: one.n_points]).all()
    assert np.isinf(h[one.n_points :]).all()


def test_stretched_triangles_need_no_iteration():
    # Where marching goes round in circles: Delaunay triangles stretched 10:1.
    base = random_square(3000, 920)
    mesh = SimplexMesh(base.points * [10.0, 1.0], base.cells)
    h0 = at_nodes(mesh, [5, 700, 2000], [0.1, 0.2, 0.15])
    solution = solve(mesh, h0)
    assert solution.iterations < 2 * mesh.n_points
    assert_allclose(solution.h, limit_gradient(mesh, h0, G, method="exact"), rtol=1e-12)


def test_limiting_twice_changes_nothing_with_sources_at_nodes():
    mesh = random_square(1500, 921)
    h0 = np.random.default_rng(922).uniform(0.05, 1.0, 1500)
    once = solve(mesh, h0, face_sources=False).h
    assert_allclose(solve(mesh, once, face_sources=False).h, once, rtol=1e-12)


def brute_force_paths(mesh, h0, g):
    """Lower bound for any domain: straight lines through whatever is in the way."""
    distance = np.linalg.norm(mesh.points[:, None] - mesh.points, axis=2)
    return (h0 + g * distance).min(axis=1)


@st.composite
def any_mesh(draw):
    """Cells between a few points of a small grid: overlapping, folded, flat, apart, crossing."""
    dim = draw(st.sampled_from([2, 3]))
    coordinate = st.integers(0, 3).map(float)
    points = draw(st.lists(st.tuples(*[coordinate] * dim), min_size=dim + 1, max_size=12))
    node = st.integers(0, len(points) - 1)
    cell = st.lists(node, min_size=dim + 1, max_size=dim + 1, unique=True)
    cells = draw(st.lists(cell, min_size=1, max_size=25))
    size = st.one_of(st.just(np.inf), st.floats(0.01, 3.0))
    h0 = draw(st.lists(size, min_size=len(points), max_size=len(points)))
    h0[draw(node)] = draw(st.floats(0.01, 3.0))
    return SimplexMesh(points, cells), np.array(h0)


@given(any_mesh(), st.sampled_from([0.0, 0.1, 1.0]), st.booleans())
def test_no_size_is_below_that_of_straight_lines_or_above_that_of_edges(case, g, faces):
    mesh, h0 = case
    h = solve(mesh, h0, g, face_sources=faces).h
    along_edges = limit_gradient(mesh, h0, g, method="edge-based")
    assert (h <= along_edges * (1.0 + 1e-12)).all()
    assert (np.isfinite(h) == np.isfinite(along_edges)).all()
    if not faces:
        reached = np.isfinite(h)
        assert (h[reached] >= brute_force_paths(mesh, h0, g)[reached] * (1.0 - 1e-12)).all()


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_random_holes_bend_paths_and_never_shorten_them(seed, everywhere):
    rng = np.random.default_rng(seed)
    mesh = random_square(60, seed)
    cells = mesh.cells[rng.random(mesh.n_cells) < 0.7]
    mesh = SimplexMesh(mesh.points, cells)
    h0 = np.where(rng.random(60) < (1.0 if everywhere else 0.1), rng.uniform(0.05, 1.0, 60), np.inf)
    h0[7] = 0.1
    h = solve(mesh, h0, face_sources=False).h
    reached = np.isfinite(h)
    assert (h[reached] >= brute_force_paths(mesh, h0, G)[reached] * (1.0 - 1e-12)).all()
    assert (h <= limit_gradient(mesh, h0, G, method="edge-based") * (1.0 + 1e-12)).all()
