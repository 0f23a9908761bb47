"""The same on real ranks, started by mpiexec."""

from pathlib import Path

import pytest
from real_ranks import numbers_of_ranks, run_on_ranks

HERE = Path(__file__).parent


@pytest.mark.parametrize("task", ["operations", "compare", "report", "cycle"])
@pytest.mark.parametrize("n_ranks", numbers_of_ranks())
def test_on_real_ranks(task, n_ranks):
    if task == "report" and n_ranks == 1:
        task = "operations"
    ended = run_on_ranks(n_ranks, HERE / "rank_program.py", HERE.parent / "support", task)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert ended.stdout.count("done") == n_ranks
