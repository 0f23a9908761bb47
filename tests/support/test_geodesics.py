"""What sees what, and shortest paths in the plane, against closed forms and brute force."""

from itertools import pairwise

import domains
import numpy as np
import pytest
from geodesics import (
    area,
    contains,
    distances,
    perimeter,
    reflex_corners,
    sees,
)
from numpy.testing import assert_allclose

SQUARE = np.array([[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]])
BLOCK = np.array([[-5.0, -10.0], [-5.0, 10.0], [5.0, 10.0], [5.0, -10.0]])  # clockwise: a hole


def some_points(rings, n, seed):
    points = np.random.default_rng(seed).uniform(-50.0, 50.0, (3 * n, 2))
    return points[contains(rings, points)][:n]


def length(*places):
    return sum(np.linalg.norm(b - a, axis=-1) for a, b in pairwise(places))


# ---------------------------------------------------------------- what sees what


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


def test_sight_agrees_with_many_points_along_the_line():
    for name in ("star holes", "maze", "round holes"):
        _, rings = domains.CASES[name].make(500)
        a, b = some_points(rings, 300, 51), some_points(rings, 300, 52)
        share = np.linspace(0.0, 1.0, 1501)[:, None, None]
        on_line = (a + share * (b - a)).reshape(-1, 2)
        inside = contains(rings, on_line).reshape(1501, -1).all(axis=0)
        visible = sees(rings, a, b)
        assert (inside >= visible).all(), name
        # Steps are up to 0.1 long: a few lines cut less than that off a corner.
        assert (inside != visible).sum() <= 6, name
        assert 30 < visible.sum() < 270, name


def test_points_inside_are_those_with_an_odd_winding():
    _, rings = domains.star_holes(500)
    points = np.random.default_rng(53).uniform(-60.0, 60.0, (2000, 2))
    winding = np.zeros(2000)
    for ring in rings:
        to = ring - points[:, None]
        following = np.roll(to, -1, axis=1)
        cross = to[..., 0] * following[..., 1] - to[..., 1] * following[..., 0]
        winding += np.arctan2(cross, (to * following).sum(axis=2)).sum(axis=1)
    assert (contains(rings, points) == (np.round(winding / (2.0 * np.pi)) == 1)).all()
    assert all(contains(rings, ring).all() for ring in rings)


def test_reflex_corners_are_those_that_paths_bend_at():
    assert_allclose(reflex_corners((SQUARE, BLOCK)), BLOCK)
    assert len(reflex_corners((SQUARE,))) == 0
    _, rings = domains.star_holes(500)
    assert len(reflex_corners(rings)) == 7 + 6 + 9
    assert_allclose(area((SQUARE, BLOCK)), 10_000.0 - 200.0)
    assert_allclose(perimeter((SQUARE, BLOCK)), 400.0 + 60.0)


# ---------------------------------------------------------------- shortest paths


def test_around_a_block_over_the_shorter_side():
    source = np.array([-30.0, 2.0])
    x = np.column_stack([np.linspace(6.0, 50.0, 200), np.linspace(-9.0, 9.0, 200)])  # all hidden
    up, down = BLOCK[[1, 2]], BLOCK[[0, 3]]
    expected = np.minimum(
        length(source, *up, x),
        length(source, *down, x),
    )
    assert_allclose(distances((SQUARE, BLOCK), source, x), expected, rtol=1e-14)


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


def test_through_a_winding_corridor():
    # Around the ends of the four walls in turn, each 2 thick, and half-way past the T.
    _, rings = domains.maze(500)
    source, end = np.array([-40.0, -10.0]), np.array([32.0, -40.0])
    before = np.array([(-31, -30), (-29, -30), (-11, 30), (-9, 30)], float)
    after = np.array([(9, -30), (11, -30), (29, 30), (31, 30)], float)
    free = length(source, *before, *after, end)
    assert_allclose(distances(rings[:1], source, end[None])[0], free, rtol=1e-14)
    left_of_it, right_of_it = np.array([(-6, 9), (-1, -15)]), np.array([(5, 11), (5, 9)])
    least = min(length(source, *before, *way, *after, end) for way in (left_of_it, right_of_it))
    assert_allclose(distances(rings, source, end[None])[0], least, rtol=1e-14)
    assert least > free + 1.0


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


@pytest.mark.parametrize("name", ["slit", "star holes", "maze", "round holes"])
def test_the_distance_is_a_metric_no_shorter_than_the_line(name):
    _, rings = domains.CASES[name].make(500)
    x = some_points(rings, 20, 55)
    d = np.array([distances(rings, source, x) for source in x])
    straight = np.linalg.norm(x[:, None] - x, axis=2)
    assert_allclose(d, d.T, rtol=1e-13)
    assert (np.diagonal(d) == 0.0).all()
    assert (d >= straight * (1.0 - 1e-14)).all()
    assert (d > straight * 1.001).mean() > 0.05  # some paths do bend
    assert (d[:, :, None] + d[None] >= d[:, None] * (1.0 - 1e-13)).all()  # d_ij + d_jk >= d_ik


def test_with_fewer_obstacles_paths_are_no_longer():
    _, rings = domains.round_holes(500)
    x, source = some_points(rings, 200, 56), np.array([-48.0, -45.0])
    longer = distances(rings, source, x)
    for n_rings in range(len(rings) - 1, 0, -1):
        d = distances(rings[:n_rings], source, x)
        assert (d <= longer * (1.0 + 1e-14)).all()
        longer = d
    assert_allclose(longer, np.linalg.norm(x - source, axis=1), rtol=1e-15)  # none is left


def test_shortest_paths_agree_with_a_fine_graph_of_points():
    # The slow twin knows neither corners nor crossings: steps of up to 10 between random
    # points, allowed where 40 points in between lie inside.  Paths get longer by bends only.
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra
    from scipy.spatial import cKDTree

    _, rings = domains.star_holes(500)
    x = some_points(rings, 1500, 57)
    i, j = cKDTree(x).query_pairs(10.0, output_type="ndarray").T
    share = np.linspace(0.0, 1.0, 42)[1:-1, None, None]
    between = (x[i] + share * (x[j] - x[i])).reshape(-1, 2)
    free = contains(rings, between).reshape(40, -1).all(axis=0)
    steps = np.linalg.norm(x[i] - x[j], axis=1)[free]
    graph = coo_matrix((steps, (i[free], j[free])), shape=(len(x), len(x)))
    rough = dijkstra(graph, directed=False, indices=0)
    d = distances(rings, x[0], x)
    far = d > 10.0
    # 0.02 is room for corners that a step cuts between two of its 40 points.
    assert (rough > d - 0.02)[far].all()
    # A few points sit at the bottom of a narrow valley, which the graph hardly enters.
    assert np.median(rough[far] / d[far]) < 1.02
    assert np.quantile(rough[far] / d[far], 0.98) < 1.1
