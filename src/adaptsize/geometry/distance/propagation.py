"""Propagation of boundary features from node to node, so that each node finds the nearest one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from adaptsize._kernels.surface_distance import (
    Features,
    GridFrame,
    Nearest,
    Queue,
    propagate_features,
)
from adaptsize.background import AnyBackground, CartesianGrid
from adaptsize.typing import FloatArray, LongArray, ProgressCallback

#: Numbers of nodes.

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


def places_of(background: AnyBackground) -> Callable[[LongArray], FloatArray]:
    """Return a function that maps node numbers to coordinates, float64[n, dim]."""
    if not isinstance(background, CartesianGrid):
        return lambda nodes: background.points[nodes]
    origin, spacing, shape = background.origin, background.spacing, background.shape
    return lambda nodes: origin + spacing * np.stack(np.unravel_index(nodes, shape), axis=1)
