"""The medial axis of a boundary on the edges of an octree or a mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._checks import check_type, describe
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.geometry.distance.closest_points import (
    Boundary,
    Depths,
    FunctionBoundary,
    OwnBoundary,
    SurfaceBoundary,
)
from adaptsize.geometry.medial.grid_corners import Fronts, meet_at_corner
from adaptsize.geometry.medial.points import MedialAxis
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback

# Default of the smallest angle, in degrees, between the directions to the boundary.
SEPARATION_ANGLE = 40.0

# Edges processed between two progress reports.
_EDGES_AT_ONCE = 200_000
# Number of bisections of the part of an edge on which fronts meet.
_HALVINGS = 8
# Ends of edges closer to the boundary, in lengths of the edge, have no direction; ...
_ON_BOUNDARY = 1e-6
# ... it is evaluated at this offset along the edge instead.
_OFF_BOUNDARY = 1.0 / 64.0
# Smallest relative difference between the rates of two depths along an edge.
_ROUNDING = 1e-12
# Range of the inward search from an edge on which directions turn rapidly, in edge lengths.
_FARTHEST = 2.0
# If the sine of the angle between an end of an edge and the normal of a point is smaller, the
# distance of the end from the medial axis is that from the point; ...
_ASIDE = 0.02
# ... for other ends the axis is searched for at their foot, with this relative offset.
_ACROSS = 0.125
# Directions at the ends of the last part of an edge are those of a point if its radius is this
# share of the edge at least, sixteen times that part.
_RESOLVED = 1.0 / 16.0
# If both feet are at most this number of radii away from a vertex, they are on its edges; the feet
# on a vertex and a wall are farther apart by a factor of the square root of 2.
_BESIDE = 1.2


class Meetings(NamedTuple):
    """Points where fronts meet."""

    fronts: Fronts
    ends: npt.NDArray[np.int64]
    """Nodes of the edge from which each point was found, int64[n, 2]."""

    def taken(self, which: BoolArray) -> Meetings:
        """Return some of the points."""
        return Meetings(self.fronts.taken(which), self.ends[which])

    @property
    def normals(self) -> FloatArray:
        """Unit normals of the medial axis, of either sign, float64[n, dim]."""
        across = self.fronts.directions[:, 0] - self.fronts.directions[:, 1]
        return np.asarray(across / np.linalg.norm(across, axis=1)[:, None])


@dataclass(frozen=True)
class _Stretch:
    """Parts of edges whose ends have different directions to the boundary."""

    ends: npt.NDArray[np.int64]
    """Nodes of the edge, int64[n, 2]."""
    start: FloatArray
    """float64[n, dim]."""
    way: FloatArray
    """Vector from one end of the edge to the other, float64[n, dim]."""
    at: FloatArray
    """Start and end of the part, 0 to 1, float64[n, 2]."""
    depth: FloatArray
    """float64[n, 2]."""
    outward: FloatArray
    """float64[n, 2, dim]."""

    def taken(self, which: npt.NDArray[Any]) -> _Stretch:
        return replace(self, **{name: value[which] for name, value in vars(self).items()})

    def points(self, at: FloatArray) -> FloatArray:
        """Return points of the edges, float64[n, dim]."""
        return np.asarray(self.start + at[:, None] * self.way)

    @property
    def cosine(self) -> FloatArray:
        """Of the angle between the directions at the ends."""
        return np.asarray((self.outward[:, 0] * self.outward[:, 1]).sum(axis=1))


def find_meetings(
    mesh: SimplexMesh,
    boundary: Boundary,
    nodes: Depths,
    least: float,
    report: ProgressCallback,
) -> Meetings:
    """Return the points inside where fronts from different parts of a boundary meet.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in the plane or tetrahedra.
    boundary : Boundary
    nodes : Depths
        Depths of the nodes of the mesh.
    least : float
        Cosine of the smallest angle between the directions to the boundary.
    report : callable

    Returns
    -------
    Meetings
        Points on edges where the directions jump, and off edges where they only turn rapidly.
    """
    edges = mesh.edges
    found = []
    for first in range(0, len(edges), _EDGES_AT_ONCE):
        part = edges[first : first + _EDGES_AT_ONCE].astype(np.int64)
        stretch = _candidates(mesh, boundary, nodes, part, least)
        stretch = _narrowed(boundary, stretch, least)
        jumps = _has_jump(stretch)
        found.append(_crossings(stretch.taken(jumps)))
        found.append(_beside(boundary, stretch.taken(~jumps), least))
        report("finding the medial axis", min(1.0, (first + _EDGES_AT_ONCE) / len(edges)))
    return _joined(found)


def _joined(parts: list[Meetings]) -> Meetings:
    fronts = Fronts(*(np.concatenate(a) for a in zip(*(p.fronts for p in parts), strict=True)))
    return Meetings(fronts, np.concatenate([p.ends for p in parts]))


def _candidates(
    mesh: SimplexMesh,
    boundary: Boundary,
    nodes: Depths,
    edges: npt.NDArray[np.int64],
    least: float,
) -> _Stretch:
    """Return the edges on which the depth may have a ridge inside."""
    start = mesh.points[edges[:, 0]]
    way = mesh.points[edges[:, 1]] - start
    length = np.linalg.norm(way, axis=1)
    depth = nodes.depth[edges]
    # Discard edges on which both ends reach no inside point.
    reaches = (depth > 0.0).any(axis=1) | (-depth.sum(axis=1) <= length)
    edges, start, way, length, depth = (
        array[reaches] for array in (edges, start, way, length, depth)
    )
    at = np.tile([0.0, 1.0], (len(edges), 1))
    stretch = _Stretch(edges, start, way, at, depth, nodes.outward[edges])
    for side in range(2):
        blind = np.flatnonzero(np.abs(depth[:, side]) <= _ON_BOUNDARY * length)
        if len(blind):
            stretch.at[blind, side] += _OFF_BOUNDARY * (1.0 - 2.0 * side)
            seen = boundary.seen_from(stretch.taken(blind).points(stretch.at[blind, side]))
            stretch.depth[blind, side], stretch.outward[blind, side] = seen
    directed = (np.abs(stretch.depth) > _ON_BOUNDARY * length[:, None]).all(axis=1)
    turn = stretch.outward[:, 1] - stretch.outward[:, 0]
    # Outward at both ends: the depth has a ridge.  Inward: the outside has one.
    ridge = (turn * way).sum(axis=1) > 0.0
    return stretch.taken(directed & ridge & (stretch.cosine <= least))


def _narrowed(boundary: Boundary, stretch: _Stretch, least: float) -> _Stretch:
    """Bisect the parts of edges (In/Out) while the directions at their ends differ enough."""
    going = np.arange(len(stretch.ends))
    for _ in range(_HALVINGS):
        part = stretch.taken(going)
        middle = 0.5 * (part.at[:, 0] + part.at[:, 1])
        is_inside = np.asarray((part.depth > 0.0).all(axis=1))
        seen = boundary.seen_from(part.points(middle), is_inside)
        near = _ON_BOUNDARY * np.linalg.norm(part.way, axis=1)
        blind = np.flatnonzero(np.abs(seen.depth) <= near)
        if len(blind):  # on the boundary there is no direction; move off it
            middle[blind] += _OFF_BOUNDARY * np.diff(part.at[blind], axis=1)[:, 0]
            beside = boundary.seen_from(part.points(middle)[blind])
            seen.depth[blind], seen.outward[blind] = beside
        cosines = (part.outward * seen.outward[:, None, :]).sum(axis=2)
        first = cosines[:, 0] < cosines[:, 1]
        jumps = cosines.min(axis=1, initial=1.0) <= least
        going, first, middle = going[jumps], first[jumps], middle[jumps]
        side = np.where(first, 1, 0)
        stretch.at[going, side] = middle
        stretch.depth[going, side] = seen.depth[jumps]
        stretch.outward[going, side] = seen.outward[jumps]
    return stretch


def _crossings(stretch: _Stretch) -> Meetings:
    """Return the points where the depths of two fronts are equal."""
    # Depths decrease in the outward direction.
    slopes = -(stretch.outward * stretch.way[:, None, :]).sum(axis=2)
    low, high = stretch.at.T
    gap = stretch.depth[:, 1] - stretch.depth[:, 0] - slopes[:, 1] * (high - low)
    bend = slopes[:, 0] - slopes[:, 1]
    # An edge along the axis meets it everywhere; take the midpoint.
    on_axis = bend <= _ROUNDING * np.abs(slopes).max(axis=1, initial=0.0)
    at = np.clip(low + gap / np.where(on_axis, 1.0, bend), low, high)
    at[on_axis] = 0.5 * (low + high)[on_axis]
    depth = stretch.depth[:, 0] + slopes[:, 0] * (at - low)
    inside = (stretch.depth > 0.0).all(axis=1) & (depth > 0.0)
    fronts = Fronts(stretch.points(at), depth, stretch.outward)
    return Meetings(fronts, stretch.ends).taken(np.asarray(inside))


def _beside(boundary: Boundary, stretch: _Stretch, least: float) -> Meetings:
    """Return points where fronts meet, inward from where directions turn rapidly.

    The normal of the boundary leads to the centre of curvature.  Its distance is one length of the
    edge if the directions turn by one radian on the edge.  The medial axis lies between.
    """
    middle = stretch.points(stretch.at.mean(axis=1))
    seen = boundary.seen_from(middle)
    length = np.linalg.norm(stretch.way, axis=1)
    inside = seen.depth > 0.0
    way = -_FARTHEST * length[:, None] * seen.outward
    return _on_the_way(
        boundary,
        stretch.ends[inside],
        middle[inside],
        way[inside],
        Depths(seen.depth[inside], seen.outward[inside]),
        least,
    )


def _beyond_corners(
    points: FloatArray, boundary: Boundary, corners: Meetings, least: float
) -> Meetings:
    """Return points where the two fronts of a corner meet a third: the rim of the medial axis.

    The rim lies on the ray from the corner through a meeting point.  The ray is followed slightly
    to either side, where only one of the two fronts is the nearest.
    """
    fronts, normals = corners.fronts, corners.normals
    length = np.linalg.norm(np.diff(points[corners.ends], axis=1)[:, 0], axis=1)
    inward = -fronts.directions.sum(axis=1)
    inward /= np.linalg.norm(inward, axis=1)[:, None]
    found = []
    for side in range(2):
        aside = (1.0 - 2.0 * side) * _OFF_BOUNDARY * length
        start = fronts.points + aside[:, None] * normals
        outward = fronts.directions[:, side]
        # On its own side, the depth below a plane front changes by the sideways step.
        depth = fronts.radii - aside * (normals * outward).sum(axis=1)
        way = _FARTHEST * length[:, None] * inward
        good = depth > 0.0
        seen = Depths(depth[good], outward[good])
        found.append(_on_the_way(boundary, corners.ends[good], start[good], way[good], seen, least))
    return _joined(found)


def _on_the_way(
    boundary: Boundary,
    ends: npt.NDArray[np.int64],
    start: FloatArray,
    way: FloatArray,
    seen: Depths,
    least: float,
) -> Meetings:
    """Return the first points on rays, from points with one front, where another front is met."""
    # The ball around an inside point is inside.
    far = boundary.seen_from(start + way, np.linalg.norm(way, axis=1) < seen.depth)
    depth = np.column_stack([seen.depth, far.depth])
    outward = np.stack([seen.outward, far.outward], axis=1)
    ray = _Stretch(ends, start, way, np.tile([0.0, 1.0], (len(ends), 1)), depth, outward)
    ray = _narrowed(boundary, ray.taken(ray.cosine <= least), least)
    return _crossings(ray.taken(_has_jump(ray)))


def _has_jump(stretch: _Stretch) -> BoolArray:
    """Return on which parts the directions still differ after all bisections."""
    return np.asarray(np.diff(stretch.at, axis=1)[:, 0] < 1.5 * 0.5**_HALVINGS)


def _distances(points: FloatArray, boundary: Boundary, found: Meetings, least: float) -> FloatArray:
    """Return the distances of the ends of the edges from the medial axis, float64[n, 2].

    This is the distance from the tangent plane of the axis if the axis continues in that plane up
    to the foot of the end, that is, if directions jump there as well.  Otherwise it is the
    distance from the point.
    """
    normals = found.normals[:, None, :]
    away = points[found.ends] - found.fronts.points[:, None, :]
    across = (away * normals).sum(axis=2)
    along = away - across[:, :, None] * normals
    distances = np.linalg.norm(away, axis=2)
    aside = np.linalg.norm(along, axis=2)
    oblique = np.nonzero(aside > _ASIDE * distances)
    foot = (found.fronts.points[:, None, :] + along)[oblique]
    off = _ACROSS * aside[oblique][:, None] * normals[oblique[0], 0]
    is_inside = (1.0 + _ACROSS) * aside[oblique] < found.fronts.radii[oblique[0]]
    sides = [boundary.seen_from(foot + sign * off, is_inside) for sign in (-1.0, 1.0)]
    turn = sides[1].outward - sides[0].outward
    goes_on = (sides[0].outward * sides[1].outward).sum(axis=1) <= least
    goes_on &= (turn * off).sum(axis=1) > 0.0
    goes_on &= (sides[0].depth > 0.0) & (sides[1].depth > 0.0)
    distances[oblique] = np.where(goes_on, np.abs(across[oblique]), distances[oblique])
    return np.asarray(distances)


def _at_vertex(
    points: FloatArray, boundary: Boundary, found: Meetings, corner_angle: float
) -> BoolArray:
    """Return which points to drop: at edges that meet in a vertex, unresolved, or outside.

    Where reentrant edges meet, as at the corners of a rib on a plate, fronts come from edges;
    tangent planes do not detect these corners.
    """
    from scipy.spatial import cKDTree

    fronts = found.fronts
    edge = np.linalg.norm(np.diff(points[found.ends], axis=1)[:, 0], axis=1)
    dropped = fronts.radii < _RESOLVED * edge
    if len(boundary.vertices) and len(fronts.radii):
        vertex = boundary.vertices[cKDTree(boundary.vertices).query(fronts.points)[1]]
        away = np.linalg.norm(fronts.feet() - vertex[:, None, :], axis=2)
        dropped |= (away <= _BESIDE * fronts.radii[:, None]).all(axis=1)
    dropped &= fronts.cosine > -np.cos(np.radians(corner_angle))
    # If an edge leaves the domain between two inside points, directions reverse at the boundary.
    small = np.flatnonzero(fronts.radii < _RESOLVED * edge)
    for side in range(2):
        half_way = fronts.feet(0.5)[small, side]
        dropped[small] |= boundary.seen_from(half_way).depth <= 0.0
    return np.asarray(dropped)


def medial_axis_on_mesh(
    mesh: SimplexMesh,
    boundary: Boundary,
    nodes: Depths,
    separation_angle: float,
    corner_angle: float,
    report: ProgressCallback,
) -> MedialAxis:
    """Return the medial axis, given the depths of the nodes of a mesh; angles in degrees."""
    # Below 1, as the normal of the axis is a difference of directions.
    least = min(float(np.cos(np.radians(separation_angle))), 1.0 - _ROUNDING)
    found = find_meetings(mesh, boundary, nodes, least, report)
    if len(found.ends) == 0 and not (nodes.depth > 0.0).any():
        raise ValueError("boundary must have a node or an edge of the background in it, got none")
    meet, apex = meet_at_corner(boundary.distance, 0.0, found.fronts, corner_angle)
    at_corner = meet | _at_vertex(mesh.points, boundary, found, corner_angle)
    rim = _beyond_corners(mesh.points, boundary, found.taken(at_corner), least)
    in_corner = meet_at_corner(boundary.distance, 0.0, rim.fronts, corner_angle)[0]
    in_corner |= _at_vertex(mesh.points, boundary, rim, corner_angle)
    found = _joined([found.taken(~at_corner), rim.taken(~in_corner)])
    fronts = found.fronts
    distances = np.full(mesh.n_points, np.inf)
    np.minimum.at(distances, found.ends, _distances(mesh.points, boundary, found, least))
    return MedialAxis(
        points=fronts.points,
        normals=found.normals,
        radii=fronts.radii,
        angles=np.degrees(np.arccos(np.clip(fronts.cosine, -1.0, 1.0))),
        distances=distances,
        corners=apex[meet],
    )


def boundary_on(background: object, boundary: object) -> tuple[SimplexMesh, Boundary]:
    """Return the mesh of an octree or a mesh, and the boundary, both checked."""
    check_type("background", background, SimplexMesh, CartesianGrid, Octree)
    assert isinstance(background, SimplexMesh | Octree)  # grids are handled elsewhere
    mesh = background.mesh if isinstance(background, Octree) else background
    if mesh.cell_dim < mesh.dim or mesh.dim == 1:
        raise ValueError(
            f"background must have triangles in the plane or tetrahedra, got {background!r}"
        )
    if boundary is None and isinstance(background, SimplexMesh):
        return mesh, OwnBoundary(mesh)
    if isinstance(boundary, SimplexMesh):
        if boundary.dim != mesh.dim or boundary.cell_dim != mesh.dim - 1:
            kind = "segments" if mesh.dim == 2 else "triangles"
            raise ValueError(f"boundary must consist of {kind} in {mesh.dim}-D, got {boundary!r}")
        return mesh, SurfaceBoundary(boundary)
    if callable(boundary):
        return mesh, FunctionBoundary(boundary, background.diagonal)
    raise ValueError(
        "boundary must be a SimplexMesh or a function that gives distances anywhere; distances at "
        f"nodes are for a CartesianGrid, got {describe(boundary)} for {background!r}"
    )
