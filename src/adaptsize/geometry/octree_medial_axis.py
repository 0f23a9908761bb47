"""The medial axis of a boundary on the edges of an octree or a mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._checks import describe
from adaptsize.background import Octree, SimplexMesh
from adaptsize.geometry.closest_points import (
    Boundary,
    Depths,
    FunctionBoundary,
    OwnBoundary,
    SurfaceBoundary,
)
from adaptsize.geometry.grid_corners import Fronts, meet_at_corner
from adaptsize.geometry.medial_points import MedialAxis
from adaptsize.typing import FloatArray, ProgressCallback

# Least angle, in degrees, between the directions to the boundary unless another one is given.
SEPARATION_ANGLE = 40.0

# Edges looked at between two reports.
_EDGES_AT_ONCE = 200_000
# So often the part of an edge on which fronts meet is halved.
_HALVINGS = 8
# Ends of edges closer to the boundary than that, in lengths of the edge, have no direction; ...
_ON_BOUNDARY = 1e-6
# ... there it is looked for this far along the edge.
_OFF_BOUNDARY = 1.0 / 64.0
# A ball that touches the boundary twice is one of the medial axis if nothing is closer to its
# centre by more than this share of the radius, ...
_EMPTY = 0.1
# ... and if the centre is not farther from the edge than this, in lengths of the edge.
_ASIDE = 1.5


class Meetings(NamedTuple):
    """Where fronts meet, one entry for each point."""

    fronts: Fronts
    ends: npt.NDArray[np.int64]
    """Nodes of the edge, int64[n, 2]."""
    distances: FloatArray
    """How far the medial axis is from these nodes, float64[n, 2]."""


@dataclass(frozen=True)
class _Stretch:
    """Parts of edges, at the ends of which the boundary looks different."""

    ends: npt.NDArray[np.int64]
    """Nodes of the edge, int64[n, 2]."""
    start: FloatArray
    """float64[n, dim]."""
    way: FloatArray
    """From one end of the edge to the other, float64[n, dim]."""
    at: FloatArray
    """Where the part begins and ends, 0 to 1, float64[n, 2]."""
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
    separation: float,
    report: ProgressCallback,
) -> Meetings:
    """Return where fronts from different parts of a boundary meet, inside.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in the plane or tetrahedra.
    boundary : Boundary
    nodes : Depths
        What the nodes of the mesh see.
    separation : float
        Least angle between the directions to the boundary, in radians.
    report : callable

    Returns
    -------
    Meetings
        Where the directions jump, on the edge; where they turn fast, at the centre of the ball
        that touches the boundary on both sides, which may be off the edge by its length.
    """
    least = float(np.cos(separation))
    edges = mesh.edges
    found = []
    for first in range(0, len(edges), _EDGES_AT_ONCE):
        part = edges[first : first + _EDGES_AT_ONCE].astype(np.int64)
        stretch = _candidates(mesh, boundary, nodes, part, least)
        stretch = _narrowed(boundary, stretch, least)
        jumps = np.diff(stretch.at, axis=1)[:, 0] < 1.5 * 0.5**_HALVINGS
        found.append(_crossings(boundary, stretch.taken(jumps)))
        found.append(_centres(boundary, stretch.taken(~jumps)))
        report("finding the medial axis", min(1.0, (first + _EDGES_AT_ONCE) / len(edges)))
    return _joined(found)


def _joined(parts: list[Meetings]) -> Meetings:
    fronts = Fronts(*(np.concatenate(a) for a in zip(*(p.fronts for p in parts), strict=True)))
    return Meetings(
        fronts,
        np.concatenate([p.ends for p in parts]),
        np.concatenate([p.distances for p in parts]),
    )


def _candidates(
    mesh: SimplexMesh,
    boundary: Boundary,
    nodes: Depths,
    edges: npt.NDArray[np.int64],
    least: float,
) -> _Stretch:
    """Return the edges on which a ridge of the depth may lie inside."""
    start = mesh.points[edges[:, 0]]
    way = mesh.points[edges[:, 1]] - start
    length = np.linalg.norm(way, axis=1)
    depth = nodes.depth[edges]
    # Nothing inside is reached from both ends.
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
    # Outward at both ends: the depth has a ridge.  Inward: that of the outside has.
    ridge = (turn * way).sum(axis=1) > 0.0
    return stretch.taken(directed & ridge & (stretch.cosine <= least))


def _narrowed(boundary: Boundary, stretch: _Stretch, least: float) -> _Stretch:
    """Halve the parts of edges as long as the directions at their ends differ enough."""
    going = np.arange(len(stretch.ends))
    for _ in range(_HALVINGS):
        part = stretch.taken(going)
        middle = 0.5 * (part.at[:, 0] + part.at[:, 1])
        is_inside = np.asarray((part.depth > 0.0).all(axis=1))
        seen = boundary.seen_from(part.points(middle), is_inside)
        cosines = (part.outward * seen.outward[:, None, :]).sum(axis=2)
        first = cosines[:, 0] < cosines[:, 1]
        jumps = cosines.min(axis=1, initial=1.0) <= least
        going, first, middle = going[jumps], first[jumps], middle[jumps]
        side = np.where(first, 1, 0)
        stretch.at[going, side] = middle
        stretch.depth[going, side] = seen.depth[jumps]
        stretch.outward[going, side] = seen.outward[jumps]
    return stretch


def _crossings(boundary: Boundary, stretch: _Stretch) -> Meetings:
    """Return where, on edges, two fronts are equally far from the boundary."""
    # Depths fall in the direction outward.
    slopes = -(stretch.outward * stretch.way[:, None, :]).sum(axis=2)
    low, high = stretch.at.T
    gap = stretch.depth[:, 1] - stretch.depth[:, 0] - slopes[:, 1] * (high - low)
    at = np.clip(low + gap / (slopes[:, 0] - slopes[:, 1]), low, high)
    depth = stretch.depth[:, 0] + slopes[:, 0] * (at - low)
    points = stretch.points(at)
    normals = stretch.outward[:, 1] - stretch.outward[:, 0]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    across = np.abs((normals * stretch.way).sum(axis=1))
    distances = across[:, None] * np.column_stack([at, 1.0 - at])
    inside = (stretch.depth > 0.0).all(axis=1) & (depth > 0.0)
    fronts = Fronts(points, depth, stretch.outward)
    return Meetings(fronts.taken(inside), stretch.ends[inside], distances[inside])


def _centres(boundary: Boundary, stretch: _Stretch) -> Meetings:
    """Return the centres of balls that touch the boundary at the closest points of both ends."""
    feet = [
        stretch.points(stretch.at[:, side])
        + stretch.depth[:, side, None] * stretch.outward[:, side]
        for side in range(2)
    ]
    apart = stretch.outward[:, 0] - stretch.outward[:, 1]
    radii = ((feet[0] - feet[1]) * apart).sum(axis=1) / (apart**2).sum(axis=1)
    ways = radii[:, None] * stretch.outward.sum(axis=1)
    points = 0.5 * (feet[0] + feet[1] - ways)
    seen = boundary.seen_from(points)
    length = np.linalg.norm(stretch.way, axis=1)
    middle = stretch.points(stretch.at.mean(axis=1))
    good = (np.abs(seen.depth - radii) <= _EMPTY * radii) & (radii > 0.0)
    good &= np.linalg.norm(points - middle, axis=1) <= _ASIDE * length
    ends = np.stack([stretch.start, stretch.start + stretch.way], axis=1)
    distances = np.linalg.norm(ends - points[:, None, :], axis=2)
    fronts = Fronts(points, seen.depth, stretch.outward)
    return Meetings(fronts.taken(good), stretch.ends[good], distances[good])


def medial_axis_on_mesh(
    mesh: SimplexMesh,
    boundary: Boundary,
    nodes: Depths,
    separation_angle: float,
    corner_angle: float,
    report: ProgressCallback,
) -> MedialAxis:
    """Return the medial axis from what the nodes of a mesh see; angles in degrees."""
    if not (nodes.depth > 0.0).any() and not isinstance(boundary, OwnBoundary):
        raise ValueError("boundary must have nodes of the background in it, got none")
    found = find_meetings(mesh, boundary, nodes, np.radians(separation_angle), report)
    at_corner, apex = meet_at_corner(boundary.distance, 0.0, found.fronts, corner_angle)
    fronts, ends = found.fronts.taken(~at_corner), found.ends[~at_corner]
    normals = fronts.directions[:, 0] - fronts.directions[:, 1]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    distances = np.full(mesh.n_points, np.inf)
    np.minimum.at(distances, ends, found.distances[~at_corner])
    return MedialAxis(
        points=fronts.points,
        normals=normals,
        radii=fronts.radii,
        angles=np.degrees(np.arccos(np.clip(fronts.cosine, -1.0, 1.0))),
        distances=distances,
        corners=apex[at_corner],
    )


def boundary_on(background: object, boundary: object) -> tuple[SimplexMesh, Boundary]:
    """Return the mesh of an octree or a mesh, and a boundary to be asked, after a look at both."""
    if not isinstance(background, Octree | SimplexMesh):
        raise ValueError(
            "background must be a CartesianGrid, an Octree or a SimplexMesh, "
            f"got {describe(background)}"
        )
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
