"""The feature size inside the zero level of a function, on a mesh such as that of an octree.

On and near the edges of the mesh, points of the medial axis are found, where two fronts meet.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from adaptsize._defaults import CORNER_ANGLE
from adaptsize.background import SimplexMesh
from adaptsize.background.topology import components_of
from adaptsize.geometry.distance.closest_points import Boundary, Depths
from adaptsize.geometry.distance.fast_marching import march_through_mesh
from adaptsize.geometry.medial.fronts import Fronts, Rows, meet_at_corner
from adaptsize.typing import BoolArray, FloatArray, IndexArray, LongArray, ProgressCallback

# Cosine of the smallest angle, 40 degrees, between the directions to the boundary.
_LEAST = float(np.cos(np.radians(40.0)))

# Edges processed between two progress reports.
_EDGES_AT_ONCE = 200_000
# Number of bisections of the part of an edge on which fronts meet.
_HALVINGS = 8
# Points of edges closer to the boundary, in lengths of the edge, have no direction; ...
_NO_DIRECTION = 1e-6
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


@dataclass(frozen=True)
class DomainOnMesh:
    """The region inside a boundary, and a mesh that need not conform to it.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in the plane or tetrahedra.
    boundary : Boundary
    nodes : Depths
        Depths of the nodes of the mesh.
    report : callable
    """

    mesh: SimplexMesh
    boundary: Boundary
    nodes: Depths
    report: ProgressCallback

    @cached_property
    def inside(self) -> BoolArray:
        """Which nodes are inside or on the boundary."""
        # Nodes closer to the boundary, in diagonals of the background, are on it.
        return np.asarray(self.nodes.depth >= -1e-12 * self.mesh.diagonal)

    def _fronts(self) -> Fronts:
        """Return points of the medial axis."""
        found = self._find_fronts()
        dropped = self._at_corners(found)
        rim = self._beyond_corners(found.taken(dropped))
        return Fronts.joined([found.taken(~dropped), rim.taken(~self._at_corners(rim))])

    def _find_fronts(self) -> Fronts:
        """Return the points inside where fronts from different parts of the boundary meet.

        They are on edges where the directions jump, and off edges where they only turn rapidly.
        """
        edges, found = self.mesh.edges, []
        for first in range(0, len(edges), _EDGES_AT_ONCE):
            parts = self._candidates(edges[first : first + _EDGES_AT_ONCE].astype(np.int64))
            self._narrow(parts)
            found.append(_equidistant(parts.taken(parts.has_jump)))
            found.append(self._inward(parts.taken(~parts.has_jump)))
            share = min(1.0, (first + _EDGES_AT_ONCE) / len(edges))
            self.report("finding the medial axis", share)
        return Fronts.joined(found)

    def _candidates(self, edges: LongArray) -> _Parts:
        """Return the edges on which the depth may have a ridge inside."""
        start, end = self.mesh.points[edges.T]
        at = np.tile([0.0, 1.0], (len(edges), 1))
        depth, outward = self.nodes.depth[edges], self.nodes.outward[edges]
        parts = _Parts(edges, start, end - start, at, depth, outward)
        # Discard edges on which both ends reach no inside point.
        parts = parts.taken((depth > 0.0).any(axis=1) | (-depth.sum(axis=1) <= parts.length))
        for side in range(2):
            offset = np.full(len(parts.at), _OFF_BOUNDARY * (1.0 - 2.0 * side))
            seen = Depths(parts.depth[:, side], parts.outward[:, side])
            self._leave_boundary(parts, parts.at[:, side], offset, seen)
        directed = (np.abs(parts.depth) > _NO_DIRECTION * parts.length[:, None]).all(axis=1)
        turn = parts.outward[:, 1] - parts.outward[:, 0]
        # Outward at both ends: the depth has a ridge.  Inward: the outside has one.
        ridge = (turn * parts.way).sum(axis=1) > 0.0
        return parts.taken(directed & ridge & (parts.cosine <= _LEAST))

    def _leave_boundary(
        self, parts: _Parts, at: FloatArray, offset: FloatArray, seen: Depths
    ) -> None:
        """Move positions on edges and what is seen there (In/Out) off the boundary."""
        blind = np.flatnonzero(np.abs(seen.depth) <= _NO_DIRECTION * parts.length)
        if len(blind):
            at[blind] += offset[blind]
            beside = self.boundary.seen_from(parts.points(at)[blind])
            seen.depth[blind], seen.outward[blind] = beside

    def _narrow(self, parts: _Parts) -> None:
        """Bisect parts of edges (In/Out) while the directions at their ends differ enough."""
        going = np.arange(len(parts.ends))
        for _ in range(_HALVINGS):
            part = parts.taken(going)
            middle = 0.5 * (part.at[:, 0] + part.at[:, 1])
            seen = self.boundary.seen_from(part.points(middle))
            offset = _OFF_BOUNDARY * np.diff(part.at, axis=1)[:, 0]
            self._leave_boundary(part, middle, offset, seen)
            cosines = (part.outward * seen.outward[:, None, :]).sum(axis=2)
            first = cosines[:, 0] < cosines[:, 1]
            jumps = cosines.min(axis=1, initial=1.0) <= _LEAST
            going, first, middle = going[jumps], first[jumps], middle[jumps]
            side = np.where(first, 1, 0)
            parts.at[going, side] = middle
            parts.depth[going, side] = seen.depth[jumps]
            parts.outward[going, side] = seen.outward[jumps]

    def _inward(self, parts: _Parts) -> Fronts:
        """Return points where fronts meet, inward from where directions turn rapidly.

        The normal of the boundary leads to the centre of curvature.  Its distance is one length of
        the edge if the directions turn by one radian on the edge.  The medial axis lies between.
        """
        start = parts.points(parts.at.mean(axis=1))
        seen = self.boundary.seen_from(start)
        way = -_FARTHEST * parts.length[:, None] * seen.outward
        return self._on_rays(parts.ends, start, way, seen)

    def _beyond_corners(self, corners: Fronts) -> Fronts:
        """Return points where the two fronts of a corner meet a third: the rim of the medial axis.

        The rim lies on the ray from the corner through a meeting point.  The ray is followed
        slightly to either side, where only one of the two fronts is the nearest.
        """
        normals = corners.normals
        length = self._edge_lengths(corners)
        inward = -corners.directions.sum(axis=1)
        inward /= np.linalg.norm(inward, axis=1)[:, None]
        way = _FARTHEST * length[:, None] * inward
        found = []
        for side in range(2):
            aside = (1.0 - 2.0 * side) * _OFF_BOUNDARY * length
            start = corners.points + aside[:, None] * normals
            outward = corners.directions[:, side]
            # On its own side, the depth below a plane front changes by the sideways step.
            depth = corners.radii - aside * (normals * outward).sum(axis=1)
            found.append(self._on_rays(corners.ends, start, way, Depths(depth, outward)))
        return Fronts.joined(found)

    def _on_rays(self, ends: LongArray, start: FloatArray, way: FloatArray, seen: Depths) -> Fronts:
        """Return the first points on rays from inside points where another front is met."""
        far = self.boundary.seen_from(start + way)
        depth = np.column_stack([seen.depth, far.depth])
        outward = np.stack([seen.outward, far.outward], axis=1)
        rays = _Parts(ends, start, way, np.tile([0.0, 1.0], (len(ends), 1)), depth, outward)
        rays = rays.taken((seen.depth > 0.0) & (rays.cosine <= _LEAST))
        self._narrow(rays)
        return _equidistant(rays.taken(rays.has_jump))

    def _edge_lengths(self, fronts: Fronts) -> FloatArray:
        """Return the lengths of the edges from which fronts were found, float64[n]."""
        way = np.diff(self.mesh.points[fronts.ends], axis=1)[:, 0]
        return np.asarray(np.linalg.norm(way, axis=1))

    def _at_corners(self, fronts: Fronts) -> BoolArray:
        """Return which points to drop: at corners, unresolved, or outside."""
        meet, _ = meet_at_corner(self.boundary.distance, 0.0, fronts, CORNER_ANGLE)
        # Directions at the ends of the last part of an edge are those of a point if its radius is
        # this share of the edge at least, sixteen times that part.
        small = fronts.radii < (1.0 / 16.0) * self._edge_lengths(fronts)
        dropped = small & (fronts.cosine > -np.cos(np.radians(CORNER_ANGLE)))
        # If an edge leaves the domain between two inside points, directions reverse there.
        for side in range(2):
            half_way = fronts.feet(0.5)[small, side]
            dropped[small] |= self.boundary.seen_from(half_way).depth <= 0.0
        return np.asarray(meet | dropped)

    def _distances(self, fronts: Fronts) -> FloatArray:
        """Return the distances of the ends of the edges from the medial axis, float64[n, 2].

        This is the distance from the tangent plane of the axis if the axis continues in that plane
        up to the foot of the end, that is, if directions jump there as well.  Otherwise it is the
        distance from the point.
        """
        normals = fronts.normals[:, None, :]
        away = self.mesh.points[fronts.ends] - fronts.points[:, None, :]
        across = (away * normals).sum(axis=2)
        along = away - across[:, :, None] * normals
        distances = np.linalg.norm(away, axis=2)
        aside = np.linalg.norm(along, axis=2)
        oblique = np.nonzero(aside > _ASIDE * distances)
        foot = (fronts.points[:, None, :] + along)[oblique]
        off = _ACROSS * aside[oblique][:, None] * normals[oblique[0], 0]
        sides = [self.boundary.seen_from(foot + sign * off) for sign in (-1.0, 1.0)]
        turn = sides[1].outward - sides[0].outward
        goes_on = (sides[0].outward * sides[1].outward).sum(axis=1) <= _LEAST
        goes_on &= (turn * off).sum(axis=1) > 0.0
        goes_on &= (sides[0].depth > 0.0) & (sides[1].depth > 0.0)
        distances[oblique] = np.where(goes_on, np.abs(across[oblique]), distances[oblique])
        return np.asarray(distances)

    def sizes_inside(self) -> tuple[FloatArray, InnerCells, FloatArray]:
        """Return the local feature size at the nodes of the mesh, and at those of its cells inside.

        Returns
        -------
        size : float64[mesh.n_points]
            The smallest if a node outside has several copies; inf if it has none.
        inner : InnerCells
        of_inner : float64[inner.mesh.n_points]
            The size at the nodes of the inner cells.
        """
        fronts, seeds = self._fronts(), np.full(self.mesh.n_points, np.inf)
        np.minimum.at(seeds, fronts.ends, self._distances(fronts))
        centres = self._add_deepest(seeds)
        size = np.where(self.inside, np.inf, seeds + self.nodes.depth)
        inner = _inner_cells(self.mesh, self.inside)
        depth = self.nodes.depth[inner.nodes]
        marched = depth + self._from_axis(inner, seeds, fronts, centres)
        _bound_outside(inner, marched)
        np.minimum.at(size, inner.nodes, marched)
        return size, inner, marched

    def _from_axis(
        self, inner: InnerCells, seeds: FloatArray, fronts: Fronts, centres: FloatArray
    ) -> FloatArray:
        """Return the distances of nodes from the medial axis and from centres of balls.

        Paths of marching bend in large cells.  The straight distance of a point is used if it is
        one within the domain: the balls around the node and the point must nearly overlap.
        """
        from scipy.spatial import cKDTree

        starts = np.where(inner.inside, seeds[inner.nodes], np.inf)
        text = "marching from the medial axis"
        marched = march_through_mesh(inner.mesh, starts, report=self.report, text=text)
        points = np.concatenate([fronts.points, centres])
        if len(points):
            radii = np.concatenate([fronts.radii, self.boundary.distance(centres)])
            straight, nearest = cKDTree(points).query(inner.mesh.points)
            # The segment between a node and a point of the medial axis is assumed to be in the
            # domain if the balls around them, the latter enlarged by this factor, overlap.
            reach = 1.2 * radii[nearest] + np.abs(self.nodes.depth[inner.nodes])
            marched = np.where(straight <= reach, np.minimum(marched, straight), marched)
        return marched

    def _add_deepest(self, seeds: FloatArray) -> FloatArray:
        """Lower distances (In/Out) around the centres of balls that touch on all sides.

        Returns the centres.  They are next to nodes that are deeper than all neighbours, where no
        point of the axis is near.
        """
        mesh, depth = self.mesh, self.nodes.depth
        hub, other = _links(mesh)
        highest, known = np.full(mesh.n_points, -np.inf), np.isfinite(seeds)
        np.maximum.at(highest, hub, depth[other])
        # Nodes repeat: of the neighbours that follow in an edge, and that precede, one each counts.
        for ends in (mesh.edges, mesh.edges[:, ::-1]):
            known[ends[:, 0]] |= np.isfinite(seeds[ends[:, 1]])
        deepest = np.flatnonzero(self.inside & ~known & (depth >= highest))
        if len(deepest) == 0:
            return np.empty((0, mesh.dim))
        reach = np.zeros(mesh.n_points)
        np.maximum.at(reach, mesh.edges, mesh.edge_lengths[:, None])
        centres, reached = _centres_of_balls(self.boundary, mesh.points[deepest], reach[deepest])
        number = np.full(mesh.n_points, -1)
        number[deepest[reached]] = np.arange(len(centres))
        # The nodes themselves and their neighbours.
        hub, other = np.append(hub, deepest), np.append(other, deepest)
        near = np.flatnonzero(number[hub] >= 0)
        away = mesh.points[other[near]] - centres[number[hub[near]]]
        np.minimum.at(seeds, other[near], np.linalg.norm(away, axis=1))
        return centres


# Parts of edges


@dataclass(frozen=True)
class _Parts(Rows):
    """Parts of edges or rays whose ends have different directions to the boundary.

    Parameters
    ----------
    ends : int64[n, 2]
        Nodes of the edge, or of the edge where the ray was found.
    start, way : float64[n, dim]
        One end of the edge, and the vector from there to the other.
    at : float64[n, 2]
        Start and end of the part, 0 to 1.
    depth : float64[n, 2]
    outward : float64[n, 2, dim]
    """

    ends: LongArray
    start: FloatArray
    way: FloatArray
    at: FloatArray
    depth: FloatArray
    outward: FloatArray

    def points(self, at: FloatArray) -> FloatArray:
        """Return points of the edges, float64[n, dim]."""
        return np.asarray(self.start + at[:, None] * self.way)

    @property
    def length(self) -> FloatArray:
        """Of the edges, float64[n]."""
        return np.asarray(np.linalg.norm(self.way, axis=1))

    @property
    def cosine(self) -> FloatArray:
        """Of the angle between the directions at the ends, float64[n]."""
        return np.asarray((self.outward[:, 0] * self.outward[:, 1]).sum(axis=1))

    @property
    def has_jump(self) -> BoolArray:
        """Whether the directions still differ after all bisections, bool[n]."""
        return np.asarray(np.diff(self.at, axis=1)[:, 0] < 1.5 * 0.5**_HALVINGS)


def _equidistant(parts: _Parts) -> Fronts:
    """Return the points inside where the depths of two fronts are equal."""
    # Depths decrease in the outward direction.
    slopes = -(parts.outward * parts.way[:, None, :]).sum(axis=2)
    low, high = parts.at.T
    gap = parts.depth[:, 1] - parts.depth[:, 0] - slopes[:, 1] * (high - low)
    bend = slopes[:, 0] - slopes[:, 1]
    # An edge along the axis meets it everywhere; take the midpoint.
    on_axis = bend <= _ROUNDING * np.abs(slopes).max(axis=1, initial=0.0)
    at = np.clip(low + gap / np.where(on_axis, 1.0, bend), low, high)
    at[on_axis] = 0.5 * (low + high)[on_axis]
    depth = parts.depth[:, 0] + slopes[:, 0] * (at - low)
    inside = (parts.depth > 0.0).all(axis=1) & (depth > 0.0)
    return Fronts(parts.points(at), depth, parts.outward, parts.ends).taken(inside)


# Cells inside


class InnerCells(NamedTuple):
    """The cells that have a node inside, with copies of their nodes outside.

    An outside node is copied for each group of its cells that share inside nodes.  On the two
    sides of a gap there are different copies, so that no path leads through outside nodes.

    Parameters
    ----------
    mesh : SimplexMesh
    nodes : LongArray
        Node of the background of which each node is a copy.
    inside : BoolArray
    """

    mesh: SimplexMesh
    nodes: LongArray
    inside: BoolArray


def _bound_outside(inner: InnerCells, size: FloatArray) -> None:
    """Bound sizes (In/Out) from below at outside nodes, where distances are differences."""
    outer, other = _links(inner.mesh)
    least = np.full(len(size), np.inf)
    from_inside = inner.inside[other]
    np.minimum.at(least, outer[from_inside], size[other[from_inside]])
    outside = ~inner.inside & np.isfinite(least)
    # At outside nodes, the feature size is at least this share of that of their inside neighbours.
    size[outside] = np.maximum(size[outside], 0.5 * least[outside])


def _links(mesh: SimplexMesh) -> LongArray:
    """Return the ends of edges and their other ends, each edge both ways, int64[2, n]."""
    return np.concatenate([mesh.edges.T, mesh.edges.T[::-1]], axis=1).astype(np.int64)


def _inner_cells(mesh: SimplexMesh, inside: BoolArray) -> InnerCells:
    """Return the cells with an inside node, of which there is at least one."""
    cells = mesh.cells[inside[mesh.cells].any(axis=1)].astype(np.int64)
    used = np.unique(cells[inside[cells]])
    number = np.zeros(mesh.n_points, np.int64)
    number[used] = np.arange(len(used))
    numbers = number[cells]
    corner, copies = _copies(cells, inside)
    numbers.reshape(-1)[corner] = len(used) + copies
    first = np.unique(copies, return_index=True)[1]
    nodes = np.concatenate([used, cells.reshape(-1)[corner[first]]])
    return InnerCells(SimplexMesh(mesh.points[nodes], numbers), nodes, inside[nodes])


def _copies(cells: LongArray, inside: BoolArray) -> tuple[IndexArray, IndexArray]:
    """Return the outside corners of cells (flat numbers), and the number of the copy for each."""
    corner = np.flatnonzero(~inside[cells])
    around = cells[corner // cells.shape[1]]
    # Corners at the same outside node are linked through each inside node that they share.
    row, column = np.nonzero(inside[around])
    shared = cells.reshape(-1)[corner[row]] * len(inside) + around[row, column]
    names, hub = np.unique(shared, return_inverse=True)
    links = np.column_stack([row, len(corner) + hub.reshape(-1)])
    return corner, components_of(links, len(corner) + len(names))[: len(corner)]


# Centres of balls


def _centres_of_balls(
    boundary: Boundary, points: FloatArray, reach: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return the centres of round parts, and near which points there is one.

    It is where the normals of the boundary through places around a point meet.

    Parameters
    ----------
    boundary : Boundary
    points : float64[n, dim]
        Inside.
    reach : float64[n]
        Largest distance of a centre from its point.

    Returns
    -------
    float64[m, dim], bool[n]
    """
    dim = points.shape[1]
    around = np.concatenate([np.eye(dim), -np.eye(dim)])
    places = points[:, None] + 0.5 * reach[:, None, None] * around
    normals = boundary.seen_from(places.reshape(-1, dim)).outward.reshape(places.shape)
    across = np.eye(dim) - normals[..., :, None] * normals[..., None, :]
    # Parallel normals meet nowhere; of their common points, the nearest is taken.
    matrix = across.sum(axis=1) + 1e-9 * np.eye(dim)
    right = np.einsum("nkij,nkj->ni", across, places) + 1e-9 * points
    centres = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
    off = np.einsum("nkij,nkj->nki", across, centres[:, None] - places)
    meet = np.linalg.norm(off, axis=2).max(axis=1) <= 0.1 * reach
    meet &= np.linalg.norm(centres - points, axis=1) <= reach
    return centres[meet], meet
