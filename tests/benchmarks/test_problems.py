"""The problems and methods of the benchmark of limiting, on a few hundred nodes."""

import warnings

import numpy as np
import pytest
from _problems import SERIES

from limiting import solve

#: Making these takes long, of any number of nodes.
SLOW = {"250 holes of 12 corners", "100 holes of 24 corners", "6 holes of 200 corners"}


@pytest.mark.parametrize("name", sorted(SERIES.keys() - SLOW))
def test_each_method_solves_each_problem(name):
    series = SERIES[name]
    problem = series.make(300)
    for options in series.methods.values():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an iteration may not converge
            seconds, h = solve(problem, options)
        assert seconds >= 0.0
        assert (np.ravel(h) <= np.ravel(problem.h0)).all()
        assert np.isfinite(h).any()
