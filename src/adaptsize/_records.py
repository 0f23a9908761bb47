"""Records beside files: what a file was made with, to look it up and to make it again."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

from adaptsize import __version__
from adaptsize._calls import (
    Call,
    as_steps,
    fault_of_steps,
    files_of,
    state_of,
    text_of_steps,
    unknowns_of,
)
from adaptsize._formats.guards import write_whole
from adaptsize._formats.text import write_text

#: Packages on which a result may depend.
_PACKAGES = ("numpy", "scipy", "numba", "mmgpy", "netgen-mesher", "pytetwild", "gmsh")


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits."""
    found = hashlib.sha256()
    with path.open("rb") as stream:
        while part := stream.read(2**20):
            found.update(part)
    return found.hexdigest()


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages on which results may depend."""
    found = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def facts_of(path: Path, inputs: Mapping[str, str | None]) -> dict[str, Any]:
    """Return what every record has: versions, inputs, and the SHA-256 of the file, plain values.

    Parameters
    ----------
    path : Path
        The file that was written.
    inputs : mapping of str to str or None
        SHA-256 of each file that was read, by its path as given.  The first one is the main one.
    """
    return {
        "program": "adaptsize",
        "version": __version__,
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "folder": str(Path.cwd()),
        "input": next(iter(inputs), None),
        "inputs": dict(inputs),
        "versions": versions(),
        "system": platform.platform(),
        "sha256": sha256(path),
    }


def record_calls(path: Path, last: Call, written: Path | None = None, **more: Any) -> list[str]:
    """Write the record of a file that Python code has written, and return what it lacks.

    Parameters
    ----------
    path : Path
        The file.
    written : Path, optional
        Where its content is until it is renamed.
    last : Call
        The call that wrote it.
    **more
        Further plain values.
    """
    steps, unknown = as_steps(last), []
    inputs: dict[str, str | None] = {}
    places: dict[str, str] = {}
    for name, state in files_of(last).items():
        same = state is not None and state in state_of(state[0]).values()
        inputs[name] = sha256(Path(state[0])) if state is not None and same else None
        if state is not None:
            places[name] = state[0]
        if inputs[name] is None:
            unknown.append(f"{name} is missing, or has changed since it was read")
    unknown += unknowns_of(steps)
    facts = facts_of(written or path, inputs) | {"places": places}
    write_record(path, facts | {"calls": steps, "unknown": unknown} | more)
    return unknown


def write_record(path: Path, record: Mapping[str, Any]) -> None:
    """Store what a file was made with, plain values, in ``NAME.json`` beside it.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "part.stl"
    ...     write_record(path, {"tolerance": 0.001})
    ...     (sorted(p.name for p in path.parent.iterdir()), read_record(path))
    (['part.stl.json'], {'tolerance': 0.001})
    """
    text = json.dumps(record, allow_nan=False)
    write_whole(record_beside(path), lambda target: write_text(target, text, "\n"))


def read_record(path: Path) -> dict[str, Any]:
    """Return what `write_record` stored beside a file; empty if there is nothing."""
    try:
        found = json.loads(record_beside(path).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):  # also of another program
        return {}
    return found if isinstance(found, dict) else {}


def record_of(path: Path) -> dict[str, Any]:
    """Return the record of a file; empty if there is none, or only one of another content."""
    found = read_record(path)
    if found.get("program") != "adaptsize" or fault_of(found):
        return {}
    try:
        return found if found["sha256"] == sha256(path) else {}
    except OSError:
        return {}


def is_stale(path: Path) -> bool:
    """Return whether a record beside a file is that of another content."""
    return read_record(path).get("program") == "adaptsize" and not record_of(path)


def fault_of(record: Mapping[str, Any]) -> str:
    """Return in words what is wrong with the shape of a record; empty if nothing is."""
    kinds = {
        "version": str, "date": str, "folder": str, "sha256": str, "input": str | None,
        "inputs": dict, "versions": dict, "places": dict,
        "command": list, "unknown": list, "calls": list,
    }  # fmt: skip
    optional = {"versions", "places", "command", "unknown", "calls"}
    for name, kind in kinds.items():
        if name not in record and name not in optional:
            return f"{name} is missing"
        if name in record and not isinstance(record[name], kind):
            return f"{name} is {record[name]!r:.80}"
    of_texts = [record.get("command", []), record.get("unknown", [])]
    of_texts += [record.get(name, {}).values() for name in ("versions", "places")]
    for texts in of_texts:
        if not all(isinstance(text, str) for text in texts):
            return f"{[*texts]!r:.80} are no texts"
    if not all(isinstance(known, str | None) for known in record["inputs"].values()):
        return f"inputs are {record['inputs']!r:.80}"
    if len(record.get("command", ["", ""])) < 2:
        return f"command is {record['command']!r}"
    return fault_of_steps(record["calls"]) if "calls" in record else ""


def record_beside(path: Path) -> Path:
    """Return the file with the record of another one."""
    return path.with_name(f"{path.name}.json")


def description(record: Mapping[str, Any]) -> str:
    """Return in words what made a file."""
    version, made_from, date = (record.get(name) for name in ("version", "input", "date"))
    source = "" if made_from is None else f" from {made_from}"
    return f"made by adaptsize {version}{source} on {date}"


def how_made(record: Mapping[str, Any]) -> str:
    """Return the command or the calls that made a file, in one line; empty if unknown."""
    if "calls" in record:
        return text_of_steps(record["calls"])
    return " ".join(["adaptsize", *record["command"]]) if "command" in record else ""
