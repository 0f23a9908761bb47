"""Morton keys, their order, and the boxes of trees, against plain definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit
from numpy.testing import assert_array_equal

from adaptsize._kernels.ordering import BITS, fill_tiles
from adaptsize._kernels.trees import LEAF, distance_to_box
from adaptsize.background._curve import along_curve, boxes_over


def interleaved(numbers):
    """Return the bits of a few numbers in turn, as in the definition of the curve."""
    return sum(
        ((x >> bit) & 1) << (bit * len(numbers) + d)
        for bit in range(BITS)
        for d, x in enumerate(numbers)
    )


@njit
def distance(boxes, b, axes, box):
    return distance_to_box(boxes, b, axes, box)


@given(st.integers(0, 400), st.integers(1, 3), st.integers(1, BITS), st.integers(0, 2**32 - 1))
def test_points_are_sorted_by_the_bits_of_their_coordinates_in_turn(n, dim, bits, seed):
    numbers = np.random.default_rng(seed).integers(0, 2**bits, (n, dim))
    numbers = np.concatenate([numbers, [[0] * dim, [2**BITS - 1] * dim]])
    keys = np.array([interleaved(row) for row in numbers.tolist()])
    order = along_curve(numbers.astype(float))
    assert order.dtype == np.int32
    assert_array_equal(order, np.argsort(keys, kind="stable"))


@given(st.integers(1, 40), st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_each_box_holds_its_items_and_no_more(m, dim, seed):
    rng = np.random.default_rng(seed)
    lower = rng.random((m, dim))
    upper = lower + rng.random((m, dim)) * rng.integers(0, 2)
    value = rng.random(m)
    n_leaves = 1
    while n_leaves * LEAF < m:
        n_leaves *= 2
    boxes = boxes_over(lower, upper, value)
    assert len(boxes) == 2 * n_leaves
    for b in range(1, 2 * n_leaves):
        first, last = b, b
        while first < n_leaves:
            first, last = 2 * first, 2 * last + 1
        items = slice((first - n_leaves) * LEAF, (last + 1 - n_leaves) * LEAF)
        assert_array_equal(boxes[b, :dim], lower[items].min(axis=0, initial=np.inf))
        assert_array_equal(boxes[b, dim:-1], upper[items].max(axis=0, initial=-np.inf))
        assert boxes[b, -1] == value[items].min(initial=np.inf)


@given(st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_the_distance_of_boxes_is_that_of_their_closest_points(dim, seed):
    rng = np.random.default_rng(seed)
    corners = np.sort(rng.integers(0, 6, (2, 2, dim)), axis=1).astype(float)
    boxes = np.array([[*corners[0].ravel(), 0.0]])
    gap = np.maximum(0.0, np.maximum(corners[0, 0] - corners[1, 1], corners[1, 0] - corners[0, 1]))
    assert distance(boxes, 0, (0,) * dim, corners[1].ravel()) == pytest.approx(
        np.linalg.norm(gap), rel=1e-15
    )


@pytest.mark.parametrize("shape", [(1, 1, 1), (5, 7, 1), (4, 8, 1), (5, 3, 4), (33, 1, 1)])
def test_tiles_number_each_node_once_and_keep_tiles_together(shape):
    tile = (4, 2, 3)
    order = np.full(int(np.prod(shape)), -1, np.int32)
    fill_tiles(shape, tile, order)
    assert_array_equal(np.sort(order), np.arange(len(order)))
    of_tile = np.stack(np.unravel_index(order, shape), axis=1) // tile
    changes = (np.diff(of_tile, axis=0) != 0).any(axis=1)
    assert np.count_nonzero(changes) + 1 == len(np.unique(of_tile, axis=0))


@pytest.mark.parametrize("places", [[0.0, 5e-324], [0.0, 1e-302], [-1e308, 0.0, 1e308]])
def test_points_keep_their_order_where_the_scale_of_keys_overflows(places):
    # Regression: numbers out of the range of the digits, and so writing out of bounds.
    points = np.column_stack([places, np.zeros(len(places))])
    assert_array_equal(along_curve(points), np.arange(len(places)))
