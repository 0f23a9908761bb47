"""Source tracking on Cartesian grids."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import geodesics
from adaptsize.background import CartesianGrid
from adaptsize.limiting.grid_tracking import solve_grid_tracking
from exact_on_grids import exact_sizes

G = 0.3


def _solve(grid, h0, g=G, **options):
    options.setdefault("residual", True)
    options.setdefault("report", lambda text, share: None)
    return solve_grid_tracking(grid, h0, g, **options)


def _points_only(grid, nodes, sizes):
    h0 = np.full(grid.shape, np.inf)
    h0[tuple(np.transpose(nodes))] = sizes
    return h0


def _nodewise(grid, h0, g=G):
    """Return min over nodes y of h0(y) + g |x - y|, straight from the formula."""
    points, bound = grid.points, h0.ravel()
    h = bound.copy()
    for s in np.flatnonzero(np.isfinite(bound)):
        h = np.minimum(h, bound[s] + g * np.linalg.norm(points - points[s], axis=1))
    return h.reshape(grid.shape)


def _ring(x0, x1, y0, y1):
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float)


def _with_holes(shape, spacing, holes):
    """Return a grid with rectangular holes (node ranges, boundaries included) and its polygon."""
    active = np.ones(shape, bool)
    dx, dy = spacing
    rings = [_ring(0.0, (shape[0] - 1) * dx, 0.0, (shape[1] - 1) * dy)]
    for i0, i1, j0, j1 in holes:
        active[i0 + 1 : i1, j0 + 1 : j1] = False
        rings.append(_ring(i0 * dx, i1 * dx, j0 * dy, j1 * dy)[::-1])
    return CartesianGrid([0.0, 0.0], spacing, shape, active=active), tuple(rings)


# --- exact solutions -----------------------------------------------------------------


def test_two_sources_on_the_grid_of_figure_11_are_exact():
    grid = CartesianGrid([-50.0, -50.0], 1.0, (101, 101))
    h0 = _points_only(grid, [(40, 50), (60, 50)], [1.0, 5.0])
    # Distances of up to 140 by one square root: a few units in the last place of 40.
    assert_allclose(_solve(grid, h0).h, _nodewise(grid, h0), rtol=0.0, atol=3e-14)


@pytest.mark.parametrize(
    ("shape", "spacing"), [((31,), 0.5), ((20, 31), (1.0, 0.3)), ((9, 12, 10), (1.0, 0.4, 2.0))]
)
def test_point_sources_are_exact_with_any_spacing_in_one_to_three_dimensions(shape, spacing):
    grid = CartesianGrid((3.0,) * len(shape), spacing, shape)
    h0 = _points_only(grid, [np.subtract(shape, 3), np.full(len(shape), 2)], [1.0, 1.2])
    solution = _solve(grid, h0)
    assert_allclose(solution.h, _nodewise(grid, h0), rtol=0.0, atol=1e-14)
    assert solution.is_convex
    assert solution.residual < 1e-15


@pytest.mark.parametrize(
    "holes",
    [
        [(6, 35, 19, 21)],
        [(4, 8, 2, 30), (10, 14, 6, 38), (18, 22, 2, 26), (24, 28, 10, 38), (30, 38, 18, 22)],
    ],
    ids=["slit", "maze"],
)
def test_sizes_around_rectangles_are_the_geodesic_ones(holes):
    grid, rings = _with_holes((41, 41), (1.0, 0.8), holes)
    nodes, sizes = np.array([(2, 3), (37, 12), (22, 2)]), np.array([1.0, 2.0, 4.0])
    solution = _solve(grid, _points_only(grid, nodes, sizes))
    points = grid.points[grid.active.ravel()]
    exact = geodesics.limited_sizes(rings, points, G, nodes * grid.spacing, sizes)
    # The reference lets paths cut corners by 1e-11 of the extent.
    assert_allclose(solution.h[grid.active], exact, rtol=0.0, atol=1e-11)
    assert not solution.is_convex


def test_behind_a_wall_in_space_sizes_are_of_second_order():
    errors = []
    for n in (13, 25):
        grid = CartesianGrid([-1.0, -1.0, -1.0], 2.0 / (n - 1), (n, n, n))
        x, y, _ = np.meshgrid(*grid.axes, indexing="ij")
        active = (y >= -1e-12) | (np.abs(x) >= 1.0 / 6.0 - 1e-9)
        source = np.array([2, 2, 4]) * (n - 1) // 12
        grid = grid.with_active(active)
        solution = _solve(grid, _points_only(grid, [source], [1.0]))
        at = grid.points.reshape(*grid.shape, 3)[tuple(source)]
        rings = (
            np.array([[-1, -1], [-1 / 6, -1], [-1 / 6, 0], [1 / 6, 0], [1 / 6, -1], [1, -1.0]]),
        )
        rings = (np.concatenate([rings[0], [[1.0, 1.0], [-1.0, 1.0]]]),)
        # At the far wall and beyond only: near the edge itself the error is of first order.
        some = grid.points[(active & (x >= 0.5)).ravel()]
        exact = geodesics.prism_sizes(rings, some, G, [at], [1.0])
        error = solution.h[active & (x >= 0.5)] - exact
        assert error.min() > -1e-11
        errors.append(error.max())
    # The bend is half a spacing off at most: g a^2/8 (1/r + 1/s), twice, with r, s > 1/3.
    assert errors[0] < 2 * G / 6.0**2 / 8.0 * 6.0
    assert errors[1] < 2 * G / 12.0**2 / 8.0 * 6.0


# --- data on lines and everywhere ------------------------------------------------------


def test_data_on_a_side_count_as_linear_between_the_nodes():
    grid = CartesianGrid([0.0, 0.0], [1.0, 0.7], (9, 15))
    h0 = np.full(grid.shape, np.inf)
    h0[0] = 2.0 + 0.15 * np.sin(np.arange(15))
    x, y = grid.points.T
    exact = np.full(grid.n_points, np.inf)
    fine = np.linspace(0.0, 14.0, 14 * 400 + 1)  # min over samples: above by 3e-6 at most
    size = np.interp(fine, np.arange(15), h0[0])
    for s, u in zip(fine * 0.7, size, strict=True):
        exact = np.minimum(exact, u + G * np.hypot(x, y - s))
    error = _solve(grid, h0).h.ravel() - exact
    assert error.max() < 1e-12
    assert error.min() > -G * (0.7 / 800) ** 2 / (2 * 1.0) - 1e-4 * G


@pytest.mark.parametrize(("dim", "sizes"), [(2, (51, 101, 201)), (3, (17, 33))])
def test_smooth_data_everywhere_are_limited_to_second_order(dim, sizes):
    errors = []
    for n in sizes:
        grid = CartesianGrid([-1.0] * dim, 2.0 / (n - 1), (n,) * dim)
        r = np.linalg.norm(grid.points, axis=1)
        h0 = 1.0 + 0.3 * np.cos(6.0 * r)  # slopes up to 1.8
        s = np.linspace(0.0, np.sqrt(dim), 20001)
        v = 1.0 + 0.3 * np.cos(6.0 * s)
        up = np.minimum.accumulate(v - G * s) + G * s
        down = np.minimum.accumulate((v + G * s)[::-1])[::-1] - G * s
        exact = np.interp(r, s, np.minimum(up, down))
        inside = r < 0.7  # all that bounds these sizes lies in the square
        h = _solve(grid, h0.reshape(grid.shape)).h.ravel()
        errors.append(np.abs(h - exact)[inside].mean())
    assert np.log2(errors[-2] / errors[-1]) > 1.6


def test_no_sizes_are_made_up_where_data_turn_a_corner():
    grid = CartesianGrid([0.0, 0.0], 1.0, (6, 6))
    h0 = np.full(grid.shape, np.inf)
    h0[0, :] = h0[:, 0] = 1.0
    i, j = np.indices(grid.shape)
    assert_array_equal(_solve(grid, h0).h, 1.0 + G * np.minimum(i, j))


# --- the domain of a mask --------------------------------------------------------------


def test_nothing_leaks_through_a_staircase_of_inactive_nodes():
    i, j = np.indices((12, 12))
    grid = CartesianGrid([0.0, 0.0], 1.0, (12, 12), active=i != j)
    solution = _solve(grid, _points_only(grid, [(8, 3)], [1.0]))
    assert np.isinf(solution.h[j > i]).all()
    assert np.isfinite(solution.h[i > j]).all()


def test_corridors_of_one_node_are_passed_node_by_node():
    active = np.zeros((5, 5), bool)
    active[0, :] = active[:, 4] = True
    grid = CartesianGrid([0.0, 0.0], [1.0, 2.0], (5, 5), active=active)
    h = _solve(grid, _points_only(grid, [(0, 0)], [1.0])).h
    assert_allclose(h[4, 4], 1.0 + G * (4 * 2.0 + 4 * 1.0), rtol=1e-14)


# --- laws ------------------------------------------------------------------------------


@st.composite
def _problems(draw):
    dim = draw(st.sampled_from([2, 3]))
    shape = tuple(draw(st.integers(2, 6 if dim == 2 else 3)) for _ in range(dim))
    spacing = [draw(st.sampled_from([0.5, 1.0, 1.7])) for _ in range(dim)]
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    active = rng.random(shape) < draw(st.sampled_from([0.7, 0.85, 1.0]))
    h0 = 1.0 + draw(st.sampled_from([0.3, 2.0])) * rng.random(shape)
    h0[rng.random(shape) > draw(st.sampled_from([0.1, 0.4, 1.0]))] = np.inf
    first = tuple(rng.integers(shape))
    active[first], h0[first] = True, 1.5
    return CartesianGrid([0.0] * dim, spacing, shape, active=active), h0


@given(_problems(), st.booleans())
@settings(max_examples=25)
def test_no_size_is_below_the_definition_and_few_are_above(problem, segments):
    grid, h0 = problem
    solution = _solve(grid, h0, face_sources=segments)
    exact = exact_sizes(grid.shape, grid.spacing, grid.active, h0, G, segments=segments)
    h = solution.h[grid.active]
    exact = exact[grid.active]
    assert_array_equal(np.isinf(h), np.isinf(exact))
    error = (h - exact)[np.isfinite(exact)]
    assert error.min() > -1e-9  # golden sections find feet to 1e-8
    # In the plane none of some 20 000 nodes tried was; in space one in 1000.
    assert np.count_nonzero(error > 1e-9) <= (0 if grid.dim == 2 else 2)
    assert solution.residual < 1e-14


@given(_problems())
@settings(max_examples=15)
def test_sources_tell_the_sizes_and_limiting_again_changes_nothing(problem):
    grid, h0 = problem
    before = h0.copy()
    solution = _solve(grid, h0, face_sources=False)
    assert_array_equal(h0, before)
    h, source = solution.h.ravel(), solution.source[:, 0]
    away = np.linalg.norm(grid.points - grid.points[source], axis=1)
    straight = solution.source_sizes[:, 0] + G * away
    reached = np.isfinite(h)
    assert_allclose(straight[reached], h[reached], rtol=1e-14)
    assert_array_equal(h[source[reached]], solution.source_sizes[reached, 0])
    again = _solve(grid, solution.h, face_sources=False)
    assert_allclose(again.h, solution.h, rtol=1e-14)


def test_sources_on_segments_tell_the_sizes_too():
    grid = CartesianGrid([0.0, 0.0], [1.0, 0.7], (9, 15))
    h0 = np.full(grid.shape, np.inf)
    h0[0] = 2.0 + 0.1 * np.arange(15)
    solution = _solve(grid, h0)
    (a, b), (u, v) = solution.source.T, solution.source_sizes.T
    on_segment = np.flatnonzero(b >= 0)
    assert len(on_segment) > 50
    t = np.linspace(0.0, 1.0, 5001)[:, None]
    p, q = grid.points[a[on_segment]], grid.points[b[on_segment]]
    x = grid.points[on_segment]
    foot = p + t[..., None] * (q - p)
    size = u[on_segment] + t * (v - u)[on_segment] + G * np.linalg.norm(x - foot, axis=2)
    # Samples 0.7 / 5000 apart miss the least by g (0.7 / 1e4)^2 / (2 D), D >= 1, or less.
    assert_allclose(size.min(axis=0), solution.h.ravel()[on_segment], atol=1e-9)


def test_where_nothing_is_steep_nothing_changes_and_every_node_is_its_own_source():
    grid = CartesianGrid([0.0, 0.0], 1.0, (7, 8))
    h0 = 1.0 + 0.1 * np.add(*np.indices(grid.shape))
    solution = _solve(grid, h0)
    assert_array_equal(solution.h, h0)
    assert_array_equal(solution.source[:, 0], np.arange(56))
    assert solution.iterations == 0


def test_a_slope_of_zero_spreads_the_least_size_of_each_component():
    active = np.ones((5, 9), bool)
    active[:, 4] = False
    grid = CartesianGrid([0.0, 0.0], 1.0, (5, 9), active=active)
    h = _solve(grid, _points_only(grid, [(1, 1), (3, 2), (0, 8)], [2.0, 1.0, 3.0]), g=0.0).h
    assert (h[:, :4] == 1.0).all()
    assert (h[:, 5:] == 3.0).all()
