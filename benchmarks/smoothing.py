"""Speed and quality of meshes from distance functions.

    python benchmarks/smoothing.py [--quick] [--output benchmarks/results]

One core; kernels compiled beforehand; process time of one run.  The domain is a disc (ball) of
radius 1 less one of radius 0.3 around (0.2, 0.2); the size grows from the inner circle by 0.25
per length, in the large case in the plane by 0.02.  *On a grid*: the same size as a
`SizeFunction`.  *Other force*: that of Bossen and Heckbert (1996), which pulls too, instead of
that of Persson and Strang (2004).  *Not improved*: without swaps and moves of single nodes at
the end.  Writes `smoothing.md` and `smoothing.json`.
"""

import time
import warnings
from contextlib import contextmanager

import numpy as np
from _timing import arguments_of, machine, table, three, write

import adaptsize as ads
from adaptsize.remeshing.distmesh import finish, relaxation

CENTRE, INNER = 0.2, 0.3
# Dimension, size at the inner circle.
CASES = ((2, 0.005), (3, 0.062), (3, 0.0315))
QUICK_CASES = ((2, 0.03), (3, 0.15))


def ring(x):
    inner = INNER - np.linalg.norm(x - CENTRE, axis=1)
    return np.maximum(np.linalg.norm(x, axis=1) - 1.0, inner)


def size_from(smallest):
    # In the plane some 20 000 nodes, with sizes that differ by a factor of five.
    def size(x, slope=0.02 if smallest < 0.01 else 0.25):
        return smallest + slope * np.abs(np.linalg.norm(x - CENTRE, axis=1) - INNER)

    return size


def pliant_forces(points, edges, h):
    """Return the steps by the force of Bossen and Heckbert, over the number of neighbours."""
    n, dim = points.shape
    i, j = edges.T
    edge = points[i] - points[j]
    length = np.linalg.norm(edge, axis=1)
    wanted = 0.5 * (h[i] + h[j])
    scale = {2: 1.2, 3: 1.15}[dim] * np.clip(np.median(length / wanted), 0.9, 1.15)
    x4 = (length / (scale * wanted)) ** 4
    force = (1.0 - x4) * np.exp(-x4) * wanted / np.maximum(length, 1e-12 * wanted)
    move = np.empty((n, dim))
    for d in range(dim):
        along = force * edge[:, d]
        move[:, d] = np.bincount(i, along, n) - np.bincount(j, along, n)
    count = np.bincount(edges.ravel(), minlength=n)
    return move * ({2: 0.9, 3: 1.2}[dim] / np.maximum(count, 1))[:, None]


@contextmanager
def replaced(module, name, value):
    original = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, original)


@contextmanager
def variant(name):
    if name == "other force":
        with replaced(relaxation, "_forces", pliant_forces):
            yield
    elif name == "not improved":
        with replaced(finish, "improved", lambda domain, points, cells, h, **_: (points, cells)):
            yield
    else:
        yield


def on_grid(size, dim):
    n = 221 if dim == 2 else 61
    grid = ads.CartesianGrid([-1.1] * dim, 2.2 / (n - 1), (n,) * dim)
    return ads.SizeFunction(grid, size(grid.points).reshape(grid.shape))


def measure(dim, size, name):
    with variant(name), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # slivers are what is to be seen
        start = time.process_time()
        mesh, report = ads.mesh_from_distance.with_info(ring, size, [-1.1] * dim, [1.1] * dim)
        seconds = time.process_time() - start
    c = report.conformity
    return {
        "dim": dim,
        "variant": name,
        "nodes": mesh.n_points,
        "cells": mesh.n_cells,
        "steps": report.n_steps,
        "converged": report.converged,
        "triangulations": report.n_triangulations,
        "seconds": seconds,
        "share_in_band": c.share_in_band,
        "radius_ratio_mean": c.radius_ratio_mean,
        "angle_p01": c.angle_p01,
        "angle_min": c.angle_min,
        "slivers": report.n_slivers,
    }


def compile_all():
    for dim in (2, 3):
        measure(dim, 0.4, "")
        measure(dim, on_grid(size_from(0.3), dim), "")


def main():
    arguments = arguments_of(__doc__)
    compile_all()
    rows = []
    for dim, smallest in QUICK_CASES if arguments.quick else CASES:
        size = size_from(smallest)
        rows.append(measure(dim, size, ""))
        rows.append(measure(dim, on_grid(size, dim), "size on a grid"))
        if dim == 2 or smallest > 0.04:
            rows += [measure(dim, size, name) for name in ("other force", "not improved")]
    heads = ["dim", "", "nodes", "cells", "steps", "triangulations", "seconds", "in band",
             "mean radius ratio", "angle 1 %", "smallest", "slivers"]  # fmt: skip
    lines = [
        [r["dim"], r["variant"], r["nodes"], r["cells"], r["steps"], r["triangulations"],
         three(r["seconds"]), f"{r['share_in_band']:.1%}", f"{r['radius_ratio_mean']:.3f}",
         f"{r['angle_p01']:.1f}", f"{r['angle_min']:.1f}", r["slivers"]]
        for r in rows
    ]  # fmt: skip
    text = f"# Meshes from distance functions\n\n{machine()}\n\n{table(heads, lines)}\n"
    write(arguments.output, "smoothing", text, {"machine": machine(), "rows": rows})


if __name__ == "__main__":
    main()
