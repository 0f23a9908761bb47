"""VTU files with one piece per rank, and the PVTU file that lists them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from adaptsize._formats.guards import write_whole
from adaptsize.background import SimplexMesh
from adaptsize.background.migration import NODE_NUMBERS, Piece
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.errors import MeshFileError
from adaptsize.io import read, write

#: Names that programs give to the numbers of nodes in the whole mesh.
_NUMBERS = (NODE_NUMBERS, "GlobalNodeIds", "GlobalPointId", "GlobalNodeId")
_GHOST_TYPE = "vtkGhostType"
_DUPLICATE = 1
_VTK_TYPES = {"f8": "Float64", "f4": "Float32", "i8": "Int64", "i4": "Int32", "u1": "UInt8"}


def names_of_pieces(path: Path) -> list[Path]:
    """Return the files of the pieces that a PVTU file lists."""
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise MeshFileError(f"{path}: cannot be read as a PVTU file ({error})") from error
    pieces = [piece.get("Source") for piece in root.iter("Piece")]
    if not pieces or None in pieces:
        raise MeshFileError(f"{path}: lists no pieces")
    return [path.parent / str(piece) for piece in pieces]


def read_piece(path: Path) -> Piece | None:
    """Return a piece without its ghost cells; None if it has no cells."""
    if not _has_cells(path):
        return None
    mesh = read(path, flatten=False)
    if _GHOST_TYPE in mesh.cell_data:
        own = _without_ghosts(mesh)
        if own is None:
            return None
        mesh = own
    name = next((name for name in _NUMBERS if name in mesh.point_data), None)
    keys = None if name is None else np.asarray(mesh.point_data[name]).astype(np.int64).ravel()
    return Piece(mesh, keys)


def _has_cells(path: Path) -> bool:
    """Return whether a piece has cells: ranks without cells write files without."""
    with open(path, "rb") as file:
        head = file.read(4096)
    return b'NumberOfCells="0"' not in head


def _without_ghosts(mesh: SimplexMesh) -> SimplexMesh | None:
    """Return the cells that no other piece has too, and their nodes."""
    own = (np.asarray(mesh.cell_data[_GHOST_TYPE]).astype(np.int64) & _DUPLICATE) == 0
    if not own.any():
        return None
    nodes, local = np.unique(mesh.cells[own], return_inverse=True)
    facets = tags = None
    if mesh.tagged_facets is not None and mesh.facet_tags is not None:
        number = np.full(mesh.n_points, -1)
        number[nodes] = np.arange(len(nodes))
        facets = number[mesh.tagged_facets]
        held = (facets >= 0).all(axis=1)
        facets, tags = facets[held], mesh.facet_tags[held]
    fields = {name: values[own] for name, values in mesh.cell_data.items() if name != _GHOST_TYPE}
    return SimplexMesh(
        mesh.points[nodes],
        local.reshape(-1, mesh.cells.shape[1]),
        cell_tags=None if mesh.cell_tags is None else mesh.cell_tags[own],
        tagged_facets=facets,
        facet_tags=tags,
        tag_names=mesh.tag_names,
        point_data={name: values[nodes] for name, values in mesh.point_data.items()},
        cell_data=fields,
    )


def write_pieces(
    path: Path, part: PartitionedMesh, fields: Mapping[str, npt.ArrayLike]
) -> list[Path]:
    """Write the piece of this rank, and on rank 0 the PVTU file; collective.

    Ranks without cells write no file.  Returns the files of all ranks, the PVTU file first.
    """

    def write_own() -> tuple[str, SimplexMesh] | None:
        if part.mesh is None:
            return None
        piece = path.with_name(f"{path.stem}_{part.ranks.rank:04d}.vtu")
        mesh = part.mesh.with_data(point_data={**fields, NODE_NUMBERS: part.global_ids})
        write(piece, mesh)
        return piece.name, mesh

    own = part.ranks.agree(write_own)
    names = part.ranks.allgather(None if own is None else own[0])
    held = [name for name in names if name is not None]
    first = names.index(held[0])

    def write_list() -> None:
        if own is not None and part.ranks.rank == first:
            content = _listing(own[1], held)
            write_whole(path, partial(_write_bytes, content))

    part.ranks.agree(write_list)
    return [path, *(path.with_name(name) for name in held)]


def _write_bytes(content: bytes, place: Path) -> None:
    place.write_bytes(content)


def _listing(mesh: SimplexMesh, pieces: list[str]) -> bytes:
    """Return the content of a PVTU file."""
    root = ElementTree.Element(
        "VTKFile", type="PUnstructuredGrid", version="0.1", byte_order="LittleEndian"
    )
    grid = ElementTree.SubElement(root, "PUnstructuredGrid", GhostLevel="0")
    for tag, data in (("PPointData", mesh.point_data), ("PCellData", _cell_data(mesh))):
        section = ElementTree.SubElement(grid, tag)
        for name, values in data.items():
            width = int(np.prod(values.shape[1:], dtype=np.int64))
            _array(section, name, values.dtype, width)
    _array(ElementTree.SubElement(grid, "PPoints"), "Points", np.dtype(np.float64), 3)
    for piece in pieces:
        ElementTree.SubElement(grid, "Piece", Source=piece)
    ElementTree.indent(root)
    content: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return content


def _cell_data(mesh: SimplexMesh) -> dict[str, npt.NDArray[np.generic]]:
    """Return the cell data of the written piece."""
    tagged = mesh.cell_tags is not None or mesh.facet_tags is not None
    tags = {"cell_tags": np.empty(0, np.int32)} if tagged else {}
    return {**mesh.cell_data, **tags}


def _array(parent: ElementTree.Element, name: str, dtype: np.dtype[Any], width: int) -> None:
    kind = _VTK_TYPES.get(dtype.str[1:], "Float64")
    ElementTree.SubElement(
        parent, "PDataArray", type=kind, Name=name, NumberOfComponents=str(width)
    )
