"""OFF files.  trimesh splits their polygons as if all were convex."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import RawMesh, name_of_polygon
from adaptsize._formats.text import check_last_number, numbers
from adaptsize.errors import MeshFileError

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
