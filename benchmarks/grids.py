"""Speed and memory of fast marching on grids, and scikit-fmm on the same grids.

    python benchmarks/grids.py [--quick] [--output benchmarks/results]

One core; kernels compiled beforehand; least process time of three (of two at 256^3).

*Two sources*: section 6.2 of Persson (2006).  Memory is what one call needs besides grid,
h0 and result: numpy's arrays as tracemalloc counts them, and the growth of the largest
resident set of a process of its own.

*One source*, against `skfmm.distance`: the distance from the node at (-10, 0).  scikit-fmm
is given phi = 0 there and 1 elsewhere, so that it starts from this node alone; adaptsize
h0 = 1 there, inf elsewhere, and g = 1, so that h - 1 is the distance.  Both solve the same
upwind equations, hence the column "difference".  Writes `grids.md` and `grids.json`.
"""

import json
import os
import resource
import subprocess
import sys
import tracemalloc
from functools import partial
from pathlib import Path

import numpy as np
from _timing import (
    G,
    arguments_of,
    best_of,
    machine,
    model_bound,
    model_grid,
    node_of,
    table,
    three,
    write,
)

import adaptsize as ads
from adaptsize.limiting import FastMarching

# Dimension, boxes along an axis, orders, repetitions.  255 boxes: sources nearest to their places.
METHODS = {1: "auto", 2: FastMarching(order=2)}
CASES = ((2, 800, (1, 2), 3), (3, 100, (1, 2), 3), (3, 255, (1,), 2))
QUICK_CASES = ((2, 200, (1, 2), 3), (3, 30, (1, 2), 3))
PEER_CASES = ((2, 800, (1, 2), 3), (3, 100, (1, 2), 3), (3, 255, (1,), 1))


limit_gradient = partial(ads.limit_gradient, method="fast-marching")


def compile_all():
    for dim in (2, 3):
        grid = model_grid(10, dim)
        for order in (1, 2):
            limit_gradient(grid, model_bound(grid), G, method=METHODS[order])


def resident():
    """Return the bytes of this process that are in memory, or None where Linux is not."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return None
    return pages * os.sysconf("SC_PAGE_SIZE")


def memory(dim, n_cells, order):
    """Return bytes per node of one call in this process: of arrays, and of resident set."""
    compile_all()
    grid = model_grid(n_cells, dim)
    h0 = model_bound(grid)
    before = resident()
    h = limit_gradient(grid, h0, G, method=METHODS[order])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    grown = None if before is None else (peak - before - h.nbytes) / grid.n_points
    del h
    tracemalloc.start()
    h = limit_gradient(grid, h0, G, method=METHODS[order])
    traced = tracemalloc.get_traced_memory()[1] - h.nbytes
    return {"array_bytes_per_node": traced / grid.n_points, "resident_bytes_per_node": grown}


def speed(dim, n_cells, order, times):
    """Return times and memory of the problem of two sources."""
    grid = model_grid(n_cells, dim)
    h0 = model_bound(grid)
    _, wall, own = best_of(times, lambda: limit_gradient(grid, h0, G, method=METHODS[order]))
    command = [sys.executable, __file__, "--memory", str(dim), str(n_cells), str(order)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    row = {"dim": dim, "n_points": grid.n_points, "order": order, "process_seconds": own,
           "wall_seconds": wall, **json.loads(done.stdout)}  # fmt: skip
    print(row, file=sys.stderr)
    return row


def against_peer(dim, n_cells, order, times):
    """Return times, errors and difference of adaptsize and scikit-fmm."""
    import skfmm

    grid = model_grid(n_cells, dim)
    source = node_of(grid, -10.0)
    phi = np.ones(grid.shape)
    phi[source] = 0.0
    h0 = np.full(grid.shape, np.inf)
    h0[source] = 1.0
    h, _, own = best_of(times, lambda: limit_gradient(grid, h0, 1.0, method=METHODS[order]))
    peer = partial(skfmm.distance, phi, dx=grid.spacing, order=order)
    distance, _, peer_own = best_of(times, peer)
    h -= 1.0
    place = [axis[i] for axis, i in zip(grid.axes, source, strict=True)]
    exact = grid.sample(lambda x: np.linalg.norm(x - place, axis=1))
    row = {"dim": dim, "n_points": grid.n_points, "order": order, "process_seconds": own,
           "skfmm_process_seconds": peer_own,
           "max_error": float(np.abs(h - exact).max()),
           "skfmm_max_error": float(np.abs(distance - exact).max()),
           "max_difference": float(np.abs(h - distance).max())}  # fmt: skip
    print(row, file=sys.stderr)
    return row


def table_of_speed(rows):
    heads = ["dim", "nodes", "order", "own s", "wall s", "µs/node", "bytes/node, arrays",
             "bytes/node, resident"]  # fmt: skip
    lines = []
    for row in rows:
        own, grown = row["process_seconds"], row["resident_bytes_per_node"]
        lines.append(
            [row["dim"], row["n_points"], row["order"], three(own), three(row["wall_seconds"]),
             three(own / row["n_points"] * 1e6), f"{row['array_bytes_per_node']:.0f}",
             "" if grown is None else f"{grown:.0f}"]
        )  # fmt: skip
    return table(heads, lines)


def table_of_peer(rows):
    heads = ["dim", "nodes", "order", "adaptsize s", "scikit-fmm s", "times faster", "max error",
             "its max error", "difference"]  # fmt: skip
    lines = []
    for row in rows:
        own, peer = row["process_seconds"], row["skfmm_process_seconds"]
        lines.append(
            [row["dim"], row["n_points"], row["order"], three(own), three(peer),
             f"{peer / own:.1f}", three(row["max_error"]), three(row["skfmm_max_error"]),
             f"{row['max_difference']:.0e}"]
        )  # fmt: skip
    return table(heads, lines)


def main():
    if sys.argv[1:2] == ["--memory"]:
        print(json.dumps(memory(*map(int, sys.argv[2:]))))
        return
    arguments = arguments_of(__doc__)
    compile_all()
    cases, peers = (QUICK_CASES, QUICK_CASES) if arguments.quick else (CASES, PEER_CASES)
    own = [speed(dim, n, order, times) for dim, n, orders, times in cases for order in orders]
    both = [against_peer(dim, n, order, k) for dim, n, orders, k in peers for order in orders]
    text = (
        f"# Fast marching on grids\n\n{machine()}; one thread; process time, the least of three "
        f"(at 256^3 of two,\nand of one beside scikit-fmm). What is compared: "
        f"`benchmarks/grids.py`.\n\n## Two sources\n\n{table_of_speed(own)}\n\n"
        f"## Distance from one source, and scikit-fmm\n\n{table_of_peer(both)}\n"
    )
    write(arguments.output, "grids", text, {"machine": machine(), "speed": own, "peer": both})


if __name__ == "__main__":
    main()
