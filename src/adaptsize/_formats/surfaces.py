"""Files of surfaces: OFF, and STL (ascii and binary)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import RawMesh, name_of_polygon
from adaptsize._formats.text import check_last_number, numbers
from adaptsize.errors import MeshFileError
from adaptsize.typing import FloatArray

_COMMENT = re.compile(rb"#[^\r\n]*")
#: Vertices may have texture coordinates, colours and normals after their coordinates.
_KEYWORD = re.compile(rb"(?:ST)?C?N?OFF", re.IGNORECASE)


def read_off(path: Path) -> RawMesh:
    """Return the surface in an OFF file.  Colours, normals and texture are left out.

    Raises
    ------
    MeshFileError
        If the file is damaged, or ends before the counts in its header are reached.
    """
    content = _COMMENT.sub(b"", path.read_bytes())
    rows = [row for row in map(bytes.split, content.splitlines()) if row]
    if not rows or not _KEYWORD.fullmatch(rows[0][0]):
        raise MeshFileError("cannot be read as a mesh (an OFF file begins with OFF)")
    rows = [rows[0][1:], *rows[1:]] if len(rows[0]) > 1 else rows[1:]
    if not rows or len(rows[0]) not in (2, 3) or not all(word.isdigit() for word in rows[0]):
        raise MeshFileError("cannot be read as a mesh (no numbers of vertices and faces)")
    n_points, n_faces = int(rows[0][0]), int(rows[0][1])
    points, faces = rows[1 : 1 + n_points], rows[1 + n_points : 1 + n_points + n_faces]
    if len(points) < n_points:
        raise MeshFileError(f"is truncated (promises {n_points} vertices, holds {len(points)})")
    if len(faces) < n_faces:
        raise MeshFileError(f"is truncated (promises {n_faces} faces, holds {len(faces)})")
    if len(rows) == 1 + n_points + n_faces:
        check_last_number(content, n_points)
    short = next((row for row in points if len(row) < 3), None)
    if short is not None:
        raise MeshFileError(f"has a vertex with {len(short)} coordinates, where 3 are required")
    coordinates = numbers([word for row in points for word in row[:3]], np.float64)
    return RawMesh(coordinates.reshape(-1, 3), _blocks_of(faces))


def _blocks_of(faces: list[list[bytes]]) -> list[tuple[str, npt.NDArray[Any]]]:
    """Return faces as cells, one block for each number of corners."""
    counts = numbers([row[0] for row in faces], np.int64).tolist()
    for i, (row, n) in enumerate(zip(faces, counts, strict=True)):
        if n < 3:
            raise MeshFileError(f"has a face with {n} corners (face {i})")
        if len(row) <= n:
            raise MeshFileError(f"has {len(row) - 1} of {n} nodes of face {i}; is it truncated?")
    blocks = []
    for n in sorted(set(counts)):
        of_size = [row[1 : n + 1] for row, count in zip(faces, counts, strict=True) if count == n]
        cells = numbers([word for row in of_size for word in row], np.int64).reshape(-1, n)
        blocks.append((name_of_polygon(n), cells))
    return blocks


_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_STL_HEADER = 84  # 80 free bytes and the number of triangles
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
    n = int(np.frombuffer(content, "<u4", 1, 80)[0]) if len(content) >= _STL_HEADER else 0
    if len(content) >= _STL_HEADER and len(content) == _STL_HEADER + n * _RECORD.itemsize:
        if n == 0:
            raise MeshFileError("is a binary STL file without triangles")
        return np.frombuffer(content, _RECORD, n, _STL_HEADER)["corners"]
    if content.lstrip()[:5].lower() == b"solid" and b"\0" not in content:
        return _ascii_corners(content)
    if len(content) > _STL_HEADER + n * _RECORD.itemsize and n > 0:
        return np.frombuffer(content, _RECORD, n, _STL_HEADER)["corners"]
    held = max(len(content) - _STL_HEADER, 0) // _RECORD.itemsize
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
    bad = next((k for k, row in enumerate(rows) if len(row) != 3), None)
    if bad is not None:
        raise MeshFileError(f"is a broken ascii STL file: vertex {bad} must be three numbers")
    try:
        corners = numbers([word for row in rows for word in row], np.float64)
    except MeshFileError as error:
        raise MeshFileError(f"is a broken ascii STL file: it {error}") from error
    n_facets = len(_END_FACET.findall(content))
    if len(rows) != 3 * n_facets:
        raise MeshFileError(
            f"is a broken or truncated ascii STL file ({len(rows)} vertices in {n_facets} facets)"
        )
    begins = [match.start() for match in _SOLID.finditer(content)]  # of one solid or several
    if not _END_SOLID.search(content, max(begins, default=0)):
        raise MeshFileError("is a truncated ascii STL file (no endsolid)")
    return corners.reshape(-1, 3, 3)
