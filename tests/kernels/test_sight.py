"""What walls hide, against exact arithmetic of whole numbers."""

from typing import NamedTuple

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from adaptsize._kernels import sight
from adaptsize._kernels.sight import CACHED, LEFT, RIGHT, Sight
from adaptsize._kernels.trees import DEPTH
from adaptsize.background._curve import boxes_over

SLACK = 1e-9
coordinate = st.integers(0, 6)
point = st.tuples(coordinate, coordinate)


class Rays(NamedTuple):
    origins: np.ndarray
    sides: np.ndarray
    which: np.ndarray
    stack: np.ndarray
    shaft: np.ndarray
    cached: np.ndarray


@njit
def hides(wall, a, b, side, slack):
    return sight.hides(wall, a, b, side, slack)


@njit
def without_hidden(sight_, x, rays, m):
    return sight.without_hidden(sight_, x, rays, m)


def turn(a, b, c):
    """Return twice the area of a triangle."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def separates(p, q, a, b):
    """Return whether a and b are strictly on either side of the closed wall pq that they cross."""
    return turn(p, q, a) * turn(p, q, b) < 0 and turn(a, b, p) * turn(a, b, q) <= 0


def as_walls(segments):
    ends = np.array(segments, float).reshape(-1, 4)
    lower, upper = np.minimum(ends[:, :2], ends[:, 2:]), np.maximum(ends[:, :2], ends[:, 2:])
    boxes = boxes_over(lower, upper, np.zeros(len(ends)))
    return Sight(ends, boxes, np.zeros(1, np.int32), np.zeros((0, 5)), SLACK)


def visible(walls, x, origins, cached=None):
    """Return which of the points are left that see their origins."""
    n = len(x)
    which, sides = np.arange(n), np.full(n, LEFT + RIGHT)
    cached = np.full(CACHED, -1) if cached is None else cached
    places = [np.array(rows, float).reshape(n, 2).T.copy() for rows in (x, origins)]
    rays = Rays(places[1], sides, which, np.empty(DEPTH, np.int64), np.empty(12), cached)
    m = without_hidden(walls, places[0], rays, n)
    return which[:m].tolist()


def is_hidden(p, q, a, b, side):
    a, b = (tuple(map(float, x)) for x in (a, b))
    return hides(np.array([*p, *q], float), a, b, side, SLACK)


@given(point, point, point, point)
def test_a_wall_hides_what_is_strictly_on_either_side_of_it(p, q, a, b):
    assert is_hidden(p, q, a, b, LEFT + RIGHT) == separates(p, q, a, b)


@given(point, point, point, point)
def test_a_wall_that_touches_from_the_other_side_hides_nothing(p, q, a, b):
    expected = separates(p, q, a, b)
    left = expected and max(turn(a, b, p), turn(a, b, q)) > 0
    right = expected and min(turn(a, b, p), turn(a, b, q)) < 0
    assert is_hidden(p, q, a, b, LEFT) == left
    assert is_hidden(p, q, a, b, RIGHT) == right


@given(
    st.lists(st.tuples(point, point), min_size=1, max_size=30),
    st.lists(st.tuples(point, point), min_size=1, max_size=8),
)
def test_points_are_left_that_no_wall_hides_from_their_feet(segments, pairs):
    expected = [
        i for i, (a, b) in enumerate(pairs) if not any(separates(p, q, a, b) for p, q in segments)
    ]
    cached = np.full(CACHED, -1)
    for _ in range(2):  # with and without walls that have hidden points before
        assert visible(as_walls(segments), *zip(*pairs, strict=True), cached) == expected
