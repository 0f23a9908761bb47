"""Table 3 of Persson (2006) measured anew: two point sources, section 6.2, g = 0.3.

    python benchmarks/table3.py [--quick] [--output benchmarks/results]

Five solvers on one core, in one process, kernels compiled beforehand, the least time of
three; process time, which other processes disturb less, and wall time.  Sources at nodes.

*Edge iteration*: the paper's, written here.  Passes over all pairs (i, j) of neighbours
along the axes, in the order of the nodes in memory, lowering in place h_j to h_i + g dx or h_i
to h_j + g dx where that is less, until a pass changes nothing.

*H-J iteration*: `method="hamilton-jacobi"` of order 1 from a constant, until no node changes
faster than 0.01 g ("about two digits"); with the paper's step dx/2, and with the library's.
It is the obstacle form of iteration (16), whose steps and cost are the same.

*Fast marching*, order 1 and 2, and *edge-based* are `limit_gradient` with its defaults: the
latter has the steady state of the edge iteration, in one ordered pass.

On octrees the schemes run on conforming triangles and tetrahedra, made beforehand like their
adjacency, and the iteration is the positive coefficient scheme from a constant, to 0.01, once.
Writes `table3.md` and `table3.json`.
"""

import math
import sys
from functools import partial

import numpy as np
from _timing import (
    SIZES,
    G,
    arguments_of,
    best_of,
    machine,
    model_bound,
    model_exact,
    model_grid,
    place,
    table,
    three,
    write,
)
from numba import njit

from adaptsize import Octree, limit_gradient, refine_to_size
from adaptsize.limiting import FastMarching, HamiltonJacobi
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.limiting.problem import Problem

# Seconds on an Athlon XP 2800+: edge iteration, H-J iteration, H-J fast.
PAPER = {
    100: (0.009, 0.060, 0.006),
    200: (0.068, 0.470, 0.030),
    400: (0.844, 3.625, 0.181),
    800: (6.609, 28.422, 1.453),
}
# Above all limited sizes: 5 + 0.3 times the diagonal of the square.
START = 50.0
TOL = 1e-2
CELLS = {2: (100, 200, 400, 800), 3: (30, 60, 100)}
QUICK_CELLS = {2: (100, 200), 3: (30,)}
# Largest leaf as a share of the size in it.
FACTORS = {2: (0.4, 0.1, 0.02), 3: (1.6, 0.4)}
QUICK_FACTORS = {2: (0.4,), 3: (1.6,)}
# Nodes up to which the positive coefficient scheme is run, and once only: it takes minutes beyond.
MOST_ITERATED = 5_000


@njit(cache=True)
def pass_over_pairs(h, rise):
    """Make one pass over neighbours in a 2-D array (In/Out); return whether it changed."""
    changed = False
    for i in range(h.shape[0]):
        for j in range(h.shape[1]):
            if i + 1 < h.shape[0]:
                if h[i + 1, j] > h[i, j] + rise:
                    h[i + 1, j] = h[i, j] + rise
                    changed = True
                elif h[i, j] > h[i + 1, j] + rise:
                    h[i, j] = h[i + 1, j] + rise
                    changed = True
            if j + 1 < h.shape[1]:
                if h[i, j + 1] > h[i, j] + rise:
                    h[i, j + 1] = h[i, j] + rise
                    changed = True
                elif h[i, j] > h[i, j + 1] + rise:
                    h[i, j] = h[i, j + 1] + rise
                    changed = True
    return changed


@njit(cache=True)
def pass_over_pairs_in_space(h, rise):
    """Make one pass over neighbours in a 3-D array (In/Out); return whether it changed."""
    changed = False
    for i in range(h.shape[0]):
        for j in range(h.shape[1]):
            for k in range(h.shape[2]):
                for axis in range(3):
                    a, b, c = i + (axis == 0), j + (axis == 1), k + (axis == 2)
                    if a < h.shape[0] and b < h.shape[1] and c < h.shape[2]:
                        if h[a, b, c] > h[i, j, k] + rise:
                            h[a, b, c] = h[i, j, k] + rise
                            changed = True
                        elif h[i, j, k] > h[a, b, c] + rise:
                            h[i, j, k] = h[a, b, c] + rise
                            changed = True
    return changed


def edge_iteration(grid, h0):
    """Return the steady state of the paper's edge-based iterations and their number."""
    h = h0.copy()
    one_pass = pass_over_pairs if grid.dim == 2 else pass_over_pairs_in_space
    rise = G * float(grid.spacing[0])
    n_passes = 1
    while one_pass(h, rise):
        n_passes += 1
    return h, n_passes


def hamilton_jacobi(grid, h0, cfl=HamiltonJacobi.cfl):
    """Return the sizes and the number of steps of the iteration from a constant."""
    scheme = HamiltonJacobi(tol=TOL)
    object.__setattr__(scheme, "cfl", cfl)
    problem = Problem(grid, h0, Slope(np.array([G])))
    solution = scheme.iterate(problem, np.full(grid.shape, START))
    return solution.h, solution.iterations


def limited(background, h0, method="fast-marching", **options):
    """Return the sizes of `limit_gradient`; and the number of steps of an iteration."""
    if "initial" not in options:
        return limit_gradient(background, h0, G, method=method, **options), None
    h, info = limit_gradient.with_info(background, h0, G, method=method, **options)
    return h, info.iterations


def solvers(dim):
    """Return the solvers on grids by name."""
    return {
        "edge iteration": edge_iteration,
        "H-J iteration, dx/2": partial(hamilton_jacobi, cfl=math.sqrt(dim) / 2.0),
        "H-J iteration": hamilton_jacobi,
        "fast marching": limited,
        "fast marching, order 2": partial(limited, method=FastMarching(order=2)),
        "edge-based, ordered": partial(limited, method="edge-based"),
    }


def measure(name, solver, background, h0, points, times=3):
    """Return times and errors of one solver."""
    (h, n_steps), wall, own = best_of(times, lambda: solver(background, h0))
    error = np.abs(h.ravel() - model_exact(points))
    row = {
        "dim": background.dim,
        "n_points": background.n_points,
        "solver": name,
        "process_seconds": own,
        "wall_seconds": wall,
        "steps": n_steps,
        "max_error": float(error.max()),
        "mean_error": float(error.mean()),
    }
    print(row, file=sys.stderr)
    return row


def on_grids(dim, n_cells):
    """Return a row per solver on one grid."""
    grid = model_grid(n_cells, dim)
    h0 = model_bound(grid)
    return [
        {"cells": n_cells, **measure(name, solver, grid, h0, grid.points)}
        for name, solver in solvers(dim).items()
    ]


def on_octree(dim, factor):
    """Return a row per scheme on one octree, its leaves as fine as sizes of section 6.2 want."""
    tree = Octree.build(
        [-50.0] * dim, [50.0] * dim, refine_to_size(model_exact, factor=factor, g=G),
        max_level=12, root_shape=[10] * dim,
    )  # fmt: skip
    h0 = np.full(tree.n_points, np.inf)
    for x, size in SIZES.items():
        h0[np.linalg.norm(tree.points - place(x, dim), axis=1).argmin()] = size
    schemes = {
        "edge-based, ordered": partial(limited, method="edge-based"),
        "fast marching": limited,
    }
    rows = [measure(name, run, tree, h0, tree.points) for name, run in schemes.items()]
    if tree.n_points <= MOST_ITERATED:
        options = {"initial": np.full(tree.n_points, START), "tol": TOL}
        run = partial(limited, method="positive-coefficient", **options)
        rows.append(measure("positive coefficient", run, tree, h0, tree.points, times=1))
    return [{"leaves": tree.n_leaves, **row} for row in rows]


def by_solver(rows, n_points):
    return {row["solver"]: row for row in rows if row["n_points"] == n_points}


def table_of_paper(rows):
    """Return Table 3: seconds and what they are to fast marching, then and now."""
    heads = ["nodes", "", "edge iteration", "H-J iteration, dx/2", "fast marching",
             "edge to fast", "H-J to fast"]  # fmt: skip
    lines = []
    for n_cells, seconds in PAPER.items():
        found = by_solver(rows, (n_cells + 1) ** 2)
        if not found:
            continue
        now = [found[name]["process_seconds"] for name in heads[2:5]]
        for who, times in (("paper", seconds), ("here", now)):
            ratios = [f"{times[0] / times[2]:.1f}", f"{times[1] / times[2]:.1f}"]
            lines.append([f"{n_cells**2}", who, *map(three, times), *ratios])
    return table(heads, lines)


def table_of_all(rows):
    """Return all that was measured."""
    heads = ["dim", "nodes", "solver", "own s", "wall s", "µs/node", "to fast", "steps",
             "max error", "mean"]  # fmt: skip
    lines = []
    for row in rows:
        same = [r for r in rows if r["dim"] == row["dim"]]
        base = by_solver(same, row["n_points"])["fast marching"]["process_seconds"]
        own = row["process_seconds"]
        lines.append(
            [row["dim"], row["n_points"], row["solver"], three(own), three(row["wall_seconds"]),
             three(own / row["n_points"] * 1e6), f"{own / base:.2f}", row["steps"] or "",
             three(row["max_error"]), three(row["mean_error"])]
        )  # fmt: skip
    return table(heads, lines)


def compile_all():
    """Run every solver once where it costs nothing."""
    for dim in (2, 3):
        grid = model_grid(10, dim)
        for solver in solvers(dim).values():
            solver(grid, model_bound(grid))
        tree = Octree.build([0] * dim, [1] * dim, lambda x, s: x[:, 0] < 1.0, max_level=1)
        h0 = np.where(np.arange(tree.n_points) == 0, 1.0, np.inf)
        for method in ("edge-based", "fast-marching", "positive-coefficient"):
            limit_gradient(tree, h0, G, method=method)


def main():
    arguments = arguments_of(__doc__)
    compile_all()
    cells, factors = (QUICK_CELLS, QUICK_FACTORS) if arguments.quick else (CELLS, FACTORS)
    grids = [row for dim in cells for n in cells[dim] for row in on_grids(dim, n)]
    trees = [row for dim in factors for factor in factors[dim] for row in on_octree(dim, factor)]
    text = (
        f"# Table 3: two sources, seconds\n\n{machine()}; one thread; g = {G}; process time, the "
        f"least of three.\nThe paper's machine was an Athlon XP 2800+. What the solvers are: "
        f"`benchmarks/table3.py`.\n\n{table_of_paper(grids)}\n\n## All solvers on grids\n\n"
        f"{table_of_all(grids)}\n\n## Octrees, as conforming simplices\n\n{table_of_all(trees)}\n"
    )
    write(
        arguments.output, "table3", text, {"machine": machine(), "grids": grids, "octrees": trees}
    )


if __name__ == "__main__":
    main()
