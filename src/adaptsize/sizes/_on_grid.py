"""Sizes from sources at the nodes of a Cartesian grid.

All is computed from the indices of the nodes.  No boxes and no coordinates are stored per
node.  Functions lower ``h0``, float64 of the grid's shape (In/Out), at active nodes only.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.sizes._touched import Nearby, Pieces
from adaptsize.typing import BoolArray, FloatArray, LongArray

#: Returns the requested sizes at some distances from a source.
SizeAt = Callable[[FloatArray], FloatArray]


def nodes_around(grid: CartesianGrid, points: FloatArray) -> Nearby:
    """Return the active corners of the boxes around points.

    A point outside belongs to the closest box.  If no corner of it is active, it belongs to
    the nearest active node.
    """
    boxes = _boxes_around(grid, points)
    corners = np.array(list(product((0, 1), repeat=grid.dim)))
    nodes = (boxes[:, None, :] + corners).reshape(-1, grid.dim)
    which = np.repeat(np.arange(len(points)), len(corners))
    if grid.active is not None:
        good = grid.active[tuple(nodes.T)]
        lost = ~good.reshape(len(points), -1).any(axis=1)
        nodes, which = nodes[good], which[good]
        if lost.any():
            nodes = np.concatenate([nodes, _nearest_active(grid, points[lost])])
            which = np.concatenate([which, np.flatnonzero(lost)])
    flat = np.ravel_multi_index(tuple(nodes.T), grid.shape)
    return Nearby(which, flat, _coordinates(grid, nodes))


def pieces_along(grid: CartesianGrid, curve: SimplexMesh) -> Pieces:
    """Return the pieces of a curve in all boxes that it passes through."""
    segment, first, last = _pieces_in_boxes(grid, curve)
    a, b = (curve.points[nodes] for nodes in curve.cells[segment].T)
    middle = 0.5 * (first + last)[:, None]
    return Pieces(segment, first, last, nodes_around(grid, a + middle * (b - a)))


def lower_in_box(
    grid: CartesianGrid, lower: FloatArray, upper: FloatArray, size_at: SizeAt, h0: FloatArray
) -> None:
    """Lower ``h0`` (In/Out) at the corners of the boxes that meet a box."""
    window = _window(grid, lower, upper)
    gaps = [
        np.maximum(np.maximum(lower[d] - x, x - upper[d]), 0.0)
        for d, x in enumerate(_axes_of(grid, window))
    ]
    _lower_window(grid, window, size_at(np.sqrt(_sum_of_squares(gaps))), h0)


def lower_in_ball(
    grid: CartesianGrid, centre: FloatArray, radius: float, size_at: SizeAt, h0: FloatArray
) -> None:
    """Lower ``h0`` (In/Out) at the corners of the boxes that meet a ball."""
    window = _window(grid, centre - radius, centre + radius)
    away, of_boxes = [], []
    for d, x in enumerate(_axes_of(grid, window)):
        offset = np.abs(x - centre[d])
        away.append(offset)
        # The boxes around a node extend one spacing from it.  Boxes that extend beyond the
        # grid intersect the ball only where the ball is outside as well.
        inside = np.clip(centre[d], grid.lower[d], grid.upper[d])
        beyond = np.maximum(np.abs(x - inside) - grid.spacing[d], 0.0)
        of_boxes.append(beyond + abs(centre[d] - inside))
    requested = size_at(np.maximum(np.sqrt(_sum_of_squares(away)) - radius, 0.0))
    requested[_sum_of_squares(of_boxes) > radius**2] = np.inf
    _lower_window(grid, window, requested, h0)


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


def nodes_near(grid: CartesianGrid, mesh: SimplexMesh, within: float) -> LongArray:
    """Return the active nodes up to a distance from a mesh, int64[n, dim].

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
    if grid.active is not None:
        blocks = blocks[grid.active[tuple(blocks.T)]]
    return np.asarray(blocks)


def boundary_nodes(grid: CartesianGrid) -> BoolArray:
    """Return which active nodes have inactive neighbours, including diagonal neighbours."""
    active = np.ones(grid.shape, np.bool_) if grid.active is None else grid.active
    inner = active
    for d in range(grid.dim):
        across = np.moveaxis(inner, d, 0)
        kept = np.zeros_like(across)
        kept[1:-1] = across[1:-1] & across[:-2] & across[2:]
        inner = np.moveaxis(kept, 0, d)
    return active & ~inner


def _boxes_around(grid: CartesianGrid, points: FloatArray) -> LongArray:
    """Return the indices of the box around each point, or of the closest box."""
    last = np.array(grid.shape) - 2
    # Clipped before they become integers: points may be far away.
    along = np.clip(np.floor((points - grid.lower) / grid.spacing), 0.0, last)
    return along.astype(np.int64)


def _nearest_active(grid: CartesianGrid, points: FloatArray) -> LongArray:
    """Return the nearest active node of each point in or outside boxes without any."""
    from scipy.spatial import cKDTree

    # It has a neighbour that is not active, or it would not be the nearest.
    nodes = np.argwhere(boundary_nodes(grid))
    nearest = cKDTree(_coordinates(grid, nodes)).query(points)[1]
    return np.asarray(nodes[nearest])


def _coordinates(grid: CartesianGrid, nodes: LongArray) -> FloatArray:
    """Return the coordinates of nodes, float64[n, dim]."""
    return grid.origin + grid.spacing * nodes


def _pieces_in_boxes(
    grid: CartesianGrid, curve: SimplexMesh
) -> tuple[LongArray, FloatArray, FloatArray]:
    """Split the segments of a curve at each plane of nodes that they cross.

    Each piece lies in one box, or has one closest box if it lies outside.

    Returns
    -------
    segment : int64[n_pieces]
    first, last : float64[n_pieces]
        Ends of the piece, 0 at the first node of the segment to 1 at the second.
    """
    a, b = curve.points[curve.cells[:, 0]], curve.points[curve.cells[:, 1]]
    n = len(a)
    cuts = [np.zeros(n), np.ones(n)]
    owners = [np.arange(n), np.arange(n)]
    for d in range(grid.dim):
        from_a = (a[:, d] - grid.lower[d]) / grid.spacing[d]
        step = (b[:, d] - a[:, d]) / grid.spacing[d]
        low, high = np.minimum(from_a, from_a + step), np.maximum(from_a, from_a + step)
        # Clipped before they become integers: the curve may go far away.
        first = np.ceil(np.clip(low, 0.0, grid.shape[d])).astype(np.int64)
        last = np.floor(np.clip(high, -1.0, grid.shape[d] - 1)).astype(np.int64)
        crossed = np.where(step == 0.0, 0, np.maximum(last - first + 1, 0))
        owner = np.repeat(np.arange(n), crossed)
        plane = np.arange(len(owner)) - np.repeat(np.cumsum(crossed) - crossed, crossed)
        cuts.append(np.clip((first[owner] + plane - from_a[owner]) / step[owner], 0.0, 1.0))
        owners.append(owner)
    at, segment = np.concatenate(cuts), np.concatenate(owners)
    order = np.lexsort((at, segment))
    at, segment = at[order], segment[order]
    is_piece = (segment[1:] == segment[:-1]) & (at[1:] > at[:-1])
    return segment[1:][is_piece], at[:-1][is_piece], at[1:][is_piece]


def _window(grid: CartesianGrid, lower: FloatArray, upper: FloatArray) -> tuple[slice, ...]:
    """Return the nodes of the boxes that intersect a box, empty if there are none."""
    first = np.ceil((lower - grid.lower) / grid.spacing - 1.0)
    last = np.floor((upper - grid.lower) / grid.spacing + 1.0)
    most = np.array(grid.shape) - 1.0
    if (first > most - 1.0).any() or (last < 1.0).any():
        return (slice(0, 0),) * grid.dim
    return tuple(
        slice(int(max(i, 0.0)), int(min(j, n)) + 1)
        for i, j, n in zip(first, last, most, strict=True)
    )


def _axes_of(grid: CartesianGrid, window: tuple[slice, ...]) -> list[FloatArray]:
    return [axis[part] for axis, part in zip(grid.axes, window, strict=True)]


def _sum_of_squares(per_axis: list[FloatArray]) -> FloatArray:
    """Return the sum over the axes of squares, one entry per node of a window."""
    total: FloatArray = np.zeros([len(values) for values in per_axis])
    for d, values in enumerate(per_axis):
        total += (values**2).reshape([-1 if e == d else 1 for e in range(len(per_axis))])
    return total


def _lower_window(
    grid: CartesianGrid, window: tuple[slice, ...], requested: FloatArray, h0: FloatArray
) -> None:
    active = True if grid.active is None else grid.active[window]
    np.minimum(h0[window], requested, out=h0[window], where=active)
