"""The problems of the benchmark of several cores, on a few hundred nodes."""

import warnings

import pytest
from cores import PROBLEMS


@pytest.mark.parametrize("name", sorted(PROBLEMS))
def test_each_problem_is_solved(name):
    call = PROBLEMS[name](1e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of sizes that are coarse for so few facets
        assert call() is not None
