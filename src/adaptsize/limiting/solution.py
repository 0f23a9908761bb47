"""What every scheme returns, and what the caller learns about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptsize.limiting.sources import SizeSources
from adaptsize.typing import FloatArray

QUANTILES = (0.5, 0.9, 0.99, 1.0)


@dataclass(frozen=True)
class Solution:
    """Result of one scheme."""

    h: FloatArray
    iterations: int
    residual: float
    converged: bool = True


@dataclass(frozen=True)
class LimitingInfo:
    """What a careful user asks of a limited size field.

    Slopes are told as multiples of the gradient limit, so that 1 means "as steep as
    allowed", also where g varies; with g(h) they are those of the transformed size.
    """

    method: str
    """The scheme that was used."""
    n_changed: int
    """Number of nodes whose size is now below ``h0``."""
    n_free: int
    """Number of nodes that are still inf: no bound lies in their component.  Inactive
    nodes of a grid do not count."""
    largest_edge_slope: float
    """Largest (h_i - h_j) / (g |x_i - x_j|) over all edges; 1 to rounding, or less,
    is what the schemes promise."""
    cell_gradient_quantiles: dict[float, float]
    """Quantiles (0.5, 0.9, 0.99, 1) of |grad h| / g of the interpolant, over the cells
    that are not degenerate (on grids: at the centre of each box).  May exceed 1 around
    point sources and where fronts meet: exact nodal values do so too."""
    iterations: int
    """Nodes accepted while marching, or steps of an iteration."""
    residual: float
    """What the scheme's own equation is missed by, relative to the largest finite size
    (marching) or to g (iterations); of source tracking, by how much the bound along edges is."""
    converged: bool
    """Whether the tolerance was met within ``max_iter``."""
    sources: SizeSources | None = None
    """Where each size comes from; only of source tracking."""


def describe_solution(
    method: str,
    h0: FloatArray,
    solution: Solution,
    n_inactive: int,
    steepest: float,
    ratio: FloatArray,
    sources: SizeSources | None,
) -> LimitingInfo:
    """Tell of a solution of bound ``h0``; both transformed or both not.

    ``steepest`` and ``ratio`` are slopes over g: of the steepest edge, and in each cell.
    """
    # Values that occur, not means of two: a cell where g = 0 counts as inf.
    levels = np.zeros(len(QUANTILES))
    if ratio.size:
        levels = np.quantile(ratio, QUANTILES, method="higher")
    return LimitingInfo(
        method=method,
        n_changed=int(np.count_nonzero(solution.h < h0)),
        n_free=int(np.count_nonzero(np.isinf(solution.h))) - n_inactive,
        largest_edge_slope=steepest,
        cell_gradient_quantiles=dict(zip(QUANTILES, map(float, levels), strict=True)),
        iterations=solution.iterations,
        residual=solution.residual,
        converged=solution.converged,
        sources=sources,
    )
