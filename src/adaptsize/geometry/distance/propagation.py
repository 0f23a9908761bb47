"""Features of a boundary handed from node to node: every node finds the nearest one."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._kernels import surface_distance as kernels
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

#: Numbers of nodes.
Nodes: TypeAlias = npt.NDArray[np.int64]
AnyBackground: TypeAlias = SimplexMesh | CartesianGrid | Octree

# Accepted nodes between two reports: about 0.3 s.
_NODES_AT_ONCE = 200_000
_BUCKETS = 64


class GridFrame(NamedTuple):
    """A grid as the kernels take it, with three axes."""

    lower: FloatArray
    spacing: FloatArray
    shape: npt.NDArray[np.int64]


def frame_of(grid: CartesianGrid) -> GridFrame:
    """Return a grid with axes of one node for those that it lacks."""
    missing = 3 - grid.dim
    return GridFrame(
        np.append(grid.origin, [0.0] * missing),
        np.append(grid.spacing, [1.0] * missing),
        np.array([*grid.shape, *[1] * missing], np.int64),
    )


class Features(NamedTuple):
    """What distances are measured to; the members as `hand_on_facets` takes them."""

    points: FloatArray
    facets: IntArray
    corners: IntArray
    ring_ptr: IntArray
    ring: IntArray


def hand_on(
    frame: GridFrame,
    features: Features,
    distance: FloatArray,
    nearest: IntArray,
    report: ProgressCallback,
) -> None:
    """Fill distances (In/Out, inf: unknown) by what is nearest to the neighbours (In/Out)."""
    first = np.full(_BUCKETS, -1, np.int32)
    following = np.full(distance.size, -2, np.int32)
    state = np.array([-1, 0], np.int64)
    width = float(frame.spacing[frame.shape > 1].min())
    rest = (*features, *frame, distance, nearest, width)
    accepted, newly = 0, _NODES_AT_ONCE
    while newly == _NODES_AT_ONCE:
        newly = kernels.hand_on_facets(*rest, first, following, state, _NODES_AT_ONCE)
        accepted += newly
        report("distance beyond the band", min(accepted / distance.size, 1.0))


def places_of(background: AnyBackground) -> Callable[[Nodes], FloatArray]:
    """Return what gives the coordinates of nodes, float64[n, dim], by their numbers."""
    if not isinstance(background, CartesianGrid):
        return lambda nodes: background.points[nodes]
    origin, spacing, shape = background.origin, background.spacing, background.shape
    return lambda nodes: origin + spacing * np.stack(np.unravel_index(nodes, shape), axis=1)
