"""Distances on grids from values near where they are zero, by fast marching and propagation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.surface_distance import (
    Features,
    GridFrame,
    Nearest,
    Queue,
    propagate_features,
)
from adaptsize.background import AnyBackground, CartesianGrid, PartitionedMesh
from adaptsize.background.marching import (
    march_on_grid,
    pad,
    strides_of_padded,
    unpad,
)
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback


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


# Nodes accepted between two progress reports: about 0.3 s.
_NODES_AT_ONCE = 200_000
_BUCKETS = 64


def frame_of(grid: CartesianGrid) -> GridFrame:
    """Return a grid in which missing axes have one node."""
    missing = 3 - grid.dim
    return GridFrame(
        np.append(grid.origin, [0.0] * missing),
        np.append(grid.spacing, [1.0] * missing),
        np.array([*grid.shape, *[1] * missing], np.int64),
    )


def propagate(
    grid: CartesianGrid, features: Features, found: Nearest, report: ProgressCallback
) -> None:
    """Fill unknown distances (In/Out, inf) from the nearest features of neighbours (In/Out)."""
    frame, n = frame_of(grid), grid.n_points
    first, following = np.full(_BUCKETS, -1, np.int32), np.full(n, -2, np.int32)
    queue = Queue(float(grid.spacing.min()), first, following, np.array([-1, 0], np.int64))
    accepted, newly = 0, _NODES_AT_ONCE
    while newly == _NODES_AT_ONCE:
        newly = propagate_features(features, frame, found, queue, _NODES_AT_ONCE)
        accepted += newly
        report("distance beyond the band", min(accepted / n, 1.0))


def places_of(
    background: AnyBackground | PartitionedMesh,
) -> Callable[[npt.NDArray[np.integer]], FloatArray]:
    """Return a function that maps node numbers to coordinates, float64[n, dim]."""
    if not isinstance(background, CartesianGrid):
        return lambda nodes: background.points[nodes]
    origin, spacing, shape = background.origin, background.spacing, background.shape
    return lambda nodes: origin + spacing * np.stack(np.unravel_index(nodes, shape), axis=1)
