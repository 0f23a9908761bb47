"""The same on real ranks, started by mpiexec."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent


def mpiexec():
    """Return the launcher of the implementation of MPI that is installed beside Python."""
    beside = Path(sys.executable).parent
    found = [beside / name for name in ("mpiexec", "mpiexec.exe") if (beside / name).exists()]
    return str(found[0]) if found else "mpiexec"


@pytest.mark.parametrize("task", ["operations", "compare", "report"])
@pytest.mark.parametrize("n_ranks", [1, 2])
def test_on_real_ranks(task, n_ranks):
    if task == "report" and n_ranks == 1:
        task = "operations"
    command = [mpiexec(), "-n", str(n_ranks), sys.executable, str(HERE / "rank_program.py")]
    command += [str(HERE.parent / "support"), task]
    source = str(HERE.parents[1] / "src")
    paths = [source, *filter(None, [os.environ.get("PYTHONPATH")])]
    ended = subprocess.run(
        command,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert ended.stdout.count("done") == n_ranks
