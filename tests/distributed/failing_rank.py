"""The command line with a fault planted on one rank: failing_rank.py PHASE RANK ARGUMENT..."""

import os
import signal
import sys

from mpi4py import MPI

import adaptsize
from adaptsize.cli import console
from adaptsize.cli.entry import main
from adaptsize.distributed import files

phase, rank = sys.argv[1], int(sys.argv[2])

# The module and the function in which each phase fails, where the other ranks wait for this one.
PLACES = {"writing": (files, "_rows_of"), "killed": (adaptsize, "limit_gradient")}


def fail(*args, **options):
    """Fail as planted."""
    if phase == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    raise ValueError("planted fault")


console._PATIENCE = 0.3  # seconds; ranks that wait compute all the time
if MPI.COMM_WORLD.Get_rank() == rank and phase in PLACES:
    setattr(*PLACES[phase], fail)
main(sys.argv[3:])
