"""Which ranks are asked: those whose boxes are near, found without a table of all ranks."""

import numpy as np
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
