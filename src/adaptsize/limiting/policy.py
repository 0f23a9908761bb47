"""Policy iteration: the discrete equations where marching would go round in circles."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_matrix, identity
from scipy.sparse.linalg import splu

from adaptsize._kernels.march import fill_policy
from adaptsize.errors import ConvergenceWarning
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.limiting.gradient_limit import Slope

_MOST_STEPS = 200
_ROUNDING = 1e-13


def iterate_policies(
    mesh: SimplexMesh, h0: FloatArray, slope: Slope, h: FloatArray, report: ProgressCallback
) -> FloatArray:
    r"""Solve h_k = min(h0_k, min over cells of the Hopf-Lax update) from above.

    Each update is the minimum of linear functions of the sizes it uses.  So fix the
    best one of every node, solve the linear equations :math:`(I - W) h = c` that
    result, and repeat until no node finds a better one (Howard [1]_).  From a start
    above the solution the sizes fall monotonically; the convergence is that of Newton's
    method, however long the circles in which nodes depend on each other.

    Parameters
    ----------
    mesh : SimplexMesh
    h0 : float64[n]
    slope : Slope
    h : float64[n]
        Start: at least the solution everywhere, finite wherever that is.
    report : callable

    Returns
    -------
    float64[n]
        The solution, to 1e-13 relative.

    Warns
    -----
    ConvergenceWarning
        If 200 policies were not enough (5 to 50 were seen).

    References
    ----------
    .. [1] O. Bokanowski, S. Maroso, H. Zidani, "Some convergence results for Howard's
       algorithm", SIAM J. Numer. Anal. 47 (2009) 3001-3026.
    """
    n = mesh.n_points
    value, cost = np.empty(n), np.empty(n)
    source, weight = np.empty((n, 3), np.int32), np.empty((n, 3))
    bounded = np.flatnonzero(np.isfinite(h))
    for _ in range(_MOST_STEPS):
        limit = (slope.values, slope.step)
        axes = (0,) * mesh.dim
        fill_policy(mesh.points, axes, mesh.cells, h, h0, *limit, value, source, weight, cost)
        before = h[bounded]
        h = np.minimum(h, value)
        better = _solve(bounded, source, weight, cost, n)
        h[bounded] = np.minimum(h[bounded], better)
        # Both steps count: a node on which no other depends is lowered by the first alone.
        change = float(np.max((before - h[bounded]) / before, initial=0.0))
        report("policy iteration", None)
        if change <= _ROUNDING:
            return h
    warnings.warn(
        f"policy iteration stopped after {_MOST_STEPS} steps with sizes still falling by "
        f"{change:.1g} relative",
        ConvergenceWarning,
        stacklevel=5,
    )
    return h


def _solve(
    nodes: npt.NDArray[np.int64], source: IntArray, weight: FloatArray, cost: FloatArray, n: int
) -> FloatArray:
    """Return the sizes of ``nodes`` that satisfy h = W h + c."""
    place = np.empty(n, np.int64)
    place[nodes] = np.arange(len(nodes))
    rows, columns = np.nonzero(weight[nodes] > 0.0)
    entries = weight[nodes][rows, columns]
    shape = (len(nodes), len(nodes))
    used = csc_matrix((entries, (rows, place[source[nodes][rows, columns]])), shape=shape)
    matrix = (identity(len(nodes), format="csc") - used).tocsc()
    return np.asarray(splu(matrix).solve(cost[nodes]))
