"""Measure what the first calls in a new environment cost: compilation, and what starts a process.

    python benchmarks/first_calls.py [--only TEXT] [--kernels 8] [--passes]

Each call runs in a fresh process with one thread, first with an empty cache of kernels (cold), then
with the one that this has filled (warm).  Printed are processor seconds of the whole process and
its children, with the import of the package, and the number of compiled kernels.  With
``--kernels`` those that took longest, without the kernels that they call, and with ``--passes`` the
compiler's passes.  The digest tells whether two versions give the same result bit for bit.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def limiting(dim: int) -> object:
    """Limit three sizes on a square, or a cube."""
    import numpy as np

    import adaptsize as ads

    mesh = ads.CartesianGrid([0.0] * dim, 1.0, (9,) * dim).mesh
    h0 = np.full(mesh.n_points, np.inf)
    h0[[0, 7, 31]] = 0.1
    return ads.limit_gradient(mesh, h0, 0.3)


def limiting_of_field(dim: int) -> object:
    """Limit a smooth field on a square, or a cube, with a notch."""
    import adaptsize as ads

    whole = ads.CartesianGrid([0.0] * dim, 1.0, (9,) * dim).mesh
    middle = whole.points[whole.cells].mean(axis=1)
    mesh = ads.SimplexMesh(whole.points, whole.cells[~(middle > 4.0).all(axis=1)])
    return ads.limit_gradient(mesh, 0.1 + (mesh.points**2).sum(axis=1), 0.3)


def box() -> object:
    """Return the surface of a box with the notch of an edge."""
    import adaptsize as ads

    whole = ads.CartesianGrid([0.0] * 3, 1.0, (5, 4, 4)).mesh
    middle = whole.points[whole.cells].mean(axis=1)
    mesh = ads.SimplexMesh(whole.points, whole.cells[~(middle[:, :2] > 1.0).all(axis=1)])
    return mesh.boundary().mesh


def limiting_on_surface() -> object:
    """Limit three sizes on a surface."""
    import numpy as np

    import adaptsize as ads

    surface = box()
    h0 = np.full(surface.n_points, np.inf)
    h0[[0, 7, 31]] = 0.1
    return ads.limit_gradient(surface, h0, 0.3)


def plane_size() -> object:
    """Make the size function of a square with a notch."""
    import adaptsize as ads

    whole = ads.CartesianGrid([0.0, 0.0], 1.0, (9, 9)).mesh
    middle = whole.points[whole.cells].mean(axis=1)
    mesh = ads.SimplexMesh(whole.points, whole.cells[~(middle > 4.0).all(axis=1)])
    size = ads.size_function(mesh)
    return size(mesh.points)


def surface_size() -> object:
    """Make the size function of a box with a notch."""
    import adaptsize as ads

    surface = box()
    return ads.size_function(surface)(surface.points)


def remeshing() -> object:
    """Fill a box with a notch."""
    import adaptsize as ads

    surface = box()
    size = ads.size_function(surface, hmin=0.2, hmax=0.5)
    return ads.remesh(surface, size, target="tetrahedra").points


def adapting() -> object:
    """Adapt a square to sizes that are small on a line."""
    import numpy as np

    import adaptsize as ads

    mesh = ads.CartesianGrid([0.0, 0.0], 0.1, (11, 11)).mesh
    sizes = 0.05 + np.abs(mesh.points[:, 0] - 0.5)
    return ads.adapt(mesh, h0=sizes, fields={"x": sizes}).mesh.points


def command(name: str, *arguments: str) -> object:
    """Run a command on a surface."""
    import numpy as np

    import adaptsize as ads
    from adaptsize.cli import main

    file = Path("part.stl")
    ads.write(file, box())
    try:
        code = main([name, str(file), *arguments])
    except SystemExit as exit:
        code = exit.code
    return np.array([code or 0])


CALLS: dict[str, Callable[[], object]] = {
    "import": lambda: __import__("adaptsize"),
    "limit_gradient, square": lambda: limiting(2),
    "limit_gradient, notched square": lambda: limiting_of_field(2),
    "limit_gradient, cube": lambda: limiting(3),
    "limit_gradient, notched cube": lambda: limiting_of_field(3),
    "limit_gradient, surface": limiting_on_surface,
    "size_function, plane": plane_size,
    "size_function, surface": surface_size,
    "remesh, surface": remeshing,
    "adapt, plane": adapting,
    "adaptsize info": lambda: command("info"),
    "adaptsize remesh": lambda: command("remesh", "--max-elements", "2000", "-o", "out.vtu"),
}


def processor_seconds() -> float:
    """Return those of this process and of its children that have ended."""
    return sum(os.times()[:4])


def listen() -> tuple[dict[str, list[float]], dict[str, float]]:
    """Return the seconds of kernels and of passes, which fill up as kernels are compiled."""
    from numba.core import event

    kernels: dict[str, list[float]] = defaultdict(list)
    passes: dict[str, float] = defaultdict(float)

    class Timer(event.Listener):
        """Keeps the time of what is compiled without the time of what that compiles."""

        def __init__(self, done: Callable[[event.Event, float], None]) -> None:
            self.done = done
            self.stack: list[list[float]] = []

        def on_start(self, _started: event.Event) -> None:
            self.stack.append([time.process_time(), 0.0])

        def on_end(self, ended: event.Event) -> None:
            start, within = self.stack.pop()
            whole = time.process_time() - start
            if self.stack:
                self.stack[-1][1] += whole
            self.done(ended, whole - within)

    def compiled(ended: event.Event, seconds: float) -> None:
        function = ended.data["dispatcher"].py_func
        name = f"{function.__module__.removeprefix('adaptsize._kernels.')}.{function.__name__}"
        kernels[name].append(seconds)

    def passed(ended: event.Event, seconds: float) -> None:
        passes[ended.data["name"].split(" [")[0]] += seconds

    event.register("numba:compile", Timer(compiled))
    event.register("numba:run_pass", Timer(passed))
    return kernels, passes


def run(name: str) -> None:
    """Make one call and print what it took."""
    import warnings

    warnings.simplefilter("ignore")
    call = CALLS[name]
    if not os.environ.get("WITHOUT_TIMERS"):
        kernels, passes = listen()
    else:
        kernels, passes = {}, {}
    wall = time.perf_counter()
    result = call()
    wall = time.perf_counter() - wall
    content = result.tobytes() if hasattr(result, "tobytes") else b""
    digest = sha256(content).hexdigest()[:10]
    seconds = processor_seconds()
    print("\n" + json.dumps([seconds, wall, digest, kernels, passes]))


def measured(name: str, cache: Path, timers: bool = True) -> tuple[float, float, str, dict, dict]:
    """Return what a fresh process says."""
    env = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "NUMBA_NUM_THREADS": "1"}
    if not timers:
        env["WITHOUT_TIMERS"] = "1"
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, __file__, "--run", name],
            env=env, cwd=folder, check=True, capture_output=True, text=True,
        )  # fmt: skip
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="")
    parser.add_argument("--kernels", type=int, default=0)
    parser.add_argument("--passes", action="store_true")
    parser.add_argument("--run", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.run:
        run(arguments.run)
        return
    print("| call | cold, CPU s | warm, CPU s | cold, wall s | kernels | digest |")
    print("|---|---|---|---|---|---|", flush=True)
    for name in CALLS:
        if arguments.only not in name:
            continue
        with tempfile.TemporaryDirectory() as folder:
            cold, wall, digest, kernels, passes = measured(name, Path(folder))
            warm = min(measured(name, Path(folder), False)[0] for _ in range(2))
        count = sum(map(len, kernels.values()))
        print(
            f"| {name} | {cold:.2f} | {warm:.2f} | {wall:.2f} | {count} | {digest} |", flush=True
        )
        dearest = sorted(kernels.items(), key=lambda pair: -sum(pair[1]))[: arguments.kernels]
        for kernel, seconds in dearest:
            print(f"    {sum(seconds):6.2f} s  {len(seconds)} x  {kernel}")
        if arguments.passes:
            for step, took in sorted(passes.items(), key=lambda pair: -pair[1])[:12]:
                print(f"    {took:6.2f} s  pass {step}")


if __name__ == "__main__":
    main()
