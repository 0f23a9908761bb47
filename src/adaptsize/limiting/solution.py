"""What every scheme returns, and what the caller learns about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from adaptsize._kernels.march import largest_edge_slope
from adaptsize._kernels.simplex import fill_gradient_norms
from adaptsize.typing import FloatArray

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.limiting.gradient_limit import Slope

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
    """Number of nodes that are still inf: no bound lies in their component."""
    largest_edge_slope: float
    """Largest (h_i - h_j) / (g |x_i - x_j|) over all edges; 1 to rounding, or less,
    is what the schemes promise."""
    cell_gradient_quantiles: dict[float, float]
    """Quantiles (0.5, 0.9, 0.99, 1) of |grad h| / g of the linear interpolant, over the
    cells that are not degenerate.  May exceed 1 around point sources and where
    fronts meet: exact nodal values do so too."""
    iterations: int
    """Nodes accepted while marching, or steps of an iteration."""
    residual: float
    """What the scheme's own equation is missed by, relative to the largest finite size
    (marching) or to g (positive coefficient)."""
    converged: bool
    """Whether the tolerance was met within ``max_iter``."""


def describe_solution(
    mesh: SimplexMesh, method: str, slope: Slope, h0: FloatArray, u: FloatArray, solution: Solution
) -> LimitingInfo:
    """Measure a solution; ``h0`` and ``u`` are bound and result, both transformed or both not."""
    axes = (0,) * mesh.dim
    steepest = largest_edge_slope(mesh.points, axes, mesh.cells, u, slope.values, slope.step)
    norms = np.empty(mesh.n_cells)
    fill_gradient_norms(mesh.points, mesh.cells, u, norms)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(norms > 0.0, norms / slope.values, 0.0)[mesh.measures > 0.0]
    # Values that occur, not means of two: a cell where g = 0 counts as inf.
    levels = np.zeros(len(QUANTILES))
    if ratio.size:
        levels = np.quantile(ratio, QUANTILES, method="higher")
    return LimitingInfo(
        method=method,
        n_changed=int(np.count_nonzero(u < h0)),
        n_free=int(np.count_nonzero(np.isinf(u))),
        largest_edge_slope=float(steepest),
        cell_gradient_quantiles=dict(zip(QUANTILES, map(float, levels), strict=True)),
        iterations=solution.iterations,
        residual=solution.residual,
        converged=solution.converged,
    )
