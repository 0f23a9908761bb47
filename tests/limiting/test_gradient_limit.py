"""g as a user gives it: arrays into cells, and g(h) into a change of variable."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import quad

from adaptsize import SimplexMesh
from adaptsize.limiting.gradient_limit import SizeTransform, resolve

SQUARE = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
BOUND = np.array([0.5, 2.0, np.inf, 1.0])

LIMITS = {
    "constant": lambda h: np.full_like(h, 0.3),
    "linear": lambda h: 0.2 * h,
    "step-like": lambda h: 0.4 - 0.2 * np.tanh((h - 6.0) / 2.0),
    "rational": lambda h: 0.1 + 1.0 / (1.0 + h**2),
}


@pytest.mark.parametrize("name", LIMITS)
@given(seed=st.integers(0, 2**32 - 1))
def test_there_and_back_loses_rounding_only(name, seed):
    transform = SizeTransform(LIMITS[name], 0.01, 50.0)
    h = np.exp(np.random.default_rng(seed).uniform(np.log(0.01), np.log(50.0), 50))
    phi = transform.forward(h)
    # phi rounds by eps times its largest value, which g turns into sizes.
    step = 4.0 * np.finfo(float).eps * phi.max() * LIMITS[name](h)
    assert (np.abs(transform.backward(phi) - h) <= step + 4e-15 * h).all()


@pytest.mark.parametrize("name", LIMITS)
def test_phi_is_the_integral_of_one_over_g(name):
    g = LIMITS[name]
    transform = SizeTransform(g, 0.01, 50.0)
    for upper in (0.011, 0.3, 5.0, 6.5, 50.0):
        exact = quad(
            lambda h: 1.0 / float(g(np.array([h]))[0]), 0.01, upper, epsabs=0, epsrel=1e-11
        )
        # Linear interpolation over steps of h / 8192: 2e-9 of h dPhi/dh at most.
        bound = 1e-10 * exact[0] + 4e-9 * upper / float(g(np.array([upper]))[0])
        assert abs(float(transform.forward(np.array([upper]))[0]) - exact[0]) <= bound


def test_the_table_grows_as_far_as_sizes_reach():
    transform = SizeTransform(lambda h: 0.2 * h, 0.1, 0.1)
    phi = np.array([0.0, 1.0, 20.0, 100.0])
    assert_allclose(transform.backward(phi), 0.1 * np.exp(0.2 * phi), rtol=2e-9)
    # What was grown is used by both directions.
    assert_allclose(transform.forward(np.array([0.1 * np.exp(20.0)])), [100.0], rtol=1e-9)


def test_infinity_goes_to_infinity_and_back():
    transform = SizeTransform(lambda h: 0.3, 0.1, 1.0)
    assert transform.forward(np.array([0.1, np.inf])).tolist() == [0.0, np.inf]
    assert transform.backward(np.array([np.inf, 0.0])).tolist() == [np.inf, 0.1]
    assert transform.backward(np.array([np.inf])).tolist() == [np.inf]


def test_a_number_returned_by_g_of_h_counts_for_every_size():
    transform = SizeTransform(lambda h: 0.25, 1.0, 3.0)
    assert_allclose(transform.forward(np.array([1.0, 2.0, 3.0])), [0.0, 4.0, 8.0], rtol=1e-12)


@pytest.mark.parametrize("sizes", [(1e-61, 1.0), (1.0, 1e62), (1e308, 1e308)])
def test_sizes_out_of_range_are_refused(sizes):
    with pytest.raises(ValueError, match=re.escape("finite sizes must be from 1e-60 to 1e+60")):
        SizeTransform(lambda h: 0.25, *sizes)


def test_sizes_that_overflow_are_refused():
    transform = SizeTransform(lambda h: h**2, 1.0, 2.0)  # Phi = 1 - 1/h never reaches 2
    with pytest.raises(ValueError, match=re.escape("g(h) must be bounded")):
        transform.backward(np.array([2.0]))


def test_g_of_h_is_asked_between_the_sizes_only():
    asked = []

    def g(h):
        asked.append((h.min(), h.max()))
        return np.full_like(h, 0.3)

    SizeTransform(g, 0.5, 8.0)
    assert min(low for low, _ in asked) >= 0.5
    assert max(high for _, high in asked) <= 8.0


@pytest.mark.parametrize(
    ("g", "values"),
    [
        (0.3, [0.3]),
        ([0.1, 0.2, 0.6, 0.8], [0.3, 0.5]),  # of nodes: the means in cells
        ([0.1, 0.7], [0.1, 0.7]),
        ((0.1, 0.7), [0.1, 0.7]),  # a pair of numbers is no product
        ([1e-200, 1e-31], [0.0, 0.0]),  # too small to square
    ],
)
def test_numbers_give_a_slope_for_all_cells_or_one_for_each(g, values):
    slope, transform = resolve(SQUARE, g, BOUND)
    assert_allclose(slope.values, values, rtol=1e-15)
    assert slope.step == (len(values) > 1)
    assert transform is None


def test_functions_and_products_give_slope_and_transform():
    slope, transform = resolve(SQUARE, lambda h: 0.5 * h, BOUND)
    assert slope.values.tolist() == [1.0]
    # The table starts at the least size.
    assert_allclose(
        transform.forward(BOUND), [0.0, np.log(4) / 0.5, np.inf, np.log(2) / 0.5], rtol=1e-8
    )
    slope, transform = resolve(SQUARE, ([0.1, 0.7], lambda h: 0.5 * h), BOUND)
    assert slope.values.tolist() == [0.1, 0.7]
    assert_allclose(transform.forward(BOUND)[3], np.log(2) / 0.5, rtol=1e-8)
