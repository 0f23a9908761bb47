"""Remesh every surface in a folder, each in a child process, and tabulate what happened.

    python -m tests.attack.corpus DIR [--output FILE] [--timeout S] [--memory GB]
    python -m tests.attack.corpus --nasty N --seed S [--output FILE]

The outcomes are kept in FILE.jsonl, one line per surface.  A second run skips what is there, so
that an interrupted run can be resumed.  FILE is the table, in markdown.  With ``--nasty`` the
surfaces are those of `nasty`, and the table has a line per defect.

An outcome is of one of five kinds:

kept      a mesh without inverted cells that meets the demands of `check_mesh` on the boundary, the
          volume and the topology
warned    a mesh without inverted cells that misses such a demand, with a warning about the surface
deviates  the same without a warning
refused   an error of one line
failed    anything else: a crash, a limit of time or memory, an unclear error, inverted cells
"""

import argparse
import contextlib
import json
import os
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .nasty import write_surfaces
from .tables import table, table_of_defects

_SUFFIXES = {".stl", ".off", ".obj", ".ply", ".vtk", ".vtu", ".msh", ".mesh", ".meshb"}
#: The wall time of a case is limited to this many times its processor time.
_PATIENCE = 20.0
#: Demands of `check_mesh` about the domain.
_OF_DOMAIN = ("boundary", "measure", "topology")


def main() -> int:
    arguments = _arguments()
    folder = Path(arguments.folder or f"nasty-{arguments.seed}")
    if arguments.nasty:
        write_surfaces(folder, arguments.nasty, arguments.seed)
    files = sorted(p for p in folder.rglob("*") if p.suffix.lower() in _SUFFIXES)
    store = arguments.output.with_suffix(arguments.output.suffix + ".jsonl")
    known = {row["file"]: row for row in _rows_in(store)}
    _load_kernels()
    for number, file in enumerate(files, 1):
        name = str(file.relative_to(folder))
        if name in known:
            continue
        row = {"file": name, **_in_child(file, arguments)}
        known[name] = row
        with open(store, "a", encoding="utf-8") as rows:
            rows.write(json.dumps(row) + "\n")
        said = f"{row['kind']}: {row['outcome'][:120]}"
        print(f"{number} of {len(files)}: {name}: {said}", flush=True)
    chosen = [known[str(file.relative_to(folder))] for file in files]
    made = table_of_defects(chosen) if arguments.nasty else table(chosen)
    arguments.output.write_text(made, encoding="utf-8")
    bad = sum(row["kind"] == "failed" for row in chosen)
    print(f"{len(files)} files, {bad} failed; {arguments.output}")
    return 1 if bad else 0


def outcome_of(file: Path, max_elements: float, tolerance: float) -> dict[str, Any]:
    """Read, size, remesh and check a surface in this process."""
    import adaptsize as ads

    from .calls import check_error
    from .cases import Failure

    row: dict[str, Any] = {}
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            surface = ads.read(file)
            row["triangles"] = surface.n_cells
            size = ads.size_function(surface, max_elements=max_elements, tolerance=tolerance)
            made = ads.remesh(surface, size, tolerance=tolerance)
        found = ads.size_conformity(made, size, surface=_of_space(surface))
        check = ads.check_mesh(made, original=surface, size=size, tolerance=tolerance)
    except Exception as error:
        try:
            check_error(error)
        except Failure as failure:
            return row | {"kind": "failed", "outcome": f"{failure}"}
        # An error of a mesh generator names it, all others are about the input.
        return row | {"kind": "refused", "outcome": f"{type(error).__name__}: {error}"}
    row |= {
        "made": made.n_cells,
        "in band": round(found.edges.share_in_band, 3),
        "angle": round(found.angle_min, 1),
        "distance": found.hausdorff_relative,
    }
    odd = [w for w in warned if not issubclass(w.category, UserWarning)]
    if odd or found.n_inverted:
        text = f"{odd[0].category.__name__}: {odd[0].message}" if odd else "inverted cells"
        return row | {"kind": "failed", "outcome": text}
    missed = [demand.name for demand in check.failures if demand.name in _OF_DOMAIN]
    said = "; ".join(sorted({str(w.message).splitlines()[0][:100] for w in warned}))
    parts = [f"other {', '.join(missed)}"] if missed else []
    parts += [f"warned: {said}"] if said else []
    kind = "kept" if not missed else "warned" if said else "deviates"
    return row | {"kind": kind, "outcome": "; ".join(parts)}


def _of_space(surface: Any) -> Any:
    return surface if surface.cell_dim == 2 and surface.dim == 3 else None


def _in_child(file: Path, arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the outcome of a surface, whatever happens to the process.

    The child is a copy of this process, which has loaded all kernels.
    """
    memory, seconds = int(arguments.memory * 2**30), int(arguments.timeout)
    with tempfile.TemporaryFile() as output:
        pid = os.fork()
        if pid == 0:
            try:
                os.setsid()
                os.dup2(os.open(os.devnull, os.O_RDWR), 1)
                os.dup2(1, 2)
                resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
                # Of each process: mesh generators run in processes of their own.
                resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
                row = outcome_of(file, arguments.max_elements, arguments.tolerance)
                output.write(json.dumps(row).encode())
                output.flush()
            finally:
                os._exit(0)
        code, usage = _wait(pid, _PATIENCE * arguments.timeout)
        output.seek(0)
        printed = output.read()
    figures = {
        "CPU s": round(usage.ru_utime + usage.ru_stime, 1),
        "MB": usage.ru_maxrss // 1024,
    }
    if code != 0 or not printed:
        died = signal.Signals(-code).name if code < 0 else "an unexpected end"
        return {"kind": "failed", **figures, "outcome": died}
    row = figures | json.loads(printed)
    if "SIGXCPU" in row["outcome"]:
        row["kind"] = "failed"
    return row


def _load_kernels() -> None:
    """Run what every case runs once, so that children need not load or compile it."""
    import adaptsize as ads

    corners = np.vstack([np.zeros(3), np.eye(3)])
    surface = ads.SimplexMesh(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    size = ads.size_function(surface, max_elements=100)
    ads.check_mesh(surface, original=surface, size=size)


def _wait(child: int, seconds: float) -> tuple[int, resource.struct_rusage]:
    """Wait for a child; return its exit code, and what it and its children used."""
    until = time.monotonic() + seconds
    while True:
        pid, status, usage = os.wait4(child, os.WNOHANG)
        if pid:
            return os.waitstatus_to_exitcode(status), usage
        if time.monotonic() > until:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child, signal.SIGKILL)
        time.sleep(0.05)


def _rows_in(store: Path) -> list[dict[str, Any]]:
    """Return the rows of an earlier run; a line that was cut off is left out."""
    if not store.exists():
        return []
    rows = []
    for line in store.read_text(encoding="utf-8").splitlines():
        try:
            rows.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return rows


def _arguments() -> argparse.Namespace:
    number: Callable[[str], float] = float
    parser = argparse.ArgumentParser(
        prog="python -m tests.attack.corpus",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", nargs="?", help="with --nasty, where the surfaces are written")
    parser.add_argument("--output", type=Path, default=Path("corpus.md"))
    parser.add_argument("--nasty", type=int, default=0, help="generate so many surfaces")
    parser.add_argument("--seed", type=int, default=1, help="of the generated surfaces")
    parser.add_argument(
        "--timeout", type=number, default=900.0, help="seconds of processor time per process"
    )
    parser.add_argument("--memory", type=number, default=8.0, help="gigabytes per process")
    parser.add_argument("--max-elements", type=number, default=100_000.0)
    parser.add_argument("--tolerance", type=number, default=1e-3, help="as of remesh")
    arguments = parser.parse_args()
    if not arguments.folder and not arguments.nasty:
        parser.error("a folder or --nasty is needed")
    return arguments


if __name__ == "__main__":
    sys.exit(main())
