"""Time the limiting schemes on the two-source problem of Persson, section 6.2.

    python benchmarks/limiting.py [--quick] [--output benchmarks/results]

Jittered Delaunay triangles (10k to 640k nodes) and jittered tetrahedra (30k to 1M
nodes); every run is a process of its own on one thread, kernels compiled beforehand, best of
three.  Seconds are all in: arrays in, array out, adjacency included.  Writes
`limiting.md` and `limiting.json`.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
import tracemalloc
from itertools import permutations
from pathlib import Path

import numpy as np

G = 0.3
METHODS = ("edge-based", "fast-marching", "positive-coefficient", "exact")
SIDES = {"triangles": (100, 200, 400, 800), "tetrahedra": (31, 59, 100)}
QUICK_SIDES = {"triangles": (100, 200), "tetrahedra": (16, 31)}


def jittered_triangles(n_side):
    """Return points and Delaunay triangles of a grid on (-50, 50)^2 moved by up to 0.3 cells."""
    from scipy.spatial import Delaunay

    points = jittered_grid(n_side, 2, 0.3)
    return points, Delaunay(points).simplices


def jittered_tetrahedra(n_side):
    """Return points of a grid on (-50, 50)^3 moved by up to 0.15 cells, each cube cut in six.

    Not Delaunay: for a million points on a grid that takes a quarter of an hour.
    """
    points = jittered_grid(n_side, 3, 0.15)
    node = np.arange(n_side**3).reshape(n_side, n_side, n_side)
    cells = []
    for way in permutations(range(3)):  # from one corner to the opposite one, axis by axis
        corner = np.zeros(3, int)
        path = []
        for step in (None, *way):
            if step is not None:
                corner[step] = 1
            block = tuple(slice(c, n_side - 1 + c) for c in corner)
            path.append(node[block].ravel())
        cells.append(np.column_stack(path))
    return points, np.concatenate(cells)


def jittered_grid(n_side, dim, share):
    """Return the points of a grid on (-50, 50)^dim, the inner ones moved."""
    rng = np.random.default_rng(20050711)
    axis = np.linspace(-50.0, 50.0, n_side)
    points = np.stack(np.meshgrid(*[axis] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    spacing = axis[1] - axis[0]
    inner = (np.abs(points) < 50.0 - 0.5 * spacing).all(axis=1)
    points[inner] += rng.uniform(-share, share, (int(inner.sum()), dim)) * spacing
    return points


def two_sources(points):
    """Return h0 (1 near (-10, 0), 5 near (10, 0), else inf) and the exact limited size."""
    h0 = np.full(len(points), np.inf)
    exact = h0.copy()
    for x, size in ((-10.0, 1.0), (10.0, 5.0)):
        place = np.zeros(points.shape[1])
        place[0] = x
        node = int(np.argmin(np.linalg.norm(points - place, axis=1)))
        h0[node] = size
        exact = np.minimum(exact, size + G * np.linalg.norm(points - points[node], axis=1))
    return h0, exact


MESHES = {"triangles": jittered_triangles, "tetrahedra": jittered_tetrahedra}


def measure(mesh_file, method):
    """Return seconds, errors and memory of one scheme on one mesh, as this process sees them."""
    from adaptsize import SimplexMesh, limit_gradient

    data = np.load(mesh_file)
    points, cells = data["points"], data["cells"]
    h0, exact = two_sources(points)
    few = np.flatnonzero((cells < len(points)).all(axis=1))[:1000]
    nodes, local = np.unique(cells[few], return_inverse=True)
    small = SimplexMesh(points[nodes], local.reshape(len(few), -1))
    limit_gradient(small, np.where(np.arange(len(nodes)) == 0, 1.0, np.inf), G, method=method)

    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        mesh = SimplexMesh(points, cells)
        h = limit_gradient(mesh, h0, G, method=method)
        seconds.append(time.perf_counter() - start)
    error = h - exact
    return {
        "n_points": len(points),
        "n_cells": len(cells),
        "method": method,
        "seconds": min(seconds),
        "peak_bytes_per_node": peak_memory(SimplexMesh(points, cells), h0, method) / len(points),
        "max_error": float(np.abs(error).max()),
        "mean_error": float(np.abs(error).mean()),
    }


def peak_memory(mesh, h0, method):
    """Return the most bytes of arrays that one call needs beside mesh and h0."""
    from adaptsize import limit_gradient

    tracemalloc.start()
    limit_gradient(mesh, h0, G, method=method)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


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


def table(rows):
    """Return the rows as a markdown table, with ratios to the edge-based scheme."""
    lines = [
        "| cells | nodes | method | s | ns/node | to edge-based | bytes/node | max error | mean |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        base = next(
            r
            for r in rows
            if (r["kind"], r["n_points"], r["method"])
            == (row["kind"], row["n_points"], "edge-based")
        )
        per_node = row["seconds"] / row["n_points"] * 1e9
        lines.append(
            f"| {row['kind']} | {row['n_points']} | {row['method']} | {row['seconds']:.3g} "
            f"| {per_node:.0f} | {row['seconds'] / base['seconds']:.2f} "
            f"| {row['peak_bytes_per_node']:.0f} | {row['max_error']:.3g} "
            f"| {row['mean_error']:.3g} |"
        )
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small meshes only")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    parser.add_argument("--one", nargs=2, metavar=("MESH", "METHOD"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(measure(*arguments.one)))
        return

    rows = []
    with tempfile.TemporaryDirectory() as workdir:
        starts = start_up(workdir)
        for kind, sides in (QUICK_SIDES if arguments.quick else SIDES).items():
            for side in sides:
                points, cells = MESHES[kind](side)
                mesh_file = str(Path(workdir) / "mesh.npz")
                np.savez(mesh_file, points=points, cells=cells)
                for method in METHODS:
                    command = [sys.executable, __file__, "--one", mesh_file, method]
                    done = subprocess.run(command, check=True, capture_output=True, text=True)
                    rows.append({"kind": kind, **json.loads(done.stdout)})
                    print(rows[-1], file=sys.stderr)
    machine = f"{platform.machine()}, {platform.system()}, Python {platform.python_version()}"
    arguments.output.mkdir(parents=True, exist_ok=True)
    report = {"machine": machine, "start_up_seconds": starts, "rows": rows}
    (arguments.output / "limiting.json").write_text(json.dumps(report, indent=1) + "\n")
    text = f"# Limiting schemes, two sources\n\n{machine}; one thread; g = {G}.\n\n{table(rows)}\n"
    text += "\n| process | s |\n|---|---|\n"
    text += "\n".join(f"| {name} | {seconds:.2f} |" for name, seconds in starts.items()) + "\n"
    (arguments.output / "limiting.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
