"""STL files, ascii and binary."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats.text import numbers
from adaptsize.errors import MeshFileError
from adaptsize.typing import FloatArray

_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = 84  # 80 free bytes and the number of triangles
_VERTEX = re.compile(rb"^[ \t]*vertex\b([^\n]*)", re.MULTILINE | re.IGNORECASE)
_END_FACET = re.compile(rb"^[ \t]*endfacet\b", re.MULTILINE | re.IGNORECASE)
_SOLID = re.compile(rb"^[ \t]*solid\b", re.MULTILINE | re.IGNORECASE)
_END_SOLID = re.compile(rb"^[ \t]*end ?solid\b", re.MULTILINE | re.IGNORECASE)


def read_corners(path: Path) -> npt.NDArray[Any]:
    """Return the corners of the triangles, float[n, 3, 3], in the order of the file.

    A file with the length of a binary file is read as binary, even if it starts with
    ``solid``, which is common.
    """
    content = path.read_bytes()
    n = int(np.frombuffer(content, "<u4", 1, 80)[0]) if len(content) >= _HEADER else 0
    if len(content) >= _HEADER and len(content) == _HEADER + n * _RECORD.itemsize:
        if n == 0:
            raise MeshFileError("is a binary STL file without triangles")
        return np.frombuffer(content, _RECORD, n, _HEADER)["corners"]
    if content.lstrip()[:5].lower() == b"solid" and b"\0" not in content:
        return _ascii_corners(content)
    if len(content) > _HEADER + n * _RECORD.itemsize and n > 0:
        return np.frombuffer(content, _RECORD, n, _HEADER)["corners"]
    held = max(len(content) - _HEADER, 0) // _RECORD.itemsize
    if n and held and b"\0" in content:
        raise MeshFileError(
            f"is a truncated binary STL file (promises {n} triangles, holds {held})"
        )
    raise MeshFileError("is neither an ascii nor a binary STL file")


def write_binary(path: Path, corners: FloatArray) -> None:
    """Write float64[n, 3, 3] as a binary STL file.  Coordinates are rounded to float32."""
    records = np.zeros(len(corners), _RECORD)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    records["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    records["corners"] = corners
    with path.open("wb") as file:
        file.write(b"binary STL".ljust(80))
        file.write(np.array([len(corners)], "<u4").tobytes())
        file.write(records.tobytes())


def _ascii_corners(content: bytes) -> FloatArray:
    rows = [line.split() for line in _VERTEX.findall(content)]
    if not rows:
        raise MeshFileError("is an ascii STL file without triangles")
    try:
        corners = numbers([word for row in rows for word in row], np.float64)
    except MeshFileError:
        corners = np.empty(0)
    if len(corners) != 3 * len(rows) or any(len(row) != 3 for row in rows):
        raise MeshFileError(f"is a broken ascii STL file: {_first_bad_vertex(content)}")
    n_facets = len(_END_FACET.findall(content))
    if len(rows) != 3 * n_facets:
        raise MeshFileError(
            f"is a broken or truncated ascii STL file ({len(rows)} vertices in {n_facets} facets)"
        )
    begins = [match.start() for match in _SOLID.finditer(content)]  # of one solid or several
    if not _END_SOLID.search(content, max(begins, default=0)):
        raise MeshFileError("is a truncated ascii STL file (no endsolid)")
    return corners.reshape(-1, 3, 3)


def _first_bad_vertex(content: bytes) -> str:
    """Return a text with the line of the first vertex that is not three numbers."""
    for match in _VERTEX.finditer(content):
        words = match.group(1).split()
        try:
            good = len([float(word) for word in words]) == 3
        except ValueError:
            good = False
        if not good:
            line = content.count(b"\n", 0, match.start(1)) + 1
            given = " ".join(match.group(1).decode("latin-1").split())[:40]
            return f"line {line}: a vertex is three numbers, got {given!r}"
    return "a vertex is three numbers"
