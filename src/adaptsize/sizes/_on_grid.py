"""Which nodes of a Cartesian grid a point, a box or a ball touches.

All is computed from the indices of the nodes.  No boxes and no coordinates are stored per
node.  Numbers of nodes are those of ``grid.points``; only active nodes are returned.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background.interpolation import places_of
from adaptsize.typing import FloatArray, IndexArray, LongArray


def nodes_around(grid: CartesianGrid, points: FloatArray) -> tuple[LongArray, IndexArray]:
    """Return the corners of the boxes around points: the number of the point, and the node.

    A point outside belongs to the closest box.  If no corner of it is active, it belongs to
    the nearest active node.
    """
    last = np.array(grid.shape) - 2
    # Clipped before they become integers: points may be far away.
    boxes = np.clip(np.floor((points - grid.lower) / grid.spacing), 0.0, last).astype(np.int64)
    corners = np.array(list(product((0, 1), repeat=grid.dim)))
    nodes = _numbers(grid, (boxes[:, None, :] + corners).reshape(-1, grid.dim))
    which = np.repeat(np.arange(len(points)), len(corners))
    if grid.active is not None:
        good = grid.active.ravel()[nodes]
        lost = np.flatnonzero(~good.reshape(len(points), -1).any(axis=1))
        nodes, which = nodes[good], which[good]
        if len(lost):
            nodes = np.concatenate([nodes, _nearest_active(grid, points[lost])])
            which = np.concatenate([which, lost])
    return which, nodes


def nodes_beside_ball(
    grid: CartesianGrid, lower: FloatArray, upper: FloatArray, radius: float
) -> IndexArray:
    """Return the corners of the boxes that are within a radius of a box, or of a point."""
    ends = np.clip([lower, upper], grid.lower, grid.upper)
    beyond = np.maximum(np.maximum(lower - grid.upper, grid.lower - upper), 0.0)
    gaps, index = [], []
    for d, x in enumerate(grid.axes):
        # The boxes around a node extend one spacing from it.  Those that extend beyond the grid
        # intersect the ball only where the ball is outside as well.
        to_node = np.abs(x - np.clip(x, *ends[:, d]))
        gap = np.maximum(to_node - grid.spacing[d], 0.0) + beyond[d]
        index.append(np.flatnonzero(gap <= radius))
        gaps.append(gap[index[-1]] ** 2)
    meets = np.array(sum(np.meshgrid(*gaps, indexing="ij", sparse=True))) <= radius**2
    nodes = np.stack(np.meshgrid(*index, indexing="ij"), axis=-1)[meets]
    return _active(grid, _numbers(grid, nodes))


def at_active_nodes(
    grid: CartesianGrid, function: Callable[[FloatArray], npt.ArrayLike], name: str
) -> FloatArray:
    """Return the values of a function at active nodes, and inf at other nodes."""
    values = np.full(grid.shape, np.inf)
    for slab, points in grid.slabs():
        wanted = np.ones(len(points), np.bool_)
        if grid.active is not None:
            wanted = grid.active[slab].ravel()
        here = points[wanted]
        part = values[slab].reshape(-1)  # a view: slabs are contiguous
        part[wanted] = as_float_array(name, function(here), (len(here),))
    return values


def nodes_near(grid: CartesianGrid, mesh: SimplexMesh, within: float) -> IndexArray:
    """Return the active nodes up to a distance from a mesh.

    Blocks of nodes are halved along each axis while they may contain such nodes.
    """
    shape = np.array(grid.shape)
    edge = 1
    while (shape > 8 * edge).any():
        edge *= 2
    corners = np.array(list(product((0, 1), repeat=grid.dim)))
    blocks = np.argwhere(np.ones(-(-shape // edge), np.bool_))
    while True:
        first, last = edge * blocks, np.minimum(edge * (blocks + 1), shape) - 1
        distance = mesh.locator.nearest(grid.origin + grid.spacing * 0.5 * (first + last))[2]
        reach = 0.5 * np.linalg.norm(grid.spacing * (last - first), axis=1)
        blocks = blocks[distance <= within + reach * (1.0 + 1e-9)]
        if edge == 1:
            break
        edge //= 2
        blocks = (2 * blocks[:, None] + corners).reshape(-1, grid.dim)
        blocks = blocks[(edge * blocks < shape).all(axis=1)]
    return _active(grid, _numbers(grid, blocks))


def boundary_nodes(grid: CartesianGrid) -> IndexArray:
    """Return the active nodes that have inactive neighbours, including diagonal neighbours."""
    from scipy import ndimage

    active = np.ones(grid.shape, np.bool_) if grid.active is None else grid.active
    inner = ndimage.binary_erosion(active, np.ones((3,) * grid.dim))
    return np.flatnonzero(active & ~inner)


def _nearest_active(grid: CartesianGrid, points: FloatArray) -> IndexArray:
    """Return the nearest active node of each point in or outside boxes without any."""
    from scipy.spatial import cKDTree

    # It has a neighbour that is not active, or it would not be the nearest.
    nodes = boundary_nodes(grid)
    return np.asarray(nodes[cKDTree(places_of(grid)(nodes)).query(points)[1]])


def _numbers(grid: CartesianGrid, index: LongArray) -> IndexArray:
    """Return the numbers of nodes with given indices along the axes, int64[n, dim]."""
    return np.asarray(np.ravel_multi_index(tuple(index.T), grid.shape))


def _active(grid: CartesianGrid, nodes: IndexArray) -> IndexArray:
    return nodes if grid.active is None else nodes[grid.active.ravel()[nodes]]
