"""Which ranks are asked: those whose boxes are near, found without a table of all ranks."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from adaptsize.background.requests import _nearest_boxes, ranks_within


def table(low, high, boxes):
    """Distances of all boxes to those of all ranks."""
    gaps = np.maximum(boxes[:, 0] - high[:, None], low[:, None] - boxes[:, 1])
    return np.linalg.norm(np.maximum(gaps, 0.0), axis=2)


def some_boxes(rng, n, dim):
    boxes = np.sort(rng.uniform(0.0, 4.0, (n, 2, dim)), axis=1)
    boxes[:, 1] = boxes[:, 0] + 0.3 * (boxes[:, 1] - boxes[:, 0])
    boxes[rng.random(n) < 0.2] = np.inf  # ranks without cells
    boxes[0] = [[0.0] * dim, [1.0] * dim]
    return boxes


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.sampled_from([0, 1, 3000]))
def test_ranks_are_those_of_the_table_of_all_distances(seed, dim, n):
    rng = np.random.default_rng(seed)
    boxes = some_boxes(rng, 30, dim)
    low = rng.uniform(-1.0, 5.0, (n, dim))
    high = low + 0.1 * rng.random((n, dim))
    reach = rng.choice([np.nextafter(0.0, 1.0), 0.2, 1.0], n)
    assert_array_equal(
        ranks_within(low, high, boxes, reach), np.nonzero(table(low, high, boxes) < reach[:, None])
    )
    own = int(rng.integers(30))
    away = table(low, low, boxes)
    expected = np.where(away[:, own] <= away.min(axis=1, initial=np.inf), own, away.argmin(axis=1))
    assert_array_equal(_nearest_boxes(low, boxes, own), expected)


@pytest.mark.parametrize("dim", [2, 3])
def test_memory_does_not_grow_with_the_number_of_ranks(dim):
    """Of 100 000 points of one rank, among 2 and among 4096 ranks side by side."""
    rng = np.random.default_rng(4127)
    points = rng.random((100_000, dim))

    def peak(n_ranks):
        side = round(n_ranks ** (1 / dim))
        corner = np.stack(np.meshgrid(*[np.arange(side)] * dim), axis=-1).reshape(-1, dim)
        boxes = np.stack([corner, corner + 1.0], axis=1).astype(float)
        tracemalloc.start()
        first = _nearest_boxes(points, boxes, 0)
        which, _ = ranks_within(points, points, boxes, np.full(len(points), 1e-3))
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert (first == 0).all()
        assert len(points) <= len(which) < 1.1 * len(points)
        return most

    # A table of all distances has 8 bytes for each of 4e8 pairs.
    assert peak(4096) < 1.2 * peak(2**dim) + 2e6
