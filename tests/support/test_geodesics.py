"""The references of limited sizes, against each other, closed forms, minimization and marching."""

from itertools import pairwise
from math import dist

import domains
import numpy as np
import pytest
from exact_oracle import plane_domain, plane_sees, plane_sizes
from geodesics import (
    contains,
    curve_sizes,
    distances,
    limited_sizes,
    sees,
    window_sizes,
)
from numpy.testing import assert_allclose
from scipy.optimize import minimize

from adaptsize import limit_gradient

G = 0.3
SQUARE = np.array([[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]])
BLOCK = np.array([[-5.0, -10.0], [-5.0, 10.0], [5.0, 10.0], [5.0, -10.0]])  # clockwise: a hole


def some_points(rings, n, seed):
    points = np.random.default_rng(seed).uniform(-50.0, 50.0, (3 * n, 2))
    return points[contains(rings, points)][:n]


def length(*places):
    return sum(np.linalg.norm(b - a, axis=-1) for a, b in pairwise(places))


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ((-20, 0), (20, 0), False),  # through the block
        ((-20, 20), (20, 20), True),  # past it
        ((-20, 10), (20, 10), True),  # along its upper side, overlapping all of it
        ((-5, 3), (-5, -50), True),  # from one of its sides along this side
        ((-5, 10), (5, -10), False),  # its diagonal, corner to corner
        ((-5, 3), (5, 3), False),  # from one side to the other inside it
        ((-5, 10), (5, 10), True),  # its upper side itself
        ((-15, 0), (5, 20), True),  # touching the corner (-5, 10) only
        ((-15, -1), (5, 19), False),  # cutting off 0.7 of that corner
        ((-15, 1e-13), (5, 20), True),  # the same touch, to rounding
        ((-5, 0), (-50, 0), True),  # from its side away
        ((-5, 0), (20, 0), False),  # from its side through it
        ((-50, -50), (50, -50), True),  # the square's own side
        ((7, 7), (7, 7), True),
    ],
)
def test_sight(a, b, expected):
    a, b = np.array([a, b], float)[:, None]
    for p, q in ((a, b), (b, a)):
        assert sees((SQUARE, BLOCK), p, q)[0] == expected


PLACES = [(-45, 45), (30, -30), (5, 5), (-40, -45), (44, 40)]


@pytest.mark.parametrize(
    "name", ["slit_square", "blocks", "maze", "spiral", "star_holes", "round_holes", "disc"]
)
def test_the_two_references_in_the_plane_agree(name):
    # One knows the polygons, the other walks through the cells: these fill the polygons.
    mesh, rings = getattr(domains, name)(2000, seed=2201)
    h0, nodes = domains.point_sources(mesh, PLACES, (1.0, 4.0, 6.0, 3.0, 2.0))
    expected = limited_sizes(rings, mesh.points, G, mesh.points[nodes], h0[nodes])
    domain = plane_domain(mesh)
    assert_allclose(plane_sizes(domain, h0, G), expected, rtol=0.0, atol=1e-12)
    pairs = np.random.default_rng(2202).integers(0, mesh.n_points, (2000, 2))
    assert np.array_equal(plane_sees(domain, pairs), sees(rings, *mesh.points[pairs.T]))


def test_around_a_slit_by_one_tip_or_by_both():
    rings = (domains.slit_polygon(1.0, -20.0),)
    source = np.array([-20.0, 30.0])
    left, right = np.array([-0.5, -20.0]), np.array([0.5, -20.0])
    x = some_points(rings, 500, 54)
    slope = (left - source)[1] / (left - source)[0]  # of the shadow line through the left tip
    is_hidden = (x[:, 0] > -0.5) & (x[:, 1] > left[1] + slope * (x[:, 0] - left[0]))
    is_beyond = (x[:, 0] > 0.5) & (x[:, 1] > -20.0)  # these do not see the left tip
    straight, once = length(source, x), length(source, left, x)
    twice = length(source, left, right, x)
    expected = np.where(is_hidden, np.where(is_beyond, twice, once), straight)
    assert is_beyond.sum() > 100
    assert (is_hidden & ~is_beyond).sum() > 10
    assert_allclose(distances(rings, source, x), expected, rtol=1e-14)


WINDOW = (2.0, (-20.0, -8.0), (10.0, 16.0))


def beside_the_wall(n, seed, sign):
    x = np.random.default_rng(seed).uniform(-45.0, 45.0, (n, 3))
    x[:, 0] = sign * (1.0 + np.abs(x[:, 0]))
    return x


def test_through_a_window_the_bends_are_where_the_sum_of_lengths_is_least():
    # The twin minimises over the four coordinates at once, by quadratic programs.
    _, lower, upper = WINDOW
    bounds = [(lower[0], upper[0]), (lower[1], upper[1])] * 2
    bends = set()
    x = beside_the_wall(12, 67, 1.0)
    for a in beside_the_wall(3, 66, -1.0):

        def through(v, b, a=a):
            p, q = (-1.0, v[0], v[1]), (1.0, v[2], v[3])
            return dist(a, p) + dist(p, q) + dist(q, b)

        exact = window_sizes(WINDOW, x, 1.0, a[None], [0.0])
        for b, least in zip(x, exact, strict=True):
            brute = minimize(
                through, np.zeros(4), (b,), "SLSQP", bounds=bounds, options={"ftol": 1e-14}
            )
            assert_allclose(least, brute.fun, rtol=1e-7)
            assert least <= brute.fun * (1.0 + 1e-13)
            bends.add(sum(lo < v < up for v, (lo, up) in zip(brute.x, bounds, strict=True)))
    assert bends >= {0, 2, 4}  # at two corners; over two edges; straight on


def test_a_function_of_one_variable_is_cut_where_its_slope_is_g():
    # s^2 is steeper than g from s = g/2 on: there the tangent g s - g^2/4 takes over.
    x = np.linspace(-1.0, 1.0, 401)[:, None]
    h = curve_sizes(lambda s: s[:, None], lambda s: s**2, (-1.0, 1.0), x, G)
    size = np.abs(x[:, 0])
    assert_allclose(h, np.where(size < G / 2, size**2, G * size - G**2 / 4), atol=1e-13)


@pytest.mark.parametrize("name", domains.CASES)
def test_marching_converges_to_the_reference(name):
    # Two independent ways to the same sizes.  Exact ones near the sources, whose tips would
    # cost a logarithm; the corners that paths bend at still do.  Spacing 2.07 (1.8) times finer.
    case, means = domains.CASES[name], []
    for n in (700, 5000) if name in ("wall", "window") else (700, 3000):
        mesh, domain = case.make(n)
        _, nodes = domains.point_sources(mesh, case.places, case.sizes)
        exact = case.exact(domain, mesh.points, G, mesh.points[nodes], case.sizes)
        away = np.linalg.norm(mesh.points[:, None] - mesh.points[nodes], axis=2).min(axis=1)
        h0 = np.where(away < (10.0 if mesh.dim == 2 else 20.0), exact, np.inf)
        error = limit_gradient(mesh, h0, G, method="fast-marching") - exact
        assert error.min() > -0.1  # linear interpolation where two fronts meet
        means.append(error.mean())
    assert means[0] < 1.0
    assert means[1] < (0.6 if mesh.dim == 2 else 0.65) * means[0], means


def test_the_tetrahedra_fill_the_box_around_the_window_exactly():
    mesh, (width, lower, upper) = domains.window_box(2000)
    assert (width, lower, upper) == (2.0, (-20.0, -8.0), (10.0, 16.0))
    high, deep = np.subtract(upper, lower)
    wall = 100.0**2 - high * deep
    sides = 6.0 * 100.0**2 - 4.0 * 100.0 * width
    # A cell across the boundary would change the one sum, a crack inside the other.
    surface = sides + 2.0 * wall + 2.0 * width * (high + deep)
    assert_allclose(mesh.measures.sum(), 100.0**3 - width * wall, rtol=1e-12)
    assert_allclose(mesh.boundary().mesh.measures.sum(), surface, rtol=1e-12)
    x, y, z = mesh.points[mesh.cells].mean(axis=1).T
    open_here = (y > lower[0]) & (y < upper[0]) & (z > lower[1]) & (z < upper[1])
    assert ((np.abs(x) > 1.0) | open_here).all()
    corners = [[x, y, z] for x in (-1, 1) for y in (-20, 10) for z in (-8, 16)]
    assert all((mesh.points == corner).all(axis=1).any() for corner in corners)
