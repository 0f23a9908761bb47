"""Reading of the meshes of Medit and Mmg, as text and binary."""

import codecs
import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import RawMesh, n_nodes_of
from adaptsize._formats.text import numbers_in
from adaptsize.errors import MeshFileError

#: Cells by keywords and their numbers in binary files.
_CELLS = {
    ("edges", 5): "line",
    ("triangles", 6): "triangle",
    ("quadrilaterals", 7): "quad",
    ("tetrahedra", 8): "tetra",
    ("prisms", 9): "wedge",
    ("hexahedra", 10): "hexahedron",
    ("pyramids", 49): "pyramid",
}
_BY_WORD = {word: kind for (word, _), kind in _CELLS.items()}
_BY_NUMBER = {number: kind for (_, number), kind in _CELLS.items()}
_DIMENSION, _VERTICES, _END = 3, 4, 54
_COMMENT = re.compile(rb"#[^\r\n]*")
_KEYWORD = re.compile(rb"^[ \t]*([A-Za-z]\w*)", re.M)
#: Types of coordinates, indices and positions in the file by its version.
_TYPES = {
    1: ("f4", "i4", "i4"),
    2: ("f8", "i4", "i4"),
    3: ("f8", "i4", "i8"),
    4: ("f8", "i8", "i8"),
}


def read(path: Path) -> RawMesh:
    """Return the cells with their references as tags, and those of the nodes.

    Sections of other keywords, such as ridges, normals and required triangles, are left out.

    Raises
    ------
    MeshFileError
        If the file is damaged, or ends before its last section does.

    References
    ----------
    Keywords and their numbers are those of libMeshb (L. Marechal, "The LM library", Inria).
    """
    content = path.read_bytes()
    is_binary = content[:4] in (b"\1\0\0\0", b"\0\0\0\1")
    return _read_binary(content) if is_binary else _read_text(content)


def _read_text(content: bytes) -> RawMesh:
    content = _COMMENT.sub(b"", content.removeprefix(codecs.BOM_UTF8))
    raw, dim, found = _empty(), 3, [*_KEYWORD.finditer(content)]
    words = [match[1].decode().lower() for match in found]
    if "end" not in words:
        raise MeshFileError("is truncated (no End)")
    ends = [match.start() for match in found[1:]] + [len(content)]
    for word, match, end in zip(words, found, ends, strict=True):
        if word not in ("dimension", "vertices", *_BY_WORD):
            continue
        values = numbers_in(content[match.end() : end], word.capitalize())
        if not len(values):
            raise MeshFileError(f"has no number after {word.capitalize()}")
        n, rows = int(values[0]), values[1:]
        if word == "dimension":
            dim = n
            continue
        width = (dim if word == "vertices" else n_nodes_of(_BY_WORD[word])) + 1
        if n < 0 or len(rows) < n * width:
            raise MeshFileError(f"is truncated (promises {n} {word}, holds {len(rows) // width})")
        table = rows[: n * width].reshape(n, width)
        _add(raw, _BY_WORD.get(word), table[:, :-1], table[:, -1])
    return raw


def _read_binary(content: bytes) -> RawMesh:
    order = "<" if content[:1] == b"\1" else ">"
    version = int(np.frombuffer(content, f"{order}i4", 2)[1]) if len(content) >= 8 else 0
    if version not in _TYPES:
        raise MeshFileError(f"is truncated, or of the unknown version {version} of Medit's format")
    real, integer, position = (np.dtype(order + kind) for kind in _TYPES[version])
    raw, dim, place = _empty(), 3, 8

    def take(n: int, kind: np.dtype[Any]) -> npt.NDArray[Any]:
        nonlocal place
        if n < 0 or len(content) - place < n * kind.itemsize:
            raise MeshFileError("is truncated (no End)")
        values = np.frombuffer(content, kind, n, place)
        place += n * kind.itemsize
        return values

    while True:
        keyword = int(take(1, np.dtype(f"{order}i4"))[0])
        following = int(take(1, position)[0])
        if keyword == _END:
            return raw
        if not place <= following <= len(content):
            raise MeshFileError("is truncated (a section ends after the file)")
        kind = _BY_NUMBER.get(keyword)
        if keyword == _DIMENSION:
            dim = int(take(1, np.dtype(f"{order}i4"))[0])
        elif keyword == _VERTICES or kind is not None:
            n = int(take(1, integer)[0])
            width, of = (dim, real) if kind is None else (n_nodes_of(kind), integer)
            record = np.dtype([("values", of, (width,)), ("ref", integer)])
            rows = take(n, record)
            _add(raw, kind, rows["values"], rows["ref"])
        place = following


def _empty() -> RawMesh:
    return RawMesh(np.empty((0, 3)), [], {}, {"medit:ref": []})


def _add(raw: RawMesh, kind: str | None, values: npt.NDArray[Any], refs: npt.NDArray[Any]) -> None:
    """Add the vertices, or cells of a kind, with their references."""
    if kind is None:
        raw.points = values.astype(np.float64)
        raw.point_data = {"medit:ref": refs.astype(np.int64)}
        return
    raw.blocks.append((kind, values.astype(np.int64) - 1))
    raw.cell_data = {"medit:ref": [*raw.cell_data["medit:ref"], refs.astype(np.int64)]}
