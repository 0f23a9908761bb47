"""Kernels of source tracking on grids against brute force."""

import itertools
import math

import numpy as np
import pytest
from scipy.ndimage import distance_transform_cdt

from adaptsize._kernels.track_grid import coordinates, minimum_on_segment
from adaptsize._kernels.visibility_grid import is_visible, measure_clearance
from exact_on_grids import sees

RNG_SEED = 20251


def _padded(active):
    u = np.full([n + 2 for n in active.shape], np.nan)
    u[(slice(1, -1),) * active.ndim][active] = 1.0
    strides = tuple(int(np.prod(u.shape[a + 1 :])) for a in range(u.ndim))
    vectors = [v for v in itertools.product((-1, 0, 1), repeat=u.ndim) if any(v)]
    steps = (np.array(vectors) * strides).sum(axis=1).astype(np.int64)
    clear = np.zeros(u.size, np.uint8)
    measure_clearance(u.ravel(), strides, steps, clear)
    return u.ravel(), strides, clear


@pytest.mark.parametrize(("shape", "share"), [((9, 12), 0.8), ((5, 4, 6), 0.85)])
def test_lines_between_nodes_and_to_edges_are_seen_as_by_definition(shape, share):
    rng = np.random.default_rng(RNG_SEED)
    active = rng.random(shape) < share
    u, strides, clear = _padded(active)
    nodes = np.argwhere(active)
    for start in nodes[::2]:
        k = int((start + 1) @ strides)
        for stop in rng.choice(nodes, 12):
            end = stop.astype(float)
            along = rng.integers(len(shape))
            other = stop.copy()
            other[along] += 1
            if other[along] < shape[along] and active[tuple(other)] and rng.random() < 0.5:
                end[along] += rng.random()
            move = np.zeros(3)
            move[: len(shape)] = end - start
            assert is_visible(u, clear, strides, k, *move) == sees(active, start, end)


@pytest.mark.parametrize("shape", [(30, 41), (9, 12, 14)])
def test_clearance_is_the_chessboard_distance_of_boxes(shape):
    active = np.random.default_rng(RNG_SEED + 1).random(shape) < 0.995
    clear = _padded(active)[2].reshape([n + 2 for n in shape])
    whole = np.ones(clear.shape, bool)
    padded = np.pad(active, 1)
    for corner in itertools.product((0, 1), repeat=len(shape)):
        whole &= np.roll(padded, [-c for c in corner], range(len(shape)))
    assert (clear == distance_transform_cdt(whole, "chessboard")).all()


def test_minimum_on_a_segment_is_that_of_many_samples():
    rng = np.random.default_rng(RNG_SEED + 2)
    share = np.linspace(0.0, 1.0, 2001)
    for _ in range(100):
        w, e = rng.normal(size=(2, 3))
        rise, g = rng.normal() * 0.5, rng.uniform(0.1, 1.0)
        value, t = minimum_on_segment(*w, *e, 2.0, rise, g)
        sampled = 2.0 + share * rise + g * np.linalg.norm(w - share[:, None] * e, axis=1)
        assert value <= sampled.min() + 1e-14
        at = 2.0 + t * rise + g * math.dist(w, t * e)
        assert at == pytest.approx(value, abs=1e-14)


def test_coordinates_of_padded_nodes_are_exact_up_to_the_largest_grid():
    strides = (46342, 1)
    per_stride = tuple(1.0 / s for s in strides)
    for row, column in [(0, 0), (1, 0), (46340, 46341), (46339, 0), (7, 46341)]:
        found = coordinates(row * strides[0] + column, strides, per_stride)
        assert found == (row, column, 0)
