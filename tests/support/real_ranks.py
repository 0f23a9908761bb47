"""Python programs on ranks of MPI, started by the mpiexec that is installed."""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from shutil import which

SOURCE = Path(__file__).parents[2] / "src"

# Open MPI does not start more ranks than cores, or as root, unless it is allowed to.  Other
# implementations ignore these variables.
_ALLOWED = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",  # to version 4
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",  # from version 5 on
}


@cache
def mpiexec():
    """Return the launcher beside Python, which fits mpi4py, or else the one on the path."""
    beside = Path(sys.executable).parent
    found = [beside / name for name in ("mpiexec", "mpiexec.exe") if (beside / name).exists()]
    return str(found[0]) if found else which("mpiexec") or "mpiexec"


@cache
def is_open_mpi():
    """Return whether the ranks yield the processor while they wait."""
    try:
        shown = subprocess.run(
            [mpiexec(), "--version"], capture_output=True, text=True, timeout=60, check=False
        )
    except OSError:
        return False
    return "Open MPI" in shown.stdout


def numbers_of_ranks():
    """Return the numbers of ranks to test: 4 only where they do not wait busily."""
    return (1, 2, 4) if is_open_mpi() else (1, 2)


def run_on_ranks(n_ranks, *arguments, timeout=240):
    """Run Python with the arguments on ranks of MPI, and return what it printed."""
    paths = [str(SOURCE), *filter(None, [os.environ.get("PYTHONPATH")])]
    done = subprocess.run(
        [mpiexec(), "-n", str(n_ranks), sys.executable, *map(str, arguments)],
        env={**os.environ, **_ALLOWED, "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
    done.stderr = done.stderr.replace("\0", "")  # Open MPI ends its messages with one
    return done
