"""The search for a number: what it finds, in how many trials, and what it records."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adaptsize.sizes.search import Search, rounded_up, scale_to, smallest_tolerance


def run(search, number_of):
    """Try all factors that a search proposes, and return the number of trials."""
    while (factor := search.factor) is not None:
        search.add(number_of(factor), factor)
    return len(search.trials)


@given(st.floats(1.0, 3.0), st.floats(-4.0, 4.0))
def test_a_power_law_is_met_by_the_second_trial(order, log_ratio):
    search = Search(1000.0, order, 1e-6, reach=9.0)
    assert run(search, lambda s: 1000.0 * math.exp(log_ratio) * s**-order) <= 2
    assert search.miss == pytest.approx(0.0, abs=1e-6)


@given(st.integers(0, 2**32 - 1), st.floats(0.5, 4.0), st.floats(-3.0, 3.0), st.floats(0.002, 0.02))
def test_any_falling_number_is_met_or_the_bound_is_the_answer(seed, order, x, accuracy):
    rng = np.random.default_rng(seed)
    # Between plateaus, where given bounds control all, powers that differ by up to ten times.
    at = np.cumsum(np.append(-8.0, rng.uniform(0.3, 4.0, 8)))
    fall = rng.uniform(0.5, 5.0, 8) * (rng.random(8) < 0.7)
    y = -np.cumsum(np.append(0.0, fall * np.diff(at)))

    def number(factor):
        return math.exp(float(np.interp(math.log(factor), at, y)))

    wanted = number(math.exp(x))
    bounds = math.exp(at[0]), math.exp(at[-1])
    search = Search(wanted, order, accuracy, bounds=bounds, resolution=1e-12)
    assert run(search, number) <= 25
    assert abs(search.miss) <= accuracy
    too_many = Search(2.0 * number(bounds[0]), order, accuracy, bounds=bounds)
    run(too_many, number)
    assert too_many.best.number == pytest.approx(number(bounds[0]), rel=1e-9)


@given(st.floats(0.3, 5.0), st.floats(1.2, 50.0))
def test_of_a_cap_the_largest_allowed_number_is_the_best(power, load):
    search = Search(1.0, 3.0, 0.02, below=0.05, is_cap=True, bounds=(1.0, 1e9))
    run(search, lambda s: load * s**-power)
    assert -0.05 <= search.miss <= 0.02
    jump = Search(1.0, 3.0, 0.02, below=0.05, is_cap=True, bounds=(1.0, 64.0), resolution=0.01)
    run(jump, lambda s: load if s < 3.0 else 0.2)
    assert jump.best.number == 0.2
    assert jump.best.factor == pytest.approx(3.0, rel=0.02)
    fine = Search(1.0, 3.0, 0.02, below=0.05, is_cap=True, bounds=(1.0, 64.0))
    assert run(fine, lambda s: 0.5) == 1  # fewer are allowed, and nothing is tightened


def test_sizes_that_do_not_change_end_the_search():
    search = Search(100.0, 3.0, 0.01, patience=3)
    assert run(search, lambda s: 700.0) == 4
    assert search.best.factor == 1.0


def test_meshes_are_corrected_by_the_numbers_that_they_have():
    search = Search.by_meshes(1000.0, 2, 0.05)
    for ratio in (1.3, 1.08, 1.01):
        predicted = 1000.0 * search.factor**-2
        search.add(predicted, None, made=ratio * predicted)
    assert search.factor is None
    predicted = [trial.predicted for trial in search.trials]
    assert predicted[1] == pytest.approx(1000.0 / 1.3)
    assert str(search.trials[0]) == "1300 where 1000 were predicted"
    assert search.records.count("were predicted") == 3
    assert search.best is min(search.trials, key=lambda trial: abs(trial.made - 1000.0))


def test_numbers_on_both_sides_are_interpolated():
    # A generator that makes 1.6 or .75 times the predicted number.
    search = Search.by_meshes(1000.0, 3, 0.05)
    search.add(1000.0, None, made=1600.0)
    second = 1000.0 * search.factor**-3
    search.add(second, None, made=0.75 * second)
    third = 1000.0 * search.factor**-3
    assert second == pytest.approx(625.0)
    expected = np.exp(np.interp(0.0, np.log([0.75 * 0.625, 1.6]), np.log([625.0, 1000.0])))
    assert third == pytest.approx(expected)


def test_scales_reach_their_value_or_the_nearest_one():
    assert scale_to(8.0, float, lambda s: s**-3.0, 1.0, 3) == pytest.approx(0.5, rel=1e-4)
    clipped = scale_to(50.0, float, lambda s: min(s**-3.0, 27.0), 1.0, 3, bounds=(1 / 3, 9.0))
    assert clipped <= 1.001 / 3.0
    step = scale_to(5.0, float, lambda s: 9.0 if s < 0.7 else 1.0, 1.0, 3)
    assert step == pytest.approx(0.7, rel=1e-3)


@given(st.floats(1.5, 30.0), st.floats(0.8, 2.0))
def test_the_smallest_tolerance_is_enough_and_a_smaller_one_is_not(load, power):
    def load_of(tolerance):
        return load * (tolerance / 1e-3) ** -power

    offer = smallest_tolerance(1e-3, load, load_of)
    if load_of(0.05) > 1.02:
        assert offer is None
    else:
        assert load_of(offer) <= 1.02
        assert load_of(0.8 * offer) > 1.0
        assert offer == rounded_up(offer)


def test_a_predicted_number_replaces_the_expected_order():
    """With the order of the prediction, a number that falls slowly is met by the second trial."""
    for is_predicted in (True, False):
        search = Search(1000.0, 2.0, 1e-3)
        search.add(1500.0, None)
        if is_predicted:
            search.expect(1500.0 * search.factor**-0.7)
        search.add(1500.0 * search.factor**-0.7, None)
        assert (search.factor is None) == is_predicted
    search = Search(1000.0, 2.0, 1e-3)
    search.add(1500.0, None)
    before = search.factor
    for useless in (0.0, math.inf, math.nan):
        search.expect(useless)
        assert search.factor == before
    met = Search(1000.0, 2.0, 1e-3)
    met.add(1000.0, None)
    met.expect(500.0)
    assert met.factor is None


def test_a_search_for_another_number_begins_with_the_last_trial():
    search = Search(1000.0, 2.0, 1e-3, start=3.0)
    search.add(1500.0, "first")
    search.expect(1500.0 * (search.factor / 3.0) ** -0.7)
    other = search.for_other(1200.0)
    assert [trial.result for trial in other.trials] == ["first"]
    assert other.factor == pytest.approx(3.0 * (1500.0 / 1200.0) ** (1.0 / 0.7))
    assert search.for_other(1500.5).factor is None
    assert search.wanted == 1000.0
