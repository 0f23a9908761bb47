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
    RESOLVED,
    Fronts,
    come_from_boundary,
    look_half_way,
    meet_at_corner,
    rounding_of_patches,
)
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback

# Smallest curvature that is resolved, times the diameter of the part.
_CURVATURE_TIMES_DIAMETER = 4.0

# A gradient shorter than that, where a distance has one of length 1, has no direction.
_DIRECTED = 0.5

# Directions must differ by this much, in radians, to have a normal between them.
_LEAST_TURN = 1e-3

# Turn of the boundary at a corner, in degrees, from which on its place is told.
_SHARP = 20.0

# Crossings up to here from the boundary tell where corners are, in spacings.
_WITNESS = 12.0

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
        Where the boundary has corners of which crossings close to it come, one for each of these
        crossings: many for one corner, and in space points of sharp edges.
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
        return f"MedialAxis({len(self.points)} points)"


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
    r"""Return where the fronts of a distance function meet inside the domain.

    Algorithm 1 of [1]_.  Along each edge of the grid one parabola is laid through the distance
    at three nodes on either side; a point is where they cross, if the second one is steeper
    throughout, and the gradients on both sides differ by more than the curvature of
    the fronts explains,

    .. math:: \nabla\phi_i \cdot \nabla\phi_{i+1}
              < 1 - \tfrac12 \gamma^2 \max(\kappa_{i-1}, \kappa_{i+2}, \kappa_{tol})^2 \Delta x^2 .

    Points between two pieces of the boundary that meet at a corner are left out: there the
    medial axis reaches the boundary, and a feature size from it would vanish.

    Parameters
    ----------
    grid : CartesianGrid
        Any spacing for each axis; inactive nodes count as missing.
    phi : array_like of float, of the shape of the grid
        Signed distance from the boundary, negative inside; exact to well below a spacing at three
        nodes on either side of the medial axis.
    curvature_tolerance : float, optional
        Smallest curvature that is resolved, 1 / length, >= 0.  Flatter angles between
        fronts than ``gamma * curvature_tolerance * spacing`` (in radians) are not
        found.  By default 4 over the diameter of the part.
    gamma : float, optional
        Factor on curvatures, > 0, which makes up for their being taken a node away, and for
        one-sided gradients being as of nodes two spacings apart; below 2 smooth
        fronts are taken for crossings, above it more points are missing.
    patches : array_like of int, of the shape of the grid, optional
        Which smooth piece of the boundary is next to each node.  Only pieces that meet
        have corners then, and they may be rounded off by more.  Without it corners are found
        from the distance alone.
    corner_angle : float, optional
        Least angle between two pieces inside the domain, in degrees, 0 to 180, from which on
        they form a corner; a smaller one is a narrow place.
    progress : callable or bool, optional
        Called with a text and the share done; True shows a bar on a terminal.
        Raising in it (or Ctrl-C) stops the work.

    Returns
    -------
    MedialAxis
        Points, normals, radii and angles; and the distances at the nodes next to them.

    Raises
    ------
    ValueError
        If a shape is wrong, phi is not finite at an active node or nowhere negative, or an
        option is out of its range.

    See Also
    --------
    feature_size : the local feature size from it.

    Notes
    -----
    Points lie within 0.001 to 0.3 spacings of surfaces of the medial axis (third order between
    smooth fronts), within 1.2 of curves in space and points in the plane.  Some are missing, most
    of all where two surfaces of the axis meet, at its rim, and where it is as steep as an
    edge is long; no attempt is made to link them up.  The centre of a ball, a single point, may
    fall between the edges; `feature_size` knows it by its depth.

    Gradients are one-sided differences, on the side with the smaller second difference, since
    the upwind side crosses the axis.  The directions of both fronts are then looked up again half
    way to the boundary.  Two pieces form a corner if the boundary follows their tangents up to
    where these meet.  Less than three spacings from the boundary no corner is resolved: there
    points count only between walls that form no corner at all.

    O(n) time: two seconds for 256^3 nodes; 16 bytes per node besides phi.

    References
    ----------
    .. [1] P.-O. Persson, "Mesh size functions for implicit geometries and PDE-based
       gradient limiting", Engineering with Computers 22 (2006) 95-109, section 4.

    Examples
    --------
    The medial axis of a ring of radii 1 and 2 is the circle of radius 1.5:

    >>> import numpy as np
    >>> grid = CartesianGrid.around([[-2.0, -2.0], [2.0, 2.0]], spacing=0.1, margin=0.2)
    >>> radius = np.linalg.norm(grid.points, axis=1).reshape(grid.shape)
    >>> medial = medial_axis(grid, np.maximum(1.0 - radius, radius - 2.0))
    >>> bool(np.allclose(np.linalg.norm(medial.points, axis=1), 1.5, atol=1e-3))
    True
    >>> bool(np.allclose(medial.radii, 0.5, atol=1e-3))
    True
    """
    values, tolerance = checked_distance(grid, phi), curvature_tolerance
    if tolerance is None:
        tolerance = _CURVATURE_TIMES_DIAMETER / _diameter_inside(grid, values)
    tolerance = as_number("curvature_tolerance", tolerance, lower=0.0)
    gamma = as_number("gamma", gamma, lower=0.0, strict=True)
    angle = as_number("corner_angle", corner_angle, lower=0.0)
    if angle > 180.0:
        raise ValueError(f"corner_angle must be 0 to 180 degrees, got {angle:g}")
    pieces = None if patches is None else _checked_patches(grid, patches)
    with reporting(progress) as report:
        found = _find(grid, values, tolerance, gamma, report)
    found = found.taken(_is_steepest(grid, found))
    length = np.linalg.norm(found.gradients, axis=2)
    directed = (length > _DIRECTED).all(axis=1)
    found, length = found.taken(directed), length[directed]
    unit = found.gradients / length[:, :, None]
    fronts = look_half_way(grid, values, Fronts(_positions(grid, found), found.depth, unit))
    turned = max(gamma * tolerance * float(grid.spacing.max()), _LEAST_TURN)
    sound = (fronts.cosine < 1.0 - 0.5 * turned**2) & come_from_boundary(grid, values, fronts)
    found, fronts = found.taken(sound), fronts.taken(sound)
    rounded = None
    if pieces is not None:
        rounded = rounding_of_patches(grid, values, pieces, *_nodes_beside(grid, found))
    at_corner, apex = meet_at_corner(grid, values, fronts, angle, rounded)
    # Seen from farther away, or flatter, a smooth boundary may look like a corner.
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
        # Of two as steep, those of a crossing at a node, the first stays.
        steepest[b] &= ~(same & (place[a] >= here[b] - 2) & (rise[a] >= rise[b]))
        steepest[a] &= ~(same & (place[b] <= here[a] + 3) & (rise[b] > rise[a]))
    result = np.empty_like(steepest)
    result[order] = steepest
    return result


def _steps(grid: CartesianGrid) -> npt.NDArray[np.int64]:
    """Return how much the number of a node grows along each axis."""
    return np.array([int(np.prod(grid.shape[a + 1 :])) for a in range(grid.dim)])


def _nodes_beside(
    grid: CartesianGrid, found: _Crossings
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the nodes one off the edges of crossings, which lie clearly on either side."""
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


def checked_distance(grid: CartesianGrid, phi: npt.ArrayLike) -> FloatArray:
    """Return a signed distance at the nodes of a grid, finite, and negative somewhere."""
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
