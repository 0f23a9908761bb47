"""Files of surfaces: OFF, PLY (text and binary, with fields), STL (ascii and binary)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import RawMesh
from adaptsize._formats.completeness import check_last_number, numbers
from adaptsize.errors import MeshFileError
from adaptsize.typing import FloatArray


class Blocks(NamedTuple):
    """Blocks of faces with the same number of corners, and the faces that they come from."""

    cells: list[tuple[str, npt.NDArray[np.int64]]]
    faces: list[npt.NDArray[np.intp]]
    """Number of the face of each cell, one array per block."""


def as_blocks(counts: npt.NDArray[Any], nodes: npt.NDArray[Any]) -> Blocks:
    """Return faces as cells.

    Parameters
    ----------
    counts : int[n_faces]
        Number of corners of each face.
    nodes : int[sum of counts]
        Corners of all faces.

    Raises
    ------
    MeshFileError
        If a face has fewer than three corners.
    """
    if len(counts) and counts.min() < 3:
        bad = int(np.argmin(counts))
        raise MeshFileError(f"has a face with {counts[bad]} corners (face {bad})")
    starts = np.cumsum(counts) - counts
    blocks = Blocks([], [])
    for n in np.unique(counts):
        faces = np.flatnonzero(counts == n)
        corners = nodes[starts[faces][:, None] + np.arange(n)].astype(np.int64)
        blocks.cells.append(({3: "triangle", 4: "quad"}.get(int(n), "polygon"), corners))
        blocks.faces.append(faces)
    return blocks


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
    counts, nodes = _corners(faces)
    return RawMesh(_coordinates(points), as_blocks(counts, nodes).cells)


def _coordinates(rows: list[list[bytes]]) -> npt.NDArray[Any]:
    short = next((row for row in rows if len(row) < 3), None)
    if short is not None:
        raise MeshFileError(f"has a vertex with {len(short)} coordinates, where 3 are required")
    return numbers([word for row in rows for word in row[:3]], np.float64).reshape(-1, 3)


def _corners(rows: list[list[bytes]]) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    counts = numbers([row[0] for row in rows], np.int64)
    for i, (row, n) in enumerate(zip(rows, counts.tolist(), strict=True)):
        if len(row) <= n:
            raise MeshFileError(f"has {len(row) - 1} of {n} nodes of face {i}; is it truncated?")
    nodes = [word for row, n in zip(rows, counts.tolist(), strict=True) for word in row[1 : n + 1]]
    return counts, numbers(nodes, np.int64)


_HEADER = re.compile(rb"\Aply\s.*?\bend_header\s*?\n", re.DOTALL)
_TYPES = {
    name: np.dtype(code)
    for code, names in {
        "i1": ("char", "int8"),
        "u1": ("uchar", "uint8"),
        "i2": ("short", "int16"),
        "u2": ("ushort", "uint16"),
        "i4": ("int", "int32"),
        "u4": ("uint", "uint32"),
        "i8": ("int64",),
        "u8": ("uint64",),
        "f4": ("float", "float32"),
        "f8": ("double", "float64"),
    }.items()
    for name in names
}
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_PLURALS = {"vertex": "vertices", "face": "faces"}


class _Property(NamedTuple):
    name: str
    dtype: np.dtype[Any]
    count_dtype: np.dtype[Any] | None
    """Type of the number of values; None unless the property is a list."""


class _Element(NamedTuple):
    name: str
    n: int
    properties: list[_Property]


class _Lists(NamedTuple):
    counts: npt.NDArray[np.int64]
    values: npt.NDArray[Any]
    """The values of all lists, one after the other."""


#: Values of an element by property.
_Columns = dict[str, "npt.NDArray[Any] | _Lists"]


def read_ply(path: Path) -> RawMesh:
    """Return the surface in a PLY file, with its scalar fields.

    Raises
    ------
    MeshFileError
        If the file is damaged, or ends before the counts in its header are reached.
    """
    content = path.read_bytes()
    header = _HEADER.match(content)
    if header is None:
        raise MeshFileError("cannot be read as a mesh (no complete PLY header)")
    form, elements = _parsed(header[0].decode("latin-1"))
    body, order = content[header.end() :], _ORDERS[form]
    if form == "ascii":  # read as a binary file in which each number is a float64
        body = numbers(body.split(), np.float64).tobytes()
    start = 0
    columns: dict[str, _Columns] = {}
    for element in elements:
        stored = _as_stored(element, order, is_text=form == "ascii")
        columns[element.name], start = _read_element(stored, body, start)
    vertices, faces = columns.get("vertex", {}), columns.get("face", {})
    if not {"x", "y", "z"} <= set(vertices):
        raise MeshFileError("cannot be read as a mesh (no vertices with x, y and z)")
    points = np.column_stack([_plain(vertices[axis]) for axis in "xyz"]).astype(np.float64)
    if form == "ascii" and start == len(body):
        ends_in_nodes = elements[-1].properties[-1].name.startswith("vertex_ind")
        check_last_number(content, len(points) if ends_in_nodes else np.inf)
    types = {element.name: {p.name: p.dtype for p in element.properties} for element in elements}
    nodal = {
        name: values.astype(types["vertex"][name])
        for name, values in vertices.items()
        if name not in "xyz" and not isinstance(values, _Lists)
    }
    return _mesh(points, faces, nodal, types.get("face", {}))


def _mesh(
    points: npt.NDArray[np.float64],
    faces: _Columns,
    nodal: dict[str, npt.NDArray[Any]],
    types: dict[str, np.dtype[Any]],
) -> RawMesh:
    corners = faces.get("vertex_indices", faces.get("vertex_index"))
    if not isinstance(corners, _Lists):
        raise MeshFileError("holds points but no cells")
    cells, origin = as_blocks(*corners)
    of_cells = {
        name: [values.astype(types[name])[rows] for rows in origin]
        for name, values in faces.items()
        if not isinstance(values, _Lists)
    }
    return RawMesh(points, cells, nodal, of_cells)


def _plain(values: npt.NDArray[Any] | _Lists) -> npt.NDArray[Any]:
    if isinstance(values, _Lists):
        raise MeshFileError("has coordinates that are lists")
    return values


def _parsed(header: str) -> tuple[str, list[_Element]]:
    """Return the format and the elements of a header."""
    form, elements = "", list[_Element]()
    for words in map(str.split, header.splitlines()):
        match words:
            case ["format", given, *_] if given in _ORDERS:
                form = given
            case ["element", name, count] if count.isdigit():
                elements.append(_Element(name, int(count), []))
            case ["property", "list", n, of, name] if elements and {n, of} <= _TYPES.keys():
                elements[-1].properties.append(_Property(name, _TYPES[of], _TYPES[n]))
            case ["property", of, name] if elements and of in _TYPES:
                elements[-1].properties.append(_Property(name, _TYPES[of], None))
            case [] | ["ply" | "comment" | "obj_info" | "end_header", *_]:
                pass
            case _:
                line = " ".join(words)[:60]
                raise MeshFileError(f"cannot be read as a mesh (line {line!r} in its header)")
    if not form or not elements or not all(element.properties for element in elements):
        raise MeshFileError("cannot be read as a mesh (incomplete PLY header)")
    return form, elements


def _as_stored(element: _Element, order: str, *, is_text: bool) -> _Element:
    """Return the element with the types that its values have in the file."""

    def stored(dtype: np.dtype[Any]) -> np.dtype[Any]:
        return np.dtype(np.float64) if is_text else np.dtype(f"{order}{dtype.str[1:]}")

    properties = [
        _Property(p.name, stored(p.dtype), None if p.count_dtype is None else stored(p.count_dtype))
        for p in element.properties
    ]
    return element._replace(properties=properties)


def _read_element(element: _Element, body: bytes, start: int) -> tuple[_Columns, int]:
    """Return the values of an element, and where the next one starts."""
    fast = _read_equal_records(element, body, start)
    return _read_records(element, body, start) if fast is None else fast


def _read_equal_records(element: _Element, body: bytes, start: int) -> tuple[_Columns, int] | None:
    """Read records whose lists are as long as those of the first record; None if there are others.

    This is much faster than reading one record after the other.
    """
    one, _ = _read_records(element._replace(n=min(element.n, 1)), body, start)
    fields: list[Any] = []
    for p in element.properties:
        column = one[p.name]
        if isinstance(column, _Lists) and p.count_dtype is not None:
            fields += [(f"n {p.name}", p.count_dtype), (p.name, p.dtype, (len(column.values),))]
        else:
            fields.append((p.name, p.dtype))
    layout = np.dtype(fields)
    if len(body) - start < element.n * layout.itemsize:
        return None
    table = np.frombuffer(body, layout, element.n, start)
    columns: _Columns = {}
    for p in element.properties:
        columns[p.name] = table[p.name]
        if p.count_dtype is not None:
            counts = table[f"n {p.name}"]
            if len(counts) and (counts != counts[0]).any():
                return None
            columns[p.name] = _Lists(counts.astype(np.int64), table[p.name].reshape(-1))
    return columns, start + table.nbytes


def _read_records(element: _Element, body: bytes, start: int) -> tuple[_Columns, int]:
    """Read records with lists of any length, one after the other."""
    values: dict[str, list[Any]] = {p.name: [] for p in element.properties}
    counts: dict[str, list[int]] = {p.name: [] for p in element.properties if p.count_dtype}

    def take(dtype: np.dtype[Any], n: int) -> npt.NDArray[Any]:
        nonlocal start
        end = start + n * dtype.itemsize
        if n < 0 or end > len(body):
            name = _PLURALS.get(element.name, f"{element.name} records")
            raise MeshFileError(f"is truncated (promises {element.n} {name}, holds {done})")
        found = np.frombuffer(body, dtype, n, start)
        start = end
        return found

    for done in range(element.n):  # noqa: B007 - it is used in take
        for p in element.properties:
            n = 1
            if p.count_dtype is not None:
                n = int(take(p.count_dtype, 1)[0])
                counts[p.name].append(n)
            values[p.name].extend(take(p.dtype, n).tolist())
    columns: _Columns = {}
    for p in element.properties:
        column = np.array(values[p.name], p.dtype)
        is_list = p.name in counts
        columns[p.name] = _Lists(np.array(counts[p.name], np.int64), column) if is_list else column
    return columns, start


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
