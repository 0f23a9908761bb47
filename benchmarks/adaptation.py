"""Cost of the transfer of fields between two meshes, and of a cycle of `adapt`.

    python benchmarks/adaptation.py [--quick] [--output benchmarks/results]

One core; kernels compiled beforehand; process time, best of three.  Both meshes are Delaunay
meshes of a grid with its nodes moved by up to 0.3 spacings, of the square and of the cube; the new
one has as many nodes along an edge as the table says, the old one a tenth more.  *Tree*:
building the tree of the old cells, once per mesh.  *Nodal*: location and interpolation of one
scalar field, and *more* each further field.  *Overlaps*: measures of all overlaps, once for
all fields; *conservative* and *at centroids* are then the cost of one scalar cell field.
*Cycles* (with Mmg installed): the indicator lies along a circle or sphere that has moved by a tenth
of the side, and one nodal field is projected.  Processor time of this process, of starting a
program in a supervised child, and of the rest of the child, which is Mmg with its files.

Writes `adaptation.md` and `adaptation.json`.
"""

import resource
import sys
import time
from pathlib import Path

import numpy as np
from _timing import arguments_of, machine, table, three, write

from adaptsize import FieldTransfer, SimplexMesh, adapt
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.protocol import Program

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
from meshes import jittered_cube, jittered_square

CASES = ((2, 100), (2, 250), (2, 500), (3, 16), (3, 28))
QUICK_CASES = ((2, 40), (3, 10))
CYCLES = ((2, 4000), (2, 16_000), (2, 64_000), (3, 10_000), (3, 100_000))
QUICK_CYCLES = ((2, 1000),)
NODAL = ("nodal", "more", "project", "bounded", "another")


def pair(dim, n):
    make = jittered_square if dim == 2 else jittered_cube
    return make(round(1.1 * n), 61), make(n, 62)


def seconds(work):
    start = time.process_time()
    result = work()
    return result, time.process_time() - start


def once(old, new):
    """Return the seconds of each part, on meshes without anything kept."""
    old, new = (SimplexMesh(m.points, m.cells) for m in (old, new))
    rng = np.random.default_rng(63)
    nodal, by_cell = rng.random(old.n_points), rng.random(old.n_cells)
    took = {}
    _, took["tree"] = seconds(lambda: old.locator)
    transfer = FieldTransfer(old, new)
    for part in ("nodal", "more"):
        _, took[part] = seconds(lambda: transfer.nodal(nodal, method="interpolate"))
    for method in ("project", "bounded"):
        fresh = FieldTransfer(old, new)
        _, took[method] = seconds(lambda: fresh.nodal(nodal, method=method))  # noqa: B023
    _, took["another"] = seconds(lambda: fresh.nodal(nodal, method="project"))
    overlap, took["overlaps"] = seconds(lambda: transfer.overlap)
    _, took["at centroids"] = seconds(lambda: transfer.cells(by_cell, conservative=False))
    made, took["conservative"] = seconds(lambda: transfer.cells(by_cell))
    before, after = transfer.integrals(by_cell, made)
    return took, overlap.nnz / new.n_cells, float(abs(after / before - 1.0))


def measured(dim, n):
    old, new = pair(dim, n)
    runs = [once(old, new) for _ in range(3)]
    took = {part: min(run[0][part] for run in runs) for part in runs[0][0]}
    per = {
        part: 1e6
        * s
        / (old.n_cells if part == "tree" else new.n_points if part in NODAL else new.n_cells)
        for part, s in took.items()
    }
    return {
        "dim": dim, "old_cells": old.n_cells, "new_cells": new.n_cells,
        "new_nodes": new.n_points, "seconds": took, "microseconds": per,
        "overlaps_per_cell": runs[0][1], "integral_changed": max(run[2] for run in runs),
    }  # fmt: skip


def indicator(mesh, radius):
    """Return the error of cells along a circle or sphere."""
    away = np.abs(np.linalg.norm(mesh.points[mesh.cells].mean(axis=1), axis=1) - radius)
    return mesh.measures ** (1.0 / mesh.dim + 0.5) / (0.03 + away) ** 2


def processor_times():
    """Return the seconds of this process and of its children."""
    usage = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return np.array([used.ru_utime + used.ru_stime for used in usage])


def start_of_a_child():
    """Return the processor time of a supervised program that does nothing."""

    def write(folder, *_):
        (folder / "result").touch()
        return ["true"]

    nothing = Program(write, "result", lambda *_: {})
    before = processor_times()
    for _ in range(10):
        IsolatedRunner("none", None, None, lambda *_: None)(nothing, "", {}, {})
    return (processor_times() - before)[1] / 10


def cycle(dim, n, start):
    """Return the cost of one cycle of `adapt` for about n cells."""
    mesh = (
        jittered_square(30, 5, half_width=0.5) if dim == 2 else jittered_cube(8, 5, half_width=0.5)
    )
    for _ in range(3):
        mesh = adapt(mesh, indicator(mesh, 0.25), elements=n, enough=2.0).mesh
    field = np.sin(5.0 * mesh.points[:, 0]) * mesh.points[:, 1]
    calls = []
    call = IsolatedRunner.__call__
    IsolatedRunner.__call__ = lambda *arguments: calls.append(1) or call(*arguments)
    runs = []
    for _ in range(3):
        fresh = SimplexMesh(mesh.points, mesh.cells)
        eta = indicator(fresh, 0.35)
        calls.clear()
        before, began = processor_times(), time.perf_counter()
        result = adapt(fresh, eta, elements=n, fields={"u": field}, enough=2.0)
        wall = time.perf_counter() - began
        own, child = processor_times() - before
        starts = start * len(calls)
        runs.append((own, starts, max(child - starts, 0.0), wall))
    IsolatedRunner.__call__ = call
    own, starts, in_mmg, wall = min(runs)
    return {
        "dim": dim, "old_cells": mesh.n_cells, "new_cells": result.mesh.n_cells,
        "meshes": result.report.n_meshes, "this_process": own, "starts": starts,
        "mmg": in_mmg, "wall": wall,
    }  # fmt: skip


def main():
    arguments = arguments_of(__doc__)
    for dim, n in QUICK_CASES:
        once(*pair(dim, n // 2))  # compile
    rows = [measured(*case) for case in (QUICK_CASES if arguments.quick else CASES)]
    start = start_of_a_child()
    in_cycles = [cycle(*case, start) for case in (QUICK_CYCLES if arguments.quick else CYCLES)]
    parts = ("tree", *NODAL, "overlaps", "conservative", "at centroids")
    text = "\n".join(
        [
            "# Transfer of fields",
            "",
            "Microseconds: of the tree per old cell, of nodal fields per new node, of the rest per "
            "new cell.  Nodal: interpolated, a further field, projected, projected in bounds, a "
            "further field projected.",
            "",
            table(
                ["cells", "old", "new", *parts, "overlaps per cell", "integral changed by"],
                [
                    [
                        "triangles" if row["dim"] == 2 else "tetrahedra",
                        row["old_cells"],
                        row["new_cells"],
                        *[three(row["microseconds"][part]) for part in parts],
                        three(row["overlaps_per_cell"]),
                        f"{row['integral_changed']:.0e}",
                    ]
                    for row in rows
                ],
            ),
            "",
            "Cycles of `adapt`, seconds.",
            "",
            table(
                ["cells", "old", "new", "this process", "start of Mmg", "Mmg", "wall"],
                [
                    [
                        "triangles" if row["dim"] == 2 else "tetrahedra",
                        row["old_cells"],
                        row["new_cells"],
                        *[f"{row[part]:.2f}" for part in ("this_process", "starts", "mmg", "wall")],
                    ]
                    for row in in_cycles
                ],
            ),
            "",
            f"{machine()}. Written by `benchmarks/adaptation.py`.",
            "",
        ]
    )
    write(
        arguments.output,
        "adaptation",
        text,
        {"machine": machine(), "transfer": rows, "cycles": in_cycles},
    )


if __name__ == "__main__":
    main()
