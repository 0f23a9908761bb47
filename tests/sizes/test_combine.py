"""The smallest of several bounds."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from adaptsize.sizes.combine import minimum

sizes = st.lists(st.floats(1e-6, 1e6) | st.just(np.inf), min_size=4, max_size=4)


@given(st.lists(sizes, min_size=1, max_size=4), st.randoms(use_true_random=False))
def test_smallest_in_any_order(bounds, random):
    expected = np.array(bounds).min(axis=0)
    assert_array_equal(minimum(*bounds), expected)
    random.shuffle(bounds)
    assert_array_equal(minimum(*bounds), expected)
    assert_array_equal(minimum(expected, minimum(*bounds)), expected)


@given(sizes, st.floats(0.1, 1.0), st.floats(1.0, 10.0))
def test_limits_hold_everywhere(h0, hmin, hmax):
    h = minimum(h0, hmin=hmin, hmax=hmax)
    assert (h >= hmin).all()
    assert (h <= hmax).all()
    inside = (np.array(h0) >= hmin) & (np.array(h0) <= hmax)
    assert_array_equal(h[inside], np.array(h0)[inside])


def test_inf_stays_unless_hmax_is_given():
    assert_array_equal(minimum([np.inf, 2.0], [np.inf, 3.0], hmin=2.5), [np.inf, 2.5])
    assert_array_equal(minimum([np.inf, 2.0], hmax=4.0), [4.0, 2.0])
