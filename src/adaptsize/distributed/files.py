"""Files of meshes in parts: PVTU files with one piece per rank, and partitions of Gmsh."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_path, check_type, describe
from adaptsize._formats import gmsh
from adaptsize._formats.guards import about_file, write_whole
from adaptsize.background import SimplexMesh
from adaptsize.background.migration import NODE_NUMBERS, Piece, from_pieces
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.errors import MeshFileError
from adaptsize.io import read, write
from adaptsize.ranks import Communicator, as_communicator


def read_parts(path: str | os.PathLike[str], comm: Any = None) -> PartitionedMesh:
    """Return the mesh in a file, or in several files, distributed over the ranks; collective.

    Parameters
    ----------
    path : path-like
        One of

        * a ``.pvtu`` file, whose pieces are dealt to the ranks in turn.  Nodes are identified by
          the nodal field "GlobalPointIds" or "GlobalNodeIds", otherwise by their coordinates, which
          must then be equal bit for bit.  Ghost cells (``vtkGhostType``) are left out.
        * ``name.msh`` where ``name_1.msh``, ``name_2.msh``, ... exist: one file of Gmsh per
          partition (``Mesh.PartitionSplitMeshFiles``), text of version 4.1.
        * a ``.msh`` file with partitions, text of version 4.1, whose partitions become parts.
        * any other file that `read` reads.  Rank 0 reads and partitions it.
    comm : communicator, optional

    Returns
    -------
    PartitionedMesh

    Raises
    ------
    ValueError
        On all ranks alike.  The message has the number of the first rank that failed.
    """
    ranks, file = as_communicator(comm), as_path("path", path)
    suffix = file.suffix.lower()
    if suffix == ".pvtu":
        names = ranks.agree(lambda: _names_of_pieces(file))
        own = ranks.agree(lambda: [_read_piece(name) for name in names[ranks.rank :: ranks.size]])
        return from_pieces(ranks, [piece for piece in own if piece is not None])
    if suffix == ".msh":
        names = ranks.bcast(gmsh.split_files(file) if ranks.rank == 0 else [])
        if names:
            pieces = ranks.agree(lambda: _pieces_of(names[ranks.rank :: ranks.size]))
            return from_pieces(ranks, pieces)
    return _from_one_file(ranks, file)


def _pieces_of(names: list[Path]) -> list[Piece]:
    found = [_partition_in(name) for name in names]
    return [Piece(partition.mesh, partition.numbers) for partition in found]


def _partition_in(name: Path) -> gmsh.Partition:
    try:
        return gmsh.read_partition(name)
    except MeshFileError as error:
        raise about_file(name, error) from error


def _from_one_file(ranks: Communicator, file: Path) -> PartitionedMesh:
    """Return the mesh that rank 0 reads, in its own partitions or in new ones."""

    def load() -> tuple[Any, Any]:
        if ranks.rank > 0:
            return None, None
        if file.suffix.lower() == ".msh" and file.is_file() and gmsh.is_partitioned(file):
            found = _partition_in(file)
            whole = from_pieces(as_communicator(None), [Piece(found.mesh, found.numbers)]).mesh
            return whole, (found.parts % ranks.size).astype(np.int32)
        return read(file), None

    mesh, parts = ranks.agree(load)
    return PartitionedMesh.from_serial(mesh, parts, ranks)


def write_parts(
    path: str | os.PathLike[str],
    part: PartitionedMesh,
    *,
    fields: Mapping[str, npt.ArrayLike] | None = None,
) -> list[Path]:
    """Write a distributed mesh; collective.

    Parameters
    ----------
    path : path-like
        A ``.pvtu`` file: each rank writes its piece ``name_0000.vtu``, ..., with the field
        "GlobalPointIds".  Any other suffix that `write` knows: rank 0 gathers and writes the mesh.
    part : PartitionedMesh
    fields : mapping of str to array_like, optional
        Nodal fields with one row per local node, besides those of the mesh.

    Returns
    -------
    list of Path
        The files, on all ranks.
    """
    file = as_path("path", path)
    check_type("part", part, PartitionedMesh)
    if fields is not None and not isinstance(fields, Mapping):
        raise ValueError(f"fields must be a mapping of names to arrays, got {describe(fields)}")
    given = {} if fields is None else dict(fields)
    if file.suffix.lower() == ".pvtu":
        return _write_pieces(file, part, given)
    whole = part.gather()
    gathered = {name: part.gather_nodal(values) for name, values in given.items()}

    def save() -> None:
        if whole is not None:
            write(file, whole, fields={name: v for name, v in gathered.items() if v is not None})

    part.ranks.agree(save)
    return [file]


#: Names that programs give to the numbers of nodes in the whole mesh.
_NUMBERS = (NODE_NUMBERS, "GlobalNodeIds", "GlobalPointId", "GlobalNodeId")
_GHOST_TYPE = "vtkGhostType"
_VTK_TYPES = {"f8": "Float64", "f4": "Float32", "i8": "Int64", "i4": "Int32", "u1": "UInt8"}


def _names_of_pieces(path: Path) -> list[Path]:
    """Return the files of the pieces that a PVTU file lists."""
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise MeshFileError(f"{path}: cannot be read as a PVTU file ({error})") from error
    pieces = [piece.get("Source") for piece in root.iter("Piece")]
    if not pieces or None in pieces:
        raise MeshFileError(f"{path}: lists no pieces")
    return [path.parent / str(piece) for piece in pieces]


def _read_piece(path: Path) -> Piece | None:
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
    own = (np.asarray(mesh.cell_data[_GHOST_TYPE]).astype(np.int64) & 1) == 0  # a duplicate
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


def _write_pieces(
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
