"""What a mesh was made with: tolerance, sizes, input, date, version, in ``NAME.json`` beside it."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from adaptsize._formats.guards import write_whole
from adaptsize._formats.text import write_text


def write_provenance(path: Path, record: Mapping[str, Any]) -> None:
    """Store plain values beside a mesh that was just written.

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
    write_whole(_beside(path), lambda target: write_text(target, text, "\n"))


def read_provenance(path: Path) -> dict[str, Any]:
    """Return what `write_provenance` stored beside a mesh; empty if there is nothing."""
    try:
        found = json.loads(_beside(path).read_text(encoding="utf-8"))
    except (OSError, ValueError):  # also of another program
        return {}
    return found if isinstance(found, dict) else {}


def _beside(path: Path) -> Path:
    return path.with_name(f"{path.name}.json")
