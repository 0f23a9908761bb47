"""Label-correcting fast marching on simplices."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels import fast_marching as kernels
from adaptsize._kernels.edge_based import march_edges
from adaptsize.limiting.policy_iteration import iterate_policies
from adaptsize.limiting.solution import Solution, relative_to_largest
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.limiting.gradient_limit import Slope

# Nodes accepted between two progress reports, at which Ctrl-C takes effect: about 0.1 s.
CHUNK = 50_000

# A candidate must be lower by more than rounding to count.
KEEP = 1.0 - 1e-14

# Before policy iteration, marching continues until no size decreases by more than this share.
# Policy iteration then needs half as many steps.
_KEEP_ROUGHLY = 1.0 - 1e-3

# Acceptances per node before policy iteration is used.  Meshes of mesh generators need 1.0 to
# 1.2; larger numbers mean that obtuse slivers cause cyclic dependencies between nodes.
_PATIENCE = 8


class Stars(NamedTuple):
    """For each node the other vertices of its cells (see `fill_stars`)."""

    star_ptr: npt.NDArray[np.int64]
    star: IntArray
    owner: IntArray


def solve_fast_marching(
    mesh: SimplexMesh, h0: FloatArray, slope: Slope, *, residual: bool, report: ProgressCallback
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
    residual : bool
        Whether to compute the residual, which takes one more sweep.  If False, 0 is returned.
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
    return march_until_converged(
        mesh, h0, slope, kernels.sweep_cells, kernels.march, residual, report
    )


def march_until_converged(
    mesh: SimplexMesh,
    h0: FloatArray,
    slope: Slope,
    sweep: Callable[..., None],
    march: Callable[..., int],
    with_residual: bool,
    report: ProgressCallback,
) -> Solution:
    """March until convergence: no node is lowered any more."""
    n = mesh.n_points
    axes = (0,) * mesh.dim
    limit = (slope.values, slope.step)
    h = h0.copy()
    candidate = np.empty(n)
    heap = new_heap(n)
    # Along edges every node is accepted once, in order, and sizes are minima of finitely many sums.
    along_edges = march is march_edges
    keep = 1.0 if along_edges else KEEP
    sweep(mesh.points, axes, mesh.cells, h, *limit, candidate)
    kernels.queue_lowered(h, candidate, keep, *heap)

    accepted, unfinished = 0, ""
    stars = None
    if heap[3][0] > 0:
        stars = stars_of(mesh, slope)
        geometry = (mesh.points, axes, (0,) * mesh.cell_dim, *stars)
        most = None if along_edges else patience(n)
        accepted = accept_all(march, geometry, h, slope, heap, most, report, keep)
        if heap[3][0] > 0:
            # Only small changes are missing now.  First give every node a finite size.
            march_edges(*geometry, h, *limit, *heap, KEEP, np.inf, 1 << 62)
            sweep(mesh.points, axes, mesh.cells, h, *limit, candidate)
            kernels.queue_lowered(h, candidate, _KEEP_ROUGHLY, *heap)
            while heap[3][0] > 0:
                march(*geometry, h, *limit, *heap, _KEEP_ROUGHLY, np.inf, CHUNK)
                report("limiting the gradient", 1.0)
            h, unfinished = iterate_policies(mesh, slope, h, report)

    residual = partial(residual_of, mesh, slope, h, sweep) if with_residual else 0.0
    return Solution(h, accepted, residual, unfinished, stars)


def new_heap(n: int) -> tuple[FloatArray, IntArray, IntArray, npt.NDArray[np.int64]]:
    """Return an empty heap of up to n nodes (see heap.py)."""
    return np.empty(n), np.empty(n, np.int32), np.full(n, -1, np.int32), np.zeros(1, np.int64)


def patience(n: int) -> int:
    """Return the largest number of acceptances on n nodes before policy iteration is used."""
    return _PATIENCE * n + CHUNK


def accept_all(
    march: Callable[..., int],
    geometry: tuple[Any, ...],
    h: FloatArray,
    slope: Slope,
    heap: tuple[Any, ...],
    most: int | None,
    report: ProgressCallback,
    keep: float = KEEP,
) -> int:
    """March (In/Out: h, heap) until the heap is empty or ``most`` nodes were accepted.

    ``geometry`` holds the leading arguments of the kernels of fast_marching.py.
    """
    accepted = 0
    while heap[3][0] > 0 and (most is None or accepted < most):
        accepted += march(*geometry, h, slope.values, slope.step, *heap, keep, np.inf, CHUNK)
        report("limiting the gradient", min(accepted / len(h), 1.0))
    return accepted


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


def stars_of(mesh: SimplexMesh, slope: Slope) -> Stars:
    """Return the stars of the nodes, with owners only if g varies."""
    star_ptr = np.empty(mesh.n_points + 1, np.int64)
    star = np.empty((mesh.cells.size, mesh.cell_dim), np.int32)
    owner = np.empty(mesh.cells.size if slope.step else 0, np.int32)
    kernels.fill_stars(mesh.cells, star_ptr, star, owner)
    return Stars(star_ptr, star, owner)
