"""Transfer of fields between two meshes in parts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize.adaptation._fields import as_columns, from_columns
from adaptsize.adaptation.overlaps import OUTSIDE, intersections_of
from adaptsize.adaptation.projection import Projection, sums_over
from adaptsize.background import PartitionedMesh, SimplexMesh
from adaptsize.background.requests import (
    ask_nearest,
    ask_ranks,
    boxes_of,
    boxes_of_pieces,
    ranks_that_meet,
    values_at,
)
from adaptsize.limiting.exact.field import Workers
from adaptsize.typing import FloatArray, IntArray, NodalMethod

#: One thread on each rank.
_WORKERS = Workers(1)


class TransferredFields(NamedTuple):
    """Result of `transfer_fields`."""

    fields: dict[str, npt.NDArray[Any]]
    """Nodal fields on the new mesh."""
    cell_fields: dict[str, npt.NDArray[Any]]
    """Cell fields on the new mesh."""


def transfer_in_parts(
    old: PartitionedMesh,
    new: PartitionedMesh,
    nodal: dict[str, npt.NDArray[Any]],
    by_cell: dict[str, npt.NDArray[Any]],
    *,
    conservative: bool,
    method: Mapping[str, NodalMethod],
) -> TransferredFields:
    """Return checked fields on another mesh, as `adaptsize.transfer_fields`; collective."""
    old.ranks.require_equal(
        fields=_kinds(nodal), cell_fields=_kinds(by_cell), conservative=conservative,
        method=dict(method),
    )  # fmt: skip
    boxes = boxes_of(old)
    found = {
        name: _nodal(old, new, boxes, values, method=method[name]) for name, values in nodal.items()
    }
    cells = {
        name: _cells(old, new, boxes, values, averaged=conservative)
        for name, values in by_cell.items()
    }
    return TransferredFields(found, cells)


def _kinds(fields: Mapping[str, npt.NDArray[Any]]) -> list[tuple[str, str, tuple[int, ...]]]:
    """Return the names, types and shapes of fields, which decide the messages between ranks."""
    return [(name, array.dtype.kind, array.shape[1:]) for name, array in fields.items()]


def _nodal(
    old: PartitionedMesh,
    new: PartitionedMesh,
    boxes: FloatArray,
    field: npt.NDArray[Any],
    *,
    method: NodalMethod,
) -> npt.NDArray[Any]:
    whole = field.dtype.kind in "biu"
    columns = as_columns(field)

    def interpolated() -> FloatArray:
        answer = partial(values_at, old.mesh, columns, of_one_node=whole)
        return ask_nearest(old, boxes, new.points, answer)[:, 1:]

    if whole or method == "interpolate":
        return from_columns(interpolated(), field)
    bounded = method == "bounded"
    k, n_corners = columns.shape[1], new.cells.shape[1]
    measures = np.zeros(0) if new.mesh is None else new.mesh.measures
    projection = Projection(new.cells, measures, new.shared, new.n_points)

    def integrals(sent: SimplexMesh) -> FloatArray:
        assert old.mesh is not None
        products = intersections_of(old.mesh, sent, _WORKERS, products=True).products
        assert products is not None
        return sums_over(products, columns, ranges=bounded).reshape(sent.n_cells, -1)

    which, parts = _ask_cells(
        old, new.points[new.cells], measures, integrals, 1 + (3 if bounded else 1) * k
    )
    # One row for each node of each cell that was sent.
    nodes, rows = new.cells[which].ravel(), parts.reshape(-1, parts.shape[1] // n_corners)
    sums = np.zeros((new.n_points, 1 + k))
    np.add.at(sums, nodes, rows[:, : 1 + k])
    merged = [new.shared.merge(sums, np.add)]
    for place, (merge, neutral) in enumerate(((np.minimum, np.inf), (np.maximum, -np.inf))):
        if bounded:
            ends = np.full((new.n_points, k), neutral)
            first = 1 + (1 + place) * k
            merge.at(ends, nodes, rows[:, first : first + k])
            merged.append(new.shared.merge(ends, merge))
    return from_columns(projection.field(np.hstack(merged), interpolated, bounded=bounded), field)


def _cells(
    old: PartitionedMesh,
    new: PartitionedMesh,
    boxes: FloatArray,
    field: npt.NDArray[Any],
    *,
    averaged: bool,
) -> npt.NDArray[Any]:
    columns = as_columns(field)
    corners = new.points[new.cells]
    holders = partial(_values_in, old.mesh, columns)
    values = ask_nearest(old, boxes, corners.mean(axis=1), holders)[:, 1:]
    if not averaged or field.dtype.kind in "biu":
        return from_columns(values, field)

    def integrals(sent: SimplexMesh) -> FloatArray:
        assert old.mesh is not None
        overlap = intersections_of(old.mesh, sent, _WORKERS).measures
        return np.column_stack([np.asarray(overlap.sum(axis=1)).ravel(), overlap @ columns])

    measures = np.zeros(0) if new.mesh is None else new.mesh.measures
    width = 1 + columns.shape[1]
    which, parts = _ask_cells(old, corners, measures, integrals, width)
    sums = np.zeros((len(corners), width))
    np.add.at(sums, which, parts)
    inside = sums[:, 0] > OUTSIDE * measures
    values[inside] = sums[inside, 1:] / sums[inside, :1]
    return from_columns(values, field)


def _values_in(mesh: SimplexMesh | None, columns: FloatArray, points: FloatArray) -> FloatArray:
    """Return the distance of each point and the values of the cell that contains it."""
    assert mesh is not None
    cells, _, distance = mesh.locator.nearest(points)
    return np.column_stack([distance, columns[cells]])


def _ask_cells(
    old: PartitionedMesh,
    corners: FloatArray,
    measures: FloatArray,
    answer: Callable[[SimplexMesh], FloatArray],
    width: int,
) -> tuple[npt.NDArray[np.int64], FloatArray]:
    """Return new cells and the answers about them of the ranks that they overlap; collective.

    Cells that lie in the part of this rank, which nearly all do, are sent to no other.

    Parameters
    ----------
    corners : float64[n, k, dim]
    measures : float64[n]
    answer : callable
        Returns a row for each cell, in runs of ``width`` columns.  The first columns of these add
        up to the measure that the cell has in common with the part.
    width : int
    """
    flat = corners.reshape(len(corners), corners.shape[1] * corners.shape[2])

    def of_rows(rows: FloatArray) -> FloatArray:
        n, k, dim = len(rows), *corners.shape[1:]
        cells: IntArray = np.arange(n * k, dtype=np.int32).reshape(n, k)
        return answer(SimplexMesh(rows.reshape(-1, dim), cells))

    has_own = old.mesh is not None and len(flat) > 0
    own = old.ranks.agree(lambda: of_rows(flat) if has_own else None)
    missing = np.arange(len(flat))
    if own is not None:
        # What is missing up to rounding lies in the part.
        missing = np.flatnonzero(own[:, ::width].sum(axis=1) < (1.0 - 1e-13) * measures)
    low = corners[missing].min(axis=1, initial=np.inf)
    high = corners[missing].max(axis=1, initial=-np.inf)
    which, rank = ranks_that_meet(low, high, boxes_of_pieces(old))
    others = rank != old.ranks.rank
    which, rank = missing[which[others]], rank[others]
    asked = ask_ranks(old, flat, which, rank, of_rows)
    if own is None:
        return which, asked
    if len(which) == 0:  # then the width of the answers may be unknown
        return np.arange(len(flat)), own
    return np.concatenate([np.arange(len(flat)), which]), np.concatenate([own, asked])
