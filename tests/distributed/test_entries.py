"""A rank sends the entries that may lower a size of the other rank, and no others."""

import numpy as np
import pytest

from adaptsize._kernels.exact_plane import COLUMNS, CORNER
from adaptsize.distributed.entries import entries_in_reach, of_this_rank, reach_of
from adaptsize.limiting.exact.waves import node_wave, wave_at
from adaptsize.limiting.exact.work import along_curve


def _slow(wave, boxes, g):
    """Compare all entries with all boxes."""
    dim = wave.nodes.shape[1]
    low, high = wave.places.min(axis=1), wave.places.max(axis=1)
    lower, upper, largest = np.split(boxes, [dim, 2 * dim], axis=1)
    gap = np.maximum(np.maximum(lower - high[:, None], low[:, None] - upper), 0.0)
    allowed = wave.sizes.min(axis=1)[:, None] + g * np.linalg.norm(gap, axis=2)
    return np.flatnonzero((allowed < largest[:, 0]).any(axis=1))


@pytest.mark.parametrize("g", [0.0, 0.3, 2.0])
@pytest.mark.parametrize("n_vertices", [1, 2, 3])
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_entries_in_reach_are_those_of_the_definition(dim, n_vertices, g):
    rng = np.random.default_rng(880)
    counts = []
    for n, pieces in ((0, 3), (1, 5), (5, 1), (700, 0), (700, 1), (700, 40)):
        points, sizes = rng.random((n, dim)), rng.uniform(0.1, 1.0, n)
        named = np.full((n, dim), -1, np.int32)
        k = min(n_vertices, dim)
        if n:
            named[:, :k] = rng.integers(0, n, (n, k))
        wave = wave_at(points, sizes, named)
        others = rng.uniform(-0.2, 1.2, (pieces, dim))
        boxes = reach_of(others, along_curve(others), rng.uniform(0.05, 0.4, pieces))
        found = entries_in_reach(wave, boxes, g)
        assert np.array_equal(found, _slow(wave, boxes, g))
        counts.append(len(found))
    assert counts[3] == 0
    assert 0 < counts[5] < 700


def test_all_entries_are_in_reach_of_a_rank_without_bounds_but_of_none_without_nodes():
    rng = np.random.default_rng(881)
    points = rng.random((50, 2))
    wave = node_wave(points, rng.random(50), np.arange(50, dtype=np.int32))
    far = points + 1e6
    boxes = reach_of(far, along_curve(far), np.full(50, np.inf))
    assert len(entries_in_reach(wave, boxes, 0.3)) == 50
    assert len(entries_in_reach(wave, reach_of(far, np.empty(0, np.int32), np.ones(50)), 0.3)) == 0


def test_boxes_hold_the_nodes_and_their_sizes():
    rng = np.random.default_rng(882)
    points, h = rng.random((100, 3)), rng.random(100)
    boxes = reach_of(points, along_curve(points), h)
    inside = ((points[:, None] >= boxes[:, :3]) & (points[:, None] <= boxes[:, 3:6])).all(axis=2)
    assert len(boxes) == 16
    assert (inside & (h[:, None] <= boxes[:, 6])).any(axis=1).all()


def test_corners_and_sources_between_the_nodes_are_not_sent():
    rng = np.random.default_rng(883)
    wave = node_wave(rng.random((9, 2)), np.full(9, 0.1), np.arange(9, dtype=np.int32))
    assert of_this_rank(wave, 9) is wave
    kept = of_this_rank(wave, 6)
    assert sorted(kept.nodes[:, 0]) == list(range(6))
    whole = np.array([[0.0, 0.0, 1.0, 1.0, 1.0]])
    assert np.array_equal(entries_in_reach(kept, whole, 0.3), np.arange(6))
    table = np.zeros((9, COLUMNS))
    table[:, :6] = wave.table
    table[4, CORNER] = 1.0
    kept = of_this_rank(wave._replace(table=table), 9)
    assert np.array_equal(kept.nodes, np.delete(wave.nodes, 4, axis=0))
