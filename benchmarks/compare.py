"""Compare the speed of two commits by paired runs.

    python benchmarks/compare.py OLD NEW [--rounds 5] [--only TEXT]

The sources of both commits are extracted to temporary directories.  Each round runs every case in
a fresh process per commit, in alternating order, so that both see the same load; the cases are
those of this file for both commits and use public functions only.  Kernels are compiled
beforehand, into a cache of each commit.  Printed are the processor times of the fastest runs and
the median of the ratios NEW / OLD of the pairs, with the smallest and largest of them.  Two equal
commits show the noise.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
# In a process a case is repeated so often, and for so many seconds; the fastest run counts.
REPEATS, SECONDS = 3, 1.0


def jittered(n, dim, *, half_width=1.0):
    """Return a mesh of a square or cube with about n nodes, by Delaunay's triangulation."""
    from scipy.spatial import Delaunay

    import adaptsize as ads

    side = round(n ** (1.0 / dim))
    axis = np.linspace(-half_width, half_width, side)
    points = np.stack(np.meshgrid(*[axis] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    inside = (np.abs(points) < half_width).all(axis=1)
    step = 0.25 * (axis[1] - axis[0])
    moves = np.random.default_rng(20406).uniform(-step, step, points.shape)
    points = points + moves * inside[:, None]
    cells = Delaunay(points).simplices
    mesh = ads.SimplexMesh(points, cells)
    return ads.SimplexMesh(points, cells[mesh.measures > 1e-9 * mesh.measures.max()])


def limiting(n, dim, bounds):
    """Return a call that limits a field of few or many bounds."""
    import adaptsize as ads

    mesh = jittered(n, dim)
    if bounds == "smooth":
        h0 = 0.05 + (mesh.points**2).sum(axis=1)
    else:
        h0 = np.full(mesh.n_points, np.inf)
        h0[np.random.default_rng(5091).integers(mesh.n_points, size=bounds)] = 0.01
    return lambda: ads.limit_gradient(mesh, h0, g=0.25)


def around_slit(n):
    """Return a call that limits around the slit of the sample, refined to its size."""
    import adaptsize as ads

    mesh = ads.read(ROOT / "data" / "slit.vtu")
    h0 = np.full(mesh.n_points, np.inf)
    h0[:: max(mesh.n_points // n, 1)] = 0.02
    return lambda: ads.limit_gradient(mesh, h0, g=0.25)


def marching(n):
    """Return a call that limits by fast marching."""
    import adaptsize as ads

    mesh = jittered(n, 2)
    h0 = np.full(mesh.n_points, np.inf)
    h0[0] = 0.01
    return lambda: ads.limit_gradient(mesh, h0, g=0.25, method="fast-marching")


def periodic(n):
    """Return a call that limits a field of few bounds in a periodic square."""
    import adaptsize as ads

    mesh = jittered(n, 2)
    h0 = np.full(mesh.n_points, np.inf)
    h0[np.random.default_rng(5092).integers(mesh.n_points, size=2)] = 0.01
    return lambda: ads.limit_gradient(mesh, h0, g=0.25, periodic=2.0 * np.eye(2))


def around_the_earth(n):
    """Return a call that limits along great circles, from random points with bounds."""
    import adaptsize as ads

    rng = np.random.default_rng(5093)
    lon_lat = np.column_stack(
        [rng.uniform(-180.0, 180.0, n), np.rad2deg(np.arcsin(rng.uniform(-1.0, 1.0, n)))]
    )
    h0 = np.full(n, np.inf)
    h0[:2000] = rng.uniform(1e3, 1e5, 2000)
    return lambda: ads.limit_on_sphere(lon_lat, h0, 0.25)


def sizes_of_part():
    """Return a call that makes the size function of the bracket."""
    import adaptsize as ads

    mesh = ads.read(ROOT / "data" / "bracket.stl")
    return lambda: ads.size_function(ads.SimplexMesh(mesh.points, mesh.cells), hmin=1.0)


def distance(n):
    """Return a call that computes the distance of the bracket at the nodes of a grid."""
    import adaptsize as ads

    mesh = ads.read(ROOT / "data" / "bracket.stl")
    grid = ads.CartesianGrid.around(mesh.points, mesh.diagonal / n)
    return lambda: ads.signed_distance(grid, mesh)


def transfer(n):
    """Return a call that transfers a nodal and a cell field."""
    import adaptsize as ads

    old, new = jittered(n, 2), jittered(n // 2, 2)
    field, cells = old.points[:, 0], old.points[old.cells].mean(axis=1)[:, 0]

    def call():
        made = ads.FieldTransfer(ads.SimplexMesh(old.points, old.cells), new)
        return made.nodal(field), made.cells(cells)

    return call


CASES: dict[str, Callable] = {
    "limit, 2 bounds, 100 000 triangle nodes": lambda: limiting(100_000, 2, 2),
    "limit, 2000 bounds, 100 000 triangle nodes": lambda: limiting(100_000, 2, 2000),
    "limit, smooth field, 40 000 triangle nodes": lambda: limiting(40_000, 2, "smooth"),
    "limit, 2 bounds, 40 000 tetrahedron nodes": lambda: limiting(40_000, 3, 2),
    "limit, around a slit": lambda: around_slit(200),
    "fast marching, 100 000 triangle nodes": lambda: marching(100_000),
    "limit, periodic, 40 000 triangle nodes": lambda: periodic(40_000),
    "limit on the sphere, 100 000 points": lambda: around_the_earth(100_000),
    "size function of the bracket": sizes_of_part,
    "signed distance of the bracket": lambda: distance(60),
    "transfer of fields, 40 000 nodes": lambda: transfer(40_000),
}


def measured(only):
    """Return the processor seconds of each case in this process, None where it fails."""
    found = {}
    for name, make in CASES.items():
        if only not in name:
            continue
        try:
            call = make()
            call()  # compiles, or loads compiled kernels
            runs: list[float] = []
            start = time.process_time()
            while len(runs) < REPEATS or time.process_time() - start < SECONDS:
                began = time.process_time()
                call()
                runs.append(time.process_time() - began)
            found[name] = min(runs)
        except Exception as error:  # an older commit may lack an argument
            print(f"{name}: {type(error).__name__}: {error}", file=sys.stderr)
            found[name] = None
    return found


def extract(commit, folder):
    """Extract the sources of a commit and return their directory."""
    archive = subprocess.run(
        ["git", "-C", ROOT, "archive", commit, "src"], check=True, capture_output=True
    ).stdout
    folder.mkdir()
    subprocess.run(["tar", "-x", "-C", folder], input=archive, check=True)
    return folder / "src"


def run(source, only):
    """Return the seconds of all cases with the sources of a commit, in a fresh process."""
    environment = os.environ | {
        "PYTHONPATH": str(source),
        "NUMBA_CACHE_DIR": str(source.parent / "cache"),
        "NUMBA_NUM_THREADS": "1",
    }
    words = [sys.executable, __file__, "--measure", "--only", only]
    child = subprocess.run(words, env=environment, check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(child.stdout)


def compare(sources, rounds, only, measure=run):
    """Return per case the fastest times of both, and the ratios of the pairs."""
    for source in sources:
        measure(source, only)  # compile
    pairs = []
    for number in range(rounds):
        order = (0, 1) if number % 2 == 0 else (1, 0)
        times = {which: measure(sources[which], only) for which in order}
        pairs.append((times[0], times[1]))
    rows = []
    for name in pairs[0][1]:
        both = [(old.get(name), new.get(name)) for old, new in pairs]
        complete = [(a, b) for a, b in both if a is not None and b is not None]
        if complete:
            ratios = sorted(b / a for a, b in complete)
            rows.append((name, *(min(times) for times in zip(*complete, strict=True)), ratios))
    return rows


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("commits", nargs="*", metavar="COMMIT", help="OLD and NEW")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", default="", help="cases whose names contain this text")
    parser.add_argument("--measure", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        print(json.dumps(measured(arguments.only)))
        return
    if len(arguments.commits) != 2:
        parser.error("give two commits: OLD NEW")
    with tempfile.TemporaryDirectory() as folder:
        names = ("old", "new")
        sources = [
            extract(commit, Path(folder, name))
            for commit, name in zip(arguments.commits, names, strict=True)
        ]
        rows = compare(sources, arguments.rounds, arguments.only)
    print("| case | old, s | new, s | new / old | smallest and largest |\n|---|---|---|---|---|")
    for name, old, new, ratios in rows:
        print(
            f"| {name} | {old:.4f} | {new:.4f} | {np.median(ratios):.2f} "
            f"| {ratios[0]:.2f} to {ratios[-1]:.2f} |"
        )


if __name__ == "__main__":
    main()
