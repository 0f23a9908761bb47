"""The medial axis of a distance function on a Cartesian grid."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_number, describe, refuse_where
from adaptsize._kernels.medial_axis import find_crossings
from adaptsize._progress import reporting
from adaptsize.background import CartesianGrid
from adaptsize.geometry.grid_corners import (
    Fronts,
    come_from_boundary,
    look_half_way,
    meet_at_corner,
    rounding_of_patches,
)
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback

# Smallest curvature that is resolved, times the diameter of the part.
_CURVATURE_TIMES_DIAMETER = 4.0

# Nodes that the parabolas reach beyond an edge.
_BORDER = 3

# Crossings listed between two reports, which also let Ctrl-C through.
_CROSSINGS_AT_ONCE = 2**18


@dataclass(frozen=True, eq=False, repr=False)
class MedialAxis:
    """Points of a medial axis on the edges of a Cartesian grid.

    Parameters
    ----------
    points : float64[n, dim]
        Where two fronts meet, each on an edge of the grid.
    normals : float64[n, dim]
        Unit normals of the medial axis there, of either sign.  Where the axis is a curve in space
        (or a point in the plane) one of the directions across it.
    radii : float64[n]
        Distance of each point from the boundary.
    angles : float64[n]
        Angle in degrees between the ways to the two nearest points of the boundary: 180 between
        parallel walls.
    distances : float64 of the shape of the grid
        Distance from the medial axis at the ends of these edges, inf at all other nodes.
    corners : float64[m, dim]
        Where the boundary has the corner from which a crossing comes that was left out, one for
        each of them: in space points of sharp edges.
    """

    points: FloatArray
    normals: FloatArray
    radii: FloatArray
    angles: FloatArray
    distances: FloatArray
    corners: FloatArray

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            getattr(self, name).flags.writeable = False

    def __repr__(self) -> str:
        """Say how many points."""
        return f"MedialAxis({len(self.points)} points, {len(self.corners)} left out at corners)"


@dataclass(frozen=True)
class _Crossings:
    """What `find_crossings` fills, one entry for each crossing."""

    node: npt.NDArray[np.int64]
    axis: npt.NDArray[np.int64]
    place: FloatArray
    rise: FloatArray
    depth: FloatArray
    gradients: FloatArray

    def taken(self, which: npt.NDArray[Any]) -> _Crossings:
        return replace(self, **{name: value[which] for name, value in vars(self).items()})


def medial_axis(
    grid: CartesianGrid,
    phi: npt.ArrayLike,
    *,
    curvature_tolerance: float | None = None,
    gamma: float = 2.0,
    patches: npt.ArrayLike | None = None,
    corner_angle: float = 30.0,
    progress: ProgressCallback | bool | None = None,
) -> MedialAxis:
    """Return where the fronts of a distance function meet inside the domain."""
    values, tolerance = _checked_distance(grid, phi), curvature_tolerance
    if tolerance is None:
        tolerance = _CURVATURE_TIMES_DIAMETER / _diameter_inside(grid, values)
    tolerance = as_number("curvature_tolerance", tolerance, lower=0.0)
    gamma = as_number("gamma", gamma, lower=0.0, strict=True)
    pieces = None if patches is None else _checked_patches(grid, patches)
    with reporting(progress) as report:
        found = _find(grid, values, tolerance, gamma, report)
    found = found.taken(_is_steepest(grid, found))
    angle = as_number("corner_angle", corner_angle, lower=0.0)
    unit = found.gradients / np.linalg.norm(found.gradients, axis=2)[:, :, None]
    fronts = look_half_way(grid, values, Fronts(_positions(grid, found), found.depth, unit))
    turned = gamma * tolerance * float(grid.spacing.max())
    sound = (fronts.cosine < 1.0 - 0.5 * turned**2) & come_from_boundary(grid, values, fronts)
    found, fronts = found.taken(sound), fronts.taken(sound)
    rounded = None
    if pieces is not None:
        ends = (found.node, found.node + _steps(grid)[found.axis])
        rounded = rounding_of_patches(grid, values, pieces, *ends)
    at_corner, apex = meet_at_corner(grid, values, fronts, angle, rounded)
    return _assemble(grid, found.taken(~at_corner), fronts.taken(~at_corner), apex[at_corner])


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
        # Of two as steep, those of a crossing at a node, the first stays.
        steepest[b] &= ~(same & (place[a] >= here[b] - 2) & (rise[a] >= rise[b]))
        steepest[a] &= ~(same & (place[b] <= here[a] + 3) & (rise[b] > rise[a]))
    result = np.empty_like(steepest)
    result[order] = steepest
    return result


def _steps(grid: CartesianGrid) -> npt.NDArray[np.int64]:
    """Return how much the number of a node grows along each axis."""
    return np.array([int(np.prod(grid.shape[a + 1 :])) for a in range(grid.dim)])


def _positions(grid: CartesianGrid, found: _Crossings) -> FloatArray:
    """Return the coordinates of crossings, float64[n, dim]."""
    steps = np.stack(np.unravel_index(found.node, grid.shape), axis=-1).astype(np.float64)
    steps[np.arange(len(steps)), found.axis] += found.place
    return grid.origin + grid.spacing * steps


def _checked_distance(grid: CartesianGrid, phi: npt.ArrayLike) -> FloatArray:
    if not isinstance(grid, CartesianGrid):
        raise ValueError(f"grid must be a CartesianGrid, got {describe(grid)}")
    values = as_float_array("phi", phi, grid.shape)
    counted = True if grid.active is None else grid.active
    refuse_where("phi", ~np.isfinite(values) & counted, values, "must be finite")
    if not ((values < 0.0) & counted).any():
        raise ValueError("phi must be negative at one node at least, inside the domain, got none")
    return values


def _checked_patches(grid: CartesianGrid, patches: npt.ArrayLike) -> npt.NDArray[np.int64]:
    raw = np.asarray(patches)
    if raw.dtype.kind not in "iu" or raw.shape != grid.shape:
        raise ValueError(
            f"patches must be integers of shape {grid.shape}, got {raw.dtype} of {raw.shape}"
        )
    return raw.astype(np.int64)


def _diameter_inside(grid: CartesianGrid, phi: FloatArray) -> float:
    """Return the diagonal of the box of the nodes inside the domain, a cell added."""
    inside = phi < 0.0
    if grid.active is not None:
        inside = inside & grid.active
    square = 0.0
    for axis in range(grid.dim):
        others = tuple(a for a in range(grid.dim) if a != axis)
        reached = np.flatnonzero(inside.any(axis=others))
        square += float((reached[-1] - reached[0] + 1) * grid.spacing[axis]) ** 2
    return float(np.sqrt(square))
