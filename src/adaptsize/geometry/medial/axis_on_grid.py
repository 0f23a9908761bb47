"""The medial axis of a distance function on a Cartesian grid: Algorithm 1 of Persson."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.medial_axis import find_crossings
from adaptsize.background import CartesianGrid
from adaptsize.geometry.medial.grid_corners import (
    RESOLVED,
    Fronts,
    come_from_boundary,
    distance_on_grid,
    look_half_way,
    meet_at_corner,
    rounding_of_patches,
)
from adaptsize.geometry.medial.points import MedialAxis
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback

# Smallest curvature that is resolved, times the diameter of the part.
_CURVATURE_TIMES_DIAMETER = 4.0

# Gradients shorter than this (those of a distance have length 1) have no direction.
_DIRECTED = 0.5

# Directions must differ by this much, in radians, to have a normal between them.
_LEAST_TURN = 1e-3

# Smallest turn of the boundary, in degrees, at a corner that is reported.
_SHARP = 20.0

# Crossings up to this distance from the boundary, in spacings, are used to locate corners.
_WITNESS = 12.0

# Nodes that the parabolas reach beyond an edge.
_BORDER = 3

# Crossings listed between two reports, at which Ctrl-C takes effect.
_CROSSINGS_AT_ONCE = 2**18


@dataclass(frozen=True)
class _Crossings:
    """Output of `find_crossings`, one entry for each crossing."""

    node: npt.NDArray[np.int64]
    axis: npt.NDArray[np.int64]
    place: FloatArray
    rise: FloatArray
    depth: FloatArray
    gradients: FloatArray

    def taken(self, which: npt.NDArray[Any]) -> _Crossings:
        return replace(self, **{name: value[which] for name, value in vars(self).items()})


def medial_axis_on_grid(
    grid: CartesianGrid,
    phi: FloatArray,
    *,
    tolerance: float | None,
    gamma: float,
    patches: npt.NDArray[np.int64] | None,
    corner_angle: float,
    report: ProgressCallback,
) -> MedialAxis:
    """Return the medial axis as `adaptsize.medial_axis`, for checked arguments."""
    if tolerance is None:
        tolerance = _CURVATURE_TIMES_DIAMETER / _diameter_inside(grid, phi)
    found = _find(grid, phi, tolerance, gamma, report)
    found = found.taken(_is_steepest(grid, found))
    length = np.linalg.norm(found.gradients, axis=2)
    directed = (length > _DIRECTED).all(axis=1)
    found, length = found.taken(directed), length[directed]
    unit = found.gradients / length[:, :, None]
    fronts = look_half_way(grid, phi, Fronts(_positions(grid, found), found.depth, unit))
    turned = max(gamma * tolerance * float(grid.spacing.max()), _LEAST_TURN)
    valid = (fronts.cosine < 1.0 - 0.5 * turned**2) & come_from_boundary(grid, phi, fronts)
    found, fronts = found.taken(valid), fronts.taken(valid)
    rounded = None
    if patches is not None:
        rounded = rounding_of_patches(grid, phi, patches, *_nodes_beside(grid, found))
    step = float(grid.spacing.max())
    distance = distance_on_grid(grid, phi)
    at_corner, apex = meet_at_corner(distance, step, fronts, corner_angle, rounded)
    # At larger distances or smaller turns, a smooth boundary is indistinguishable from a corner.
    sharp = at_corner & (fronts.cosine < np.cos(np.radians(_SHARP)))
    steps = fronts.radii / grid.spacing.max()
    sharp &= (steps >= RESOLVED) & (steps <= _WITNESS)
    return _assemble(grid, found.taken(~at_corner), fronts.taken(~at_corner), apex[sharp])


def _assemble(
    grid: CartesianGrid, found: _Crossings, fronts: Fronts, corners: FloatArray
) -> MedialAxis:
    """Return the medial axis of accepted crossings."""
    normals = fronts.directions[:, 0] - fronts.directions[:, 1]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    along = np.abs(normals[np.arange(len(normals)), found.axis]) * grid.spacing[found.axis]
    distances = np.full(grid.n_points, np.inf)
    np.minimum.at(distances, found.node, along * found.place)
    other = found.node + _steps(grid)[found.axis]
    np.minimum.at(distances, other, along * (1.0 - found.place))
    return MedialAxis(
        points=fronts.points,
        normals=normals,
        radii=fronts.radii,
        angles=np.degrees(np.arccos(np.clip(fronts.cosine, -1.0, 1.0))),
        distances=distances.reshape(grid.shape),
        corners=corners,
    )


def _find(
    grid: CartesianGrid,
    phi: FloatArray,
    tolerance: float,
    gamma: float,
    report: ProgressCallback,
) -> _Crossings:
    """Return all edges on which two fronts meet, before neighbours are compared."""
    missing = 3 - grid.dim
    padded = _pad(grid, phi)
    geometry = (
        (*[1] * missing, *grid.shape),
        (*[0] * missing, *[_BORDER] * grid.dim),
        (*[0] * missing, *(s // padded.itemsize for s in padded.strides)),
        (*[1.0] * missing, *(float(h) for h in grid.spacing)),
    )
    n_rows = grid.n_points // grid.shape[-1]
    room = max(_CROSSINGS_AT_ONCE, 3 * grid.shape[-1])
    parts, row = [], 0
    while row < n_rows:
        nodes, axes = np.empty((2, room), np.int64)
        place, rise, depth = np.empty((3, room))
        part = _Crossings(nodes, axes, place, rise, depth, np.empty((room, 2, 3)))
        count, row = find_crossings(
            padded.reshape(-1), *geometry, tolerance, gamma, row, *vars(part).values()
        )
        parts.append(part.taken(np.arange(count)))
        report("finding the medial axis", row / n_rows)
    joined = [
        np.concatenate(arrays) for arrays in zip(*(vars(p).values() for p in parts), strict=True)
    ]
    found = _Crossings(*joined)
    return replace(
        found, axis=found.axis - missing, gradients=found.gradients[:, :, missing:].copy()
    )


def _pad(grid: CartesianGrid, phi: FloatArray) -> FloatArray:
    """Return the distance with three more nodes on every side, NaN at inactive nodes.

    Values are continued by a point reflection, which keeps linear functions linear.
    """
    values = phi if grid.active is None else np.where(grid.active, phi, np.nan)
    return np.pad(values, _BORDER, mode="reflect", reflect_type="odd")


def _is_steepest(grid: CartesianGrid, found: _Crossings) -> BoolArray:
    """Return which crossings have no steeper one on their line, two nodes before to three after."""
    along = np.stack(np.unravel_index(found.node, grid.shape), axis=-1)
    here = along[np.arange(len(found.node)), found.axis]
    line = found.node - here * _steps(grid)[found.axis]
    order = np.lexsort((here, line, found.axis))
    axis, line, here = found.axis[order], line[order], here[order]
    rise, place = found.rise[order], here + found.place[order]
    steepest = np.ones(len(order), np.bool_)
    for apart in range(1, 2 * _BORDER + 1):
        a, b = slice(None, -apart), slice(apart, None)
        same = (axis[a] == axis[b]) & (line[a] == line[b])
        # Of two equally steep ones, as for a crossing at a node, the first is kept.
        steepest[b] &= ~(same & (place[a] >= here[b] - 2) & (rise[a] >= rise[b]))
        steepest[a] &= ~(same & (place[b] <= here[a] + 3) & (rise[b] > rise[a]))
    result = np.empty_like(steepest)
    result[order] = steepest
    return result


def _steps(grid: CartesianGrid) -> npt.NDArray[np.int64]:
    """Return the stride of node numbers along each axis."""
    return np.array([int(np.prod(grid.shape[a + 1 :])) for a in range(grid.dim)])


def _nodes_beside(
    grid: CartesianGrid, found: _Crossings
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the nodes next to the edges of crossings, which lie clearly on either side."""
    along = np.stack(np.unravel_index(found.node, grid.shape), axis=-1)
    here = along[np.arange(len(found.node)), found.axis]
    step, n = _steps(grid)[found.axis], np.array(grid.shape)[found.axis]
    before = np.maximum(here - 1, 0) - here
    after = np.minimum(here + 2, n - 1) - here
    return found.node + step * before, found.node + step * after


def _positions(grid: CartesianGrid, found: _Crossings) -> FloatArray:
    """Return the coordinates of crossings, float64[n, dim]."""
    steps = np.stack(np.unravel_index(found.node, grid.shape), axis=-1).astype(np.float64)
    steps[np.arange(len(steps)), found.axis] += found.place
    return grid.origin + grid.spacing * steps


def _diameter_inside(grid: CartesianGrid, phi: FloatArray) -> float:
    """Return the diagonal of the box of the inside nodes, enlarged by a cell."""
    inside = phi < 0.0
    if grid.active is not None:
        inside = inside & grid.active
    square = 0.0
    for axis in range(grid.dim):
        others = tuple(a for a in range(grid.dim) if a != axis)
        reached = np.flatnonzero(inside.any(axis=others))
        square += float((reached[-1] - reached[0] + 1) * grid.spacing[axis]) ** 2
    return float(np.sqrt(square))
