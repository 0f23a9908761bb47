"""A second run of fTetWild where the first one fails."""

import numpy as np
import pytest
from shapes import block

from adaptsize.errors import BackendError, BackendTimeoutError, ResolutionWarning
from adaptsize.remeshing.preparation import as_problem
from adaptsize.remeshing.tetwild import TetWildBackend

CUBE = block(1)
PROBLEM = as_problem("surface to tetrahedra", CUBE.boundary().mesh, 0.02)


def runner(*failures):
    """Return a runner that fails so often before it returns a cube, and its tolerances."""
    left, tolerances = list(failures), []

    def run(function, text, arrays, options):
        tolerances.append(options["epsilon"])
        if left:
            raise left.pop(0)
        return {"points": CUBE.points, "cells": CUBE.cells}

    return run, tolerances


def test_a_crash_is_followed_by_a_run_with_a_smaller_tolerance_and_reported():
    run, tolerances = runner(BackendError("tetwild failed: crashed (SIGSEGV)"))
    with pytest.warns(ResolutionWarning, match=r"again with 0\.25 times .*SIGSEGV"):
        raw = TetWildBackend().solve(PROBLEM, run)
    assert len(raw["cells"]) == CUBE.n_cells
    np.testing.assert_allclose(tolerances, [0.02, 0.005])


@pytest.mark.parametrize(
    ("failures", "tolerance", "n_runs"),
    [
        ([BackendError("the first"), BackendError("the second")], 0.02, 2),
        ([BackendError("the first")], 1000.0, 1),  # a smaller one would be as absurd
        ([BackendTimeoutError("the first")], 0.02, 1),
    ],
)
def test_the_error_of_the_first_run_is_raised_if_no_other_helps(failures, tolerance, n_runs):
    run, tolerances = runner(*failures)
    problem = as_problem("surface to tetrahedra", CUBE.boundary().mesh, tolerance)
    with pytest.raises(type(failures[0]), match="the first"):
        TetWildBackend().solve(problem, run)
    assert len(tolerances) == n_runs
