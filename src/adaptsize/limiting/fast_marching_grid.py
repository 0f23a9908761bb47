"""Fast marching on Cartesian grids, of first and second order."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from adaptsize._kernels import fast_marching_grid as kernels
from adaptsize.background.marching import PaddedGrid, march_on_grid
from adaptsize.background.padding import pad, strides_of_padded, unpad
from adaptsize.limiting.solution import Solution, relative_to_largest
from adaptsize.typing import FloatArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import CartesianGrid
    from adaptsize.limiting.gradient_limit import Slope

# Nodes of the second-order pass between two progress reports.
_REFINED_AT_ONCE = 1_000_000

_TEXT = "limiting the gradient"


def solve_grid_marching(
    grid: CartesianGrid,
    h0: FloatArray,
    slope: Slope,
    *,
    order: int,
    report: ProgressCallback,
) -> Solution:
    r"""Solve the upwind equations of a Cartesian grid by marching.

    The size at a node is the root of

    .. math:: \sum_a \max\left(\frac{h - v_a}{\Delta x_a}, 0\right)^2 = g^2,
              \qquad h \le h_0,

    with the smaller neighbour :math:`v_a` along each axis.  This is the steady state of
    equation (17) of [1]_.  Nodes are accepted in order of size, in buckets of half the rise
    of a cell; the order within a bucket is arbitrary.  A node is inserted again if it is
    lowered later.

    At second order, the one-sided difference through two nodes replaces the first-order
    difference where both nodes lie upwind [2]_.  The upwind directions and the order of the
    nodes are taken from the first-order sizes.  One pass, which computes each node once, is
    therefore sufficient.

    Parameters
    ----------
    grid : CartesianGrid
    h0 : float64[shape]
        inf allowed; values at inactive nodes are ignored.
    slope : Slope
        g at the nodes, in the shape of the grid, or one g.
    order : int
        1 or 2.
    report : callable

    Returns
    -------
    Solution
        inf at inactive nodes.  The order is attained where the bounds are smooth.  At point
        sources the error is proportional to the spacing, with a logarithmic factor for order
        1; at order 2 the constant is three to six times smaller.

    Notes
    -----
    The time is O(n).  Memory besides ``h0`` and the result is 20 bytes per node (40 at order
    2), and 8 more if g varies.

    References
    ----------
    .. [1] P.-O. Persson, Engineering with Computers 22 (2006) 95-109.
    .. [2] J. A. Sethian, SIAM Review 41 (1999) 199-235.
    """
    return march_grid_until_converged(grid, h0, slope, order, False, report)


def march_grid_until_converged(
    grid: CartesianGrid,
    h0: FloatArray,
    slope: Slope,
    order: int,
    edges: bool,
    report: ProgressCallback,
) -> Solution:
    """March until no node is lowered any more, with ``edges`` along edges only."""
    bounds = pad(grid, h0)
    u = bounds.copy() if order == 2 else bounds
    weights = tuple(float(w) for w in 1.0 / grid.spacing**2)
    g = pad(grid, slope.values) if slope.step else slope.values
    geometry = (strides_of_padded(grid), weights, g, slope.step)
    accepted = march_on_grid(grid, u, geometry, edges, report, _TEXT)
    residual = partial(residual_of, u, geometry, edges)
    if order == 2:
        u = _refine(grid, u, bounds, geometry, report)
        # A few sizes may be too steep along an edge.
        march_on_grid(grid, u, geometry, True, report, _TEXT)
    return Solution(unpad(grid, u), accepted, residual)


def residual_of(
    u: FloatArray,
    geometry: PaddedGrid,
    edges: bool,
) -> float:
    """Return the largest excess of padded sizes over updates, relative to the largest finite h."""
    candidate = np.empty(u.size)
    kernels.sweep_grid(u, *geometry, edges, candidate)
    finite = np.isfinite(u)
    excess = np.maximum(u[finite] - candidate[finite], 0.0)
    return relative_to_largest(float(excess.max()), u)


def _refine(
    grid: CartesianGrid,
    u1: FloatArray,
    u0: FloatArray,
    geometry: PaddedGrid,
    report: ProgressCallback,
) -> FloatArray:
    """Return the second-order sizes from the first-order ones."""
    strides, weights, g, g_step = geometry
    finite = u1[np.isfinite(u1)]
    order = np.empty(u1.size, np.int32)
    start = np.empty(finite.size + 1, np.int32)
    count = kernels.order_by_size(u1, u0, finite.min(), finite.max(), start, order)
    if count < 0:
        order = np.flatnonzero(u1 < u0).astype(np.int32)
        order = order[np.argsort(u1[order], kind="stable")]
        count = order.size
    spacing = tuple(map(float, grid.spacing))
    u = u0.copy()
    for begin in range(0, count, _REFINED_AT_ONCE):
        part = order[begin : min(begin + _REFINED_AT_ONCE, count)]
        kernels.refine_in_order(part, u1, u0, strides, weights, spacing, g, g_step, u)
        report("second-order pass", (begin + len(part)) / count)
    return u
