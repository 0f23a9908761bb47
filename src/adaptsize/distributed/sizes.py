"""Sizes from error estimates, and predicted numbers of elements, on distributed meshes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_sizes, check_type
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.background.surroundings import surroundings_of
from adaptsize.limiting.in_parts.limit import limit_gradient
from adaptsize.sizes.budget import CellSums, calibration, count_elements
from adaptsize.sizes.combine import minimum
from adaptsize.sizes.error import scaled_by_derivative, scaled_by_error, steepest_derivatives
from adaptsize.sizes.quadratic_fits import second_derivatives_of_fits
from adaptsize.sizes.recovery import as_nodal_field
from adaptsize.typing import FloatArray, GradientLimit, IntArray

T = TypeVar("T")


@dataclass(frozen=True)
class _Cells:
    """What sums over cells need of a part of a mesh; there may be no cells."""

    cells: IntArray
    measures: FloatArray
    n_points: int
    cell_dim: int

    @property
    def n_cells(self) -> int:
        return len(self.cells)


@dataclass(frozen=True)
class PartSums(CellSums):
    """Sums over the cells of all ranks."""

    part: PartitionedMesh

    def at_nodes(self, values: FloatArray) -> FloatArray:
        """Return nodal sums over the cells of all ranks at each node."""
        return self.part.sum(values)

    def total(self, value: float) -> float:
        """Return a sum over the cells of all ranks."""
        return float(self.part.ranks.allreduce(float(value), "sum"))

    def largest(self, value: float) -> float:
        """Return a maximum over the cells of all ranks."""
        return float(self.part.ranks.allreduce(float(value), "max"))

    def agree(self, task: Callable[[], T]) -> T:
        """Return the result of a task, or raise its error on all ranks."""
        return self.part.ranks.agree(task)


def cells_of(part: PartitionedMesh) -> Any:
    """Return what sums over cells need of a part, which may have no cells."""
    measures = np.empty(0) if part.mesh is None else part.mesh.measures
    return _Cells(part.cells, measures, part.n_points, part.cell_dim)


def predicted_elements(
    part: PartitionedMesh, size: npt.ArrayLike, *, backend: str | None = None
) -> float:
    """Return the predicted number of elements of the whole mesh; collective.

    Parameters
    ----------
    part : PartitionedMesh
    size : array_like of float, shape (n_local,)
        Requested edge lengths at the nodes of this rank.
    backend : str, optional
        As for `adaptsize.sizes.predicted_elements`.

    Returns
    -------
    float
        The same on all ranks; that of the serial function, to rounding.

    Examples
    --------
    >>> from adaptsize import SimplexMesh
    >>> triangle = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    >>> round(predicted_elements(PartitionedMesh.from_serial(triangle), [0.1, 0.1, 0.1]))
    115
    """
    check_type("part", part, PartitionedMesh)
    h = part.ranks.agree(lambda: as_sizes("size", size, part.nodal_shape))
    counted = count_elements(cells_of(part), h, PartSums(part))
    return calibration(backend, part.cell_dim) * counted


def size_from_error(
    part: PartitionedMesh,
    indicator: npt.ArrayLike,
    *,
    order: float,
    tolerance: float | None = None,
    target_elements: float | None = None,
    max_refine: float = 4.0,
    max_coarsen: float = 2.0,
    hmin: float | None = None,
    hmax: float | None = None,
    g: GradientLimit | None = None,
    backend: str | None = None,
) -> FloatArray:
    """Return the size that gives all elements of the next mesh the same error; collective.

    The result is that of `adaptsize.size_from_error` on the whole mesh, to the tolerance of the
    search for the scale (1e-4), in practice to rounding.

    Parameters
    ----------
    part : PartitionedMesh
    indicator : array_like of float, shape (n_cells,)
        Error of each cell of this rank.
    order, tolerance, target_elements, max_refine, max_coarsen, hmin, hmax, g, backend
        As for `adaptsize.size_from_error`; the same on all ranks, except for arrays g.

    Returns
    -------
    ndarray of float64, shape (n_local,)

    Raises
    ------
    ValueError
        On all ranks, if the input of any rank is bad.

    Notes
    -----
    About ten trials of the scale, each with one exchange and one reduction, and with those of
    `distributed.limit_gradient` if ``g`` is given.
    """
    check_type("part", part, PartitionedMesh)
    return scaled_by_error(
        cells_of(part),
        indicator,
        _finishing(part, hmin, hmax, g),
        order=order,
        tolerance=tolerance,
        target_elements=target_elements,
        max_refine=max_refine,
        max_coarsen=max_coarsen,
        backend=backend,
        sums=PartSums(part),
    )


def size_from_hessian(
    part: PartitionedMesh,
    values: npt.ArrayLike,
    *,
    tolerance: float | None = None,
    target_elements: float | None = None,
    norm: float = math.inf,
    hmin: float | None = None,
    hmax: float | None = None,
    g: GradientLimit | None = None,
    backend: str | None = None,
) -> FloatArray:
    """Return the size at which linear elements interpolate a field equally well; collective.

    The result is that of `adaptsize.size_from_hessian` on the whole mesh, to rounding and to the
    tolerance of the search for the scale (1e-4), in practice to rounding.

    Parameters
    ----------
    part : PartitionedMesh
    values : array_like of float, shape (n_local,)
        The field at the nodes of this rank, equal at shared nodes.
    tolerance, target_elements, norm, hmin, hmax, g, backend
        As for `adaptsize.size_from_hessian`; the same on all ranks, except for arrays g.

    Returns
    -------
    ndarray of float64, shape (n_local,)

    Raises
    ------
    ValueError
        On all ranks, if the input of any rank is bad.

    Notes
    -----
    Derivatives are recovered from the nodes around each node, on all ranks: four exchanges, and
    two more when a mesh is used for the first time, for two layers of cells.  With
    ``target_elements``, the trials are those of `distributed.size_from_error`.

    Examples
    --------
    The field x^2 has the second derivative 2 everywhere:

    >>> from adaptsize import SimplexMesh
    >>> from scipy.spatial import Delaunay
    >>> x = np.random.default_rng(7).random((50, 2))
    >>> part = PartitionedMesh.from_serial(SimplexMesh(x, Delaunay(x).simplices))
    >>> np.unique(size_from_hessian(part, x[:, 0] ** 2, tolerance=0.01).round(6))
    array([0.1])
    """
    check_type("part", part, PartitionedMesh)

    def check() -> FloatArray:
        if part.mesh is None:
            return as_float_array("values", values, (0,))
        return as_nodal_field("values", values, part.mesh)

    nodal = part.ranks.agree(check)
    around = surroundings_of(part)
    ends = np.array([nodal.min(initial=np.inf), -nodal.max(initial=-np.inf)])
    low, high = part.points.min(axis=0, initial=np.inf), part.points.max(axis=0, initial=-np.inf)
    ends = part.ranks.allreduce(np.concatenate([ends, low, -high]), "min")
    diagonal = float(np.linalg.norm(-ends[2 + part.dim :] - ends[2 : 2 + part.dim]))
    at_nodes = around.values(part, nodal)
    hessian = np.zeros((part.n_points, part.dim, part.dim))
    if around.mesh is not None:
        hessian = second_derivatives_of_fits(around.mesh, at_nodes)[around.own]
    steepest = steepest_derivatives(hessian, -float(ends[1] + ends[0]), diagonal)
    return scaled_by_derivative(
        cells_of(part),
        steepest,
        _finishing(part, hmin, hmax, g),
        norm=norm,
        tolerance=tolerance,
        target_elements=target_elements,
        backend=backend,
        sums=PartSums(part),
    )


def _finishing(
    part: PartitionedMesh, hmin: float | None, hmax: float | None, g: GradientLimit | None
) -> Callable[[FloatArray], FloatArray]:
    """Return the function that clips sizes to two limits and limits their gradient; collective."""
    part.ranks.agree(lambda: minimum(np.ones(1), hmin=hmin, hmax=hmax))

    def finish(h0: FloatArray) -> FloatArray:
        clipped = minimum(h0, hmin=hmin, hmax=hmax)
        return clipped if g is None else limit_gradient(part, clipped, g)

    return finish
