"""Files of meshes in parts: read by all ranks, and written by all to one VTKHDF file."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy.typing as npt

from adaptsize._checks import as_path, check_type, describe
from adaptsize._formats import assembly, vtk
from adaptsize._formats.blocks import NODE_NUMBERS, check_raw, numbers_of_nodes
from adaptsize._formats.formats import FORMATS, check_named
from adaptsize._formats.guards import about_file, check_readable, temporary_for
from adaptsize._formats.limited import read_limited
from adaptsize._formats.writers import content_of
from adaptsize.background.migration import Piece, from_pieces
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.io import read, write
from adaptsize.ranks import Communicator, as_communicator


def read_parts(path: str | os.PathLike[str], comm: object = None) -> PartitionedMesh:
    """Return the mesh in a file, distributed over the ranks; collective.

    Parameters
    ----------
    path : path-like
        A ``.pvtu`` or ``.vtkhdf`` file, whose pieces are dealt to the ranks in turn.  Nodes are
        identified by the nodal field "GlobalPointIds" or "GlobalNodeIds", otherwise by their
        coordinates, which must then be equal bit for bit.  Ghost cells (``vtkGhostType``) are left
        out.  Any other file that `read` reads, and a file of one piece: rank 0 reads and
        partitions it.
    comm : communicator, optional

    Returns
    -------
    PartitionedMesh

    Raises
    ------
    ValueError
        On every rank.  The message has the number of the first rank that failed.
    """
    ranks, file = as_communicator(comm), as_path("path", path)
    if file.suffix.lower() in (".pvtu", ".vtkhdf"):
        pieces = ranks.agree(lambda: _pieces_in(file, ranks))
        if ranks.size == 1 or ranks.allreduce(len(pieces), "sum") > 1:
            return from_pieces(ranks, pieces)
    mesh = ranks.agree(lambda: read(file) if ranks.rank == 0 else None)
    return PartitionedMesh.from_serial(mesh, None, ranks)


def _pieces_in(file: Path, ranks: Communicator) -> list[Piece]:
    """Return the pieces of this rank."""
    try:
        check_readable(file)
        check_named(file, ranks.rank, ranks.size)
        pieces = []
        for raw in read_limited("foreign.read_pieces", file, ranks.rank, ranks.size):
            check_raw(raw)
            mesh = assembly.build(raw, kind=None, flatten=False, notes=[])
            pieces.append(Piece(mesh, numbers_of_nodes(mesh.point_data)))
    except (ValueError, MemoryError) as error:
        raise about_file(file, error) from error
    return pieces


def write_parts(
    path: str | os.PathLike[str],
    part: PartitionedMesh,
    *,
    fields: Mapping[str, npt.ArrayLike] | None = None,
) -> Path:
    """Write a distributed mesh to one file; collective.

    Parameters
    ----------
    path : path-like
        A ``.vtkhdf`` file: the ranks write their parts one after another, with the nodal field
        "GlobalPointIds", and no rank holds the whole mesh.  Any other suffix that `write` knows:
        rank 0 gathers and writes the mesh.
    part : PartitionedMesh
    fields : mapping of str to array_like, optional
        Nodal fields with one row per local node, besides those of the mesh.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ValueError
        On every rank, as for `write`.  An existing file is then unchanged.
    """
    file = as_path("path", path)
    check_type("part", part, PartitionedMesh)
    if fields is not None and not isinstance(fields, Mapping):
        raise ValueError(f"fields must be a mapping of names to arrays, got {describe(fields)}")
    given = {} if fields is None else dict(fields)
    if file.suffix.lower() == ".vtkhdf":
        _write_in_turn(file, part, given)
        return file
    whole = part.gather()
    gathered = {name: part.gather_nodal(values) for name, values in given.items()}

    def save() -> None:
        if whole is not None:
            write(file, whole, fields={name: v for name, v in gathered.items() if v is not None})

    part.ranks.agree(save)
    return file


def _write_in_turn(path: Path, part: PartitionedMesh, fields: Mapping[str, npt.ArrayLike]) -> None:
    """Create the file on rank 0, then write the rows of each rank in its turn; collective."""
    import h5py

    ranks = part.ranks

    def in_turn(rank: int, task: Any) -> Any:
        return ranks.agree(lambda: task() if ranks.rank == rank else None)

    rows = ranks.agree(lambda: _rows_of(path, part, fields))
    every = ranks.allgather({name: (len(v), v.shape[1:], v.dtype.str) for name, v in rows.items()})
    layout = {name: kind for held in every for name, (_, *kind) in held.items()}
    # A rank without tagged facets may lack the field of tags.
    counts = [
        {name: held.get(name, held.get("Types" if "Cell" in name else "Points", [0]))[0]
         for name in layout} for held in every
    ]  # fmt: skip
    temporary = ranks.bcast(in_turn(0, lambda: temporary_for(path)))

    def create() -> None:
        with vtk.create_hdf(temporary) as file:
            root = file["VTKHDF"]
            for name, (shape, dtype) in layout.items():
                root.create_dataset(name, (sum(n[name] for n in counts), *shape), dtype)

    def write_own() -> None:
        if not rows:
            return
        with h5py.File(temporary, "r+") as file:
            for name in layout:
                start = sum(n[name] for n in counts[: ranks.rank])
                stop = start + counts[ranks.rank][name]
                if name in rows:
                    file["VTKHDF"][name][start:stop] = rows[name]
            vtk.add_names(file, {} if part.mesh is None else part.mesh.tag_names)

    try:
        in_turn(0, create)
        for rank in range(ranks.size):
            in_turn(rank, write_own)
        in_turn(0, lambda: os.replace(temporary, path))
    finally:
        if ranks.rank == 0:
            temporary.unlink(missing_ok=True)


def _rows_of(
    path: Path, part: PartitionedMesh, fields: Mapping[str, npt.ArrayLike]
) -> dict[str, npt.NDArray[Any]]:
    """Return the rows of this rank for each array of the file; none without cells."""
    if part.mesh is None:
        return {}
    mesh = part.mesh.with_data(point_data={**fields, NODE_NUMBERS[0]: part.global_ids})
    names = [*mesh.point_data, *mesh.cell_data]
    FORMATS["vtkhdf"].check_names(path, names, mesh.tag_names.values())
    return vtk.rows_of(content_of(mesh, "cell_tags", pad=True))
