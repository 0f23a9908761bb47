"""Time exact limiting on surfaces, and measure the errors of fast marching against it.

    python docs/measurements/surfaces.py FILE...

Bounds of .01 to .1 diagonals at 1 node, 5 nodes, a tenth of the nodes and all nodes; g = .25; one
thread; processor time, the best of two, all in.  Prints a table.
"""

import sys
import time
from pathlib import Path

import numpy as np

import adaptsize as ads
from adaptsize.limiting import Exact, FastMarching

G = 0.25


def timed(mesh, h0, scheme):
    """Return sizes, info and microseconds per node."""
    best = np.inf
    for _ in range(2):
        fresh = ads.SimplexMesh(mesh.points, mesh.cells)  # nothing derived is there yet
        start = time.process_time()
        h, info = ads.limit_gradient.with_info(fresh, h0, G, method=scheme)
        best = min(best, time.process_time() - start)
    return h, info, 1e6 * best / mesh.n_points


def main():
    """Measure all surfaces, with bounds at four numbers of nodes."""
    print("| surface | nodes | bounds | exact, us/node | linear | fast marching | ", end="")
    print("exact nodes | fast marching too small, too large |\n|" + "---|" * 8)
    for name in sys.argv[1:]:
        whole = ads.read(name)
        mesh = ads.SimplexMesh(whole.points, whole.cells)
        nodes, n = np.flatnonzero(mesh.in_a_cell), mesh.n_points
        for label, count in (("1", 1), ("5", 5), ("n/10", n // 10), ("n", len(nodes))):
            rng = np.random.default_rng(1)
            h0, at = np.full(n, np.inf), rng.choice(nodes, count, replace=False)
            h0[at] = mesh.diagonal * rng.uniform(0.01, 0.1, count)
            exact, info, cost = timed(mesh, h0, Exact(face_sources=False))
            linear = timed(mesh, h0, Exact())[2]
            marched, _, marching = timed(mesh, h0, FastMarching())
            reached = np.isfinite(exact)
            error = marched[reached] / exact[reached] - 1.0
            share = info.n_proved / n
            print(
                f"| {Path(name).stem} | {n} | {label} | {cost:.1f} | {linear:.1f} "
                f"| {marching:.2f} | {share:.0%} "
                f"| {max(0.0, -error.min()):.3f}, {max(0.0, error.max()):.3f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
