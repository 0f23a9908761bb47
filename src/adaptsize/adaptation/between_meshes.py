"""What is found once between an old mesh and a new one, and the values on the new one."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from adaptsize._kernels.interpolate import combine
from adaptsize._progress import reporting
from adaptsize._workers import Workers
from adaptsize.adaptation import tuning
from adaptsize.adaptation._fields import as_columns, from_columns
from adaptsize.adaptation.overlaps import Intersections, intersections_of, measures_of_overlaps
from adaptsize.adaptation.projection import Projection, sums_over
from adaptsize.background import AnyMesh, SimplexMesh
from adaptsize.background.partitioned import local_mesh
from adaptsize.typing import FloatArray, IntArray, NodalMethod, ProgressCallback

NewMesh = TypeVar("NewMesh", bound=AnyMesh)


def refuse_surfaces(old: AnyMesh) -> None:
    """Raise a ValueError if the cells do not have the dimension of the space."""
    if old.cell_dim != old.dim:
        raise ValueError(
            "conservative must be False for triangles in space: two triangulations of a "
            f"curved surface do not overlap, got {old!r}"
        )


class BetweenMeshes(Generic[NewMesh]):
    """Places of the new nodes and cells in an old mesh, overlaps, and values that follow.

    Parameters
    ----------
    old : SimplexMesh
    new : SimplexMesh or PartitionedMesh
        Of a mesh in parts, what concerns this rank is found.
    threads : int or None
    progress : callable, bool or None
    """

    def __init__(
        self,
        old: SimplexMesh,
        new: NewMesh,
        threads: int | None,
        progress: ProgressCallback | bool | None,
    ) -> None:
        self.old = old
        self.new = new
        self._threads = threads
        self._progress = progress

    def at_nodes(self, field: npt.NDArray[Any], method: NodalMethod) -> npt.NDArray[Any]:
        """Return a checked nodal field on the new mesh, see `FieldTransfer.nodal`."""
        if method == "interpolate" or field.dtype.kind in "biu":
            return self.interpolated(field)
        return self._projected(field, bounded=method == "bounded")

    def in_cells(self, field: npt.NDArray[Any], *, conservative: bool) -> npt.NDArray[Any]:
        """Return a checked cell field on the new mesh, see `FieldTransfer.cells`."""
        if not conservative or field.dtype.kind in "biu":
            return np.asarray(field[self.holders[0]])
        overlap = self.overlap
        inside = np.where(self.coverage > tuning.OUTSIDE, 1.0, 0.0)
        weights = overlap.data * np.repeat(inside, np.diff(overlap.indptr))
        return _combined(overlap.indptr, overlap.indices, weights, field, field[self.holders[0]])

    def interpolated(self, field: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the values of a nodal field at the new nodes."""
        cells, weights, _ = self.located
        nodes = self.old.cells[cells]
        if field.dtype.kind in "biu":
            return np.asarray(field[nodes[np.arange(len(nodes)), weights.argmax(axis=1)]])
        start = np.arange(len(nodes) + 1, dtype=np.int64) * nodes.shape[1]
        return _combined(start, nodes.ravel(), weights.ravel(), field)

    def _projected(self, field: npt.NDArray[Any], *, bounded: bool) -> npt.NDArray[Any]:
        new = self.new
        columns = np.array(as_columns(field))
        n_bounded = columns.shape[1] if bounded else 0
        found = Projection(new.cells, new.measures, new.shared, new.n_points).field(
            sums_over(self._with_products.products, columns, n_bounded),
            lambda: as_columns(self.interpolated(field)),
            n_bounded,
        )
        return from_columns(found, field)

    @cached_property
    def coverage(self) -> FloatArray:
        """Share of each new cell that lies in the old mesh, float64[n_cells]; 1 to rounding."""
        measures = self.new.measures
        inside = np.asarray(self.overlap.sum(axis=1)).ravel()
        return np.asarray(
            np.divide(inside, measures, out=np.zeros_like(inside), where=measures > 0.0)
        )

    @cached_property
    def overlap(self) -> csr_array:
        """Measures of the overlaps, sparse [n_cells of the new mesh, n_cells of the old one]."""
        if "_with_products" in self.__dict__:
            return self._with_products.measures
        with reporting(self._progress) as report:
            return measures_of_overlaps(self.old, self.new, Workers.of(self._threads, report))

    @cached_property
    def _with_products(self) -> Intersections:
        with reporting(self._progress) as report:
            return intersections_of(self.old, self.new, Workers.of(self._threads, report))

    @cached_property
    def located(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """The old cells of the new nodes, the weights of their corners, and the distances."""
        cells, weights, distances = self.old.locator.nearest(self.new.points)
        mesh = local_mesh(self.new)
        if mesh is not None and _has_slits(self.old):
            nodes = mesh.boundary().nodes
            cells, weights = cells.copy(), weights.copy()
            cells[nodes], weights[nodes] = self._on_their_side(nodes)
        return cells, weights, distances

    def _on_their_side(self, nodes: IntArray) -> tuple[IntArray, FloatArray]:
        """Return old cells and weights for new nodes, on their side of a slit.

        Where two old nodes coincide, the location is ambiguous.  A point slightly inside a new
        cell at the node determines the side.
        """
        old, new = self.old, self.new
        one_cell = np.zeros(new.n_points, np.intp)
        one_cell[new.cells] = np.arange(new.n_cells)[:, None]
        points = new.points[nodes]
        inside = new.points[new.cells[one_cell[nodes]]].mean(axis=1)
        cells, weights, _ = old.locator.nearest(points + tuning.ASIDE * (inside - points))
        # Weights of the node itself in that cell, which it may miss by rounding.
        corners = old.points[old.cells[cells]]
        edges = (corners[:, 1:] - corners[:, :1]).swapaxes(1, 2)
        valid = np.abs(np.linalg.det(edges)) > 0.0
        found = np.linalg.solve(edges[valid], (points - corners[:, 0])[valid][..., None])[..., 0]
        found = np.column_stack([1.0 - found.sum(axis=1), found])
        near = np.abs(found - weights[valid]).max(axis=1) <= tuning.SAME_CELL
        found = np.clip(found, 0.0, 1.0)
        kept = np.flatnonzero(valid)[near]
        weights[kept] = found[near] / found[near].sum(axis=1, keepdims=True)
        return cells, weights

    @cached_property
    def holders(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """The old cells that contain the centroids of the new ones, or are nearest to them."""
        return self.old.locator.nearest(self.new.points[self.new.cells].mean(axis=1))


def _has_slits(mesh: SimplexMesh) -> bool:
    """Return whether nodes of the boundary coincide: the two faces of a crack."""
    if mesh.cell_dim != mesh.dim:
        return False
    points = mesh.boundary().mesh.points
    return len(np.unique(points, axis=0)) < len(points)


def _combined(
    start: npt.NDArray[Any],
    found: npt.NDArray[Any],
    weights: FloatArray,
    field: npt.NDArray[Any],
    otherwise: npt.NDArray[Any] | None = None,
) -> npt.NDArray[Any]:
    """Return weighted means of rows of a field; ``otherwise`` where all weights are zero."""
    columns = np.array(as_columns(field))
    result = np.zeros((len(start) - 1, columns.shape[1]))
    if otherwise is not None:
        result[:] = as_columns(otherwise)
    combine(
        np.array(start, np.int64), np.array(found, np.int32), np.array(weights), columns, result
    )
    return from_columns(result, field)
