"""Files of surfaces that are read here: STL and OFF."""

import codecs
import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import RawMesh, name_of_polygon
from adaptsize._formats.text import check_last_number, numbers
from adaptsize.background.merging import corner_distance, first_at_place, merge_equal_points
from adaptsize.background.topology import have_different_nodes
from adaptsize.errors import MeshFileError
from adaptsize.typing import FloatArray

#: A triangle in a binary STL file, after 80 free bytes and the number of triangles.
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_SOLID, _VERTEX = re.compile(rb"solid\b.*"), re.compile(rb"vertex\b(.*)")
_COMMENT = re.compile(rb"#[^\r\n]*")
#: Vertices may have texture coordinates, colours and normals after their coordinates.
_KEYWORD = re.compile(rb"(?:ST)?C?N?OFF", re.IGNORECASE)

#: Corners of STL files that are so close, over the extent, are one without a word.
_ROUNDING = 1e-12


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
        triangles = np.frombuffer(content, _TRIANGLE, n, 84)
        with np.errstate(invalid="ignore"):  # signalling nan, which is refused later
            corners = triangles["corners"].reshape(-1, 3).astype(np.float64)
        number = np.arange(len(corners))
    else:
        corners, number = _corners_in(content.replace(b"\r", b"\n").lower())
    with np.errstate(invalid="ignore"):  # numbers that are not finite are refused later
        points, point_of = merge_equal_points(corners)
        return _joined(points, point_of[number].reshape(-1, 3))


def _joined(points: FloatArray, cells: npt.NDArray[np.int64]) -> RawMesh:
    """Return triangles whose corners that are almost equal are one node, at their mean."""
    good = have_different_nodes(cells)
    within = corner_distance(points, cells[good]) if good.any() else 0.0
    if within == 0.0:
        return RawMesh(points, [("triangle", cells)])
    first = first_at_place(points, within)
    nodes, number = np.unique(first, return_inverse=True)
    middle = np.zeros((len(nodes), 3))
    np.add.at(middle, number, points - points[first])  # where all are equal, nothing changes
    middle = points[nodes] + middle / np.bincount(number)[:, None]
    note = (
        f"corners up to {within:.2g} apart joined, where edges do not meet exactly: {len(points)} "
        f"become {len(nodes)}"
    )
    is_rounding = within <= _ROUNDING * float(np.ptp(points[cells[good]], axis=(0, 1)).max())
    return RawMesh(middle, [("triangle", number[cells])], notes=[] if is_rounding else [note])


def _corners_in(text: bytes) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Return the different corners in a text file of one solid or several, and that of each vertex.

    Most vertices are written several times, in the same words.
    """
    solids = [found.start() for found in _SOLID.finditer(text)]
    if not solids:
        raise MeshFileError("is neither a text STL file nor a binary one")
    if text[max(solids[-1] - 4, 0) : solids[-1]].strip() != b"end":
        raise MeshFileError("is a truncated text STL file (no endsolid)")
    text = _SOLID.sub(b"", text)  # names may have any words
    rows = _VERTEX.findall(text)
    n_triangles = text.count(b"endfacet") + text.count(b"end facet")
    first: dict[bytes, int] = {}
    number = [first.setdefault(row, len(first)) for row in rows]
    try:
        corners = np.loadtxt([*first], comments=None, ndmin=2) if rows else np.empty((0, 3))
    except ValueError as error:
        reason = str(error).partition(" at row")[0]
        raise MeshFileError(f"has vertices of STL that are not three numbers ({reason})") from error
    if len(rows) != 3 * n_triangles or corners.shape != (len(first), 3):
        raise MeshFileError(f"has {n_triangles} triangles of STL, not all of three vertices")
    return corners, np.array(number, np.int64)


def read_off(path: Path) -> RawMesh:
    """Return the surface in an OFF file.  Colours, normals and texture are left out.

    trimesh splits polygons as if all were convex.

    Raises
    ------
    MeshFileError
        If the file is damaged, or ends before the counts in its header are reached.
    """
    content = _COMMENT.sub(b"", path.read_bytes().removeprefix(codecs.BOM_UTF8))
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
