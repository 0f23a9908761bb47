"""Sizes from sources at the nodes of a Cartesian grid.

All is computed from the indices of the nodes.  No boxes and no coordinates are stored per
node.  Functions lower ``h0``, float64 of the grid's shape (In/Out), at active nodes only.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.typing import BoolArray, FloatArray

_Indices = npt.NDArray[np.int64]


def lower_at_points(
    grid: CartesianGrid, points: FloatArray, size: FloatArray, g: float, h0: FloatArray
) -> None:
    """Lower ``h0`` (In/Out) at the corners of the boxes around points, or nearest to them."""
    nodes, which = _corners_around(grid, points, np.arange(len(points)))
    distance = np.linalg.norm(_coordinates(grid, nodes) - points[which], axis=1)
    _lower(h0, nodes, size[which] + g * distance)


def lower_along(
    grid: CartesianGrid, curve: SimplexMesh, size: FloatArray, g: float, h0: FloatArray
) -> None:
    """Lower ``h0`` (In/Out) at the corners of all boxes that segments pass through."""
    segment, first, last = _pieces_in_boxes(grid, curve)
    a, b = curve.cells[segment].T
    start, stop = (
        (1.0 - t)[:, None] * curve.points[a] + t[:, None] * curve.points[b] for t in (first, last)
    )
    at_start, at_stop = (size_between(t, size[a], size[b]) for t in (first, last))
    nodes, piece = _corners_around(grid, 0.5 * (start + stop), np.arange(len(segment)))
    ends = (start[piece], stop[piece], at_start[piece], at_stop[piece])
    _lower(h0, nodes, _least_from_segment(_coordinates(grid, nodes), *ends, g))
    # The closest point of the curve may lie in a box that is not at the node.
    nodes = np.unique(nodes, axis=0)
    at_nearest, distances = curve.locator.interpolate(size, _coordinates(grid, nodes))
    _lower(h0, nodes, at_nearest + g * distances)


def lower_in_box(
    grid: CartesianGrid,
    lower: FloatArray,
    upper: FloatArray,
    size: float,
    g: float,
    h0: FloatArray,
) -> None:
    """Lower ``h0`` (In/Out) at the corners of the boxes that meet a box."""
    window = _window(grid, lower, upper)
    gaps = [
        np.maximum(np.maximum(lower[d] - x, x - upper[d]), 0.0)
        for d, x in enumerate(_axes_of(grid, window))
    ]
    _lower_window(grid, window, size + g * np.sqrt(_sum_of_squares(gaps)), h0)


def lower_in_ball(
    grid: CartesianGrid, centre: FloatArray, radius: float, size: float, g: float, h0: FloatArray
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
    requested = size + g * np.maximum(np.sqrt(_sum_of_squares(away)) - radius, 0.0)
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


def nodes_near(grid: CartesianGrid, mesh: SimplexMesh, within: float) -> _Indices:
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


def _corners_around(
    grid: CartesianGrid, points: FloatArray, number: npt.NDArray[Any]
) -> tuple[_Indices, npt.NDArray[Any]]:
    """Return active corners of the boxes around points, and ``number`` of their points.

    A point outside belongs to the closest box.  If no corner of it is active, it belongs to
    the nearest active node.

    Returns
    -------
    nodes : int64[n, dim]
    number : of shape (n,)
    """
    boxes = _boxes_around(grid, points)
    corners = np.array(list(product((0, 1), repeat=grid.dim)))
    nodes = (boxes[:, None, :] + corners).reshape(-1, grid.dim)
    if grid.active is None:
        return nodes, np.repeat(number, len(corners))
    good = grid.active[tuple(nodes.T)].reshape(len(points), -1)
    lost = ~good.any(axis=1)
    found = np.repeat(number, good.sum(axis=1))
    nodes = nodes[good.ravel()]
    if lost.any():
        nodes = np.concatenate([nodes, _nearest_active(grid, points[lost])])
        found = np.concatenate([found, number[lost]])
    return nodes, found


def _boxes_around(grid: CartesianGrid, points: FloatArray) -> _Indices:
    """Return the indices of the box around each point, or of the closest box."""
    last = np.array(grid.shape) - 2
    # Clipped before they become integers: points may be far away.
    along = np.clip(np.floor((points - grid.lower) / grid.spacing), 0.0, last)
    return along.astype(np.int64)


def _nearest_active(grid: CartesianGrid, points: FloatArray) -> _Indices:
    """Return the nearest active node of each point in or outside boxes without any."""
    from scipy.spatial import cKDTree

    # It has a neighbour that is not active, or it would not be the nearest.
    nodes = np.argwhere(boundary_nodes(grid))
    nearest = cKDTree(_coordinates(grid, nodes)).query(points)[1]
    return np.asarray(nodes[nearest])


def _coordinates(grid: CartesianGrid, nodes: _Indices) -> FloatArray:
    """Return the coordinates of nodes, float64[n, dim]."""
    return grid.origin + grid.spacing * nodes


def _lower(h0: FloatArray, nodes: _Indices, requested: FloatArray) -> None:
    np.minimum.at(h0, tuple(nodes.T), requested)


def _pieces_in_boxes(
    grid: CartesianGrid, curve: SimplexMesh
) -> tuple[npt.NDArray[np.int64], FloatArray, FloatArray]:
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


def size_between(t: FloatArray, at_a: FloatArray, at_b: FloatArray) -> FloatArray:
    """Return sizes between two ends.  An end of share 0 is ignored, because inf would give nan."""
    size: FloatArray = np.where(t < 1.0, at_a, 0.0) * (1.0 - t) + np.where(t > 0.0, at_b, 0.0) * t
    return size


def _least_from_segment(
    x: FloatArray, a: FloatArray, b: FloatArray, at_a: FloatArray, at_b: FloatArray, g: float
) -> FloatArray:
    """Return the minimum of ``s(y) + g |x - y|`` over y on segments with sizes linear along them.

    With the slope m of the size along the segment, the foot of x at t and its height H, the
    minimum is at ``t - m H / sqrt(g^2 - m^2)``, clipped to the segment, or at an end if
    ``|m| >= g``.
    """
    length = np.linalg.norm(b - a, axis=1)
    along = (b - a) / np.where(length > 0.0, length, 1.0)[:, None]
    foot = ((x - a) * along).sum(axis=1)
    height = np.linalg.norm(x - a - foot[:, None] * along, axis=1)
    ends = np.minimum(
        at_a + g * np.linalg.norm(x - a, axis=1), at_b + g * np.linalg.norm(x - b, axis=1)
    )
    # Where a size is inf at one end it is inf up to the other: only the ends count.
    linear = np.isfinite(at_a) & np.isfinite(at_b) & (length > 0.0)
    rise = np.where(linear, at_b, 0.0) - np.where(linear, at_a, 0.0)
    slope = rise / np.where(length > 0.0, length, 1.0)
    linear &= np.abs(slope) < g
    root = np.sqrt(np.where(linear, g**2 - slope**2, 1.0))
    t = np.clip(foot - slope * height / root, 0.0, length)
    between = at_a + slope * t + g * np.hypot(height, t - foot)
    return np.asarray(np.where(linear, np.minimum(between, ends), ends))


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
