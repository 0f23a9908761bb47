"""`LimitingInfo`: diagnostics of a limited size field, and the data for a warm start."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.limiting import on_grids, on_simplices
from adaptsize.limiting.exact import ExactSolution
from adaptsize.limiting.gradient_limit import SizeTransform
from adaptsize.limiting.problem import Problem
from adaptsize.limiting.solution import Solution
from adaptsize.limiting.sources import SizeSources
from adaptsize.typing import FloatArray

QUANTILES = (0.5, 0.9, 0.99, 1.0)


@dataclass(frozen=True, eq=False)
class Record:
    """A problem and its solution; its arrays are never modified."""

    background: SimplexMesh | CartesianGrid | Octree
    domain: SimplexMesh | CartesianGrid
    """The mesh or grid that the scheme ran on."""
    bound: FloatArray
    """h0 as given, inf at inactive nodes; a copy."""
    h: FloatArray
    """The limited sizes; a copy."""
    transform: SizeTransform | None
    problem: Problem
    """Transformed, without the callback."""
    solution: Solution


@dataclass(frozen=True, eq=False, repr=False)
class LimitingInfo:
    """Diagnostics of a limited size field, and the data for a warm start.

    Slopes are given as multiples of the gradient limit: 1 means "as steep as allowed", also
    where g varies.  With g(h) they are slopes of the transformed size.  Numbers that need a
    pass over all nodes or cells are computed on first access.

    If an info is given to `limit_gradient` as ``initial``, most of the work is saved on a
    problem that differs at few nodes.  For this purpose it keeps the arrays of the solution.
    """

    method: str
    """The scheme that was used."""
    iterations: int
    """Number of accepted nodes (marching), steps (iterations) or sources (exact method)."""
    converged: bool
    """Whether the scheme converged; an iteration has to meet its tolerance within ``max_iter``."""
    record: Record
    """Data for a later call with this info as ``initial``; for internal use."""

    def __repr__(self) -> str:
        """Say which method was used and how many sizes are below their bounds."""
        n = self.record.h.size
        return f"LimitingInfo({self.method}: {self.n_changed} of {n} sizes are below h0)"

    @cached_property
    def n_changed(self) -> int:
        """Number of nodes whose size is now below ``h0``."""
        return int(np.count_nonzero(self.record.solution.h < self.record.problem.h0))

    @cached_property
    def n_free(self) -> int:
        """Number of nodes whose size is inf because there is no bound in their component.

        Inactive nodes of a grid are not counted.
        """
        active = getattr(self.record.domain, "active", None)
        n_inactive = 0 if active is None else int(np.count_nonzero(~active))
        return int(np.count_nonzero(np.isinf(self.record.solution.h))) - n_inactive

    @cached_property
    def residual(self) -> float:
        """Residual of the discrete equations of the scheme.

        Relative to the largest finite size (marching) or to g (iterations); 0 for the exact
        method.
        """
        return self.record.solution.residual

    @cached_property
    def _slopes(self) -> tuple[float, dict[float, float]]:
        domain, u, slope = self.record.domain, self.record.solution.h, self.record.problem.slope
        if isinstance(domain, CartesianGrid):
            steepest, ratio = on_grids.slopes(domain, u, slope)
        else:
            steepest, ratio = on_simplices.slopes(domain, u, slope)
        # Take values that occur, not means of two, since a cell with g = 0 may have ratio inf.
        levels = np.zeros(len(QUANTILES))
        if ratio.size:
            levels = np.quantile(ratio, QUANTILES, method="higher")
        return steepest, dict(zip(QUANTILES, map(float, levels), strict=True))

    @property
    def largest_edge_slope(self) -> float:
        """Largest ``(h_i - h_j) / (g |x_i - x_j|)`` over all edges.

        All schemes guarantee a value of at most 1, to rounding.
        """
        return self._slopes[0]

    @property
    def cell_gradient_quantiles(self) -> dict[float, float]:
        """Quantiles (0.5, 0.9, 0.99, 1) of ``|grad h| / g`` of the interpolant.

        Over all cells that are not degenerate; on grids, at the centre of each box.  They may
        exceed 1 around point sources and where fronts meet, even with exact nodal values.
        """
        return self._slopes[1]

    @cached_property
    def n_proved(self) -> int | None:
        """Number of nodes whose size is proved exact; None for other methods than ``"exact"``.

        In convex domains and in the plane these are all nodes.  In solids these are the nodes
        from which the source of the smallest bound, among visible and hidden ones, is visible.
        """
        solution = self.record.solution
        return solution.n_proved if isinstance(solution, ExactSolution) else None

    @cached_property
    def largest_gap(self) -> float | None:
        """Largest difference between a size that is not proved exact and its lower bound.

        The lower bound is the size that would result if all sources were visible.  The gap has
        the unit of the sizes, with g(h) of the transformed size.  It is 0 if all sizes are
        proved exact, and None for other methods than ``"exact"``.
        """
        solution = self.record.solution
        return solution.largest_gap if isinstance(solution, ExactSolution) else None

    @cached_property
    def sources(self) -> SizeSources | None:
        """Source of each size; None for other methods than ``"exact"``.

        Also None on grids where sizes propagate through passages without a whole box.
        """
        record = self.record
        if not isinstance(record.solution, ExactSolution) or not record.solution.parts:
            return None
        return SizeSources.of(
            record.background, record.solution, record.problem.h0, record.transform
        )
