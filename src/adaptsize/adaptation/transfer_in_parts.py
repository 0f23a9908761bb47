"""Transfer of fields between two meshes in parts."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._progress import silent
from adaptsize.adaptation.overlaps import OUTSIDE, overlaps_of
from adaptsize.background import PartitionedMesh, SimplexMesh
from adaptsize.background.requests import ask_nearest, ask_ranks, boxes_of, values_at
from adaptsize.typing import FloatArray, IntArray


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
) -> TransferredFields:
    """Return checked fields on another mesh, as `adaptsize.transfer_fields`; collective."""
    old.ranks.require_equal(
        fields=_kinds(nodal), cell_fields=_kinds(by_cell), conservative=conservative
    )
    boxes = boxes_of(old)
    found = {name: _nodal(old, new, boxes, values) for name, values in nodal.items()}
    cells = {
        name: _cells(old, new, boxes, values, averaged=conservative)
        for name, values in by_cell.items()
    }
    return TransferredFields(found, cells)


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
    answer = partial(values_at, old.mesh, _columns(field), of_one_node=whole)
    return _restored(ask_nearest(old, boxes, new.points, answer)[:, 1:], field)


def _cells(
    old: PartitionedMesh,
    new: PartitionedMesh,
    boxes: FloatArray,
    field: npt.NDArray[Any],
    *,
    averaged: bool,
) -> npt.NDArray[Any]:
    columns = _columns(field)
    corners = new.points[new.cells]
    holders = partial(_values_in, old.mesh, columns)
    values = ask_nearest(old, boxes, corners.mean(axis=1), holders)[:, 1:]
    if not averaged or field.dtype.kind in "biu":
        return _restored(values, field)
    sums = _overlap_sums(old, boxes, corners, columns)
    measures = np.zeros(0) if new.mesh is None else new.mesh.measures
    inside = sums[:, 0] > OUTSIDE * measures
    values[inside] = sums[inside, 1:] / sums[inside, :1]
    return _restored(values, field)


def _values_in(mesh: SimplexMesh | None, columns: FloatArray, points: FloatArray) -> FloatArray:
    """Return the distance of each point and the values of the cell that contains it."""
    assert mesh is not None
    cells, _, distance = mesh.locator.nearest(points)
    return np.column_stack([distance, columns[cells]])


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
    parts = ask_ranks(old, flat, which, rank, answer)
    sums = np.zeros((len(corners), parts.shape[1]))
    np.add.at(sums, which, parts)  # in order of rank
    return sums
