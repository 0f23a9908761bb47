"""Fixtures of the tests of the command line."""

import numpy as np
import pytest
from command_line import call

from adaptsize import SimplexMesh, write


@pytest.fixture(autouse=True)
def no_lines_about_steps(monkeypatch):
    """Commands in the process of the tests print no lines about steps and compiling."""
    monkeypatch.setattr("adaptsize.cli.tuning.SECONDS_BEFORE_LINES", 1e6)
    monkeypatch.setattr("adaptsize.cli.warmup._said", True)


@pytest.fixture
def square(tmp_path):
    """A file with two triangles and the nodal fields h0 and h."""
    mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    write(
        tmp_path / "square.vtu", mesh, fields={"h0": [0.1, np.inf, np.inf, np.inf], "h": np.ones(4)}
    )
    return tmp_path / "square.vtu"


@pytest.fixture
def refused(capsys):
    """Return a function that runs a command, which prints one line only, and returns the line.

    The exit code is 2 if the command line must be changed, and 1 otherwise.
    """

    def run(*words, code=2):
        assert call(*words) == code
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.startswith("adaptsize: error: ")
        assert printed.err.count("\n") == 1
        return printed.err

    return run
