"""The entries that a rank sends, and the boxes by which it chooses them."""

import numpy as np

from adaptsize._kernels.exact_plane import COLUMNS, CORNER
from adaptsize.background._curve import along_curve
from adaptsize.limiting.exact.field import node_entries
from adaptsize.limiting.in_parts.entries import entries_in_reach, of_this_rank, reach_of


def test_all_entries_are_in_reach_of_a_rank_without_bounds_but_of_none_without_nodes():
    rng = np.random.default_rng(881)
    points = rng.random((50, 2))
    entries = node_entries(points, rng.random(50), np.arange(50, dtype=np.int32))
    far = points + 1e6
    boxes = reach_of(far, along_curve(far), np.full(50, np.inf))
    assert len(entries_in_reach(entries, boxes, 0.3)) == 50
    assert (
        len(entries_in_reach(entries, reach_of(far, np.empty(0, np.int32), np.ones(50)), 0.3)) == 0
    )


def test_boxes_hold_the_nodes_and_their_sizes():
    rng = np.random.default_rng(882)
    points, h = rng.random((100, 3)), rng.random(100)
    boxes = reach_of(points, along_curve(points), h)
    inside = ((points[:, None] >= boxes[:, :3]) & (points[:, None] <= boxes[:, 3:6])).all(axis=2)
    assert len(boxes) == 16
    assert (inside & (h[:, None] <= boxes[:, 6])).any(axis=1).all()


def test_corners_and_sources_between_the_nodes_are_not_sent():
    rng = np.random.default_rng(883)
    entries = node_entries(rng.random((9, 2)), np.full(9, 0.1), np.arange(9, dtype=np.int32))
    assert of_this_rank(entries, 9) is entries
    kept = of_this_rank(entries, 6)
    assert sorted(kept.nodes[:, 0]) == list(range(6))
    whole = np.array([[0.0, 0.0, 1.0, 1.0, 1.0]])
    assert np.array_equal(entries_in_reach(kept, whole, 0.3), np.arange(6))
    table = np.zeros((9, COLUMNS))
    table[:, :6] = entries.table
    table[4, CORNER] = 1.0
    kept = of_this_rank(entries._replace(table=table), 9)
    assert np.array_equal(kept.nodes, np.delete(entries.nodes, 4, axis=0))
