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
