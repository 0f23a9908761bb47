"""Reading and writing of distributed meshes."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_path, check_type, describe
from adaptsize._formats import gmsh
from adaptsize._formats.guards import about_file
from adaptsize.background.migration import Piece, from_pieces
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.distributed import pvtu
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
        names = ranks.agree(lambda: pvtu.names_of_pieces(file))
        own = ranks.agree(
            lambda: [pvtu.read_piece(name) for name in names[ranks.rank :: ranks.size]]
        )
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
        return pvtu.write_pieces(file, part, given)
    whole = part.gather()
    gathered = {name: part.gather_nodal(values) for name, values in given.items()}

    def save() -> None:
        if whole is not None:
            write(file, whole, fields={name: v for name, v in gathered.items() if v is not None})

    part.ranks.agree(save)
    return [file]
