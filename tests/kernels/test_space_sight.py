"""What walls hide in space, and which boxes a shaft meets, against arithmetic of whole numbers."""

from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pytest
from numba import njit

from adaptsize._kernels import space_relay, space_sight, trees
from adaptsize._kernels.space_sight import CACHED
from adaptsize.limiting.exact.obstacles_in_space import build_sight, measure_facets

SLACK = 1e-9


class Scratch(NamedTuple):
    active: np.ndarray
    cached: np.ndarray
    shaft: np.ndarray
    stack: np.ndarray


class Near(NamedTuple):
    near: np.ndarray


class Sizes(NamedTuple):
    sizes: np.ndarray


class Found(NamedTuple):
    sizes: np.ndarray
    path: np.ndarray
    last: np.ndarray


@njit
def without_hidden(walls, a, b, m, block):
    return space_sight.without_hidden(walls, a, b, m, block)


@njit
def meets(boxes, a, b, which, axes, slack, shaft):
    trees.set_shaft(a, b, which, len(which), axes, slack, shaft)
    return trees._meets_shaft(boxes, 0, (shaft, axes))


@njit
def along_edges(relay, points, field, x, path, g, start, count, block):
    space_relay._along_edges(relay, points, field, x, path, g, start, count, block)


def volumes(a, b, c, d):
    """Return six times the volumes of tetrahedra with corners of whole numbers."""
    return np.einsum("...i,...i", np.cross(b - a, c - a), d - a)


def hidden(triangles, a, b):
    """Return whether a triangle has a and b strictly on either side, and meets the line."""
    p, q, r = triangles.transpose(1, 0, 2)
    apart = np.sign(volumes(p, q, r, a)) * np.sign(volumes(p, q, r, b)) < 0
    turns = np.stack([volumes(a, b, *ends) for ends in ((p, q), (q, r), (r, p))])
    return bool((apart & ((turns >= 0).all(axis=0) | (turns <= 0).all(axis=0))).any())


def random_walls(rng, n):
    """Return triangles that have an area, int64[n, 3, 3]."""
    while True:
        found = rng.integers(0, 7, (n, 3, 3))
        if np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0]).any(axis=1).all():
            return found


def test_points_are_left_that_no_triangle_hides_from_theirs():
    rng, n_hidden, n_seen = np.random.default_rng(2711), 0, 0
    for n in (1, 2, 5, 9, 20, 40) * 8:
        triangles = random_walls(rng, n)
        points, facets = triangles.reshape(-1, 3).astype(float), np.arange(3 * n).reshape(n, 3)
        facets = facets.astype(np.int32)
        shapes = measure_facets(points, facets)
        walls = build_sight(points, np.empty((0, 4), np.int32), facets, shapes).walls
        cached = np.full(CACHED, -1)
        for _ in range(4):  # walls that have hidden points are tried first
            m = int(rng.integers(1, 9))
            a = rng.integers(0, 7, (m, 3)) // rng.choice([1, 2], 2)[0]
            b = rng.integers(0, 7, (m, 3))
            if rng.random() < 0.5:
                a[:] = a[0]
            expected = [i for i in range(m) if not hidden(triangles, a[i], b[i])]
            block = Scratch(np.arange(m), cached, np.empty(18), np.empty((2, trees.DEPTH), int))
            ends = [np.ascontiguousarray(x.T, dtype=float) for x in (a, b)]
            left = without_hidden(walls, *ends, m, block)
            assert block.active[:left].tolist() == expected
            n_hidden, n_seen = n_hidden + m - left, n_seen + left
            used = cached[cached >= 0]
            assert (cached[len(used) :] < 0).all()
            assert len(set(used.tolist())) == len(used)
    assert min(n_hidden, n_seen) > 200


def overlap(low, high, a, b):
    """Return whether a box meets one of those between the boxes of two sets of points."""
    begin, end = Fraction(0), Fraction(1)
    for d in range(len(low)):
        for at, to in (  # at + t (to - at) <= 0
            (int(a[d].min() - high[d]), int(b[d].min() - high[d])),
            (int(low[d] - a[d].max()), int(low[d] - b[d].max())),
        ):
            if to == at:
                if at > 0:
                    return False
                continue
            time = Fraction(-at, to - at)
            begin, end = (begin, min(end, time)) if to > at else (max(begin, time), end)
    return begin <= end


@pytest.mark.parametrize("dim", [2, 3])
def test_a_shaft_meets_the_boxes_between_its_ends_and_no_others(dim):
    rng, n_met = np.random.default_rng(2712), 0
    for _ in range(1500):
        m = int(rng.integers(1, 4))
        a, b = rng.integers(0, 7, (2, dim, m))
        for d in np.flatnonzero(rng.random(dim) < 0.3):
            b[d] = a[d]  # sides that rest
        low = rng.integers(-1, 8, dim)
        high = low + rng.integers(0, 3, dim)
        boxes = np.concatenate([low, high, [0.0]])[None]
        given = (boxes, a.astype(float), b.astype(float), np.arange(m), (0,) * dim, SLACK)
        found = meets(*given, np.empty(6 * dim))
        assert found == overlap(low, high, a, b)
        n_met += found
    assert 200 < n_met < 1300
    empty = np.concatenate([np.full(dim, np.inf), np.full(dim, -np.inf), [np.inf]])[None]
    assert not meets(empty, *given[1:], np.empty(6 * dim))


def test_paths_along_edges_lower_neighbours_and_turn_at_the_node():
    rng = np.random.default_rng(2713)
    points, sizes = rng.random((30, 3)), rng.random(30)
    near = rng.permutation(30)[:12]
    start, count, x, g = 4, 7, int(near[0]), 0.7
    beside = near[start : start + count]
    value = sizes[x] + g * np.linalg.norm(points[beside] - points[x], axis=1)
    known = value * rng.choice([0.9, 1.0, 1.1], count)
    found = Found(known.copy(), np.full(count, -1), np.full((3, count), np.nan))
    along_edges(Near(near), points, Sizes(sizes), x, 5, g, start, count, found)
    lowered = known > 1.05 * value
    assert 0 < lowered.sum() < count
    same = known < 0.95 * value
    np.testing.assert_allclose(found.sizes, np.where(same, known, value), rtol=1e-14)
    assert (found.path[lowered] == 5).all()
    assert (found.last.T[lowered] == points[x]).all()
    assert (found.path[same] == -1).all()
    assert np.isnan(found.last.T[same]).all()
