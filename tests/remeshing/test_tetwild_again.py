"""A second run of fTetWild where the first one fails."""

import numpy as np
import pytest
from shapes import block

from adaptsize.errors import BackendError, BackendTimeoutError
from adaptsize.remeshing import remesh
from adaptsize.remeshing.driver import remeshed
from adaptsize.remeshing.isolation import IsolatedRunner

CUBE = block(1)
SURFACE = CUBE.boundary().mesh


@pytest.fixture
def failing(monkeypatch):
    """Return a function that makes fTetWild fail so often, and returns its tolerances."""

    def fail(*failures):
        left, tolerances = list(failures), []

        def call(run, function, text, arrays, options):
            tolerances.append(options["epsilon"])
            if left:
                raise left.pop(0)
            return {"points": arrays["points"], "cells": CUBE.cells}

        monkeypatch.setattr(IsolatedRunner, "__call__", call)
        return tolerances

    return fail


def test_a_crash_is_followed_by_a_run_with_a_smaller_tolerance(failing):
    tolerances = failing(BackendError("tetwild failed: crashed (SIGSEGV)"))
    made = remeshed(SURFACE, 1.2, backend="tetwild", tolerance=0.02)
    np.testing.assert_allclose(tolerances, [0.02, 0.005])
    first, second = made.attempts.tried
    assert (first.route, first.status) == ("tetwild", "failed")
    assert "SIGSEGV" in first.text
    assert (second.route, second.status) == ("tetwild with 0.25 x tolerance", "met")


@pytest.mark.parametrize(
    ("failures", "tolerance", "n_runs"),
    [
        ([BackendError("the first"), BackendError("the second")], 0.02, 2),
        ([BackendError("the first")], 0.5, 1),  # a smaller one would be as absurd
        ([BackendTimeoutError("the first")], 0.02, 1),
    ],
)
def test_the_errors_are_raised_if_no_run_helps(failing, failures, tolerance, n_runs):
    tolerances = failing(*failures)
    with pytest.raises(type(failures[0]), match="the first"):
        remesh(SURFACE, 1.2, backend="tetwild", tolerance=tolerance)
    assert len(tolerances) == n_runs
