"""Remesh every surface in a folder, each in a child process, and tabulate what happened.

    python -m tests.attack.corpus DIR [--output FILE] [--timeout S] [--memory GB]

The outcomes are kept in FILE.jsonl, one line per surface.  A second run skips what is there, so
that an interrupted run can be resumed.  FILE is the table, in markdown.
"""

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

_SUFFIXES = {".stl", ".off", ".obj", ".ply", ".vtk", ".vtu", ".msh", ".mesh", ".meshb"}
_COLUMNS = ("file", "triangles", "made", "s", "MB", "in band", "angle", "distance", "outcome")


def main() -> int:
    arguments = _arguments()
    if arguments.one:
        print(json.dumps(outcome_of(Path(arguments.folder), arguments.max_elements)))
        return 0
    folder = Path(arguments.folder)
    files = sorted(p for p in folder.rglob("*") if p.suffix.lower() in _SUFFIXES)
    store = arguments.output.with_suffix(arguments.output.suffix + ".jsonl")
    known = {row["file"]: row for row in _rows_in(store)}
    for number, file in enumerate(files, 1):
        name = str(file.relative_to(folder))
        if name in known:
            continue
        row = {"file": name, **_in_child(file, arguments)}
        known[name] = row
        with open(store, "a", encoding="utf-8") as rows:
            rows.write(json.dumps(row) + "\n")
        print(f"{number} of {len(files)}: {name}: {row['outcome'][:120]}", flush=True)
    names = [str(file.relative_to(folder)) for file in files]
    arguments.output.write_text(table(known[name] for name in names), encoding="utf-8")
    bad = [row for row in known.values() if row["kind"] == "failed"]
    print(f"{len(files)} files, {len(bad)} failed; {arguments.output}")
    return 1 if bad else 0


def outcome_of(file: Path, max_elements: float) -> dict[str, Any]:
    """Read, size and remesh a surface in this process.

    The kind of the outcome is "mesh", "refused" (one clear line) or "failed".
    """
    import adaptsize as ads

    from .calls import check_error
    from .cases import Failure

    row: dict[str, Any] = {}
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            surface = ads.read(file)
            row["triangles"] = surface.n_cells
            size = ads.size_function(surface, max_elements=max_elements)
            made = ads.remesh(surface, size)
            found = ads.size_conformity(made, size, surface=_of_space(surface))
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
    if found.n_inverted:
        return row | {"kind": "failed", "outcome": f"{found.n_inverted} inverted cells"}
    said = "; ".join(sorted({str(w.message).splitlines()[0][:100] for w in warned}))
    return row | {"kind": "mesh", "outcome": "mesh" + (f", warned: {said}" if said else "")}


def _of_space(surface: Any) -> Any:
    return surface if surface.cell_dim == 2 and surface.dim == 3 else None


def _in_child(file: Path, arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the outcome of a surface, whatever happens to the process."""
    package = (__package__ or "tests.attack") + ".corpus"
    command = [sys.executable, "-m", package, "--one", str(file)]
    command += ["--max-elements", str(arguments.max_elements)]
    limit = int(arguments.memory * 2**30)
    began = time.monotonic()
    child = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: resource.setrlimit(  # noqa: PLW1509 - there is one thread
            resource.RLIMIT_DATA, (limit, limit)
        ),
    )
    try:
        printed, errors = child.communicate(timeout=arguments.timeout)
    except subprocess.TimeoutExpired:
        os.killpg(child.pid, signal.SIGKILL)
        child.communicate()
        return {"kind": "failed", "s": arguments.timeout, "outcome": "stopped at the time limit"}
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    figures = {"s": round(time.monotonic() - began, 1), "MB": usage.ru_maxrss // 1024}
    if child.returncode != 0 or not printed.strip():
        code = child.returncode
        died = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        last = (errors.strip().splitlines() or [""])[-1]
        return {"kind": "failed", **figures, "outcome": f"{died}: {last[:300]}"}
    return figures | json.loads(printed.strip().splitlines()[-1])


def table(rows: Iterable[dict[str, Any]]) -> str:
    """Return the outcomes as markdown, with a line of counts."""
    rows = list(rows)
    lines = ["| " + " | ".join(_COLUMNS) + " |", "|---|" + "---|" * (len(_COLUMNS) - 1)]
    for row in rows:
        cells = [str(_format(row.get(column, ""))) for column in _COLUMNS]
        lines.append("| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |")
    counts = Counter(row["kind"] for row in rows)
    total = ", ".join(f"{count} {kind}" for kind, count in sorted(counts.items()))
    return "\n".join([*lines, "", f"{len(rows)} files: {total}.", ""])


def _format(value: Any) -> Any:
    if isinstance(value, float):
        return f"{value:.3g}"
    return value[:160] if isinstance(value, str) else value


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
    parser.add_argument("folder")
    parser.add_argument("--output", type=Path, default=Path("corpus.md"))
    parser.add_argument("--timeout", type=number, default=900.0, help="seconds per surface")
    parser.add_argument("--memory", type=number, default=8.0, help="gigabytes per surface")
    parser.add_argument("--max-elements", type=number, default=100_000.0)
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
