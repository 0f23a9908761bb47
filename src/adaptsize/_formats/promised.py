"""Check that OFF and PLY files hold as many faces as in their headers; no reader does this."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from adaptsize._formats.blocks import RawMesh, dimension_of
from adaptsize.errors import MeshFileError

_COMMENT = re.compile(rb"#[^\r\n]*")
_OFF_KEYWORD = re.compile(rb"(ST)?C?N?4?n?OFF", re.IGNORECASE)
_PLY_HEADER = re.compile(rb"\Aply\s.*?^end_header\r?\n", re.DOTALL | re.MULTILINE)
_PLY_ELEMENT = re.compile(rb"^\s*element\s+(\w+)\s+(\d+)", re.MULTILINE)


def check_faces(path: Path, raw: RawMesh) -> None:
    """Refuse a mesh with fewer faces than in the header of its file.

    Raises
    ------
    MeshFileError
        The message has both numbers, without the path.
    """
    count = _COUNTERS.get(path.suffix.lower())
    if count is None:
        return
    promised, rows = count(path.read_bytes())
    held = sum(len(cells) for cell_type, cells in raw.blocks if dimension_of(cell_type) == 2)
    if rows is not None and any(row[0] != b"3" for row in rows):  # polygons, split into triangles
        held = sum(_is_whole(row) for row in rows)
    if held < promised:
        raise MeshFileError(f"is truncated (promises {promised} faces, holds {held})")


def _count_off(content: bytes) -> tuple[int, list[list[bytes]] | None]:
    """Return the number of faces in the header, 0 if it is unclear, and the rows of the faces."""
    words = [line.split() for line in _COMMENT.sub(b"", content).splitlines()]
    rows = [row for row in words if row]
    if rows and _OFF_KEYWORD.fullmatch(rows[0][0]):
        rows[0] = rows[0][1:]
        rows = rows if rows[0] else rows[1:]
    if not rows or len(rows[0]) not in (2, 3) or not all(word.isdigit() for word in rows[0]):
        return 0, None
    n_vertices, n_faces = int(rows[0][0]), int(rows[0][1])
    return n_faces, rows[1 + n_vertices : 1 + n_vertices + n_faces]


def _count_ply(content: bytes) -> tuple[int, list[list[bytes]] | None]:
    """Return the number of faces in the header and, of text files, the rows of the faces."""
    header = _PLY_HEADER.match(content)
    if header is None:
        return 0, None
    elements = [(name, int(n)) for name, n in _PLY_ELEMENT.findall(header[0])]
    promised = sum(n for name, n in elements if name == b"face")
    if not re.search(rb"^format\s+ascii", header[0], re.MULTILINE) or not promised:
        return promised, None
    before = 0
    for name, n in elements:
        if name == b"face":
            break
        before += n
    rows = [line.split() for line in content[header.end() :].splitlines() if line.strip()]
    return promised, rows[before : before + promised]


def _is_whole(row: list[bytes]) -> bool:
    """Whether a row holds as many nodes as its first number states."""
    return row[0].isdigit() and len(row) > int(row[0])


_COUNTERS: dict[str, Callable[[bytes], tuple[int, list[list[bytes]] | None]]] = {
    ".off": _count_off,
    ".ply": _count_ply,
}
