"""VTK image data (``.vti``) and XDMF files: numbers in XML.

No package is used for image data: meshio has none, pyvista is optional, and the format consists of
a few lines of XML before the numbers.  XDMF is text, so that one file contains the whole mesh;
meshio needs h5py even without an HDF5 file.
"""

from __future__ import annotations

import base64
import io
import lzma
import re
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import RawMesh
from adaptsize._formats.completeness import numbers
from adaptsize._formats.guards import FOREIGN_FAILURES, reason
from adaptsize.background import CartesianGrid
from adaptsize.errors import MeshFileError

#: The array by which VTK hides nodes, and the bit for hidden nodes.
_GHOSTS, _HIDDEN = "vtkGhostType", 2
_TYPES = {"f4": "Float32", "f8": "Float64"} | {
    f"{kind}{size}": f"{'U' * (kind == 'u')}Int{8 * size}" for kind in "iu" for size in (1, 2, 4, 8)
}
_DTYPES = {name: np.dtype(code) for code, name in _TYPES.items()}
_DECOMPRESSORS: dict[str | None, Callable[[bytes], bytes]] = {
    "vtkZLibDataCompressor": zlib.decompress,
    "vtkLZMADataCompressor": lzma.decompress,
}
_IDENTITY = np.eye(3).ravel()


def write_vti(path: Path, grid: CartesianGrid, fields: Mapping[str, npt.NDArray[Any]]) -> None:
    """Write nodal fields of the grid's shape.  Inactive nodes are hidden.

    The raw numbers are at the end of the file.  Each field is preceded by its length in bytes.
    In VTK, x varies fastest, which is the opposite of the order here.
    """
    arrays = {name: _plain(name, values) for name, values in fields.items()}
    if grid.active is not None:
        arrays[_GHOSTS] = np.where(grid.active, 0, _HIDDEN).astype(np.uint8)
    extent = " ".join(f"0 {n - 1}" for n in (*grid.shape, *(1,) * (3 - grid.dim)))
    origin = _row([*grid.origin, *(0.0,) * (3 - grid.dim)])
    spacing = _row([*grid.spacing, *(1.0,) * (3 - grid.dim)])
    active = quoteattr(next(iter(fields), ""))
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        f'<ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{spacing}">',
        f'<Piece Extent="{extent}">',
        f"<PointData Scalars={active}>" if fields else "<PointData>",
    ]
    offset = 0
    for name, values in arrays.items():
        code = _TYPES[values.dtype.str[1:]]
        lines.append(
            f'<DataArray type="{code}" Name={quoteattr(name)} format="appended" offset="{offset}"/>'
        )
        offset += 8 + values.nbytes
    lines += ["</PointData>", "</Piece>", "</ImageData>", '<AppendedData encoding="raw">', "_"]
    with path.open("wb") as file:
        file.write("\n".join(lines).encode())
        for values in arrays.values():
            file.write(np.array(values.nbytes, "<u8").tobytes())
            _write_x_fastest(file, values)
        file.write(b"\n</AppendedData>\n</VTKFile>\n")


def read_vti(path: Path) -> tuple[CartesianGrid, dict[str, npt.NDArray[Any]]]:
    """Return the grid of a file and its nodal fields of one component.

    Raises
    ------
    MeshFileError
        If it is damaged, or its data do not fit a CartesianGrid.
    """
    try:
        return _read_vti(path.read_bytes())
    except MeshFileError:
        raise
    except FOREIGN_FAILURES as error:
        raise MeshFileError(f"cannot be read as image data ({reason(error)})") from error


@dataclass(frozen=True)
class _Encoding:
    """How a file stores its numbers."""

    byte_order: Literal["<", ">"]
    header: np.dtype[Any]
    decompress: Callable[[bytes], bytes] | None
    appended: memoryview
    appended_is_raw: bool


def _read_vti(content: bytes) -> tuple[CartesianGrid, dict[str, npt.NDArray[Any]]]:
    # Raw numbers are not XML.  Only the part before them is parsed.
    text, tag, rest = content.partition(b"<AppendedData")
    root = ElementTree.fromstring(text + b"</VTKFile>" if tag else text)
    image = root.find("ImageData")
    pieces = [] if image is None else image.findall("Piece")
    if image is None or len(pieces) != 1:
        raise MeshFileError(f"holds {len(pieces)} pieces of image data, only one can be read")
    if not np.array_equal(_numbers(image.get("Direction"), _IDENTITY), _IDENTITY):
        raise MeshFileError("holds a grid that is not axis-aligned")
    extent = _numbers(pieces[0].get("Extent")).astype(int).reshape(3, 2)
    counts = extent[:, 1] - extent[:, 0] + 1
    spacing = _numbers(image.get("Spacing"), np.ones(3))
    origin = _numbers(image.get("Origin"), np.zeros(3)) + spacing * extent[:, 0]
    dim = max((d + 1 for d in range(3) if counts[d] > 1), default=0)
    for d in range(3):
        if counts[d] < 2 and (d < dim or origin[d] != 0.0):
            raise MeshFileError(
                f"has {counts[d]} nodes along {'xyz'[d]}, at {origin[d]:g}, but needs two or more "
                "(or one along the last axes, at 0)"
            )
    shape = tuple(int(n) for n in counts[:dim])
    arrays = pieces[0].findall("PointData/DataArray")
    encoding = _encoding(root, tag + rest)
    fields = {
        array.get("Name", "field"): _values(array, encoding).reshape(shape[::-1]).T.copy()
        for array in arrays
        if int(array.get("NumberOfComponents", "1")) == 1 and array.get("type") in _DTYPES
    }
    ghosts = fields.pop(_GHOSTS, None)
    active = None if ghosts is None else ghosts & _HIDDEN == 0
    return CartesianGrid(origin[:dim], spacing[:dim], shape, active=active), fields


def _encoding(root: ElementTree.Element, appended: bytes) -> _Encoding:
    compressor = root.get("compressor")
    if compressor is not None and compressor not in _DECOMPRESSORS:
        raise MeshFileError(f"is compressed by {compressor}, which cannot be read; use zlib")
    start = appended.find(b"_") + 1
    head = appended[:start]
    return _Encoding(
        "<" if root.get("byte_order", "LittleEndian") == "LittleEndian" else ">",
        _DTYPES[root.get("header_type", "UInt32")],
        None if compressor is None else _DECOMPRESSORS[compressor],
        memoryview(appended)[start:],
        re.search(rb'encoding="raw"', head) is not None,
    )


def _values(array: ElementTree.Element, encoding: _Encoding) -> npt.NDArray[Any]:
    """Return the numbers of one array, flat and in native byte order."""
    dtype = _DTYPES[array.get("type", "")]
    form = array.get("format", "ascii")
    if form == "ascii":
        return numbers((array.text or "").split(), dtype)
    if form == "appended":
        stored: bytes | memoryview = encoding.appended[int(array.get("offset", "0")) :]
        raw = encoding.appended_is_raw
    else:
        stored, raw = "".join((array.text or "").split()).encode(), False
    take = _take_raw if raw else _take_base64
    header = encoding.header.newbyteorder(encoding.byte_order)
    if encoding.decompress is None:
        length = int(np.frombuffer(take(stored, 0, header.itemsize), header)[0])
        data = take(stored, header.itemsize, length, together=True)
    else:
        data = _decompressed(stored, header, take, encoding.decompress)
    return np.frombuffer(data, dtype.newbyteorder(encoding.byte_order)).astype(dtype)


def _decompressed(
    stored: bytes | memoryview,
    header: np.dtype[Any],
    take: Callable[..., bytes],
    decompress: Callable[[bytes], bytes],
) -> bytes:
    """Return the data of all blocks: their number, two sizes, the size of each packed one."""
    count = int(np.frombuffer(take(stored, 0, header.itemsize), header)[0])
    width = (3 + count) * header.itemsize
    sizes = np.frombuffer(take(stored, 0, width), header)[3:].astype(int)
    packed = take(stored, width, int(sizes.sum()))
    ends = np.cumsum(sizes)
    return b"".join(decompress(packed[e - n : e]) for e, n in zip(ends, sizes, strict=True))


def _take_raw(
    stored: bytes | memoryview, start: int, length: int, *, together: bool = False
) -> bytes:
    return _whole(bytes(stored[start : start + length]), length)


def _take_base64(
    stored: bytes | memoryview, start: int, length: int, *, together: bool = False
) -> bytes:
    """Decode a part; the header is encoded on its own unless it goes ``together`` with it."""
    skipped = 0 if together or start == 0 else 4 * -(-start // 3)
    before = start if together else 0
    n = 4 * -(-(before + length) // 3)
    return _whole(base64.b64decode(bytes(stored[skipped : skipped + n]))[before:][:length], length)


def _whole(data: bytes, length: int) -> bytes:
    if len(data) != length:
        raise MeshFileError("ends inside its numbers")
    return data


def _plain(name: str, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return numbers of a type that VTK supports."""
    if values.dtype.kind == "b":
        return values.astype(np.uint8)
    if values.dtype.str[1:] not in _TYPES:
        raise ValueError(f"field {name!r} must hold numbers, got {values.dtype}")
    return values


def _write_x_fastest(file: BinaryIO, values: npt.NDArray[Any]) -> None:
    """Write the numbers by planes of the last axis, which avoids a second copy in memory."""
    little = values.dtype.newbyteorder("<")
    planes = values.T if values.ndim == 3 else values.T[None]
    for plane in planes:
        file.write(np.ascontiguousarray(plane, little).tobytes())


def _row(numbers: list[Any]) -> str:
    return " ".join(repr(float(x)) for x in numbers)


def _numbers(text: str | None, default: npt.NDArray[Any] | None = None) -> npt.NDArray[Any]:
    if text is None:
        if default is None:
            raise MeshFileError("cannot be read as image data (no Extent)")
        return default
    return numbers(text.split(), np.float64)


_TOPOLOGY = {"line": "Polyline", "triangle": "Triangle", "tetra": "Tetrahedron"}
_CELL_TYPE = {name.lower(): cell_type for cell_type, name in _TOPOLOGY.items()}
_TYPE_CODE = {"line": 2, "triangle": 4, "tetra": 6}


def write_xdmf(path: Path, mesh: RawMesh) -> None:
    """Write simplices and fields as XDMF 3."""
    root = ElementTree.Element("Xdmf", Version="3.0")
    domain = ElementTree.SubElement(root, "Domain")
    grid = ElementTree.SubElement(domain, "Grid", Name="Grid", GridType="Uniform")
    kind = "XY" if mesh.points.shape[1] == 2 else "XYZ"
    geometry = ElementTree.SubElement(grid, "Geometry", GeometryType=kind)
    _add_array(geometry, mesh.points)
    _add_topology(grid, mesh.blocks)
    for name, values in mesh.point_data.items():
        _add_field(grid, name, "Node", values)
    for name, parts in mesh.cell_data.items():
        _add_field(grid, name, "Cell", np.concatenate(parts))
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def read_xdmf(path: Path) -> RawMesh:
    """Return simplices and fields of an XDMF file with one grid and all numbers as text.

    Raises
    ------
    MeshFileError
        If it is anything else.  Damaged files raise other errors.
    """
    grids = ElementTree.parse(path).getroot().findall("./Domain/Grid")
    if len(grids) != 1:
        raise MeshFileError(f"holds {len(grids)} XDMF grids, only one can be read")
    points, blocks = np.empty((0, 3)), []
    point_data: dict[str, npt.NDArray[Any]] = {}
    cell_data: dict[str, npt.NDArray[Any]] = {}
    for part in grids[0]:
        if part.tag == "Geometry":
            points = _array(part)
        elif part.tag == "Topology":
            blocks = _blocks(part)
        elif part.tag == "Attribute" and part.get("Center") in ("Node", "Cell"):
            fields = point_data if part.get("Center") == "Node" else cell_data
            fields[part.get("Name", "field")] = _array(part)
    ends = np.cumsum([len(cells) for _, cells in blocks])[:-1]
    return RawMesh(
        points, blocks, point_data, {name: np.split(v, ends) for name, v in cell_data.items()}
    )


def _array(parent: ElementTree.Element) -> npt.NDArray[Any]:
    item = parent.find("DataItem")
    if item is None or item.get("Format", "XML") != "XML":
        raise MeshFileError("holds numbers outside of the file, which needs the package h5py")
    kind = {"Float": "f", "Int": "i", "UInt": "u"}[
        item.get("DataType") or item.get("NumberType") or "Float"
    ]
    dtype = np.dtype(f"{kind}{item.get('Precision', '4')}")
    shape = [int(n) for n in item.get("Dimensions", "").split()]
    return numbers((item.text or "").split(), dtype).reshape(shape)


def _blocks(topology: ElementTree.Element) -> list[tuple[str, npt.NDArray[Any]]]:
    """Return the cells, in one block for each run of cells of one type."""
    name = (topology.get("TopologyType") or topology.get("Type") or "").lower()
    data = _array(topology)
    if name != "mixed":
        return [(_CELL_TYPE[name], data)]
    types = {code: cell_type for cell_type, code in _TYPE_CODE.items()}
    blocks = []
    data = data.ravel()
    while len(data):
        cell_type = types[int(data[0])]
        head = 2 if cell_type == "line" else 1  # a polyline also states its number of nodes
        width = head + {"line": 2, "triangle": 3, "tetra": 4}[cell_type]
        rows = data[: len(data) // width * width].reshape(-1, width)
        same = rows[:, 0] == data[0]
        n = len(same) if same.all() else int(np.argmin(same))
        if n == 0:
            raise MeshFileError("ends inside a cell")
        blocks.append((cell_type, rows[:n, head:]))
        data = data[n * width :]
    return blocks


def _add_topology(
    grid: ElementTree.Element, blocks: Sequence[tuple[str, npt.NDArray[Any]]]
) -> None:
    count = str(sum(len(cells) for _, cells in blocks))
    if len(blocks) == 1:
        cell_type, cells = blocks[0]
        topology = ElementTree.SubElement(
            grid,
            "Topology",
            TopologyType=_TOPOLOGY[cell_type],
            NumberOfElements=count,
            NodesPerElement=str(cells.shape[1]),
        )
        _add_array(topology, cells)
        return
    mixed = []
    for cell_type, cells in blocks:
        codes = [_TYPE_CODE[cell_type]] + ([2] if cell_type == "line" else [])
        head = np.broadcast_to(np.array(codes, cells.dtype), (len(cells), len(codes)))
        mixed.append(np.hstack([head, cells]).ravel())
    topology = ElementTree.SubElement(
        grid, "Topology", TopologyType="Mixed", NumberOfElements=count
    )
    _add_array(topology, np.concatenate(mixed))


def _add_field(grid: ElementTree.Element, name: str, center: str, values: npt.NDArray[Any]) -> None:
    n_components = int(np.prod(values.shape[1:], dtype=int))
    kind = {1: "Scalar", 3: "Vector", 6: "Tensor6", 9: "Tensor"}.get(n_components, "Matrix")
    attribute = ElementTree.SubElement(
        grid, "Attribute", Name=name, AttributeType=kind, Center=center
    )
    _add_array(attribute, values)


def _add_array(parent: ElementTree.Element, array: npt.NDArray[Any]) -> None:
    number_type = {"f": "Float", "i": "Int", "u": "UInt"}[array.dtype.kind]
    item = ElementTree.SubElement(
        parent,
        "DataItem",
        DataType=number_type,
        Dimensions=" ".join(str(n) for n in array.shape),
        Format="XML",
        Precision=str(array.dtype.itemsize),
    )
    text = io.StringIO()
    rows = array.reshape(len(array), -1)
    np.savetxt(text, rows, "%.17g" if number_type == "Float" else "%d")
    item.text = "\n" + text.getvalue()
