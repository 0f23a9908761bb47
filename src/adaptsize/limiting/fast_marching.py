"""Label-correcting fast marching on simplices."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from adaptsize._kernels import fast_marching as kernels
from adaptsize._kernels.edge_based import march_edges
from adaptsize.background.marching import (
    KEEP,
    accept_all,
    new_heap,
    patience,
    stars_in,
    stars_of,
    sweep_into_heap,
)
from adaptsize.limiting.policy_iteration import iterate_policies
from adaptsize.limiting.solution import Solution, relative_to_largest
from adaptsize.typing import FloatArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.limiting.gradient_limit import Slope

# Before policy iteration, marching continues until no size decreases by more than this share.
# Policy iteration then needs half as many steps.
_KEEP_ROUGHLY = 1.0 - 1e-3

_TEXT = "limiting the gradient"


def solve_fast_marching(
    mesh: SimplexMesh, h0: FloatArray, slope: Slope, *, report: ProgressCallback
) -> Solution:
    r"""Solve h_k = min(h0_k, min over cells of the Hopf-Lax update) exactly.

    The update of node k from the opposite side F of a cell T is
    :math:`\min_{x \in F} h(x) + g_T |x_k - x|`, with h linear on F.  Nodes are accepted in
    order of size and inserted into the heap again if they are lowered later.  Obtuse and
    sliver cells therefore need no special treatment.  The result is the largest solution of
    the discrete equations.

    Parameters
    ----------
    mesh : SimplexMesh
    h0 : float64[n]
        inf allowed.
    slope : Slope
    report : callable

    Returns
    -------
    Solution
        First order in the edge length a, with a factor log(1/a) at point sources.
        ``iterations`` is the number of accepted nodes: 1.01 per node on jittered grids, 1.1 on
        Delaunay meshes of random points.

    Notes
    -----
    The time is O(n log n).  Memory is ``4 k (k - 1)`` bytes per cell of k nodes (24 for
    triangles, 48 for tetrahedra) and 24 per node.  If nearly all cells are obtuse slivers
    (Delaunay triangles of random points, then stretched 10:1), dependencies between nodes are
    cyclic, and nodes would be accepted hundreds of times.  After 8 acceptances per node,
    `iterate_policies` is used instead, at the cost of some twenty sparse solves.

    References
    ----------
    .. [1] F. Bornemann, C. Rasch, Comput. Vis. Sci. 9 (2006) 57-69.
    .. [2] J. A. Sethian, Proc. Natl. Acad. Sci. 93 (1996) 1591-1595.
    """
    return march_until_converged(mesh, h0, slope, kernels.sweep_cells, kernels.march, report)


def march_until_converged(
    mesh: SimplexMesh,
    h0: FloatArray,
    slope: Slope,
    sweep: Callable[..., None],
    march: Callable[..., int],
    report: ProgressCallback,
) -> Solution:
    """March until convergence: no node is lowered any more."""
    limit = (slope.values, slope.step)
    h, heap = h0.copy(), new_heap(mesh.n_points)
    # Along edges every node is accepted once, in order, and sizes are minima of finitely many sums.
    along_edges = march is march_edges
    keep = 1.0 if along_edges else KEEP
    sweep_into_heap(mesh, sweep, h, limit, keep, heap)
    accepted, unfinished = 0, ""
    if heap[3][0] > 0:
        stars = stars_of(mesh, limit)
        geometry = stars_in(mesh, stars)
        most = np.inf if along_edges else patience(mesh.n_points)
        accepted = accept_all(march, geometry, h, limit, heap, report, _TEXT, most=most, keep=keep)
        if heap[3][0] > 0:
            # Only small changes are missing now.  First give every node a finite size.
            march_edges(*geometry, h, *limit, *heap, KEEP, np.inf, 1 << 62)
            sweep_into_heap(mesh, sweep, h, limit, _KEEP_ROUGHLY, heap)
            accept_all(march, geometry, h, limit, heap, report, _TEXT, keep=_KEEP_ROUGHLY)
            h, unfinished = iterate_policies(mesh, slope, h, report)

    return Solution(h, accepted, partial(residual_of, mesh, slope, h, sweep), unfinished)


def residual_of(
    mesh: SimplexMesh, slope: Slope, h: FloatArray, sweep: Callable[..., None]
) -> float:
    """Return the largest excess of h over the local updates, relative to the largest finite h."""
    return relative_to_largest(largest_excess(mesh, slope, h, sweep), h)


def largest_excess(
    mesh: SimplexMesh, slope: Slope, h: FloatArray, sweep: Callable[..., None]
) -> float:
    """Return the largest excess of h over the local updates."""
    candidate = np.empty(mesh.n_points)
    sweep(mesh.points, (0,) * mesh.dim, mesh.cells, h, slope.values, slope.step, candidate)
    finite = np.isfinite(h)
    return float((h[finite] - candidate[finite]).max(initial=0.0))
