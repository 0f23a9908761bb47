"""What the caller learns about a limited size field, and what the next call starts from."""

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
    """A problem and its solution; nothing in it is written into."""

    background: SimplexMesh | CartesianGrid | Octree
    domain: SimplexMesh | CartesianGrid
    """What the schemes ran on."""
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
    """What a careful user asks of a limited size field, and where the next call may start.

    Slopes are told as multiples of the gradient limit, so that 1 means "as steep as
    allowed", also where g varies; with g(h) they are those of the transformed size.
    Numbers that take a look at all nodes or cells are worked out when they are asked for.

    Given to `limit_gradient` as ``initial``, it saves most of the work on a problem that
    differs at few nodes.  For that it keeps the arrays of the solution.
    """

    method: str
    """The scheme that was used."""
    iterations: int
    """Nodes accepted while marching, steps of an iteration, or sources of the exact method."""
    converged: bool
    """Whether the scheme came to its end: iterations met their tolerance within ``max_iter``."""
    record: Record
    """What a call with this as ``initial`` starts from; of no use otherwise."""

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
        """Number of nodes that are still inf: no bound lies in their component.

        Inactive nodes of a grid do not count.
        """
        active = getattr(self.record.domain, "active", None)
        n_inactive = 0 if active is None else int(np.count_nonzero(~active))
        return int(np.count_nonzero(np.isinf(self.record.solution.h))) - n_inactive

    @cached_property
    def residual(self) -> float:
        """What the scheme's own equation is missed by.

        Relative to the largest finite size (marching) or to g (iterations); 0 of the exact method.
        """
        return self.record.solution.residual

    @cached_property
    def _slopes(self) -> tuple[float, dict[float, float]]:
        domain, u, slope = self.record.domain, self.record.solution.h, self.record.problem.slope
        if isinstance(domain, CartesianGrid):
            steepest, ratio = on_grids.slopes(domain, u, slope)
        else:
            steepest, ratio = on_simplices.slopes(domain, u, slope)
        # Values that occur, not means of two: a cell where g = 0 counts as inf.
        levels = np.zeros(len(QUANTILES))
        if ratio.size:
            levels = np.quantile(ratio, QUANTILES, method="higher")
        return steepest, dict(zip(QUANTILES, map(float, levels), strict=True))

    @property
    def largest_edge_slope(self) -> float:
        """Largest ``(h_i - h_j) / (g |x_i - x_j|)`` over all edges.

        1 to rounding, or less, is what the schemes promise.
        """
        return self._slopes[0]

    @property
    def cell_gradient_quantiles(self) -> dict[float, float]:
        """Quantiles (0.5, 0.9, 0.99, 1) of ``|grad h| / g`` of the interpolant.

        Over the cells that are not degenerate (on grids: at the centre of each box).  May exceed
        1 around point sources and where fronts meet: exact nodal values do so too.
        """
        return self._slopes[1]

    @cached_property
    def n_proved(self) -> int | None:
        """Number of nodes whose size is proved exact; None for other methods than ``"exact"``.

        All of them in convex domains and in the plane.  In space those of which the source that
        allows the least, however it is hidden, is seen.
        """
        solution = self.record.solution
        return solution.n_proved if isinstance(solution, ExactSolution) else None

    @cached_property
    def largest_gap(self) -> float | None:
        """Largest difference of a size that is not proved and its lower bound, in sizes.

        The lower bound is what all sources allow when nothing hides them.  0 if all sizes are
        proved; None for other methods than ``"exact"``.  With g(h) that of the transformed size.
        """
        solution = self.record.solution
        return solution.largest_gap if isinstance(solution, ExactSolution) else None

    @cached_property
    def sources(self) -> SizeSources | None:
        """Where each size comes from; None for other methods than ``"exact"``.

        None, too, on grids where sizes go through passages without a whole box.
        """
        record = self.record
        if not isinstance(record.solution, ExactSolution) or not record.solution.parts:
            return None
        return SizeSources.of(
            record.background, record.solution, record.problem.h0, record.transform
        )
