"""What walls hide, against exact arithmetic of whole numbers."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from adaptsize._kernels import sight
from adaptsize._kernels.sight import LEFT, MANY, NARROW, RIGHT, WIDE, Walls
from adaptsize._kernels.trees import DEPTH
from adaptsize.limiting.exact.work import boxes_over

SLACK = 1e-9
coordinate = st.integers(0, 6)
point = st.tuples(coordinate, coordinate)


@njit
def hides(ends, w, ax, ay, bx, by, side, slack):
    return sight.hides(ends, w, ax, ay, bx, by, side, slack)


@njit
def is_hidden(walls, ax, ay, bx, by, side, stack):
    return sight.is_hidden(walls, ax, ay, bx, by, side, stack)


@njit
def find_walls(walls, source, target, planes, stack, found):
    return sight.find_walls(walls, source, target, planes, stack, found)


@njit
def side_in_cone(cones, kinds, k, dx, dy, slack):
    return sight.side_in_cone(cones, kinds, k, dx, dy, slack)


def turn(a, b, c):
    """Return twice the area of a triangle."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def separates(p, q, a, b):
    """Return whether a and b are strictly on either side of the closed wall pq that they cross."""
    return turn(p, q, a) * turn(p, q, b) < 0 and turn(a, b, p) * turn(a, b, q) <= 0


def as_walls(segments):
    ends = np.array(segments, float).reshape(-1, 4)
    lower, upper = np.minimum(ends[:, :2], ends[:, 2:]), np.maximum(ends[:, :2], ends[:, 2:])
    return Walls(ends, *boxes_over(lower, upper, np.zeros(len(ends))), SLACK)


def seen_walls(walls, source, target):
    found = np.empty(MANY, np.int32)
    count = find_walls(walls, source, target, np.empty((8, 3)), np.empty(DEPTH, np.int64), found)
    return count, found[: max(count, 0)].tolist()


@given(point, point, point, point)
def test_a_wall_hides_what_is_strictly_on_either_side_of_it(p, q, a, b):
    ends = np.array([[*p, *q]], float)
    assert hides(ends, 0, *map(float, a + b), LEFT + RIGHT, SLACK) == separates(p, q, a, b)


@given(point, point, point, point)
def test_a_wall_that_touches_from_the_other_side_hides_nothing(p, q, a, b):
    ends = np.array([[*p, *q]], float)
    expected = separates(p, q, a, b)
    left = expected and max(turn(a, b, p), turn(a, b, q)) > 0
    right = expected and min(turn(a, b, p), turn(a, b, q)) < 0
    assert hides(ends, 0, *map(float, a + b), LEFT, SLACK) == left
    assert hides(ends, 0, *map(float, a + b), RIGHT, SLACK) == right


@given(st.lists(st.tuples(point, point), min_size=1, max_size=30), point, point)
def test_the_tree_finds_what_any_of_the_walls_hides(segments, a, b):
    expected = any(separates(p, q, a, b) for p, q in segments)
    walls = as_walls(segments)
    stack = np.empty(DEPTH, np.int64)
    assert is_hidden(walls, *map(float, a + b), LEFT + RIGHT, stack) == expected


@given(
    st.lists(st.tuples(point, point), min_size=1, max_size=30),
    st.lists(point, min_size=1, max_size=4),
    st.lists(point, min_size=1, max_size=4),
)
def test_a_shaft_meets_all_walls_between_its_boxes(segments, sources, targets):
    boxes = [np.array([*np.min(x, axis=0), *np.max(x, axis=0)], float) for x in (sources, targets)]
    count, found = seen_walls(as_walls(segments), *boxes)
    for a in sources:
        for b in targets:
            hiding = [w for w, (p, q) in enumerate(segments) if separates(p, q, a, b)]
            if count < 0:
                assert hiding
            else:
                assert set(hiding) <= set(found)


def test_a_wall_that_cuts_the_shaft_hides_all_at_once_and_one_beside_it_nothing():
    source, target = np.array([0.0, 0.0, 1.0, 1.0]), np.array([4.0, 0.0, 5.0, 1.0])
    assert seen_walls(as_walls([((3, -1), (3, 2))]), source, target) == (-1, [])
    assert seen_walls(as_walls([((3, -1), (3, 0.5))]), source, target) == (1, [0])
    assert seen_walls(as_walls([((3, 1.5), (3, 2))]), source, target) == (0, [])


def test_a_shaft_between_boxes_askew_is_narrower_than_the_box_around_both():
    source, target = np.array([0.0, 0.0, 1.0, 1.0]), np.array([8.0, 8.0, 9.0, 9.0])
    assert seen_walls(as_walls([((1, 7), (2, 8))]), source, target) == (0, [])
    assert seen_walls(as_walls([((4, 4), (5, 4.5))]), source, target) == (1, [0])


@given(st.integers(0, 359), st.integers(1, 359), st.integers(0, 359))
def test_directions_in_cones(start, opening, direction):
    if opening == 180:
        opening = 179
    ends = np.radians([start, start + opening])
    cone = np.array([[np.cos(ends[0]), np.sin(ends[0]), np.cos(ends[1]), np.sin(ends[1])]])
    kinds = np.array([WIDE if opening > 180 else NARROW], np.int8)
    angle = (direction - start) % 360
    dx, dy = np.cos(np.radians(direction)), np.sin(np.radians(direction))
    expected = LEFT + RIGHT if 0 < angle < opening else 0
    if angle == 0:
        expected = LEFT
    if angle == opening:
        expected = RIGHT
    assert side_in_cone(cone, kinds, 0, dx, dy, SLACK) == expected
