"""Points closer than a distance are one, wherever they lie."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from adaptsize.background.merging import place_numbers


def chains(points, within):
    """Number places by flooding: the slow twin."""
    near = np.linalg.norm(points[:, None] - points, axis=2) <= within
    number = np.full(len(points), -1)
    for i in range(len(points)):
        if number[i] < 0:
            number[i] = number.max() + 1
            reached = [i]
            while reached:
                k = reached.pop()
                for j in np.flatnonzero(near[k] & (number < 0)):
                    number[j] = number[i]
                    reached.append(j)
    return number


@pytest.mark.parametrize("scale", [1.0, 1e-150, 1e150])
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_places_are_the_chains_of_near_points(dim, scale):
    rng = np.random.default_rng(81_001 + dim)
    points = rng.random((120, dim))
    points[60:90] = points[rng.integers(0, 60, 30)]  # some are equal
    for within in (0.0, 0.01, 0.05, 2.0):
        expected = chains(points, within)
        assert_array_equal(place_numbers(scale * points, scale * within), expected)


def test_many_points_at_one_place_take_no_time():
    points = np.zeros((200_000, 2))
    points[-1] = 1.0
    assert place_numbers(points, 1e-9)[[0, 1, -2, -1]].tolist() == [0, 0, 0, 1]


@pytest.mark.parametrize("n", [0, 1])
def test_no_point_and_one_point(n):
    assert place_numbers(np.zeros((n, 3)), 1.0).tolist() == [0] * n


def test_points_far_away_do_not_overflow():
    points = np.array([[0.0, 0.0], [1e-12, 0.0], [1e300, -1e300], [-1e300, 0.0]])
    assert place_numbers(points, 1e-9).tolist() == [0, 0, 1, 2]
