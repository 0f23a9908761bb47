"""Transfer of fields between two meshes in parts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize.adaptation._fields import Arrays, as_columns, from_columns
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
    nodal: Arrays,
    by_cell: Arrays,
    *,
    conservative: bool,
    method: Mapping[str, NodalMethod],
) -> TransferredFields:
    """Return checked fields on another mesh, as `adaptsize.transfer_fields`; collective."""
    kinds = [
        [(name, array.dtype.kind, array.shape[1:]) for name, array in fields.items()]
        for fields in (nodal, by_cell)
    ]
    old.ranks.require_equal(
        fields=kinds[0], cell_fields=kinds[1], conservative=conservative, method=dict(method)
    )
    boxes = boxes_of(old)
    ways: dict[str, Arrays] = {"bounded": {}, "project": {}, "interpolate": {}, "of one node": {}}
    for name, values in nodal.items():
        ways["of one node" if values.dtype.kind in "biu" else method[name]][name] = values
    averaged = {
        name: v for name, v in by_cell.items() if conservative and v.dtype.kind not in "biu"
    }
    projected = ways["bounded"] | ways["project"]

    def nearest(fields: Arrays, points: FloatArray, answer: Callable[..., FloatArray]) -> Arrays:
        if not fields:
            return {}
        ask = partial(answer, old.mesh, _stacked(fields))
        return _split(ask_nearest(old, boxes, points, ask)[:, 1:], fields)

    made = nearest(ways["interpolate"], new.points, values_at)
    made |= nearest(ways["of one node"], new.points, partial(values_at, of_one_node=True))
    cells = nearest(by_cell, new.points[new.cells].mean(axis=1), _values_in)
    if projected or averaged:
        n_bounded = _stacked(ways["bounded"]).shape[1]
        columns = _stacked(projected, old.n_points), _stacked(averaged, old.n_cells)
        at_nodes, in_cells = _sums(old, new, *columns, n_bounded)
    if projected:
        projection = Projection(new.cells, new.measures, new.shared, new.n_points)

        def interpolated() -> FloatArray:
            return _stacked(nearest(projected, new.points, values_at))

        made |= _split(projection.field(at_nodes, interpolated, n_bounded), projected)
    if averaged:
        values = _stacked({name: cells[name] for name in averaged})
        inside = in_cells[:, 0] > OUTSIDE * new.measures
        values[inside] = in_cells[inside, 1:] / in_cells[inside, :1]
        cells |= _split(values, averaged)
    return TransferredFields({name: made[name] for name in nodal}, cells)


def _stacked(fields: Arrays, n: int = 0) -> FloatArray:
    """Return the columns of all fields, none in n rows if there are no fields."""
    return np.hstack([as_columns(values) for values in fields.values()] or [np.empty((n, 0))])


def _split(columns: FloatArray, fields: Arrays) -> Arrays:
    """Return columns as fields of the types and shapes of others."""
    ends = np.cumsum([as_columns(values[:0]).shape[1] for values in fields.values()])
    parts = np.split(columns, ends[:-1], axis=1)
    return {
        name: from_columns(part, values)
        for part, (name, values) in zip(parts, fields.items(), strict=True)
    }


def _sums(
    old: PartitionedMesh,
    new: PartitionedMesh,
    nodal: FloatArray,
    by_cell: FloatArray,
    n_bounded: int,
) -> tuple[FloatArray, FloatArray]:
    """Return what `sums_over` gives at the nodes and in the cells of this rank; collective.

    Nothing is summed at nodes if there are no nodal columns.
    """
    k, n_in_cell, merged = new.cells.shape[1], 1 + by_cell.shape[1], []
    n_at_node = nodal.shape[1] and 1 + nodal.shape[1] + 2 * n_bounded

    def answer(rows: FloatArray) -> FloatArray:
        assert old.mesh is not None
        numbers: IntArray = np.arange(len(rows) * k, dtype=np.int32).reshape(-1, k)
        sent = SimplexMesh(rows.reshape(-1, new.dim), numbers)
        found = intersections_of(old.mesh, sent, _WORKERS, products=n_at_node > 0)
        parts = [sums_over(found.measures, by_cell)]
        if found.products is not None:
            parts.append(sums_over(found.products, nodal, n_bounded).reshape(sent.n_cells, -1))
        return np.hstack(parts)

    which, rows = _ask_cells(old, new, answer, n_in_cell + k * n_at_node)
    in_cells = np.zeros((new.n_cells, n_in_cell))
    np.add.at(in_cells, which, rows[:, :n_in_cell])
    # One row for each node of each cell that was sent.
    nodes = new.cells[which].ravel()
    by_node = rows[:, n_in_cell:].reshape(len(nodes), n_at_node)
    merges = (np.add, 0.0), (np.minimum, np.inf), (np.maximum, -np.inf)
    ends = n_at_node - 2 * n_bounded, n_at_node - n_bounded
    for (merge, neutral), part in zip(merges, np.split(by_node, ends, axis=1), strict=True):
        sums = np.full((new.n_points, part.shape[1]), neutral)
        merge.at(sums, nodes, part)
        merged.append(new.shared.merge(sums, merge) if part.shape[1] else sums)
    return np.hstack(merged), in_cells


def _values_in(mesh: SimplexMesh | None, columns: FloatArray, points: FloatArray) -> FloatArray:
    """Return the distance of each point and the values of the cell that contains it."""
    assert mesh is not None
    cells, _, distance = mesh.locator.nearest(points)
    return np.column_stack([distance, columns[cells]])


def _ask_cells(
    old: PartitionedMesh,
    new: PartitionedMesh,
    answer: Callable[[FloatArray], FloatArray],
    width: int,
) -> tuple[npt.NDArray[np.int64], FloatArray]:
    """Return new cells and the answers about them of the ranks that they overlap; collective.

    Cells that lie in the part of this rank, which nearly all do, are sent to no other.

    Parameters
    ----------
    answer : callable
        Takes the coordinates of the corners of cells, one row each, and returns rows.  The first
        column is the measure that the cell has in common with the part.
    width : int
        Number of columns of an answer.
    """
    corners = new.points[new.cells]
    flat = corners.reshape(len(corners), new.cells.shape[1] * new.dim)
    here = np.arange(0 if old.mesh is None else len(flat))
    own = old.ranks.agree(lambda: answer(flat) if len(here) else np.empty((0, width)))
    inside = np.zeros(len(flat))
    inside[here] = own[:, 0]
    # What is missing up to rounding lies in the part.
    missing = np.flatnonzero(inside < (1.0 - 1e-13) * new.measures)
    low = corners[missing].min(axis=1, initial=np.inf)
    high = corners[missing].max(axis=1, initial=-np.inf)
    which, rank = ranks_that_meet(low, high, boxes_of_pieces(old))
    others = rank != old.ranks.rank
    which, rank = missing[which[others]], rank[others]
    asked = ask_ranks(old, flat, which, rank, answer).reshape(len(which), width)
    return np.concatenate([here, which]), np.concatenate([own, asked])
