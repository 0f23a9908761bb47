"""Data sets of VTK: their conversion to and from the content of files, and the files themselves.

Only the modules of VTK that are needed are imported; all of them, or pyvista, take seconds.
"""

from __future__ import annotations

import codecs
import io
import math
import os
import re
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote
from xml.sax.saxutils import escape

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import TAG_NAMES, RawMesh, tag_key
from adaptsize.errors import MeshFileError

if TYPE_CHECKING:
    from adaptsize.background import CartesianGrid

# VTK cell types by their names in meshio.  Of cells of higher order, the corners come first.
_FROM_VTK = {
    1: "vertex", 3: "line", 5: "triangle", 7: "polygon", 9: "quad", 10: "tetra", 12: "hexahedron",
    13: "wedge", 14: "pyramid",
    **dict.fromkeys((21, 35, 68, 75), "line3"), **dict.fromkeys((22, 34, 69, 76), "triangle6"),
    **dict.fromkeys((23, 28, 30, 70, 77), "quad8"), **dict.fromkeys((24, 71, 78), "tetra10"),
    **dict.fromkeys((25, 29, 33, 72, 79), "hexahedron20"),
    **dict.fromkeys((26, 31, 32, 73, 80), "wedge15"),
    **dict.fromkeys((27, 37, 74, 81), "pyramid13"),
}  # fmt: skip
_REFUSED = {15: "pentagonal prism", 16: "hexagonal prism", 36: "curved polygon", 42: "polyhedron"}
_TO_VTK = {"line": 3, "triangle": 5, "tetra": 10, "line3": 21, "triangle6": 22, "tetra10": 24}
_EMPTY, _POLYVERTEX, _POLYLINE, _STRIP, _PIXEL, _VOXEL = 0, 2, 4, 6, 8, 11
# VTK's pixels and voxels number their nodes row by row, unlike other cells.
_TURNED = {_PIXEL: ("quad", [0, 1, 3, 2]), _VOXEL: ("hexahedron", [0, 1, 3, 2, 4, 5, 7, 6])}
#: The field of texts "dimension tag name".
NAMES = "tag_names"
#: The array by which VTK hides nodes, and the bit for hidden nodes.
_GHOSTS, _HIDDEN = "vtkGhostType", 2

#: What names in XML need besides & < >.
_ESCAPED = {'"': "&quot;", "\t": "&#9;", "\n": "&#10;", "\r": "&#13;"}
_READERS = {
    ".obj": "vtkIOGeometry.vtkOBJReader",
    ".vtkhdf": "vtkIOHDF.vtkHDFReader",
    ".pvtu": "vtkIOXML.vtkXMLPUnstructuredGridReader",
}
_WRITERS = {
    ".vtu": "vtkIOXML.vtkXMLUnstructuredGridWriter",
    ".vtp": "vtkIOXML.vtkXMLPolyDataWriter",
    ".vti": "vtkIOXML.vtkXMLImageDataWriter",
    ".vtk": "vtkIOLegacy.vtkUnstructuredGridWriter",
}


def _get(name: str) -> Any:
    """Return a class of VTK by the name of its module and its own."""
    module, _, own = name.rpartition(".")
    return getattr(import_module(f"vtkmodules.{module}"), own)


# --- data sets ------------------------------------------------------------------------------------


def raw_of(data: Any) -> RawMesh:
    """Return the cells and fields of a data set, or of all in a composite one.

    Cells of parts without tags are tagged by the number of the part, from 1.
    """
    names, grids, labels = _names_in(data), list[Any](), list[str]()
    for part, label in _parts_of(data):
        names |= _names_in(part)
        grid = _grid_of_part(part)
        if grid.GetNumberOfCells():
            grids.append(grid)
            labels.append(label)
    if not grids:
        raise MeshFileError("holds no cells")
    fields = {tag_key(name) for grid in grids for name in _arrays_in(grid.GetCellData())}
    if len(grids) > 1 and any(labels) and not fields & set(TAG_NAMES):
        for number, (grid, label) in enumerate(zip(grids, labels, strict=True), start=1):
            region = np.full(grid.GetNumberOfCells(), number, np.int32)
            _add(grid.GetCellData(), {"region": region})
            names |= {(dim, number): label for dim in (2, 3) if label}
    return replace(_raw_of_grid(_appended(grids)), tag_names=names)


def _parts_of(data: Any) -> Iterator[tuple[Any, str]]:
    """Yield the data sets in an object, with their names."""
    if data is None:
        return
    if data.IsA("vtkDataSet"):
        yield data, ""
        return
    if not data.IsA("vtkCompositeDataSet"):
        raise MeshFileError(f"holds a {data.GetClassName()}, not a mesh")
    at = data.NewIterator()
    at.InitTraversal()
    while not at.IsDoneWithTraversal():
        held = at.HasCurrentMetaData() and at.GetCurrentMetaData()
        key = _get("vtkCommonDataModel.vtkCompositeDataSet").NAME()
        part = at.GetCurrentDataObject()
        if part.IsA("vtkDataSet"):
            yield part, (held.Get(key) or "") if held and held.Has(key) else ""
        at.GoToNextItem()


def raw_of_part(data: Any) -> RawMesh:
    """Return the cells and fields of a data set, without cells that other pieces have, too."""
    return replace(_raw_of_grid(_grid_of_part(data)), tag_names=_names_in(data))


def _appended(data_sets: Iterable[Any]) -> Any:
    """Return a vtkUnstructuredGrid of all cells, with the fields that all data sets have."""
    append = _get("vtkFiltersCore.vtkAppendFilter")()
    append.SetOutputPointsPrecision(append.DOUBLE_PRECISION)
    for data in data_sets:
        append.AddInputData(data)
    append.Update()
    return append.GetOutput()


def _grid_of_part(data: Any) -> Any:
    """Return a data set as a new vtkUnstructuredGrid, without cells that other pieces have, too."""
    grid = _get("vtkCommonDataModel.vtkUnstructuredGrid")()
    if data.GetNumberOfPoints():
        grid.ShallowCopy(data if data.IsA("vtkUnstructuredGrid") else _appended([data]))
    if grid.GetCellGhostArray() is not None:
        grid.RemoveGhostCells()
    return grid


def _raw_of_grid(grid: Any) -> RawMesh:
    fields, nodal = _arrays_in(grid.GetCellData()), _arrays_in(grid.GetPointData())
    for held in (fields, nodal):
        held.pop(_GHOSTS, None)
    blocks, cell_data = [], {name: list[Any]() for name in fields}
    for cell_type, cells, parent in _blocks_of(grid):
        blocks.append((cell_type, cells))
        for name, values in fields.items():
            cell_data[name].append(values[parent])
    points = _numpy(grid.GetPoints().GetData()).astype(np.float64) if blocks else np.empty((0, 3))
    return RawMesh(points, blocks, nodal, cell_data)


def _numpy(array: Any) -> npt.NDArray[Any]:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    return np.array(vtk_to_numpy(array))


def _array_of(values: npt.NDArray[Any]) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk

    return numpy_to_vtk(np.ascontiguousarray(values), deep=True)


def _arrays_in(data: Any) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of numbers of the nodes or cells by their names."""
    arrays = {}
    for i in range(data.GetNumberOfArrays()):
        array = data.GetArray(i)
        if array is not None:
            arrays[data.GetArrayName(i) or f"field {i}"] = _numpy(array)
    return arrays


def _blocks_of(
    grid: Any,
) -> Iterator[tuple[str, npt.NDArray[np.int64], npt.NDArray[np.intp]]]:
    """Yield the cells of each type and size with their numbers in the grid."""
    if not grid.GetNumberOfCells():
        return
    try:
        types = _numpy(grid.GetCellTypes())
    except TypeError:  # before VTK 9.6, it needs an argument
        types = _numpy(grid.GetCellTypesArray())
    start = _numpy(grid.GetCells().GetOffsetsArray()).astype(np.int64)
    nodes = _numpy(grid.GetCells().GetConnectivityArray()).astype(np.int64)
    width = np.diff(start)
    if len(start) != len(types) + 1 or (width < 0).any() or start[0] or start[-1] > len(nodes):
        raise MeshFileError("has cells that begin or end outside of their list of nodes")
    for vtk_type in np.unique(types).tolist():
        for size in np.unique(width[types == vtk_type]).tolist():
            of_type = np.flatnonzero((types == vtk_type) & (width == size))
            if vtk_type == _EMPTY or size == 0:
                continue
            if len(of_type) == len(types):
                cells = nodes[: start[-1]].reshape(-1, size)
            else:
                cells = nodes[start[of_type][:, None] + np.arange(size)]
            if vtk_type == _POLYVERTEX:
                yield "vertex", cells.reshape(-1, 1), np.repeat(of_type, size)
            elif vtk_type == _POLYLINE:
                pairs = np.stack([cells[:, :-1], cells[:, 1:]], axis=2)
                yield "line", pairs.reshape(-1, 2), np.repeat(of_type, size - 1)
            elif vtk_type == _STRIP:
                rows = np.stack([cells[:, :-2], cells[:, 1:-1], cells[:, 2:]], axis=2)
                rows[:, 1::2] = rows[:, 1::2, [1, 0, 2]]  # every other one is turned
                yield "triangle", rows.reshape(-1, 3), np.repeat(of_type, max(size - 2, 0))
            elif vtk_type in _TURNED:
                name, order = _TURNED[vtk_type]
                if size != len(order):
                    raise MeshFileError(f"has a {name} of {size} nodes")
                yield name, cells[:, order], of_type
            elif vtk_type in _FROM_VTK:
                yield _FROM_VTK[vtk_type], cells, of_type
            else:
                name = _REFUSED.get(vtk_type, "unknown")
                raise MeshFileError(
                    f"holds cells of VTK type {vtk_type} ({name}), which cannot be read"
                )


def _names_in(data: Any) -> dict[tuple[int, int], str]:
    found = data.GetFieldData().GetAbstractArray(NAMES)
    names = {}
    for i in range(found.GetNumberOfValues() if found and found.IsA("vtkStringArray") else 0):
        words = found.GetValue(i).split(" ", 2)
        if len(words) == 3 and words[0].isdigit() and words[1].lstrip("-").isdigit():
            names[int(words[0]), int(words[1])] = words[2]
    return names


def grid_of(mesh: RawMesh) -> Any:
    """Return a vtkUnstructuredGrid of simplices, with names of tags as texts."""
    grid = _get("vtkCommonDataModel.vtkUnstructuredGrid")()
    grid.SetPoints(_points(mesh))
    cells = _get("vtkCommonDataModel.vtkCellArray")()
    offsets, ids, types = map(_array_of, _cells_of(mesh))
    cells.SetData(offsets, ids)
    grid.SetCells(types, cells)
    _add_fields(grid, mesh)
    return grid


def triangles_of(
    polygons: npt.NDArray[np.int64], points: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return triangles of polygons, int64[n, k], and the polygon of each; none without area."""
    in_space = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    number = {"number": [np.arange(len(polygons))]}
    triangulate = _get("vtkFiltersCore.vtkTriangleFilter")()
    triangulate.SetInputData(surface_of(RawMesh(in_space, [("polygon", polygons)], {}, number)))
    triangulate.Update()
    found = triangulate.GetOutput()
    nodes = _numpy(found.GetPolys().GetConnectivityArray()).astype(np.int64)
    return nodes.reshape(-1, 3), _numpy(found.GetCellData().GetArray("number")).astype(np.int64)


def _cells_of(mesh: RawMesh) -> tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]]:
    """Return where the nodes of each simplex begin, int64[n + 1], all nodes, and VTK's types."""
    ids = np.concatenate([rows.ravel() for _, rows in mesh.blocks]).astype(np.int64)
    widths = np.concatenate([np.full(len(rows), rows.shape[1]) for _, rows in mesh.blocks])
    types = [np.full(len(rows), _TO_VTK[name], np.uint8) for name, rows in mesh.blocks]
    return np.concatenate([[0], np.cumsum(widths)]).astype(np.int64), ids, np.concatenate(types)


def rows_of(mesh: RawMesh) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of a file of VTKHDF by their places in it."""
    offsets, ids, types = _cells_of(mesh)
    counts = {"Points": len(mesh.points), "Cells": len(types), "ConnectivityIds": len(ids)}
    return {
        **{f"NumberOf{what}": np.array([count]) for what, count in counts.items()},
        "Points": mesh.points,
        "Connectivity": ids,
        "Offsets": offsets,
        "Types": types,
        **{f"PointData/{name}": values for name, values in mesh.point_data.items()},
        **{f"CellData/{name}": np.concatenate(v) for name, v in mesh.cell_data.items()},
    }


def texts_of(names: Mapping[tuple[int, int], str]) -> list[str]:
    """Return names of tags as texts."""
    return [f"{dim} {tag} {name}" for (dim, tag), name in names.items()]


def _points(mesh: RawMesh) -> Any:
    points = _get("vtkCommonCore.vtkPoints")()
    points.SetData(_array_of(mesh.points.astype(np.float64, copy=False)))
    return points


def surface_of(mesh: RawMesh) -> Any:
    """Return a vtkPolyData of segments and triangles, in VTK's order: segments first."""
    surface = _get("vtkCommonDataModel.vtkPolyData")()
    surface.SetPoints(_points(mesh))
    order = sorted(range(len(mesh.blocks)), key=lambda i: mesh.blocks[i][0])
    for i in order:
        name, rows = mesh.blocks[i]
        cells = _get("vtkCommonDataModel.vtkCellArray")()
        cells.SetData(rows.shape[1], _array_of(rows.ravel().astype(np.int64)))
        (surface.SetLines if name == "line" else surface.SetPolys)(cells)
    sorted_data = {name: [parts[i] for i in order] for name, parts in mesh.cell_data.items()}
    _add_fields(surface, RawMesh(mesh.points, [], mesh.point_data, sorted_data, mesh.tag_names))
    return surface


def _add_fields(data: Any, mesh: RawMesh) -> None:
    _add(data.GetPointData(), mesh.point_data)
    cell_data = {name: np.concatenate(parts) for name, parts in mesh.cell_data.items()}
    _add(data.GetCellData(), cell_data)
    if mesh.tag_names:
        texts = _get("vtkCommonCore.vtkStringArray")()
        texts.SetName(NAMES)
        for text in texts_of(mesh.tag_names):
            texts.InsertNextValue(text)
        data.GetFieldData().AddArray(texts)


def _add(data: Any, fields: Mapping[str, npt.NDArray[Any]]) -> None:
    for name, values in fields.items():
        array = _array_of(values)
        array.SetName(name)
        data.AddArray(array)


# --- files ----------------------------------------------------------------------------------------


_LOCK = threading.Lock()


def _unlock() -> None:
    global _LOCK  # noqa: PLW0603 - another thread may hold it when this process is forked
    _LOCK = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_unlock)


@contextmanager
def _errors() -> Iterator[list[str]]:
    """Collect the errors of VTK, without the places in its source, instead of printing them."""
    errors: list[str] = []

    def add(window: Any, event: str, text: str) -> None:
        text = re.sub(r"^.*?\((0x[0-9a-f]+|nullptr)\): ", "", text, flags=re.DOTALL)
        errors.append(" ".join(text.split()))

    # By this, VTK passes the text.
    add.CallDataType = "string0"  # type: ignore[attr-defined]
    window, logger = _get("vtkCommonCore.vtkStringOutputWindow")(), _get("vtkCommonCore.vtkLogger")
    window.AddObserver("ErrorEvent", add)
    with _LOCK:  # VTK has one window for all threads
        usual, level = window.GetInstance(), logger.GetCurrentVerbosityCutoff()
        window.SetInstance(window)
        logger.SetStderrVerbosity(logger.VERBOSITY_OFF)
        try:
            yield errors
        finally:
            window.SetInstance(usual)
            logger.SetStderrVerbosity(level)


def read_file(path: Path) -> Any:
    """Return the data object in a file.  VTK's first error is raised, and others are printed."""
    if path.suffix.lower() == ".vtk":
        return _checked(path, lambda: _read_legacy(path.read_bytes()))
    reader = _reader_of(path)
    return _checked(path, lambda: (reader.Update(), reader.GetOutputDataObject(0))[1])


def pieces_in(path: Path, rank: int, size: int) -> Iterator[RawMesh]:
    """Yield every ``size``-th piece of a ``.pvtu`` or ``.vtkhdf`` file, from ``rank`` on."""
    reader = _reader_of(path)

    def update(piece: int, n_pieces: int) -> Any:
        reader.UpdatePiece(piece, n_pieces, 0)
        return reader.GetOutputDataObject(0)

    if path.suffix.lower() == ".vtkhdf":
        data = _checked(path, lambda: update(rank, size))
        for part, _ in _parts_of(data):
            yield replace(raw_of_part(part), tag_names=_names_in(data) or _names_in(part))
        return
    _checked(path, lambda: (reader.UpdateInformation(), reader)[1])
    n_pieces = reader.GetNumberOfPieces()
    for piece in range(rank, n_pieces, size):
        yield raw_of_part(_checked(path, partial(update, piece, n_pieces)))


def _reader_of(path: Path) -> Any:
    name = _READERS.get(path.suffix.lower(), "vtkIOXML.vtkXMLGenericDataObjectReader")
    reader = _get(name)()
    reader.SetFileName(str(path))
    return reader


def _checked(path: Path, read: Callable[[], Any]) -> Any:
    """Return a data object that VTK reads without errors."""
    with _errors() as errors:
        data = read()
    if errors or data is None:
        reason = (errors or ["no data"])[0].replace(str(path), path.name)
        raise MeshFileError(f"cannot be read ({reason[:160]})")
    return data


#: The name of an array that is added to legacy files.
_END = "adaptsize end"
_LINES = re.MULTILINE | re.IGNORECASE
#: Types that meshio calls by names that VTK does not know.
_LEGACY_TYPES = {
    b"int8": b"char", b"int16": b"short", b"int32": b"int",
    b"uint8": b"unsigned_char", b"uint16": b"unsigned_short", b"uint32": b"unsigned_int",
}  # fmt: skip
_MESHIO_TYPES = re.compile(rb"vtktype(u?int(?:8|16|32))(?=\s*$)", re.MULTILINE)


def _read_legacy(content: bytes) -> Any:
    """Return the data object in a legacy file.

    VTK reads a file that ends early without an error.  An array after the end is only found if the
    last section is complete.
    """
    content = content.removeprefix(codecs.BOM_UTF8)
    content = _MESHIO_TYPES.sub(lambda found: _LEGACY_TYPES[found[1]], content)
    capitals = content.upper()  # rfind is much faster than an expression
    last = max(capitals.rfind(b"\nPOINT_DATA"), capitals.rfind(b"\nCELL_DATA"))
    section = (
        re.match(rb"\n\w+[ \t]+(\d{1,12})\b", content[last : last + 100]) if last > 0 else None
    )
    points = re.search(rb"^[ \t]*POINTS[ \t]+(\d{1,12})\b", content, _LINES)
    counts = re.search(rb"^[ \t]*DIMENSIONS((?:[ \t]+\d{1,9}){3})", content, _LINES)
    if section:
        n, head = int(section[1]), ""
    else:
        n = int(points[1]) if points else math.prod(map(int, counts[1].split())) if counts else 0
        head = f"POINT_DATA {n}\n"
    is_binary = re.match(rb"[^\n]*\n[^\n]*\n\s*BINARY", content, re.IGNORECASE)
    head = f"{head}FIELD FieldData 1\n{quote(_END)} 1 {n} unsigned_char\n"
    # No line break before it in a binary file: as the last byte of a number, it would be a 10.
    content += (b"" if is_binary else b"\n\n") + head.encode()
    content += (b"\0" if is_binary else b"0 ") * n + b"\n"
    reader = _get("vtkIOLegacy.vtkGenericDataObjectReader")()
    for kind in ("Scalars", "Vectors", "Normals", "Tensors", "ColorScalars", "TCoords", "Fields"):
        getattr(reader, f"ReadAll{kind}On")()
    reader.ReadFromInputStringOn()
    reader.SetBinaryInputString(content, len(content))
    reader.Update()
    data = reader.GetOutputDataObject(0)
    if data is not None and data.IsA("vtkDataSet"):
        fields = [f for f in (data.GetPointData(), data.GetCellData()) if f.HasArray(_END)]
        if not fields:
            raise MeshFileError("is truncated (its last section is incomplete)")
        fields[0].RemoveArray(_END)
    return data


def read_image(path: Path) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """Return what a CartesianGrid of image data is made from, and its fields of one component.

    In VTK, x varies fastest, which is the opposite of the order here.
    """
    data = read_file(path)
    if not data.IsA("vtkImageData"):
        raise MeshFileError(f"holds a {data.GetClassName()}, not image data")
    matrix = data.GetDirectionMatrix()
    if any(matrix.GetElement(i, j) != (i == j) for i in range(3) for j in range(3)):
        raise MeshFileError("holds a grid that is not axis-aligned")
    fields = _arrays_in(data.GetPointData())
    extent, spacing = np.reshape(data.GetExtent(), (3, 2)), np.array(data.GetSpacing())
    origin, counts = data.GetOrigin() + spacing * extent[:, 0], extent[:, 1] - extent[:, 0] + 1
    dim = max((d + 1 for d in range(3) if counts[d] > 1), default=0)
    for d in range(3):
        if counts[d] < 2 and (d < dim or origin[d] != 0.0):
            raise MeshFileError(
                f"has {counts[d]} nodes along {'xyz'[d]}, at {origin[d]:g}, but needs two or more "
                "(or one along the last axes, at 0)"
            )
    shape = tuple(counts[:dim].tolist())
    fields = {name: v.reshape(shape, order="F") for name, v in fields.items() if v.ndim == 1}
    ghosts = fields.pop(_GHOSTS, None)
    active = None if ghosts is None else ghosts & _HIDDEN == 0
    grid = {"origin": origin[:dim], "spacing": spacing[:dim], "shape": shape, "active": active}
    return grid, fields


def plain(name: str, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return numbers in at most two dimensions, of a type that all formats support."""
    if values.dtype.kind not in "biuf":
        raise ValueError(f"field {name!r} must hold numbers, got {values.dtype}")
    if values.dtype.kind == "b":
        values = values.astype(np.int32)
    if values.dtype.kind == "f" and values.dtype.itemsize not in (4, 8):
        values = values.astype(np.float64)
    return np.ascontiguousarray(values if values.ndim <= 2 else values.reshape(len(values), -1))


def write_image(path: Path, grid: CartesianGrid, fields: Mapping[str, npt.NDArray[Any]]) -> None:
    """Write nodal fields of the grid's shape as ``.vti``.  Inactive nodes are hidden."""
    image, more = _get("vtkCommonDataModel.vtkImageData")(), 3 - grid.dim
    image.SetOrigin(*grid.origin, *[0.0] * more)
    image.SetSpacing(*grid.spacing, *[1.0] * more)
    image.SetDimensions(*grid.shape, *[1] * more)
    flat = {name: plain(name, values.ravel(order="F")) for name, values in fields.items()}
    if grid.active is not None:
        flat[_GHOSTS] = np.where(grid.active.ravel(order="F"), 0, _HIDDEN).astype(np.uint8)
    _add(image.GetPointData(), flat)
    write(path, ".vti", image)


def create_hdf(path: Path | io.BytesIO) -> Any:
    """Return a new file of VTKHDF, open, for the rows of a vtkUnstructuredGrid."""
    import h5py

    file = h5py.File(path, "w")
    root = file.create_group("VTKHDF")
    root.attrs.update({"Version": (2, 0), "Type": np.bytes_("UnstructuredGrid")})
    return file


def add_names(file: Any, names: Mapping[tuple[int, int], str]) -> None:
    """Add the names of tags to a file of VTKHDF, unless it has names."""
    import h5py

    if names and f"VTKHDF/FieldData/{NAMES}" not in file:
        texts, kind = [text.encode() for text in texts_of(names)], h5py.string_dtype("ascii")
        file["VTKHDF"].create_dataset(f"FieldData/{NAMES}", data=texts, dtype=kind)


def write_hdf(path: Path, mesh: RawMesh) -> None:
    """Write simplices as VTKHDF, by way of memory.

    If the disk is full, VTK does not notice it, and HDF5 crashes.
    """
    content = io.BytesIO()
    with create_hdf(content) as file:
        for name, values in rows_of(mesh).items():
            file["VTKHDF"][name] = values
        add_names(file, mesh.tag_names)
    path.write_bytes(content.getbuffer())


def write(path: Path, suffix: str, data: Any) -> None:
    """Write a data set as ``.vtu``, ``.vtp``, ``.vti`` or ``.vtk``."""
    path.touch()  # if this fails, VTK does not say why
    with _errors() as errors:
        writer = _get(_WRITERS[suffix])()
        writer.SetFileName(str(path))
        writer.SetInputDataObject(data)
        if suffix == ".vtk":
            writer.SetFileTypeToBinary()
            writer.SetFileVersion(42)  # which every VTK reads
        else:
            writer.SetHeaderTypeToUInt64()
            for held in (data.GetPointData(), data.GetCellData()):
                for array in map(held.GetArray, range(held.GetNumberOfArrays())):
                    array.SetName(escape(array.GetName(), _ESCAPED))  # VTK does not
        is_written = writer.Write()
    if errors or not is_written:
        reason = _get("vtkCommonMisc.vtkErrorCode").GetStringFromErrorCode(writer.GetErrorCode())
        raise MeshFileError(f"cannot be written ({reason})")
