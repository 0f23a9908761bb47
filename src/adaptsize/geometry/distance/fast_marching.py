"""Distances on grids and meshes from values near where they are zero, by fast marching."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from adaptsize._kernels import fast_marching as mesh_kernels
from adaptsize._kernels import fast_marching_grid as kernels
from adaptsize.background.padding import buckets_for, pad, strides_of_padded
from adaptsize.errors import ConvergenceWarning
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import CartesianGrid, SimplexMesh

# Nodes accepted between two progress reports, at which Ctrl-C takes effect: about 0.1 s.
_CHUNK = 500_000

# Likewise on meshes.
_CHUNK_OF_MESH = 50_000

# Acceptances per node of a mesh after which changes must be larger: among flat cells,
# dependencies between nodes may be cyclic.
_PATIENCE = 8
_KEEP_ROUGHLY = 1.0 - 1e-3

# A candidate must be lower by more than rounding to count.
_KEEP = 1.0 - 1e-14


def march_distance(
    grid: CartesianGrid,
    seeds: FloatArray,
    *,
    where: BoolArray | None = None,
    report: ProgressCallback,
    text: str = "marching distances",
) -> FloatArray:
    r"""Return the largest distances up to the seeds that solve the eikonal equation.

    .. math:: \sum_a \max\left(\frac{d - v_a}{\Delta x_a}, 0\right)^2 = 1, \qquad d \le d_0,

    with the smaller neighbour :math:`v_a` along each axis.  The scheme is of first order [1]_.

    Parameters
    ----------
    grid : CartesianGrid
        ``active`` is ignored; pass it as ``where``.
    seeds : float64[shape]
        Known distances, >= 0; inf elsewhere, no NaN.  A seed is lowered only if another seed
        requires it.
    where : bool[shape], optional
        Nodes that paths may pass through; all by default.
    report : callable
        Called with ``text`` and the fraction completed.
    text : str, optional

    Returns
    -------
    float64[shape]
        inf at nodes outside ``where`` and at those that no seed reaches.

    Notes
    -----
    O(n) time and 36 bytes per node besides seeds and result.

    References
    ----------
    .. [1] J. A. Sethian, SIAM Review 41 (1999) 199-235.
    """
    everywhere = np.ones(grid.shape, np.bool_) if where is None else where
    u = pad(grid, seeds, where=everywhere)
    weights = tuple(float(w) for w in 1.0 / grid.spacing**2)
    geometry = (strides_of_padded(grid), weights, np.ones(1), 0, False)
    candidate = np.empty(u.size)
    kernels.sweep_grid(u, *geometry, candidate)
    first = np.flatnonzero(candidate < u * _KEEP).astype(np.int32)
    u[first] = candidate[first]
    del candidate
    if first.size > 0:
        queue = buckets_for(u, first, float(grid.spacing.min()), float(grid.spacing.max()))
        accepted, newly = 0, _CHUNK
        while newly == _CHUNK:
            newly = kernels.march_grid(u, *geometry, _KEEP, *queue, _CHUNK)
            accepted += newly
            report(text, min(accepted / grid.n_points, 1.0))
    report(text, 1.0)
    inner = (slice(1, -1),) * grid.dim
    distances = u.reshape([n + 2 for n in grid.shape])[inner].copy()
    distances[~everywhere] = np.inf
    return distances


def march_through_mesh(
    mesh: SimplexMesh, seeds: FloatArray, *, report: ProgressCallback, text: str
) -> FloatArray:
    """Return the largest distances up to the seeds that the local updates allow.

    Each node has the minimum of its seed and of the local updates from the opposite sides of its
    cells, on which distances are linear.  The scheme is of first order [1]_.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in the plane or tetrahedra, of any shape.
    seeds : float64[n_points]
        Known distances, >= 0; inf elsewhere, no NaN.
    report : callable
        Called with ``text`` and the fraction completed.
    text : str

    Returns
    -------
    float64[n_points]
        inf where no seed reaches.

    Warns
    -----
    ConvergenceWarning
        If updates among flat cells go on for so long that changes below 0.1 % are ignored.

    References
    ----------
    .. [1] F. Bornemann, C. Rasch, Comput. Vis. Sci. 9 (2006) 57-69.
    """
    n, axes = mesh.n_points, (0,) * mesh.dim
    slope = (np.ones(1), 0)
    u, candidate = seeds.copy(), np.empty(n)
    heap = (np.empty(n), np.empty(n, np.int32), np.full(n, -1, np.int32), np.zeros(1, np.int64))
    mesh_kernels.sweep_cells(mesh.points, axes, mesh.cells, u, *slope, candidate)
    mesh_kernels.queue_lowered(u, candidate, _KEEP, *heap)
    star_ptr, owner = np.empty(n + 1, np.int64), np.empty(0, np.int32)
    star = np.empty((mesh.cells.size, mesh.cell_dim), np.int32)
    mesh_kernels.fill_stars(mesh.cells, star_ptr, star, owner)
    stars = (mesh.points, axes, (0,) * mesh.cell_dim, star_ptr, star, owner)
    accepted, keep = 0, _KEEP
    while heap[3][0] > 0:
        if keep == _KEEP and accepted >= _PATIENCE * n + _CHUNK_OF_MESH:
            keep = _KEEP_ROUGHLY
            warnings.warn(
                f"{text} updated {n} nodes {accepted} times: changes below {1.0 - keep:.1%} are "
                "ignored from here on; the background has very flat cells",
                ConvergenceWarning,
                stacklevel=4,
            )
        accepted += mesh_kernels.march(*stars, u, *slope, *heap, keep, np.inf, _CHUNK_OF_MESH)
        report(text, min(accepted / n, 1.0))
    report(text, 1.0)
    return u
