"""Entries in reach of boxes are those of the definition, by comparing all with all."""

import numpy as np
import pytest

from adaptsize.background._curve import along_curve
from adaptsize.limiting.exact.exchange import entries_in_reach, reach_of
from adaptsize.limiting.exact.field import entries_at


def _slow(entries, boxes, g):
    """Compare all entries with all boxes."""
    dim = entries.nodes.shape[1]
    low, high = entries.places.min(axis=1), entries.places.max(axis=1)
    lower, upper, largest = np.split(boxes, [dim, 2 * dim], axis=1)
    gap = np.maximum(np.maximum(lower - high[:, None], low[:, None] - upper), 0.0)
    allowed = entries.sizes.min(axis=1)[:, None] + g * np.linalg.norm(gap, axis=2)
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
        entries = entries_at(points, sizes, named)
        others = rng.uniform(-0.2, 1.2, (pieces, dim))
        boxes = reach_of(others, along_curve(others), rng.uniform(0.05, 0.4, pieces))
        found = entries_in_reach(entries, boxes, g)
        assert np.array_equal(found, _slow(entries, boxes, g))
        counts.append(len(found))
    assert counts[3] == 0
    assert 0 < counts[5] < 700
