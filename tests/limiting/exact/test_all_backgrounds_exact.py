"""Cases with a known limited size, on every background that a scheme works on."""

import numpy as np
import pytest
from backgrounds import (
    CASES,
    Case,
    cases,
    coordinates,
    domain,
    graded_tree,
    square_grid,
    two_sources,
)  # fmt: skip
from meshes import jittered_cube, jittered_square, structured_square
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import CartesianGrid, SimplexMesh, limit_gradient
from adaptsize.limiting import EdgeBased, FastMarching, HamiltonJacobi

G = 0.3
# Background and kind (see `backgrounds.KINDS`), and how to make one of (-50, 50)^dim.
PLACES = {
    "triangles": ("simplices", "plane", lambda: jittered_square(31, seed=24)),
    "tetrahedra": ("simplices", "volume", lambda: jittered_cube(9, seed=25)),
    "line of nodes": ("grid", "1-D", lambda: CartesianGrid([-50.0], 2.5, (41,))),
    "grid": ("grid", "2-D", lambda: CartesianGrid([-50.0] * 2, (2.5, 6.25), (41, 17))),
    "grid in space": ("grid", "3-D", lambda: CartesianGrid([-50.0] * 3, (10, 5, 20), (11, 21, 6))),
    "quadtree": ("octree", "2-D", lambda: graded_tree(2)(17)),
    "octree": ("octree", "3-D", lambda: graded_tree(3)(6)),
}
EVERYWHERE = [
    pytest.param(case, make, id=f"{case}, {name}")
    for name, (background, kind, make) in PLACES.items()
    for case in cases(background, kind)
]
NODAL_G = [row for row in EVERYWHERE if "nodes" in row.values[0].all_limits]
# An iteration stops at tol g, which a wave of 40 nodes adds up to 40 tol; Phi has 8192
# intervals per factor e, read with an error of 2e-9.
ROUNDING = {"fast-marching": 1e-13, "positive-coefficient": 1e-13, "exact": 1e-14}


def rounding_of(case):
    return ROUNDING.get(case.method, case.rounding)


HUNDRED = {
    "simplices": lambda: structured_square(100),
    "grid": lambda: square_grid(101),
    "octree": lambda: graded_tree(2)(101),
}


@pytest.mark.parametrize("background", ["simplices", "grid"])
def test_edges_miss_the_paper_problem_by_7_79(background):
    # Persson, Fig. 11: 7.79 on 100 x 100 cells, at the corner (-50, 50), where a path
    # along the axes is 90 long and the straight line 64.0: 0.3 (90 - 64.03) = 7.79.
    place = HUNDRED[background]()
    h0, exact = two_sources(place)
    error = Case(background, EdgeBased()).limit(place, h0, G) - exact
    assert error.max() == pytest.approx(0.3 * (90.0 - np.hypot(40.0, 50.0)), abs=1e-12)
    assert f"{error.max():.2f}" == "7.79"


@pytest.mark.parametrize(
    "case", [case for case in cases() if {"plane", "2-D"} & set(case.all_kinds)], ids=str
)
def test_paper_problem_is_met_as_in_the_paper(case):
    # Persson, Fig. 11: 0.38 for first order and 0.10 for second, on 100 x 100 cells.
    background = HUNDRED[case.background]()
    h0, exact = two_sources(background)
    error = case.loose.limit(background, h0, G) - exact
    if case.is_exact:
        assert np.abs(error).max() < 1e-13  # of sizes up to 23
        return
    assert error.max() < (0.38 if case.order == 1 else 0.103)
    # Differences across the ridge where the fronts meet, and, on the simplices of leaves beside
    # four times smaller ones, flat interpolation of the cones.
    assert error.min() > {"octree": -0.03}.get(case.background, -0.013)


def test_second_order_on_the_grid_of_the_paper_has_the_errors_seen_before():
    # 0.102 by one-sided second differences, and 0.0957 by ENO with the obstacle form.
    grid = square_grid(101)
    h0, exact = two_sources(grid)
    for scheme, seen in ((FastMarching(2), 0.10205), (HamiltonJacobi(2, tol=1e-4), 0.0957)):
        error = np.abs(limit_gradient(grid, h0, G, method=scheme) - exact)
        assert error.max() == pytest.approx(seen, abs=1e-4)


# The exact method wants flat domains: lines in the plane, which the laws draw, are none.
ON_LINES = [
    case
    for case in CASES
    if {"segments", "1-D"} & set(case.all_kinds)
    or (case.background == "simplices" and case.method == "exact")
]


@pytest.mark.parametrize("g", [4.0, 2.0, 1.0, 0.5])
@pytest.mark.parametrize("case", ON_LINES, ids=str)
def test_one_dimensional_example_for_four_g(case, g):
    x = np.linspace(0.0, 4.0, 161)
    h0 = 2.0 + 1.5 * np.sin(2.0 * np.pi * x) * np.exp(-0.3 * x)  # slopes up to 9.4
    if case.background == "grid":
        line = CartesianGrid([0.0], x[1], (161,))
    else:
        line = SimplexMesh(x[:, None], np.column_stack([np.arange(160), np.arange(1, 161)]))
    exact = (h0 + g * np.abs(x[:, None] - x)).min(axis=1)
    h = case.limit(line, h0, g)
    assert_allclose(h, exact, rtol=max(rounding_of(case), 1e-13))
    assert (h < h0).any()
    assert (h == h0).any()


@pytest.mark.parametrize(("case", "make"), EVERYWHERE)
@pytest.mark.parametrize("steepness", [0.5, 1.0])
def test_linear_sizes_within_the_limit_stay(case, make, steepness):
    background = make()
    x = coordinates(background)
    direction = np.ones(x.shape[-1]) / np.sqrt(x.shape[-1])
    h0 = 200.0 + steepness * G * x @ direction
    assert_allclose(case.limit(background, h0, G), h0, rtol=1e-14)


def wave(case, background, axis, end, g):
    """Limit sizes that are 1 on one side of the box; return them and the way from there."""
    x = coordinates(background)[..., axis]
    way = np.abs(x - end * 50.0)
    return case.limit(background, np.where(way == 0.0, 1.0, np.inf), g), way


@pytest.mark.parametrize(("case", "make"), EVERYWHERE)
def test_plane_wave_from_one_side_is_exact(case, make):
    background = make()
    for axis in range(domain(background).dim):
        for end in (-1.0, 1.0):
            h, way = wave(case, background, axis, end, G)
            assert_allclose(h, 1.0 + G * way, rtol=rounding_of(case))


@pytest.mark.parametrize(("case", "make"), EVERYWHERE)
def test_g_proportional_to_h_grows_exponentially(case, make):
    # dh/ds = 0.05 h: h = exp(0.05 s), from one side.
    h, way = wave(case, make(), 0, -1.0, lambda h: 0.05 * h)
    assert_allclose(h, np.exp(0.05 * way), rtol=1e-8)


@pytest.mark.parametrize(("case", "make"), NODAL_G)
def test_product_of_g_of_x_and_g_of_h(case, make):
    # b = 0.02 h, a = 2: exp(0.04 s).
    background = make()
    a = np.full(background.nodal_shape, 2.0)
    h, way = wave(case, background, 0, -1.0, (a, lambda h: 0.02 * h))
    assert_allclose(h, np.exp(0.04 * way), rtol=1e-8)


@pytest.mark.parametrize(("case", "make"), EVERYWHERE)
def test_zero_g_spreads_the_least_size(case, make):
    background = make()
    h0 = np.random.default_rng(37).uniform(1.0, 2.0, background.nodal_shape)
    assert_array_equal(case.limit(background, h0, 0.0), h0.min())
