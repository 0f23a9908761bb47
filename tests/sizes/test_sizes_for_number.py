"""Sizes for a number of elements: few limits, and numbers predicted from the paths of one."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from adaptsize import CartesianGrid, limit_gradient
from adaptsize.sizes.budget import count_elements
from adaptsize.sizes.limited import Limit, Limited, limited, sizes_for_number

GRID = CartesianGrid([0.0, 0.0], 1.0 / 24, (25, 25)).mesh
#: Small at two places, and free of the gradient limit between.
SHAPE = 0.02 + np.minimum(*(np.linalg.norm(GRID.points - x, axis=1) for x in (0.2, 0.8))) ** 2


def test_sizes_near_a_limit_are_exact_where_they_come_from_the_same_nodes():
    sources = np.full(GRID.n_points, np.inf)
    sources[[0, 400]] = 0.01, 0.02
    found = limited(GRID, sources, 0.3)
    assert_allclose(found.h, limit_gradient(GRID, sources, 0.3), rtol=1e-12)
    near = found.near(1.01 * sources)
    same = limited(GRID, 1.01 * sources, 0.3).roots == found.roots
    assert same.mean() > 0.9
    assert_allclose(near[same], limit_gradient(GRID, 1.01 * sources, 0.3)[same], rtol=1e-12)


def test_numbers_near_a_limit_are_known_from_its_paths():
    found = limited(GRID, SHAPE, 0.3)
    for scale in (0.9, 1.1):
        near, exact = found.near(scale * SHAPE), limit_gradient(GRID, scale * SHAPE, 0.3)
        assert (near <= scale * SHAPE).all()
        assert count_elements(GRID, near) == pytest.approx(count_elements(GRID, exact), rel=0.01)


def test_without_paths_nothing_is_predicted():
    assert Limited(SHAPE, SHAPE, None).near(SHAPE) is None


@pytest.mark.parametrize("number", [300.0, 900.0])
def test_two_limits_give_a_number(number):
    calls = []

    def limit(bound):
        calls.append(bound)
        return limited(GRID, bound, 0.3)

    start = (count_elements(GRID, limit_gradient(GRID, SHAPE, 0.3)) / number) ** 0.5
    h = sizes_for_number(
        GRID, number, lambda s: s * SHAPE, Limit(lambda h: h, limit), start, accuracy=0.005
    )
    assert count_elements(GRID, h) == pytest.approx(number, rel=0.006)
    assert len(calls) <= 2
    assert_allclose(h, limit_gradient(GRID, calls[-1], 0.3), rtol=1e-12)


def test_a_corrected_number_counts_instead():
    asked = []

    def corrected(h, number):
        asked.append(number)
        return 0.8 * number

    h = sizes_for_number(
        GRID, 600.0, lambda s: s * SHAPE, Limit(lambda h: h, lambda h: limited(GRID, h, 0.3)), 1.0,
        0.005, corrected=corrected,
    )  # fmt: skip
    assert len(asked) == 1
    assert count_elements(GRID, h) == pytest.approx(0.8 * asked[0], rel=0.006)
