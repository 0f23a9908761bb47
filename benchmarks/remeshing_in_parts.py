"""Remeshing in parts against gathering: processor time of all ranks, and quality.

    PYTHONPATH=tests/support python benchmarks/remeshing_in_parts.py --ranks 4 --edges 0.12 0.06

Ranks are threads of one process, and Mmg runs in processes of their own; MPI is not needed.  With
equal parts, the elapsed time of "parts" is its processor time divided by the number of ranks, and
that of "gather" is its processor time.
"""

import argparse
import resource

import numpy as np
from simulated_ranks import SimulatedCommunicator

from adaptsize import interpolate, remesh, size_conformity
from adaptsize.distributed import PartitionedMesh
from distributed import kuhn_cube


def seconds():
    """Return the processor time of this process and of those that it has run."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(own.ru_utime + own.ru_stime for own in used)


def run(mesh, edge, how, n_ranks):
    """Return the processor time, and the quality of the new mesh."""

    def work(comm):
        part = PartitionedMesh.from_serial(mesh if comm.rank == 0 else None, None, comm)
        # Finer at a corner, with a slope of 0.25.
        h = np.minimum(edge * 0.5 + 0.25 * np.linalg.norm(part.points, axis=1), edge)
        new = remesh(part, h, how=how)
        return size_conformity(new, interpolate(part, h, new.points))

    before = seconds()
    quality = SimulatedCommunicator.run(n_ranks, work)[0]
    return seconds() - before, quality


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--ranks", type=int, default=4)
    parser.add_argument("--edges", type=float, nargs="+", default=[0.12, 0.06])
    args = parser.parse_args()
    for edge in args.edges:
        mesh = kuhn_cube(max(4, round(0.7 / edge)))
        for how in ("gather", "parts"):
            time, quality = run(mesh, edge, how, args.ranks)
            print(f"edge {edge}, {how}, {args.ranks} ranks: {time:.1f} s, {quality}", flush=True)


if __name__ == "__main__":
    main()
