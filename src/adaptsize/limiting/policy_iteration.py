"""Policy iteration for the discrete equations, where marching would cycle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.fast_marching import fill_policy
from adaptsize.background import SimplexMesh
from adaptsize.background.marching import KEEP, cells_in
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

_MOST_STEPS = 200
_ROUNDING = 1e-13


class _Policy(NamedTuple):
    """For each node the linear update that it follows (see `fill_policy`)."""

    source: IntArray
    weight: FloatArray
    cost: FloatArray


def iterate_policies(
    mesh: SimplexMesh, slope: Slope, h: FloatArray, report: ProgressCallback
) -> tuple[FloatArray, str]:
    r"""Solve h_k = min(h0_k, min over cells of the Hopf-Lax update) from above.

    Each update is the minimum of linear functions of the sizes it uses.  Fix the best one
    for every node, solve the resulting linear equations :math:`(I - W) h = c`, and repeat
    until no node finds a better one (Howard [1]_).  From a start above the solution the
    sizes decrease monotonically.  The iteration converges like Newton's method, regardless
    of the length of the cycles in which nodes depend on each other.

    Parameters
    ----------
    mesh : SimplexMesh
    slope : Slope
    h : float64[n]
        Start: at most h0, at least the solution, and finite where the solution is.
    report : callable

    Returns
    -------
    h : float64[n]
        The solution, to 1e-13 relative.
    unfinished : str
        Empty if converged.  Otherwise a message that 200 policies were not enough (5 to 50
        were observed), with the last change.

    References
    ----------
    .. [1] O. Bokanowski, S. Maroso, H. Zidani, "Some convergence results for Howard's
       algorithm", SIAM J. Numer. Anal. 47 (2009) 3001-3026.
    """
    n = mesh.n_points
    bounded = np.flatnonzero(np.isfinite(h))
    # The first policy keeps every node at its start, which is a bound like h0.
    policy = _Policy(np.zeros((n, 3), np.int32), np.zeros((n, 3)), h.copy())
    value = np.empty(n)
    offer = _Policy(np.empty((n, 3), np.int32), np.empty((n, 3)), np.empty(n))
    for _ in range(_MOST_STEPS):
        limit = (slope.values, slope.step)
        fill_policy(cells_in(mesh), (h, h), limit, value, offer)
        # A policy is changed only if the size decreases.  Otherwise coincident nodes, or nodes
        # whose distance times g is below rounding, could all refer to each other.
        lower = value < h * KEEP
        if not lower.any():
            return h, ""
        policy.source[lower] = offer.source[lower]
        policy.weight[lower] = offer.weight[lower]
        policy.cost[lower] = offer.cost[lower]
        better = _solve(bounded, policy, n)
        change = float(np.max((h[bounded] - better) / h[bounded], initial=0.0))
        h = np.minimum(h, value)
        h[bounded] = np.minimum(h[bounded], better)
        report("policy iteration", None)
        if change <= _ROUNDING:
            return h, ""
    return h, (
        f"policy iteration stopped after {_MOST_STEPS} steps with sizes still decreasing by "
        f"{change:.1g} relative"
    )


def _solve(nodes: npt.NDArray[np.int64], policy: _Policy, n: int) -> FloatArray:
    """Return the sizes of ``nodes`` that satisfy h = W h + c."""
    from scipy.sparse import csc_matrix, identity
    from scipy.sparse.linalg import splu

    place = np.empty(n, np.int64)
    place[nodes] = np.arange(len(nodes))
    weight = policy.weight[nodes]
    rows, columns = np.nonzero(weight > 0.0)
    entries = weight[rows, columns]
    shape = (len(nodes), len(nodes))
    used = csc_matrix((entries, (rows, place[policy.source[nodes][rows, columns]])), shape=shape)
    matrix = (identity(len(nodes), format="csc") - used).tocsc()
    return np.asarray(splu(matrix).solve(policy.cost[nodes]))
