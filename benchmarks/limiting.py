"""Time the limiting schemes, and measure their errors, on problems of known solution.

    python benchmarks/limiting.py [--quick] [--only TEXT] [--output benchmarks/results]

Two sources (Persson, section 6.2) on triangles, tetrahedra and grids, and in a periodic square;
hundreds of sources; domains with slits, holes, mazes, walls and thousands of corners; data on a
boundary, smooth fields, noise; a smooth g; the sides of a prism; a sphere, on its triangles and
("exact") along great circles.  Every problem is a process of its own on one thread.  Its methods
take turns, so that ratios of their times come from one stretch of time; kernels are compiled
beforehand.  Seconds are processor time, the best of three (two for 100 000 nodes and more; one for
the slow iteration, which is left out above 300 000), all in: arrays in, array out, adjacency
included.  Writes `limiting.md` and `limiting.json`.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import tracemalloc
from pathlib import Path

import numba
import numpy as np
from _timing import G, machine, three, write

QUICK = 30_000  # nodes, at most, with --quick
ITERATION = "positive-coefficient"
ITERATION_UP_TO = 300_000  # nodes
WRONG = 1e-9
STATISTICS = ("max_error", "mean_error", "most_below", "q99_error", "wrong_share")


def measure(name, n):
    """Return one row per method: seconds, errors and memory, as this process sees them."""
    from _problems import SERIES

    numba.set_num_threads(1)
    series = SERIES[name]
    methods = {m: o for m, o in series.methods.items() if m != ITERATION or n <= ITERATION_UP_TO}
    small, problem = series.make(2000), series.make(n)
    rounds = 3 if n < 100_000 else 2
    best = dict.fromkeys(methods, np.inf)
    peak, sizes = {}, {}
    for options in methods.values():
        solve(small, options)
    for number in range(rounds):
        last = number == rounds - 1
        for method, options in methods.items():
            if method == ITERATION and not last:
                continue
            if last:
                tracemalloc.start()  # costs no time worth telling: arrays are few
            seconds, sizes[method] = solve(problem, options)
            best[method] = min(best[method], seconds)
            if last:
                peak[method] = tracemalloc.get_traced_memory()[1]
                tracemalloc.stop()
    return [
        {
            "problem": name,
            "n_points": problem.background.n_points,
            "method": method,
            "seconds": best[method],
            "peak_bytes_per_node": peak[method] / problem.background.n_points,
            **errors(sizes[method].ravel()[problem.nodes] - problem.exact.ravel()),
        }
        for method in methods
    ]


def solve(problem, options):
    """Return the seconds that limiting took on a fresh mesh, and the sizes."""
    from adaptsize import SimplexMesh, limit_gradient, limit_on_sphere

    background = problem.background
    if options["method"] == "great circles":
        start = time.process_time()
        radius = np.linalg.norm(background.points[0])
        lon_lat = longitudes_and_latitudes(background.points)
        h = limit_on_sphere(lon_lat, problem.h0, problem.g, radius=radius, threads=1)
        return time.process_time() - start, h
    start = time.process_time()
    if isinstance(background, SimplexMesh):  # nothing derived is there yet
        background = SimplexMesh(background.points, background.cells)
    h = limit_gradient(background, problem.h0, problem.g, **options)
    return time.process_time() - start, h


def longitudes_and_latitudes(points):
    """Return those of points on a sphere around 0, in degrees."""
    x, y, z = points.T
    return np.rad2deg(np.column_stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))]))


def errors(error):
    """Return the statistics of the errors; nodes in no cell are infinite in both."""
    if len(error) == 0:  # nothing is known
        return dict.fromkeys(STATISTICS, np.nan)
    error = np.nan_to_num(error, nan=0.0)
    size = np.abs(error)
    return {
        "max_error": float(size.max()),
        "mean_error": float(size.mean()),
        "most_below": float(max(0.0, -error.min())),
        "q99_error": float(np.quantile(size, 0.99)),
        "wrong_share": float((size > WRONG).mean()),
    }


def in_process(code, cache):
    """Run Python code in a fresh process and return its seconds."""
    start = time.perf_counter()
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
    return time.perf_counter() - start


def start_up(workdir):
    """Return seconds of processes: import, first call ever, first call of a later process."""
    call = (
        "import numpy as np, adaptsize as ads\n"
        "mesh = ads.SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])\n"
        "ads.limit_gradient(mesh, [0.1, np.inf, np.inf, np.inf], 0.3)\n"
    )
    cache = str(Path(workdir) / "fresh_cache")
    return {
        "import adaptsize": in_process("import adaptsize", cache),
        "import numpy, numba": in_process("import numpy, numba", cache),
        "first call, compiling": in_process(call, cache),
        "first call of a later process": min(in_process(call, cache) for _ in range(3)),
    }


def summary(rows):
    """Return errors and times of the schemes that `auto` chooses from, side by side."""
    lines = [
        "| problem | nodes | fast marching | exact | wrong nodes | time, us/node | auto |",
        "|---|" + "---|" * 6,
    ]
    last = None
    by_mesh = {}
    for row in rows:
        by_mesh.setdefault((row["problem"], row["n_points"]), {})[row["method"]] = row
    for (name, n), found in by_mesh.items():
        line = [name if name != last else "", str(n), "", "", "", "", ""]
        last = name
        seconds = found["fast-marching"]["seconds"]
        line[2] = both_errors(found["fast-marching"])
        if row := found.get("exact"):
            line[3:5] = both_errors(row), share(row["wrong_share"])
            line[5] = f"{row['seconds'] / seconds:.2f}, {row['seconds'] / n * 1e6:.2f}"
        if row := found.get("auto"):
            line[6] = f"{row['seconds'] / seconds:.2f}"
        lines.append("| " + " | ".join(line) + " |")
    return "\n".join(lines)


def both_errors(row):
    """Return the largest and the mean error; those below 1e-9 are rounding."""
    if np.isnan(row["max_error"]):
        return "unknown"
    return " / ".join(
        f"{e:.2g}" if e > WRONG else "0" for e in (row["max_error"], row["mean_error"])
    )


def table(rows):
    """Return the rows as a markdown table, with ratios to fast marching on the same mesh."""
    lines = [
        "| problem | nodes | method | s | us/node | to fast marching | bytes/node "
        "| max error | mean | wrong nodes | most below |",
        "|---|" + "---|" * 10,
    ]
    base = {
        (r["problem"], r["n_points"]): r["seconds"] for r in rows if r["method"] == "fast-marching"
    }
    for row in rows:
        per_node = row["seconds"] / row["n_points"] * 1e6
        ratio = row["seconds"] / base[row["problem"], row["n_points"]]
        lines.append(
            f"| {row['problem']} | {row['n_points']} | {row['method']} | {row['seconds']:.3g} "
            f"| {per_node:.2f} | {ratio:.2f} | {row['peak_bytes_per_node']:.0f} "
            f"| {row['max_error']:.2g} | {row['mean_error']:.2g} | {share(row['wrong_share'])} "
            f"| {row['most_below']:.2g} |"
        )
    return "\n".join(lines)


def share(part):
    """Return a share as a percentage."""
    if np.isnan(part):
        return "unknown"
    return "0" if part == 0.0 else f"{three(100.0 * part)} %"


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="small meshes only")
    parser.add_argument("--only", default="", metavar="TEXT", help="problems with it in the name")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    parser.add_argument("--one", nargs=2, metavar=("PROBLEM", "N"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(measure(arguments.one[0], int(arguments.one[1]))))
        return

    from _problems import SERIES

    rows = []
    with tempfile.TemporaryDirectory() as workdir:
        starts = start_up(workdir)
        for name, series in SERIES.items():
            for n in series.sizes if arguments.only in name else ():
                if arguments.quick and n > QUICK and n != min(series.sizes):
                    continue
                command = [sys.executable, __file__, "--one", name, str(n)]
                done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
                rows += json.loads(done.stdout)
                print(f"{time.strftime('%X')} {name}, {n}", file=sys.stderr)
    text = (
        f"# Limiting schemes\n\n{machine()}; one thread; processor time; g = {G} but in g(x).  "
        f"A node is wrong by more than {WRONG:g}; sizes are up to 30.\n"
        "\nErrors, largest / mean; times as multiples of that of fast marching.\n\n"
        f"{summary(rows)}\n\nAll methods:\n\n{table(rows)}\n"
        "\n| process | s (wall) |\n|---|---|\n"
    )
    text += "\n".join(f"| {name} | {seconds:.2f} |" for name, seconds in starts.items()) + "\n"
    report = {"machine": machine(), "start_up_seconds": starts, "rows": rows}
    write(arguments.output, "limiting", text, report)


if __name__ == "__main__":
    main()
