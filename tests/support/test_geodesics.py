"""The reference of limited sizes (`geodesics`), against closed forms, minimization and marching.

In the plane it is compared with the other one, `exact_oracle`, in limiting/exact.
"""

from itertools import pairwise
from math import dist

import domains
import numpy as np
import pytest
from geodesics import (
    contains,
    curve_sizes,
    distances,
    limited_sizes,
    prism_sizes,
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


def test_around_a_round_hole_paths_follow_it():
    # Opposite points at twice the radius: two tangents and the arc in between; the
    # polygon of n corners is shorter by its share, (pi/n)^2/6 of the arc, and no more.
    radius, n = 10.0, 400
    angle = -2.0 * np.pi * np.arange(n) / n
    hole = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    d = distances((SQUARE, hole), [-20.0, 0.0], np.array([[20.0, 0.0]]))[0]
    arc = radius * (np.pi - 2.0 * np.arccos(0.5))
    smooth = 2.0 * np.sqrt(300.0) + arc
    assert smooth - arc * (np.pi / n) ** 2 < d < smooth


def test_over_a_wall_the_bends_are_where_the_sum_of_lengths_is_least():
    rings = (domains.slit_polygon(2.0, 0.0),)
    rng = np.random.default_rng(63)
    a = np.column_stack([rng.uniform(-40, -2, 8), rng.uniform(5, 45, 8), rng.uniform(-40, 40, 8)])
    b = np.column_stack([rng.uniform(2, 40, 8), rng.uniform(5, 45, 8), rng.uniform(-40, 40, 8)])
    for source, x in zip(a, b, strict=True):

        def along(z, source=source, x=x):
            return length(source, np.array([-1.0, 0.0, z[0]]), np.array([1.0, 0.0, z[1]]), x)

        brute = minimize(along, [source[2], x[2]], method="Nelder-Mead", options={"xatol": 1e-8})
        exact = prism_sizes(rings, x[None], 1.0, source[None], [0.0])[0]
        assert exact <= brute.fun * (1.0 + 1e-14)
        assert_allclose(exact, brute.fun, rtol=1e-9)


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


def test_a_window_as_high_as_the_wall_is_a_slit():
    # Seen from far within its height only the edges along z count: those of a slab with a gap.
    rings = (domains.slit_polygon(2.0, 0.0),)
    a, b = beside_the_wall(3, 71, -1.0), beside_the_wall(50, 72, 1.0)
    window = (2.0, (-1e6, -1e6), (0.0, 1e6))
    for source in a:
        assert_allclose(
            window_sizes(window, b, G, source[None], [1.0]),
            prism_sizes(rings, b, G, source[None], [1.0]),
            rtol=1e-12,
        )


@pytest.mark.parametrize("rise", [0.0, 2.0, -2.0, 20.0])
def test_a_segment_is_the_limit_of_its_points(rise):
    # 20 over a length of 40 is steeper than G: then the lower end alone counts.
    _, rings = domains.star_holes(500)
    x = some_points(rings, 200, 60)
    segment, sizes = np.array([[-45.0, -40.0], [-45.0, 0.0]]), np.array([5.0, 5.0 + rise])
    share = np.linspace(0.0, 1.0, 401)[:, None]
    dense = limited_sizes(
        rings,
        x,
        G,
        sources=segment[0] + share * (segment[1] - segment[0]),
        sizes=sizes[0] + share[:, 0] * rise,
    )
    exact = limited_sizes(rings, x, G, segments=segment[None], segment_sizes=sizes[None])
    assert (exact <= dense + 1e-13).all()
    # Points 0.1 apart: at distance D off by up to G 0.05^2/(2D) and, at no distance, G 0.05.
    # D is that of x, or of the corner at which the path to it bends first: those are 8 off.
    off = np.minimum(np.abs(x[:, 0] + 45.0), 8.0 - 1e-9)
    assert (dense - exact <= G * 0.05 / np.maximum(1.0, 2.0 * off / 0.05) + 1e-13).all()


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
