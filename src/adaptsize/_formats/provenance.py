"""What a mesh was made with, stored with it: tolerance, sizes, input, date, version.

VTU files hold it in their field data, as the text array ``adaptsize``; files of Gmsh in a section
``$Comments`` at the end.  Beside files of other formats, it is written to ``NAME.json``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_ARRAY = re.compile(rb'<DataArray type="String" Name="adaptsize"[^>]*>([\d\s]*)</DataArray>')
_COMMENTS = re.compile(rb"\$Comments\nadaptsize (\{.*\})\n\$EndComments\n$")
#: The record is within so many bytes of the start of a VTU file, and of the end of one of Gmsh.
_NEAR = 1 << 17


def beside(path: Path) -> Path | None:
    """Return the file beside a mesh that holds the record, None if the mesh itself does."""
    return None if _holds_record(path) else path.with_name(f"{path.name}.json")


def write_provenance(path: Path, record: Mapping[str, Any]) -> None:
    """Store plain values with a mesh that was just written.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "part.stl"
    ...     write_provenance(path, {"tolerance": 0.001})
    ...     (sorted(p.name for p in path.parent.iterdir()), read_provenance(path))
    (['part.stl.json'], {'tolerance': 0.001})
    """
    text = json.dumps(record, allow_nan=False).encode()  # ASCII
    sidecar = beside(path)
    if sidecar is not None:
        content, target = text + b"\n", sidecar
    elif path.suffix.lower() == ".msh":
        content, target = (
            path.read_bytes() + b"$Comments\nadaptsize " + text + b"\n$EndComments\n",
            path,
        )
    else:
        content, target = _with_array(path.read_bytes(), text), path
    unfinished = target.with_name(f".{target.name}.unfinished")
    try:
        unfinished.write_bytes(content)
        unfinished.replace(target)
    finally:
        unfinished.unlink(missing_ok=True)


def read_provenance(path: Path) -> dict[str, Any]:
    """Return what `write_provenance` stored with a mesh; empty if there is nothing."""
    sidecar = beside(path)
    try:
        if sidecar is not None:
            text = sidecar.read_bytes() if sidecar.is_file() else b""
        else:
            with path.open("rb") as file:
                text = _text_in(file, path)
        found = json.loads(text) if text else {}
    except (OSError, ValueError):  # also of another program
        return {}
    return found if isinstance(found, dict) else {}


def _holds_record(path: Path) -> bool:
    return path.suffix.lower() in (".vtu", ".msh")


def _text_in(file: Any, path: Path) -> bytes:
    if path.suffix.lower() == ".vtu":
        found = _ARRAY.search(file.read(_NEAR))
        return bytes(int(code) for code in found[1].split() if code != b"0") if found else b""
    file.seek(max(0, path.stat().st_size - _NEAR))
    found = _COMMENTS.search(file.read())
    return found[1] if found else b""


def _with_array(content: bytes, text: bytes) -> bytes:
    """Return a VTU file with the text as an array of its field data."""
    codes = " ".join(str(code) for code in text).encode()
    array = (
        b'<DataArray type="String" Name="adaptsize" NumberOfTuples="1" format="ascii">'
        + codes
        + b" 0</DataArray>\n"
    )
    before, start, after = content.partition(b"<UnstructuredGrid>\n")
    has_fields = re.match(rb"\s*<FieldData>\s*", after)
    if has_fields:
        return before + start + after[: has_fields.end()] + array + after[has_fields.end() :]
    return before + start + b"<FieldData>\n" + array + b"</FieldData>\n" + after
