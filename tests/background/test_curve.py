"""The order of points along a Morton curve, by any number of threads."""

import numpy as np
import pytest

from adaptsize.background._curve import along_curve
from adaptsize.limiting.exact.candidates import bounds_meet


def slow_order(points):
    """Return the order by keys of 21 bits per axis, those of the first axis lowest."""
    lower, width = points.min(axis=0), np.ptp(points, axis=0).max()
    scale = (2.0**21 - 1.0) / width if width > 0.0 else 0.0
    places = ((points - lower) * scale).astype(np.int64)
    keys = np.zeros(len(points), np.int64)
    for bit in range(21):
        for d in range(points.shape[1]):
            keys |= ((places[:, d] >> bit) & 1) << (bit * points.shape[1] + d)
    return np.argsort(keys, kind="stable")


def spread(rng, n, dim):
    return rng.random((n, dim))


def clustered(rng, n, dim):
    """Return points of which nearly all share the highest bits, and many are equal."""
    points = 1e-5 * np.round(rng.random((n, dim)), 3)
    points[: n // 100] = rng.random((n // 100, dim))
    return points


def in_one_place(_, n, dim):
    return np.full((n, dim), 0.3)


@pytest.mark.parametrize("threads", [1, 2, 3, 8])
@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("make", [spread, clustered, in_one_place])
@pytest.mark.parametrize("n", [1, 1000, 300_000])
def test_order_is_that_of_the_keys_and_then_of_the_numbers(make, dim, threads, n):
    points = make(np.random.default_rng(5117), n, dim)
    np.testing.assert_array_equal(along_curve(points, threads), slow_order(points))


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("meets", [False, True])
def test_bounds_at_two_nodes_of_the_last_cell_meet(meets, threads):
    n = 200_000
    cells = np.column_stack([np.arange(n), np.arange(1, n + 1)]).astype(np.int32)
    h0 = np.full(n + 1, np.inf)
    h0[::2] = 1.0
    h0[-2] = 1.0 if meets else np.inf
    assert bounds_meet(cells, h0, threads) == meets


@pytest.mark.parametrize("flat", [(2,), (0,), (1, 2), (0, 2)])
def test_axes_along_which_all_is_in_one_place_do_not_change_the_order(flat):
    points = np.random.default_rng(19).random((500, 3))
    points[:, flat] = 0.75
    assert np.array_equal(along_curve(points), slow_order(points))
    rest = [d for d in range(3) if d not in flat]
    assert np.array_equal(along_curve(points), along_curve(points[:, rest]))
