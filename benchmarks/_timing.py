"""What the benchmarks of grids share: the model problem, best-of times, tables."""

import argparse
import json
import os
import platform
import time
from pathlib import Path

import numpy as np

G = 0.3
SIZES = {-10.0: 1.0, 10.0: 5.0}


def place(x, dim):
    """Return the point (x, 0, ...)."""
    return np.array([x] + [0.0] * (dim - 1))


def model_grid(n_cells, dim):
    """Return a grid on (-50, 50)^dim; the sources are nodes if 10 divides ``n_cells``."""
    from adaptsize import CartesianGrid  # tables alone do not need it

    return CartesianGrid([-50.0] * dim, 100.0 / n_cells, (n_cells + 1,) * dim)


def node_of(grid, x):
    """Return the indices of the node at (x, 0, ...)."""
    return tuple(np.rint((place(x, grid.dim) - grid.origin) / grid.spacing).astype(int))


def model_bound(grid):
    """Return h0 of section 6.2: 1 at (-10, 0), 5 at (10, 0), else inf."""
    h0 = np.full(grid.shape, np.inf)
    for x, size in SIZES.items():
        h0[node_of(grid, x)] = size
    return h0


def model_exact(points):
    """Return the limited size of section 6.2, formula (11) of the paper."""
    sizes = [size + G * np.linalg.norm(points - place(x, points.shape[1]), axis=1)
             for x, size in SIZES.items()]  # fmt: skip
    return np.min(sizes, axis=0)


def best_of(times, function):
    """Return the result of a function, its least wall time and least process time."""
    walls, owns = [], []
    for _ in range(times):
        wall, own = time.perf_counter(), time.process_time()
        result = function()
        walls.append(time.perf_counter() - wall)
        owns.append(time.process_time() - own)
    return result, min(walls), min(owns)


def table(heads, rows):
    """Return a markdown table."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(str(x) for x in line) + " |" for line in lines)


def three(x):
    """Return a number to three figures, without an exponent."""
    return f"{x:.{max(0, 2 - int(np.floor(np.log10(x))))}f}" if x > 0.0 else "0"


def arguments_of(description):
    """Return --quick and --output of the command line."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="small grids only")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    return parser.parse_args()


def machine():
    """Say what ran the benchmark, and how many others wanted to run."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    return (
        f"{platform.machine()}, {platform.system()}, Python {platform.python_version()}, "
        f"load {load:.1f} at the end"
    )


def write(output, name, text, report):
    """Write the results as markdown and as JSON."""
    output.mkdir(parents=True, exist_ok=True)
    (output / f"{name}.md").write_text(text)
    (output / f"{name}.json").write_text(json.dumps(report, indent=1) + "\n")
    print(text)
