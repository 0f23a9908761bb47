"""Memory and processor time of large inputs: the table in docs/troubleshooting.md.

    python benchmarks/large_inputs.py [--triangles 600000 2000000] [--tetrahedra 1000000]

Each row is measured in a process of its own, after a small input that compiles the kernels.
Memory is the largest resident size.  Needs adaptsize[mmg], on Linux; 2 million triangles need 4 GB.
"""

import argparse
import multiprocessing
import resource

import numpy as np

import adaptsize as ads
from distributed import kuhn_cube
from geometry import bumpy_ball


def used(who):
    """Return the processor time in seconds, and the largest resident size in MB."""
    usage = resource.getrusage(who)
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e3  # kB on Linux


def sizes(n_triangles):
    """Return the figures of the size function of a smooth surface."""
    ads.size_function(bumpy_ball(1_000))
    surface = bumpy_ball(n_triangles // 2 + 2)
    start, _ = used(resource.RUSAGE_SELF)
    ads.size_function(surface, max_elements=10**9)
    end, memory = used(resource.RUSAGE_SELF)
    return f"{memory:.0f} MB, {end - start:.1f} s"


def overlaps(n_triangles):
    """Return the figures of the search for overlaps in two surfaces that overlap."""

    def two(n_points):
        ball = bumpy_ball(n_points)
        points = np.concatenate([ball.points, ball.points + 1.0])
        return ads.SimplexMesh(points, np.concatenate([ball.cells, ball.cells + n_points]))

    two(1_000).overlapping_bodies()
    surface = two(n_triangles // 4 + 2)
    start, _ = used(resource.RUSAGE_SELF)
    assert surface.overlapping_bodies() is not None
    end, memory = used(resource.RUSAGE_SELF)
    return f"{memory:.0f} MB, {end - start:.1f} s"


def tetrahedra(n_tetrahedra):
    """Return the figures of a cube of uniform tetrahedra by Mmg."""
    cube = kuhn_cube(8)
    ads.remesh(cube, 0.2)
    edge = (6.0 * np.sqrt(2.0) / n_tetrahedra) ** (1 / 3)
    starts = [used(who)[0] for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    made = ads.remesh(cube, edge)
    own, mmg = (used(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return (
        f"{made.n_cells} tetrahedra, Mmg {mmg[1]:.0f} MB, {mmg[0] - starts[1]:.1f} s; "
        f"the caller {own[1]:.0f} MB, {own[0] - starts[0]:.1f} s"
    )


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--triangles", type=int, nargs="*", default=[600_000, 2_000_000])
    parser.add_argument("--tetrahedra", type=int, nargs="*", default=[1_000_000])
    args = parser.parse_args()
    rows = [(case, n) for n in args.triangles for case in (sizes, overlaps)]
    rows += [(tetrahedra, n) for n in args.tetrahedra]
    for case, n in rows:
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            print(f"{case.__name__}, {n}: {pool.apply(case, (n,))}", flush=True)


if __name__ == "__main__":
    main()
