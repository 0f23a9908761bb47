"""Meshes of PETSc (DMPlex) as partitioned meshes."""

from typing import Any, NamedTuple

import numpy as np

from adaptsize._checks import describe
from adaptsize.background import SimplexMesh
from adaptsize.background.migration import number_nodes
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.ranks import as_communicator, rows_among
from adaptsize.typing import IntArray


class PlexPart(NamedTuple):
    """A DMPlex as a `PartitionedMesh`, and how their nodes and cells correspond."""

    part: PartitionedMesh
    vertices: IntArray
    """``vertices[i]`` is the point of the DMPlex (a vertex) of local node i."""
    cells: IntArray
    """``cells[c]`` is the point of the DMPlex (a cell) of local cell c."""


def from_dmplex(dm: Any, *, facet_label: str | None = None) -> PlexPart:
    """Return the part of a ``petsc4py.PETSc.DMPlex`` on each rank; collective.

    Parameters
    ----------
    dm : petsc4py.PETSc.DMPlex
        Interpolated, with affine simplices.  Cells that other ranks own (overlap) are left out.
    facet_label : str, optional
        Label whose values on facets become ``facet_tags``, such as "Face Sets".

    Raises
    ------
    ValueError
        If the argument is not a DMPlex of simplices.
    """
    try:
        dim, comm = dm.getDimension(), as_communicator(dm.getComm().tompi4py())
        first_vertex, last_vertex = dm.getDepthStratum(0)
        first_cell, last_cell = dm.getHeightStratum(0)
        cell_numbers = _numbers(dm.getCellNumbering())
        vertex_numbers = _numbers(dm.getVertexNumbering())
        section, local = dm.getCoordinateSection(), dm.getCoordinatesLocal()
    except AttributeError as error:
        raise ValueError(f"dm must be a petsc4py.PETSc.DMPlex, got {describe(dm)}") from error
    own = np.flatnonzero(cell_numbers[: last_cell - first_cell] >= 0)

    def connect() -> IntArray:
        rows = np.empty((len(own), dim + 1), np.int32)
        for row, cell in zip(rows, own + first_cell, strict=True):
            closure = dm.getTransitiveClosure(int(cell))[0]
            found = closure[(closure >= first_vertex) & (closure < last_vertex)]
            if len(found) != dim + 1:
                raise ValueError(f"dm must have simplices, cell {cell} has {len(found)} vertices")
            row[:] = found
        return rows

    rows = comm.agree(connect)
    vertices, cells = np.unique(rows, return_inverse=True)
    keys = vertex_numbers[vertices - first_vertex]
    ids, owner = number_nodes(comm, np.where(keys < 0, -keys - 1, keys))
    piece = None
    if len(own):
        offsets = np.array([section.getOffset(int(v)) for v in vertices])
        coordinates = local.getArray(readonly=True)
        width = dm.getCoordinateDim()
        points = coordinates[offsets[:, None] + np.arange(width)].real
        tags = {} if facet_label is None else _tagged(dm, facet_label, vertices)
        piece = SimplexMesh(points, cells.reshape(rows.shape).astype(np.int32), **tags)
    part = PartitionedMesh(piece, ids, owner, comm)
    return PlexPart(part, vertices.astype(np.int32), (own + first_cell).astype(np.int32))


def _numbers(numbering: Any) -> Any:
    """Return global numbers as int64; those of other ranks are -(number + 1)."""
    return np.asarray(numbering.getIndices(), np.int64)


def _tagged(dm: Any, label: str, vertices: IntArray) -> dict[str, Any]:
    """Return the facets with a value of a label, whose nodes are all on this rank."""
    first, last = dm.getHeightStratum(1)
    low, high = dm.getDepthStratum(0)
    facets, tags = [], []
    for value in dm.getLabelIdIS(label).getIndices().tolist():
        for facet in dm.getStratumIS(label, value).getIndices().tolist():
            if first <= facet < last:
                closure = dm.getTransitiveClosure(facet)[0]
                facets.append(closure[(closure >= low) & (closure < high)])
                tags.append(value)
    if not facets:
        return {}
    rows = np.array(facets)
    at = rows_among(rows, vertices)
    held = (at >= 0).all(axis=1)
    return {"tagged_facets": at[held].astype(np.int32), "facet_tags": np.array(tags)[held]}
