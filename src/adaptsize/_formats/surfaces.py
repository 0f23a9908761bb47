"""Files of surfaces that are read here: STL and OFF."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import RawMesh, name_of_polygon
from adaptsize._formats.text import check_last_number, numbers
from adaptsize.background.merging import merge_equal_points
from adaptsize.errors import MeshFileError

#: A triangle in a binary STL file, after 80 free bytes and the number of triangles.
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_SOLID, _END_SOLID, _VERTEX, _END_FACET = (
    re.compile(rb"^[ \t]*" + words, re.MULTILINE | re.IGNORECASE)
    for words in (rb"solid\b", rb"end ?solid\b", rb"vertex\b([^\n]*)", rb"end ?facet\b")
)
_COMMENT = re.compile(rb"#[^\r\n]*")
#: Vertices may have texture coordinates, colours and normals after their coordinates.
_KEYWORD = re.compile(rb"(?:ST)?C?N?OFF", re.IGNORECASE)


def read_stl(path: Path) -> RawMesh:
    """Return the triangles in an STL file.  Corners with equal coordinates are one node.

    A file with the length of a binary one is binary, even if it starts with ``solid``, as is one
    with zeros.  Bytes after its triangles are left out.

    Raises
    ------
    MeshFileError
        If the file is damaged, or ends before its last triangle or solid does.
    """
    content = path.read_bytes()
    n = int.from_bytes(content[80:84], "little")
    size = 84 + n * _TRIANGLE.itemsize
    if len(content) == size or b"\0" in content:
        if len(content) < size:
            raise MeshFileError(f"is a truncated binary STL file (promises {n} triangles)")
        corners = np.frombuffer(content, _TRIANGLE, n, 84)["corners"].astype(np.float64)
    else:
        corners = _corners_in(content.replace(b"\r", b"\n"))
    with np.errstate(invalid="ignore"):  # numbers that are not finite are refused later
        points, cells = merge_equal_points(corners.reshape(-1, 3))
    return RawMesh(points, [("triangle", cells.reshape(-1, 3))])


def _corners_in(text: bytes) -> npt.NDArray[np.float64]:
    """Return the corners of the triangles in a text file, of one solid or several."""
    begins = [found.start() for found in _SOLID.finditer(text)]
    if not begins:
        raise MeshFileError("is neither a text STL file nor a binary one")
    if not _END_SOLID.search(text, begins[-1]):
        raise MeshFileError("is a truncated text STL file (no endsolid)")
    rows = [row.split() for row in _VERTEX.findall(text)]
    n_triangles = len(_END_FACET.findall(text))
    if len(rows) != 3 * n_triangles or not all(len(row) == 3 for row in rows):
        raise MeshFileError(f"has {n_triangles} triangles of STL, not all of three vertices")
    return numbers([word for row in rows for word in row], np.float64)


def read_off(path: Path) -> RawMesh:
    """Return the surface in an OFF file.  Colours, normals and texture are left out.

    trimesh splits polygons as if all were convex.

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
