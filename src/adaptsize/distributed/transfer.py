"""Transfer of fields between two distributed meshes of the same domain."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_flag, as_near_points, check_type
from adaptsize._progress import silent
from adaptsize.adaptation._fields import as_field, as_fields
from adaptsize.adaptation.overlaps import overlaps_of
from adaptsize.adaptation.transfer import TransferredFields
from adaptsize.background import SimplexMesh
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.ranks import split_rows
from adaptsize.typing import FloatArray, IntArray

# A cell with less than this share of its measure in the old domain counts as outside.
_OUTSIDE = 1e-9


def transfer_fields(
    old: PartitionedMesh,
    new: PartitionedMesh,
    *,
    fields: Mapping[str, npt.ArrayLike] | None = None,
    cell_fields: Mapping[str, npt.ArrayLike] | None = None,
    conservative: bool = True,
) -> TransferredFields:
    """Transfer nodal and cell fields from one distributed mesh to another; collective.

    Parameters
    ----------
    old, new : PartitionedMesh
        On the same communicator, of the same domain.  Their parts need not match.
    fields, cell_fields : mapping of str to array_like, optional
        Fields on ``old``, one row per local node or cell; of the same names on all ranks.
    conservative : bool
        Whether a new cell gets the mean over the old cells that it overlaps, or the value at its
        centroid.  Integers and booleans are never averaged.

    Returns
    -------
    TransferredFields
        ``fields`` and ``cell_fields`` on the nodes and cells of this rank.

    Raises
    ------
    ValueError
        On all ranks, if a field on any rank is wrong.

    Notes
    -----
    The values are those of `adaptsize.transfer_fields` for the whole meshes, to rounding, except
    at slits, where a node between the two sides may get the value of either.  Points and cells go
    to the ranks whose boxes they meet: two requests, each with an answer, for each kind of value.
    """

    def check() -> tuple[dict[str, Any], dict[str, Any], bool]:
        nodal = as_fields("fields", fields, old.n_points)
        by_cell = as_fields("cell_fields", cell_fields, old.n_cells)
        return nodal, by_cell, as_flag("conservative", conservative)

    check_type("old", old, PartitionedMesh)
    check_type("new", new, PartitionedMesh)
    for name, part in (("old", old), ("new", new)):
        if part.cell_dim == 1:
            raise ValueError(f"{name} must consist of triangles or tetrahedra, got {part!r}")
    if (old.dim, old.cell_dim) != (new.dim, new.cell_dim):
        raise ValueError(f"old and new must be meshes of one kind, got {old!r} and {new!r}")
    nodal, by_cell, averaged = old.ranks.agree(check)
    old.ranks.require_equal(
        fields=_kinds(nodal), cell_fields=_kinds(by_cell), conservative=averaged
    )
    boxes = _boxes(old)
    found = {name: _nodal(old, new, boxes, values) for name, values in nodal.items()}
    cells = {name: _cells(old, new, boxes, values, averaged) for name, values in by_cell.items()}
    return TransferredFields(found, cells)


def interpolate(old: PartitionedMesh, values: npt.ArrayLike, points: FloatArray) -> FloatArray:
    """Return nodal values, interpolated linearly, at any points; collective."""
    check_type("old", old, PartitionedMesh)

    def check() -> tuple[npt.NDArray[Any], FloatArray]:
        field = as_field("values", values, old.n_points)
        if field.dtype.kind in "biu":
            field = field.astype(np.float64)
        return field, as_near_points("points", points, old.dim)

    field, where = old.ranks.agree(check)
    columns = _columns(field)
    return _restored(_ask(old, _boxes(old), where, partial(_values_at, old.mesh, columns)), field)


def _kinds(fields: Mapping[str, npt.NDArray[Any]]) -> list[tuple[str, str, tuple[int, ...]]]:
    """Return the names, types and shapes of fields, which decide the messages between ranks."""
    return [(name, array.dtype.kind, array.shape[1:]) for name, array in fields.items()]


def _columns(field: npt.NDArray[Any]) -> FloatArray:
    """Return a field as float64[n, k]; integers below 2^53 are exact."""
    flat = field.reshape(len(field), int(np.prod(field.shape[1:], dtype=np.int64)))
    if field.dtype.kind == "c":
        return np.ascontiguousarray(flat).view(np.float64)
    return flat.astype(np.float64)


def _restored(columns: FloatArray, field: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return columns in the type and the trailing shape of a field."""
    columns = np.ascontiguousarray(columns)
    typed = columns.view(field.dtype) if field.dtype.kind == "c" else columns.astype(field.dtype)
    return typed.reshape((len(columns), *field.shape[1:]))


def _nodal(
    old: PartitionedMesh, new: PartitionedMesh, boxes: FloatArray, field: npt.NDArray[Any]
) -> npt.NDArray[Any]:
    whole = field.dtype.kind in "biu"
    answer = partial(_values_at, old.mesh, _columns(field), of_one_node=whole)
    return _restored(_ask(old, boxes, new.points, answer), field)


def _values_at(
    mesh: SimplexMesh | None, columns: FloatArray, points: FloatArray, *, of_one_node: bool = False
) -> FloatArray:
    """Return the distance of each point and the values there, float64[n, 1 + columns]."""
    assert mesh is not None
    nodes, weights, distance = mesh.locator.weights(points)
    if of_one_node:
        values = columns[nodes[np.arange(len(nodes)), weights.argmax(axis=1)]]
    else:
        values = np.einsum("iv,ivc->ic", weights, columns[nodes])
    return np.column_stack([distance, values])


def _cells(
    old: PartitionedMesh,
    new: PartitionedMesh,
    boxes: FloatArray,
    field: npt.NDArray[Any],
    conservative: bool,
) -> npt.NDArray[Any]:
    columns = _columns(field)
    corners = new.points[new.cells]
    holders = partial(_values_in, old.mesh, columns)
    values = _ask(old, boxes, corners.mean(axis=1), holders)
    if not conservative or field.dtype.kind in "biu":
        return _restored(values, field)
    sums = _overlap_sums(old, boxes, corners, columns)
    measures = np.zeros(0) if new.mesh is None else new.mesh.measures
    inside = sums[:, 0] > _OUTSIDE * measures
    values[inside] = sums[inside, 1:] / sums[inside, :1]
    return _restored(values, field)


def _values_in(mesh: SimplexMesh | None, columns: FloatArray, points: FloatArray) -> FloatArray:
    """Return the distance of each point and the values of the cell that contains it."""
    assert mesh is not None
    cells, _, distance = mesh.locator.nearest(points)
    return np.column_stack([distance, columns[cells]])


def _boxes(part: PartitionedMesh) -> FloatArray:
    """Return the corners of the boxes of all parts, float64[size, 2, dim]; inf without cells."""
    box = np.full((2, part.dim), np.inf)
    if part.mesh is not None:
        used = part.points[np.unique(part.cells)]
        box = np.stack([used.min(axis=0), used.max(axis=0)])
    return np.array(part.ranks.allgather(box))


def _ask(
    old: PartitionedMesh,
    boxes: FloatArray,
    points: FloatArray,
    answer: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """Return what the part nearest to each point answers, without the distance; collective.

    First the part with the nearest box is asked, then all those whose boxes are nearer than the
    distance that it found.
    """
    away = np.linalg.norm(
        np.maximum(0.0, np.maximum(boxes[:, 0] - points[:, None], points[:, None] - boxes[:, 1])),
        axis=2,
    )
    away[np.isnan(away)] = np.inf
    here = away[:, old.ranks.rank] <= away.min(axis=1, initial=np.inf)
    first = np.where(here, old.ranks.rank, away.argmin(axis=1))
    every = np.arange(len(points))
    best = _answers(old, points, every, first, answer)
    nearer = away < best[:, :1]
    nearer[every, first] = False
    which, rank = np.nonzero(nearer)
    more = _answers(old, points, which, rank, answer)
    order = np.lexsort((rank, more[:, 0], which))[::-1]  # the nearest one, of the lowest rank, last
    which, more = which[order], more[order]
    closer = more[:, 0] < best[which, 0]
    best[which[closer]] = more[closer]
    return best[:, 1:]


def _answers(
    old: PartitionedMesh,
    points: FloatArray,
    which: npt.NDArray[np.int64],
    rank: npt.NDArray[Any],
    answer: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """Return the answers of given ranks for given points, one row for each; collective."""
    comm = old.ranks
    order = np.argsort(rank, kind="stable")
    asked = comm.alltoallv(split_rows(points[which], rank, comm.size))
    every = np.concatenate(asked)
    replies = comm.agree(lambda: answer(every) if len(every) else None)
    width = comm.allreduce(1 if replies is None else replies.shape[1], "max")
    rows = np.empty((0, width)) if replies is None else replies
    ends = np.cumsum([len(part) for part in asked])
    found = np.empty((len(which), width))
    found[order] = np.concatenate(comm.alltoallv(np.split(rows, ends[:-1])))
    return found


def _overlap_sums(
    old: PartitionedMesh, boxes: FloatArray, corners: FloatArray, columns: FloatArray
) -> FloatArray:
    """Return the measure of each new cell in the old domain, and the integrals of the columns."""
    low, high = corners.min(axis=1, initial=np.inf), corners.max(axis=1, initial=-np.inf)
    meets = ((low[:, None] <= boxes[:, 1]) & (high[:, None] >= boxes[:, 0])).all(axis=2)
    which, rank = np.nonzero(meets)
    shape = corners.shape[1:]

    def answer(rows: FloatArray) -> FloatArray:
        assert old.mesh is not None
        cells: IntArray = np.arange(len(rows) * shape[0], dtype=np.int32).reshape(-1, shape[0])
        sent = SimplexMesh(rows.reshape(-1, shape[1]), cells)
        overlap = overlaps_of(old.mesh, sent, silent)
        return np.column_stack([np.asarray(overlap.sum(axis=1)).ravel(), overlap @ columns])

    flat = corners.reshape(len(corners), shape[0] * shape[1])
    parts = _answers(old, flat, which, rank, answer)
    sums = np.zeros((len(corners), parts.shape[1]))
    np.add.at(sums, which, parts)  # in order of rank
    return sums
