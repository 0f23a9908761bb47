"""PLY files, text and binary: surfaces with fields at the vertices and faces."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import RawMesh
from adaptsize._formats.polygons import as_blocks
from adaptsize._formats.text import check_last_number, numbers
from adaptsize.errors import MeshFileError

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


def read(path: Path) -> RawMesh:
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
    for i in range(element.n):
        for p in element.properties:
            n = 1
            if p.count_dtype is not None:
                (n,) = map(int, _take(element, i, body, start, p.count_dtype, 1))
                start += p.count_dtype.itemsize
                counts[p.name].append(n)
            values[p.name].extend(_take(element, i, body, start, p.dtype, n).tolist())
            start += n * p.dtype.itemsize
    columns: _Columns = {}
    for p in element.properties:
        column = np.array(values[p.name], p.dtype)
        is_list = p.name in counts
        columns[p.name] = _Lists(np.array(counts[p.name], np.int64), column) if is_list else column
    return columns, start


def _take(
    element: _Element, done: int, body: bytes, start: int, dtype: np.dtype[Any], n: int
) -> npt.NDArray[Any]:
    if n < 0 or start + n * dtype.itemsize > len(body):
        name = _PLURALS.get(element.name, f"{element.name} records")
        raise MeshFileError(f"is truncated (promises {element.n} {name}, holds {done})")
    return np.frombuffer(body, dtype, n, start)
