"""What a file was made with, in ``NAME.json`` beside it: to look it up, and to make it again."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

from adaptsize import __version__
from adaptsize._formats.guards import write_whole
from adaptsize._formats.text import write_text
from adaptsize.options import Option

#: Packages on which a result may depend.
_PACKAGES = ("numpy", "scipy", "numba", "mmgpy", "netgen-mesher", "pytetwild", "gmsh")


@dataclass(frozen=True)
class TypedCommand:
    """A command as it was given, without general options and outputs."""

    words: tuple[str, ...]
    """The name of the command, the file that it reads, and options."""
    inputs: dict[str, str] = field(default_factory=dict)
    """SHA-256 of each file that it reads, by its path as typed."""

    @classmethod
    def of(
        cls, name: str, file: Path, typed: Mapping[str, Any], options: Mapping[str, Option]
    ) -> TypedCommand:
        """Return the request with options as they were typed.

        Pictures and pages are left out.
        """
        words, inputs = [name, str(file)], [file]
        for key, value in typed.items():
            option = options[key]
            is_file = option.type is Path
            if option.group == "Output" and is_file:
                continue
            for one in value if isinstance(value, list) else [value]:
                if one is None or one is False:
                    continue
                words += [option.flags[-1]] + ([] if one is True else [str(one)])
                inputs += [Path(one)] if is_file else list(_files_in(key, str(one)))
        return cls(tuple(words), {str(path): sha256(path) for path in inputs if path.is_file()})

    def at(self, folder: Path) -> list[str]:
        """Return the words with the paths of inputs from another folder."""
        found = list(self.words)
        for path in self.inputs:
            whole = str(folder.absolute() / path)
            for k, word in enumerate(found):
                if word == path:
                    found[k] = whole
                elif word.startswith(f"curve:{path}="):
                    found[k] = word.replace(path, whole, 1)
        return found


def _files_in(name: str, text: str) -> Iterable[Path]:
    """Yield the file that the text of an option names, if it does."""
    if name == "source" and text.startswith("curve:"):
        yield Path(text.rpartition("=")[0].removeprefix("curve:"))
    elif name == "metric":
        yield Path(text)


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


def provenance_of(path: Path, request: TypedCommand) -> dict[str, Any]:
    """Return what is stored beside a file that a command has written, plain values."""
    return {
        "program": "adaptsize",
        "version": __version__,
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "command": list(request.words),
        "folder": str(Path.cwd()),
        "input": request.words[1],
        "inputs": request.inputs,
        "versions": versions(),
        "system": platform.platform(),
        "sha256": sha256(path),
    }


def write_provenance(path: Path, record: Mapping[str, Any]) -> None:
    """Store what a file was made with, plain values, in ``NAME.json`` beside it.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "part.stl"
    ...     write_provenance(path, {"tolerance": 0.001})
    ...     (sorted(p.name for p in path.parent.iterdir()), read_provenance(path))
    (['part.stl.json'], {'tolerance': 0.001})
    """
    text = json.dumps(record, allow_nan=False)
    write_whole(record_beside(path), lambda target: write_text(target, text, "\n"))


def read_provenance(path: Path) -> dict[str, Any]:
    """Return what `write_provenance` stored beside a file; empty if there is nothing."""
    try:
        found = json.loads(record_beside(path).read_text(encoding="utf-8"))
    except (OSError, ValueError):  # also of another program
        return {}
    return found if isinstance(found, dict) else {}


def record_beside(path: Path) -> Path:
    """Return the file with the record of another one."""
    return path.with_name(f"{path.name}.json")


def description(record: Mapping[str, Any]) -> str:
    """Return in words what made a file."""
    version, made_from, date = (record.get(name) for name in ("version", "input", "date"))
    return f"made by adaptsize {version} from {made_from} on {date}"
