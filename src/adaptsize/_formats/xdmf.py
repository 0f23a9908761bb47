"""XDMF files with all numbers as text, so that one file contains the whole mesh.

meshio needs h5py even without an HDF5 file.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import RawMesh
from adaptsize._formats.completeness import numbers
from adaptsize.errors import MeshFileError

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
