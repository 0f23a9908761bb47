"""Distances on Cartesian grids from values near where they are zero, by fast marching."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adaptsize._kernels import march_grid as kernels
from adaptsize.background.padding import buckets_for, pad, strides_of_padded
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import CartesianGrid

# Nodes accepted between two reports, which also let Ctrl-C through: about 0.1 s.
_CHUNK = 500_000

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

    with the smaller neighbour :math:`v_a` along each axis: first order [1]_.

    Parameters
    ----------
    grid : CartesianGrid
        ``active`` does not count; give it as ``where``.
    seeds : float64[shape]
        Known distances, >= 0; inf elsewhere, no NaN.  They are lowered only if another
        seed asks for that.
    where : bool[shape], optional
        Nodes that take part; distances are those of ways through them.  All by default.
    report : callable
        Called with ``text`` and the share done.
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
