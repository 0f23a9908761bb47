"""XDMF files that hold their numbers as text, so that one file is the whole mesh."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

_TOPOLOGY = {"line": "Polyline", "triangle": "Triangle", "tetra": "Tetrahedron"}
_TYPE_CODE = {"line": 2, "triangle": 4, "tetra": 6}


def write(
    path: Path,
    points: npt.NDArray[Any],
    blocks: Sequence[tuple[str, npt.NDArray[Any]]],
    point_data: dict[str, npt.NDArray[Any]],
    cell_data: dict[str, list[npt.NDArray[Any]]],
) -> None:
    """Write simplices and fields as XDMF 3.

    Not through meshio, whose writer needs h5py even where no HDF5 file is written.
    """
    root = ElementTree.Element("Xdmf", Version="3.0")
    domain = ElementTree.SubElement(root, "Domain")
    grid = ElementTree.SubElement(domain, "Grid", Name="Grid", GridType="Uniform")
    kind = "XY" if points.shape[1] == 2 else "XYZ"
    geometry = ElementTree.SubElement(grid, "Geometry", GeometryType=kind)
    _add_array(geometry, points)
    _add_topology(grid, blocks)
    for name, values in point_data.items():
        _add_field(grid, name, "Node", values)
    for name, parts in cell_data.items():
        _add_field(grid, name, "Cell", np.concatenate(parts))
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


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
