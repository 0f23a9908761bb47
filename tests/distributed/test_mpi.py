"""The same on real ranks, started by mpiexec."""

from pathlib import Path

import pytest
from real_ranks import numbers_of_ranks, run_on_ranks

HERE = Path(__file__).parent


@pytest.mark.parametrize("n_ranks", numbers_of_ranks()[1:])
def test_on_real_ranks(n_ranks):
    ended = run_on_ranks(n_ranks, HERE / "rank_program.py", HERE.parent / "support")
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert ended.stdout.count("done") == n_ranks
