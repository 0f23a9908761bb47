"""Marching on grids until no node is lowered any more, and the distances that this gives."""

from typing import TypeAlias

import numpy as np

from adaptsize._kernels import fast_marching_grid as grid_kernels
from adaptsize._kernels.fast_marching_grid import Buckets
from adaptsize.background.grid import CartesianGrid, strides_of
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

# Buckets that the sizes of waiting nodes may spread over.
_BUCKETS = 4096


def buckets_for(u: FloatArray, seeds: IntArray, least_rise: float, most_rise: float) -> Buckets:
    """Return a queue for padded sizes in which the seeds are lowered already.

    Parameters
    ----------
    u : float64[n]
        Padded sizes.
    seeds : int32[s]
        At least one, in any order.
    least_rise, most_rise : float
        Rise over the shortest spacing at the smallest g above 0, and the largest rise of an
        update above the node that it comes from.
    """
    seeds = seeds[np.argsort(u[seeds], kind="stable")]
    lowest, highest = float(u[seeds[0]]), float(u[seeds[-1]])
    width = max(
        # Narrower buckets repeat fewer nodes (5 % at one half of this, 7 % here in 2-D, 11 and 34 %
        # in 3-D), wider ones need less search: this is fastest in both.
        least_rise,
        # All waiting nodes must fit into the circle of buckets,
        most_rise / (_BUCKETS // 2),
        # and the number of a bucket into an integer; sizes may all be equal, or g zero.
        (highest - lowest) * 1e-12,
        np.finfo(float).tiny,
    )
    return Buckets(
        seeds,
        lowest,
        width,
        np.full(_BUCKETS, -1, np.int32),
        np.empty(u.size, np.int32),
        np.empty(u.size, np.int32),
        np.full(u.size, -1, np.int32),
        np.zeros(3, np.int64),
    )


def pad(
    grid: CartesianGrid, values: FloatArray, width: int = 1, where: BoolArray | None = None
) -> FloatArray:
    """Return nodal values as a flat array with a border, NaN there and outside ``where``.

    The default of ``where`` are the active nodes.
    """
    where = grid.active if where is None else where
    padded = np.full([n + 2 * width for n in grid.shape], np.nan)
    np.copyto(
        padded[(slice(width, -width),) * grid.dim], values, where=True if where is None else where
    )
    return padded.ravel()


def unpad(grid: CartesianGrid, padded: FloatArray, width: int = 1) -> FloatArray:
    """Return nodal values of the shape of the grid; inf at inactive nodes."""
    inner = (slice(width, -width),) * grid.dim
    values = padded.reshape([n + 2 * width for n in grid.shape])[inner].copy()
    if grid.active is not None:
        values[~grid.active] = np.inf
    return values


def strides_of_padded(grid: CartesianGrid, width: int = 1) -> tuple[int, ...]:
    """Return the steps between neighbours along each axis in the array of `pad`."""
    return strides_of([n + 2 * width for n in grid.shape])


# Nodes accepted between two progress reports, at which Ctrl-C takes effect: about 0.1 s.
_CHUNK_OF_GRID = 500_000

# A candidate must be lower by more than rounding to count.
KEEP = 1.0 - 1e-14

#: Strides, weights, g and its step, as the kernels of grids take them.
PaddedGrid: TypeAlias = tuple[tuple[int, ...], tuple[float, ...], FloatArray, int]


def march_on_grid(
    grid: CartesianGrid,
    u: FloatArray,
    geometry: PaddedGrid,
    edges: bool,
    report: ProgressCallback,
    text: str,
) -> int:
    """Lower padded values (In/Out) where their neighbours require it.

    ``edges`` limits along edges only.  Returns the number of accepted nodes.
    """
    candidate = np.empty(u.size)
    grid_kernels.sweep_grid(u, geometry, edges, candidate)
    seeds = np.flatnonzero(candidate < u * KEEP).astype(np.int32)
    u[seeds] = candidate[seeds]
    del candidate
    accepted = 0
    if len(seeds):
        g = geometry[2]
        steepest = float(np.nanmax(g))
        least = float(np.min(g, where=g > 0.0, initial=steepest))
        rises = least * float(grid.spacing.min()), steepest * float(grid.spacing.max())
        queue, newly = buckets_for(u, seeds, *rises), _CHUNK_OF_GRID
        while newly == _CHUNK_OF_GRID:
            newly = grid_kernels.march_grid(u, geometry, edges, queue, (KEEP, _CHUNK_OF_GRID))
            accepted += newly
            report(text, min(accepted / grid.n_points, 1.0))
    report(text, 1.0)
    return accepted


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
    domain = grid.with_active(where)
    u = pad(domain, seeds)
    weights = tuple(float(w) for w in 1.0 / grid.spacing**2)
    march_on_grid(grid, u, (strides_of_padded(grid), weights, np.ones(1), 0), False, report, text)
    return unpad(domain, u)
