"""Shortest paths over a wall and through a window, against minimization."""

from itertools import pairwise
from math import dist

import domains
import numpy as np
from geodesics import (
    prism_sizes,
    window_sizes,
)
from numpy.testing import assert_allclose
from scipy.optimize import minimize

G = 0.3


def length(*places):
    return sum(np.linalg.norm(b - a, axis=-1) for a, b in pairwise(places))


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


def test_past_the_wall_lines_are_straight():
    rings = (domains.slit_polygon(2.0, 0.0),)
    x = np.random.default_rng(64).uniform(-50.0, 0.0, (100, 3))  # y < 0
    source = np.array([[30.0, -20.0, 40.0]])
    assert_allclose(
        prism_sizes(rings, x, G, source, [2.0]),
        2.0 + G * np.linalg.norm(x - source, axis=1),
        rtol=1e-14,
    )


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


def test_lengths_through_a_window_are_a_metric():
    x = np.concatenate([beside_the_wall(5, 68, -1.0), beside_the_wall(5, 69, 1.0)])
    d = np.array([window_sizes(WINDOW, x, 1.0, a[None], [0.0]) for a in x])
    straight = np.linalg.norm(x[:, None] - x, axis=2)
    assert_allclose(d, d.T, rtol=1e-13)
    assert (d >= straight * (1.0 - 1e-14)).all()
    assert (d[:5, :5] == straight[:5, :5]).all()
    assert (d[:5, 5:] > 1.001 * straight[:5, 5:]).mean() > 0.3
    assert (d[:, :, None] + d[None] >= d[:, None] * (1.0 - 1e-13)).all()
    # Over a point within the window no path is shorter, and none is but through some such point.
    inside = np.random.default_rng(70).uniform((-1, -20, -8), (1, 10, 16), (5000, 3))
    to_left, to_right = (
        np.array([window_sizes(WINDOW, inside, 1.0, a[None], [0.0]) for a in some])
        for some in (x[:5], x[5:])
    )
    over = (to_left[:, None] + to_right).min(axis=2)
    assert (over >= d[:5, 5:] * (1.0 - 1e-13)).all()
    assert (over <= d[:5, 5:] + 1.0).all()


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
