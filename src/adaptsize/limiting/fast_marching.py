"""Label-correcting fast marching, and its relative along edges only."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from adaptsize._kernels import march as kernels
from adaptsize.limiting.solution import Solution
from adaptsize.typing import FloatArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.limiting.gradient_limit import Slope

# Nodes accepted between two looks at the clock and at Ctrl-C: about 0.1 s.
_CHUNK = 50_000


def solve_fast_marching(
    mesh: SimplexMesh, h0: FloatArray, slope: Slope, *, residual: bool, report: ProgressCallback
) -> Solution:
    r"""Solve h_k = min(h0_k, min over cells of the Hopf-Lax update) exactly.

    The update of node k from the opposite side F of a cell T is
    :math:`\min_{x \in F} h(x) + g_T |x_k - x|`, h linear on F.  Nodes are accepted in
    order of size and come back when they are lowered again, so that obtuse and
    sliver cells need no special case; the result is the largest solution of the
    discrete equations.

    Parameters
    ----------
    mesh : SimplexMesh
    h0 : float64[n]
        inf allowed.
    slope : Slope
    residual : bool
        Whether to spend one more sweep on the residual (0 is told otherwise).
    report : callable

    Returns
    -------
    Solution
        First order in the edge length a, with a factor log(1/a) at point sources.
        ``iterations`` is the number of accepted nodes, 1.00 to 1.02 per node.

    Notes
    -----
    O(n log n) time; memory ``4 k (k - 1)`` bytes per cell of k nodes (24 for triangles,
    48 for tetrahedra) and 24 per node.

    References
    ----------
    .. [1] F. Bornemann, C. Rasch, Comput. Vis. Sci. 9 (2006) 57-69.
    .. [2] J. A. Sethian, Proc. Natl. Acad. Sci. 93 (1996) 1591-1595.
    """
    return _march(mesh, h0, slope, kernels.sweep_cells, kernels.march, residual, report)


def solve_edge_based(
    mesh: SimplexMesh, h0: FloatArray, slope: Slope, *, residual: bool, report: ProgressCallback
) -> Solution:
    """Solve h_k = min(h0_k, min over edges of h_j + g |x_k - x_j|) exactly.

    These are the shortest paths in the graph of the mesh, which most mesh generators
    use as their gradation.  They do **not** converge to the limited size function
    when the mesh is refined: fronts follow the edges, not the straight lines between
    them.  Offered for comparison only.

    Parameters and result as for `solve_fast_marching`; the cheapest possible scheme.
    """
    return _march(mesh, h0, slope, kernels.sweep_edges, kernels.march_edges, residual, report)


def _march(
    mesh: SimplexMesh,
    h0: FloatArray,
    slope: Slope,
    sweep: Callable[..., None],
    march: Callable[..., int],
    with_residual: bool,
    report: ProgressCallback,
) -> Solution:
    n = mesh.n_points
    axes, others = (0,) * mesh.dim, (0,) * mesh.cell_dim
    geometry = (mesh.points, axes, mesh.cells)
    h = h0.copy()
    candidate = np.empty(n)
    sweep(*geometry, h, slope.values, slope.step, candidate)
    heap = (np.empty(n), np.empty(n, np.int32), np.full(n, -1, np.int32), np.zeros(1, np.int64))
    kernels.queue_lowered(h, candidate, *heap)

    accepted = 0
    if heap[3][0] > 0:
        star_ptr = np.empty(n + 1, np.int64)
        star = np.empty((mesh.cells.size, mesh.cell_dim), np.int32)
        owner = np.empty(mesh.cells.size if slope.step else 0, np.int32)
        kernels.fill_stars(mesh.cells, star_ptr, star, owner)
        stars = (star_ptr, star, owner)
        while heap[3][0] > 0:
            limit = (slope.values, slope.step)
            accepted += march(mesh.points, axes, others, *stars, h, *limit, *heap, _CHUNK)
            report("limiting the gradient", min(accepted / n, 1.0))

    residual = 0.0
    if with_residual:
        sweep(*geometry, h, slope.values, slope.step, candidate)
        finite = np.isfinite(h)
        excess = np.maximum(h[finite] - candidate[finite], 0.0)
        residual = float(excess.max() / h[finite].max())
    return Solution(h, accepted, residual)
