"""Measure what several threads gain, and which share of the work is left to one.

    python benchmarks/cores.py [--threads 1 2 4] [--only TEXT] [--size 1.0]

Each problem runs in a fresh process for each number of threads: once to compile, then three times,
of which the fastest counts.  Printed are wall seconds, and the serial share: the processor time
outside of the chunks that threads share, over all.  It bounds what many cores can gain
(Amdahl's law), also where other work keeps the cores busy.  ``--size`` multiplies the number of
nodes.
"""

import argparse
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
#: Cores for which the possible speed-up is printed.
MANY = 16


def grid(dim: int, nodes: float) -> object:
    """Return a square or cube of about so many nodes."""
    import adaptsize as ads

    n = round(nodes ** (1.0 / dim))
    return ads.CartesianGrid([0.0] * dim, 1.0 / n, (n,) * dim).mesh


def limited(dim: int, nodes: float, few: bool) -> Callable[[], object]:
    """Limit three sizes, or a smooth field."""
    import adaptsize as ads

    mesh = grid(dim, nodes)
    h0 = 0.01 + (mesh.points**2).sum(axis=1)
    if few:
        h0 = np.full(mesh.n_points, np.inf)
        h0[[0, mesh.n_points // 3, mesh.n_points // 2]] = 0.01

    def call() -> object:
        # A new mesh: the old one remembers its boundary and its tree.
        return ads.limit_gradient(ads.SimplexMesh(mesh.points, mesh.cells), h0, 0.3)

    return call


def surface(facets: float) -> object:
    """Return the surface of a ball of cubes."""
    import adaptsize as ads

    n = max(4, round((facets / 7.6) ** 0.5))
    whole = ads.CartesianGrid([-1.0] * 3, 2.0 / n, (n + 1,) * 3).mesh
    middle = whole.points[whole.cells].mean(axis=1)
    inside = np.linalg.norm(middle, axis=1) < 0.9
    return ads.SimplexMesh(whole.points, whole.cells[inside]).boundary().mesh


def sized(nodes: float, bracket: bool) -> Callable[[], object]:
    """Make a size function of the bracket, or of a ball of cubes."""
    import adaptsize as ads

    given = ads.read(ROOT / "data" / "bracket.stl") if bracket else surface(nodes)
    return lambda: ads.size_function(ads.SimplexMesh(given.points, given.cells))


def queried(nodes: float, what: str) -> Callable[[], object]:
    """Ask for winding numbers, the closest cells, or a size."""
    import adaptsize as ads
    from adaptsize.geometry.distance.winding import WindingNumber

    skin = surface(20_000.0)
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (round(nodes), 3))
    if what == "winding":
        winding = WindingNumber(skin)
        return lambda: winding(points)
    if what == "nearest":
        skin.locator  # noqa: B018 - kept by the mesh
        return lambda: skin.locator.nearest(points)
    mesh = grid(3, 30_000.0)
    h = ads.SizeFunction(mesh, 0.1 + mesh.points[:, 0])
    return lambda: h(points)


def measured(nodes: float, what: str) -> Callable[[], object]:
    """Measure the conformity of a mesh to a size, or recover its Hessian, or transfer a field."""
    import adaptsize as ads

    mesh = grid(3, nodes)
    values = (mesh.points**2).sum(axis=1)
    if what == "conformity":
        return lambda: ads.size_conformity(mesh, 0.1 + values)
    if what == "recovery":
        return lambda: ads.sizes.recovered_hessian(mesh, values)
    new = grid(3, 0.7 * nodes)
    return lambda: ads.transfer_fields(mesh, new, fields={"u": values})


PROBLEMS: dict[str, Callable[[float], Callable[[], object]]] = {
    "plane, 640 000 nodes, 3 points": lambda size: limited(2, 640e3 * size, True),
    "plane, 640 000 nodes, field": lambda size: limited(2, 640e3 * size, False),
    "space, 1.03 million nodes, 3 points": lambda size: limited(3, 1030e3 * size, True),
    "space, 1.03 million nodes, field": lambda size: limited(3, 1030e3 * size, False),
    "size_function, bracket": lambda size: sized(size, True),
    "size_function, 100 000 facets": lambda size: sized(100e3 * size, False),
    "winding numbers, 1 million points": lambda size: queried(1e6 * size, "winding"),
    "nearest cells, 1 million points": lambda size: queried(1e6 * size, "nearest"),
    "sizes at 1 million points": lambda size: queried(1e6 * size, "sizes"),
    "conformity, 500 000 nodes": lambda size: measured(500e3 * size, "conformity"),
    "recovery, 500 000 nodes": lambda size: measured(500e3 * size, "recovery"),
    "transfer, 500 000 nodes": lambda size: measured(500e3 * size, "transfer"),
}


def watch() -> list[float]:
    """Return a list to which the processor seconds of chunks are added."""
    from adaptsize._workers import Workers

    in_chunks, seconds, adding = Workers.in_chunks, [0.0], threading.Lock()

    def watched(self: object, task: Callable, n: int, *rest: object, **named: object) -> None:
        def timed(first: int, last: int) -> None:
            began = time.thread_time()
            task(first, last)
            with adding:
                seconds[0] += time.thread_time() - began

        in_chunks(self, timed, n, *rest, **named)

    Workers.in_chunks = watched
    return seconds


def run(name: str, size: float) -> None:
    """Solve a problem and print wall seconds and the serial share of the fastest of three."""
    import warnings

    warnings.simplefilter("ignore")
    call, chunks, best = PROBLEMS[name](size), watch(), (np.inf, 0.0)
    call()
    for _ in range(3):
        chunks[0], wall, processor = 0.0, time.perf_counter(), time.process_time()
        call()
        wall = time.perf_counter() - wall
        processor = time.process_time() - processor
        best = min(best, (wall, 1.0 - chunks[0] / processor))
    print("\n" + json.dumps(best))


def main() -> None:
    """Print the table."""
    cores = os.cpu_count() or 1
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    powers = [2**k for k in range(cores.bit_length())]
    parser.add_argument("--threads", type=int, nargs="+", default=powers)
    parser.add_argument("--only", default="")
    parser.add_argument("--size", type=float, default=1.0)
    parser.add_argument("--run", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.run:
        run(given.run, given.size)
        return
    heads = [f"{k} threads, wall s" for k in given.threads]
    print(f"| problem | {' | '.join(heads)} | speed-up | serial share | {MANY} cores at most |")
    print("|---" * (len(heads) + 4) + "|", flush=True)
    for name in PROBLEMS:
        if given.only not in name:
            continue
        walls, share = [], 0.0
        for k in given.threads:
            command = [sys.executable, __file__, "--run", name, "--size", str(given.size)]
            env = {**os.environ, "NUMBA_NUM_THREADS": str(k)}
            done = subprocess.run(command, env=env, check=True, capture_output=True, text=True)
            wall, own = json.loads(done.stdout.splitlines()[-1])
            walls.append(wall)
            share = own if k == given.threads[0] else share
        times = " | ".join(f"{wall:.3f}" for wall in walls)
        most = 1.0 / (share + (1.0 - share) / MANY)
        gain = walls[0] / min(walls)
        print(f"| {name} | {times} | {gain:.2f} | {share:.1%} | {most:.1f} |", flush=True)


if __name__ == "__main__":
    main()
