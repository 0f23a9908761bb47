"""Meshes after a generator: nodes that left the boundary, and the worst cells.

Mmg puts single nodes beside corners off the surface, by up to five times its tolerance.  They are
projected back, and the few edges that are still too far away get a node on the surface.  Then the
worst cells are repaired, see `boundary_repair`.  No node is moved onto the surface that spoils a
cell.  Nodes of straight feature edges stay on these.  This holds for tetrahedra, surfaces and plane
meshes.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import cut_out
from adaptsize.background.splitting import bisect_edges
from adaptsize.background.topology import marked, places_among
from adaptsize.quality.boundary import FarPlaces, farthest_places
from adaptsize.quality.elements import minimum_angles
from adaptsize.remeshing import tuning
from adaptsize.remeshing.borders import Borders
from adaptsize.remeshing.boundary_repair import Wanted, repaired
from adaptsize.remeshing.crossings import crossing_facets
from adaptsize.remeshing.sizing import Size
from adaptsize.remeshing.straight_edges import StraightEdges
from adaptsize.remeshing.surface import facets_of
from adaptsize.remeshing.taken_back import move_nodes, take_back, worst_of_nodes
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: Of coordinates and of corners, in the keys of facets.  No sum of products of these with whole
#: numbers is zero, so that facets of regular grids have keys of their own.
_FACTORS = np.sqrt([[2.0, 3.0, 5.0], [7.0, 11.0, 13.0]])


def improved(
    mesh: SimplexMesh,
    given: SimplexMesh,
    tolerance: float,
    size: Size | None = None,
    *,
    give_up: Callable[[], object] | None = None,
) -> SimplexMesh:
    """Return a mesh with facets within the tolerance and better worst cells, where possible.

    Parameters
    ----------
    mesh : SimplexMesh
        Tetrahedra of positive volume, or triangles.
    given : SimplexMesh
        The mesh or surface whose boundary and interfaces these must have.
    tolerance : float
        Allowed distance of boundary and interfaces, in the unit of the coordinates.
    size : callable, optional
        Requested lengths of edges.
    give_up : callable, optional
        If it is given, nothing more is done for a mesh whose boundary stays off somewhere, since
        another mesh may follow.  It is called then.

    Returns
    -------
    SimplexMesh
        With the same regions and tags.
    """
    old = facets_of(given)
    lines = _Lines(StraightEdges(given), Borders(given, mesh))
    mesh = lines.straight.straightened(mesh, tolerance)
    nodes = np.unique(facets_of(mesh).cells)
    distance = _nearest(old, mesh.points[nodes])[1]
    # With more nodes beyond the tolerance, the generator has made another surface, which projection
    # would only hide.
    if mesh.dim == 2 or 0.0 < (distance > tolerance).mean() <= tuning.MOST_NODES_BEYOND:
        nodes = nodes[distance > tuning.OFF_BOUNDARY * tolerance]
        if len(nodes):
            points = mesh.points.copy()
            _pull(points, mesh, nodes, old, lines.borders)
            mesh = mesh.moved(points)
    mesh = _along_borders(mesh, lines.borders, tuning.AIM * tolerance)

    def made(now: _Step, least: float, spoiled: _Balls) -> _Step:
        limit = tuning.AIM * tolerance
        best = _divided(now, old, tolerance, lines, least, spoiled)
        wanted = None
        if least < tuning.LEAST_QUALITY:
            wanted = _targets(best.far, old, limit, spoiled).wanted(best.far, least)
            if best.mesh is now.mesh and not len(wanted.places):
                return now
        mesh = repaired(best.mesh, given, limit, size, wanted)
        return best if mesh is best.mesh else best.with_mesh(mesh, facets_of(mesh), old, limit)

    return _in_rounds(mesh, old, tolerance, made, give_up)


class _Lines(NamedTuple):
    """Lines of the given mesh: on the straight ones, and on borders, nodes stay."""

    straight: StraightEdges
    borders: Borders


class _Balls(NamedTuple):
    """Balls in which nothing is to be changed."""

    centres: FloatArray
    radii: FloatArray

    @classmethod
    def none(cls, dim: int) -> "_Balls":
        """Return no balls."""
        return cls(np.empty((0, dim)), np.empty(0))

    @classmethod
    def around(cls, mesh: SimplexMesh, cells: BoolArray) -> "_Balls":
        """Return balls around cells."""
        corners = mesh.points[mesh.cells[cells]]
        centres = corners.mean(axis=1)
        away = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1, initial=0.0)
        return cls(centres, 2.0 * tuning.AROUND_FLAT * away)

    def contain(self, points: FloatArray) -> BoolArray:
        """Return which points are in a ball."""
        found = np.zeros(len(points), np.bool_)
        if len(points) and len(self.centres):
            for inside in cKDTree(points).query_ball_point(self.centres, self.radii):
                found[inside] = True
        return found

    def and_also(self, other: "_Balls") -> "_Balls":
        """Return both."""
        return _Balls(*(np.concatenate(both) for both in zip(self, other, strict=True)))


class _Far(NamedTuple):
    """Places of a new surface, and of an old one, that are far from the other.

    What is nearer than the limit has been looked at no further.
    """

    surface: SimplexMesh
    keys: FloatArray
    new: FarPlaces
    lost: FarPlaces

    @classmethod
    def of(cls, surface: SimplexMesh, old: SimplexMesh, limit: float) -> "_Far":
        """Return the places of a surface."""
        new, lost = farthest_places(surface, old, limit), farthest_places(old, surface, limit)
        return cls(surface, _keys_of(surface), new, lost)

    def after(self, surface: SimplexMesh, old: SimplexMesh, limit: float) -> "_Far":
        """Return those of a surface that was changed in some places."""
        before, keys = self.surface, _keys_of(surface)
        order = np.argsort(self.keys)
        place = np.minimum(np.searchsorted(self.keys, keys, sorter=order), len(order) - 1)
        row = order[place]
        fresh = self.keys[row] != keys
        gone = before.points[before.cells[~np.isin(self.keys, keys)]]
        centre = gone.mean(axis=1)
        radius = np.linalg.norm(gone - centre[:, None], axis=2).max(axis=1, initial=0.0)
        reach = radius + max(float(self.lost.distance.max()), limit)
        near = np.unique(old.locator.within(centre, reach)[1])
        new = FarPlaces(*(values[row] for values in self.new))
        lost = FarPlaces(*(values.copy() for values in self.lost))
        for found, rows, skin, other in ((new, fresh, surface, old), (lost, near, old, surface)):
            part = SimplexMesh(skin.points, skin.cells[rows]) if len(skin.cells[rows]) else None
            if part is not None:
                for values, now in zip(found, farthest_places(part, other, limit), strict=True):
                    values[rows] = now
        return _Far(surface, keys, new, lost)

    @property
    def largest(self) -> float:
        """The largest distance."""
        return float(max(self.new.distance.max(), self.lost.distance.max()))

    def beyond(self, limit: float) -> float:
        """Return the sum of the distances beyond a limit, less the limit."""
        over = np.concatenate([self.new.distance, self.lost.distance]) - limit
        return float(over[over > 0.0].sum())

    def beyond_around(self, centres: FloatArray, reach: FloatArray, limit: float) -> FloatArray:
        """Return the sums of the distances beyond a limit in balls, less the limit."""
        points = np.concatenate([self.new.points, self.lost.points])
        over = np.concatenate([self.new.distance, self.lost.distance]) - limit
        points, over = points[over > 0.0], over[over > 0.0]
        if not len(over):
            return np.zeros(len(centres))
        near = cKDTree(points).query_ball_point(centres, reach)
        return np.array([over[rows].sum() for rows in near])

    def are_few(self, limit: float) -> bool:
        """Return whether some places are beyond a limit, but few of the new facets."""
        share = float((self.new.distance > limit).mean())
        return self.beyond(limit) > 0.0 and share <= tuning.MOST_FACETS_BEYOND


def _keys_of(surface: SimplexMesh) -> FloatArray:
    """Return a number for each facet that depends on the places of its corners only."""
    at_nodes = sum(x * factor for x, factor in zip(surface.points.T, _FACTORS[0], strict=False))
    corners = np.sort(np.asarray(at_nodes)[surface.cells], axis=1)
    return np.asarray(sum(x * factor for x, factor in zip(corners.T, _FACTORS[1], strict=False)))


class _Targets(NamedTuple):
    """Where nodes are wanted: the places, the facets nearest to these, and the weights there.

    ``shares``: how they are served, see `tuning.WEIGHTS_OF_CORNERS`.
    """

    there: FloatArray
    cells: IntArray
    weights: FloatArray
    shares: FloatArray

    def served_by(self, shares: npt.ArrayLike) -> "_Targets":
        """Return the same targets, to be served in a way, or each in its own."""
        return self._replace(shares=np.broadcast_to(shares, (len(self.there), 2)))

    def some(self, which: npt.NDArray[np.integer]) -> "_Targets":
        """Return some of the targets."""
        there, cells, weights, shares = self
        return _Targets(there[which], cells[which], weights[which], shares[which])

    def wanted(self, far: "_Far", least: float) -> Wanted:
        """Return the nodes to insert in facets, for a least quality of cells."""
        return Wanted(self.there, far.surface.cells[self.cells], tuning.ANGLE_OF_QUALITY * least)

    def nearer(self, before: "_Far", after: "_Far", limit: float) -> FloatArray:
        """Return by how much less is beyond a limit around each target than before."""
        corners = before.surface.points[before.surface.cells[self.cells]]
        reach = 2.0 * np.linalg.norm(corners - corners[:, :1], axis=2).max(axis=1)
        was, now = (far.beyond_around(self.there, reach, limit) for far in (before, after))
        return np.asarray(was - now)


class _Step(NamedTuple):
    """A changed mesh, what is far of it, and by how much less that is around each target.

    The latter is -inf for targets that are not served.
    """

    mesh: SimplexMesh
    far: _Far
    gain: FloatArray

    @classmethod
    def first(cls, mesh: SimplexMesh, old: SimplexMesh, limit: float) -> "_Step":
        """Return a mesh before any step."""
        return cls(mesh, _Far.of(facets_of(mesh), old, limit), np.empty(0))

    @property
    def crossed(self) -> BoolArray:
        """Which facets in space cross others."""
        surface = self.far.surface
        crossing = crossing_facets(surface).cells if surface.dim == 3 else np.empty(0, np.intp)
        return marked(crossing, surface.n_cells)

    def with_mesh(
        self, mesh: SimplexMesh, surface: SimplexMesh, old: SimplexMesh, limit: float
    ) -> "_Step":
        """Return the same with a mesh that was changed in some places, and its facets."""
        return self._replace(mesh=mesh, far=self.far.after(surface, old, limit))


def _in_rounds(
    mesh: SimplexMesh,
    old: SimplexMesh,
    tolerance: float,
    made: Callable[[_Step, float, _Balls], _Step],
    give_up: Callable[[], object] | None = None,
) -> SimplexMesh:
    """Return a mesh brought nearer to the old surface, until it is near.

    ``made`` returns a better mesh for a mesh, a least quality of new cells, and places to leave as
    they are.  These are where a round has spoiled cells or made facets cross, which is not kept.  A
    round that brings little nearer is the last one with its quality.
    """
    first = best = _Step.first(mesh, old, tuning.AIM * tolerance)
    spoiled, may_cross = _Balls.none(mesh.dim), bool(first.crossed.any())
    for _ in range(tuning.FIRST_ROUNDS):
        now = made(first, tuning.LEAST_QUALITY, spoiled)
        if may_cross or not now.crossed.any():
            best = now
            break
        spoiled = spoiled.and_also(_Balls.around(now.far.surface, now.crossed))
    later = list(tuning.LATER_QUALITIES)
    hopeless = max(tuning.HOPELESS * tolerance, tuning.LITTLE_NEARER * first.far.largest)
    if best.far.largest > hopeless and best.far.are_few(tolerance):
        if give_up is not None:
            give_up()
            return best.mesh
        if best.far.largest > tuning.LOST_FOR_GOOD * tolerance:
            return best.mesh
    for _ in range(tuning.MOST_LATER_ROUNDS):
        # Many are far where the sizes are coarse: nothing is divided there.
        if not later or not best.far.are_few(tolerance):
            break
        now = made(best, later[0], spoiled)
        if now.mesh is best.mesh:
            del later[0]
            continue
        least = tuning.LITTLE_FLATTER * float(minimum_angles(best.mesh).min())
        flat, crossed = minimum_angles(now.mesh) < min(tuning.FLAT_ANGLE, least), now.crossed
        if flat.any() or (crossed.any() and not may_cross):
            spoiled = spoiled.and_also(_Balls.around(now.mesh, flat))
            spoiled = spoiled.and_also(_Balls.around(now.far.surface, crossed))
            continue
        share = now.far.beyond(tolerance) / best.far.beyond(tolerance)
        if share < 1.0:
            best = now
        if share > tuning.LITTLE_NEARER:
            del later[0]
    return best.mesh


def _divided(
    now: _Step,
    old: SimplexMesh,
    tolerance: float,
    lines: _Lines,
    least: float,
    spoiled: _Balls,
) -> _Step:
    """Return the mesh with nodes of the old surface where it is too far from that.

    Edges get a node at the farthest places on facets beside them, and at places of the old surface
    that these miss; nodes are moved there.  ``least`` is the least quality of cells.  A step may
    bring the mesh farther away: where facets meet at an edge, one node alone may do so.
    """
    limit, waited, best = tuning.AIM * tolerance, 0, now
    for _ in range(tuning.STEPS_BEFORE_REPAIR):
        if waited > tuning.STEPS_IN_VAIN or not now.far.are_few(tolerance):
            break
        targets = _targets(now.far, old, limit, spoiled)
        steps = _steps(now, old, limit, lines, least, targets)
        if not steps:
            break
        now, waited = min(steps, key=lambda step: step.far.beyond(limit)), waited + 1
        if now.far.beyond(tolerance) < best.far.beyond(tolerance):
            best, waited = now, 0
    return best


def _steps(
    now: _Step,
    old: SimplexMesh,
    limit: float,
    lines: _Lines,
    least: float,
    targets: _Targets,
) -> list[_Step]:
    """Return the meshes with all targets served in one way, and each in the way best for it."""
    surface = now.far.surface
    is_straight = np.zeros(len(surface.edges), np.bool_)
    if surface.cell_dim == 2:
        is_straight = lines.straight.are_parts(surface)
    take = partial(_step, now, old, limit, lines.borders, is_straight, least)
    tried = [take(targets.served_by(shares)) for shares in tuning.WEIGHTS_OF_CORNERS]
    gains = np.array([one.gain for one in tried])
    way, gain = gains.argmax(axis=0), gains.max(axis=0, initial=-np.inf)
    order = np.argsort(-gain, kind="stable")
    order = order[gain[order] > 0.0]
    is_new = not any((one[np.isfinite(one)] > 0.0).all() for one in gains[np.unique(way[order])])
    if len(order) and is_new:
        mixed = targets.served_by(np.array(tuning.WEIGHTS_OF_CORNERS)[way]).some(order)
        tried.append(take(mixed))
    return [step for step in tried if step.mesh is not now.mesh]


def _step(
    now: _Step,
    old: SimplexMesh,
    limit: float,
    borders: Borders,
    is_straight: BoolArray,
    least: float,
    targets: _Targets,
) -> _Step:
    """Return the mesh with targets served; the same one if none can be.

    ``is_straight``: which edges of its facets are not divided.
    """
    mesh, surface, served = _with_targets(now, targets, borders, is_straight, limit, least)
    if mesh is now.mesh:
        return now._replace(gain=np.full(len(served), -np.inf))
    step = now.with_mesh(mesh, surface, old, limit)
    nearer = targets.nearer(now.far, step.far, limit)
    return step._replace(gain=np.where(served, nearer, -np.inf))


def _targets(far: _Far, old: SimplexMesh, limit: float, spoiled: _Balls) -> _Targets:
    """Return where nodes of the old surface are wanted, the farthest place first."""
    surface, new, lost = far.surface, far.new, far.lost
    off, missed = new.distance > limit, lost.distance > limit
    at = np.flatnonzero(off)
    weights = _weights_in(surface.points[surface.cells[at]], new.points[off])
    cells, beside, _ = surface.locator.nearest(lost.points[missed])
    found = _Targets(
        np.concatenate([_nearest(old, new.points[off])[0], lost.points[missed]]),
        np.concatenate([at, cells]),
        np.concatenate([weights, beside]),
        np.empty((len(at) + len(cells), 2)),
    )
    order = np.argsort(-np.append(new.distance[off], lost.distance[missed]))
    order = order[~spoiled.contain(found.there[order])]
    return found.some(order)


def _weights_in(corners: FloatArray, points: FloatArray) -> FloatArray:
    """Return the barycentric coordinates of points on segments or triangles."""
    k = corners.shape[1]
    sides = corners[:, 1:] - corners[:, :1]
    gram = np.einsum("nid,njd->nij", sides, sides)
    right = np.einsum("nid,nd->ni", sides, points - corners[:, 0])
    rest = np.einsum("nij,nj->ni", np.linalg.pinv(gram), right)
    weights = np.column_stack([1.0 - rest.sum(axis=1), rest])
    return np.asarray(np.clip(weights, 0.0, 1.0)).reshape(-1, k)


def _with_targets(
    now: _Step,
    targets: _Targets,
    borders: Borders,
    is_straight: BoolArray,
    limit: float,
    least: float,
) -> tuple[SimplexMesh, SimplexMesh, BoolArray]:
    """Return the mesh with nodes at targets, or halfway; its facets; and for which it has these.

    Nodes are moved, or edges divided.  Of targets side by side, the first is served.
    """
    mesh, surface = now.mesh, now.far.surface
    there, cells, weights, shares = targets
    is_corner = weights.max(axis=1) > shares[:, 0]
    nodes = surface.cells[cells, weights.argmax(axis=1)]
    edges = surface.cells[cells]
    if surface.cell_dim == 2:
        edges = _edges_at(surface, targets, is_straight)
    to_move = np.where(is_corner, nodes, -1)
    there, may = borders.kept_on(surface, to_move, edges, there, limit)
    is_taken, served = np.zeros(mesh.n_points, np.bool_), np.zeros(len(there), np.bool_)
    for k, cell in enumerate(cells.tolist()):
        ends = nodes[k, None] if is_corner[k] else edges[k]
        if ends[0] < 0 or is_taken[ends].any() or not may[k]:
            continue
        served[k] = True
        is_taken[surface.cells[cell]] = True
        is_taken[ends] = True
    points = mesh.points.copy()
    moved, divided = served & is_corner, served & ~is_corner
    move_nodes(points, mesh.cells, nodes[moved], there[moved], least)
    if moved.any():
        mesh = mesh.moved(points)
        surface = surface.moved(mesh.points)
    return *_with_nodes(mesh, surface, edges[divided], there[divided], least), served


def _edges_at(surface: SimplexMesh, targets: _Targets, is_straight: BoolArray) -> IntArray:
    """Return the edge to divide for each target, -1 for none.

    It is the nearest one, or the longest one if the target is inside of a facet.  Straight edges
    are not divided.
    """
    sides = surface.cell_facets[targets.cells]
    is_inside = targets.weights.min(axis=1) > targets.shares[:, 1]
    away = np.where(is_inside[:, None], -surface.edge_lengths[sides], targets.weights)
    away[is_straight[sides]] = np.inf
    chosen = surface.edges[sides[np.arange(len(sides)), away.argmin(axis=1)]].copy()
    chosen[np.isinf(away.min(axis=1))] = -1
    return np.asarray(chosen)


def _with_nodes(
    mesh: SimplexMesh, surface: SimplexMesh, edges: IntArray, there: FloatArray, least: float
) -> tuple[SimplexMesh, SimplexMesh]:
    """Return a mesh and its facets with some edges of these divided, with nodes at given points.

    An edge is not divided if a node there, even halfway, would spoil cells: their quality falls
    below ``least``.
    """
    if not len(edges):
        return mesh, surface
    near = marked(edges, mesh.n_points)[mesh.cells].sum(axis=1) > 1
    part, nodes = cut_out(mesh.points, mesh.cells[near])
    while len(edges):
        split, which, _ = bisect_edges(part, places_among(nodes, mesh.n_points)[edges])
        points, start = split.points.copy(), split.points
        new = part.n_points + np.arange(len(which))
        kept = np.minimum(worst_of_nodes(start, split.cells), least)
        moved = np.zeros(len(new), np.bool_)
        for share in (1.0, 0.5):
            left = new[~moved]
            points[left] += share * (there[which[~moved]] - points[left])
            take_back(points, split.cells, start, left, kept)
            moved = (points[new] != start[new]).any(axis=1)
        edges, there = edges[which[moved]], points[new[moved]]
        if moved.all():
            return _bisected(mesh, surface, edges, there)
    return mesh, surface


def _bisected(
    mesh: SimplexMesh, surface: SimplexMesh, edges: IntArray, there: FloatArray
) -> tuple[SimplexMesh, SimplexMesh]:
    """Return a mesh and its facets with nodes at given points on edges, of each cell on one."""
    split, which, _ = bisect_edges(mesh, edges)
    points = split.points.copy()
    points[mesh.n_points :] = there[which]
    new = replace(split, points=points)
    return new, new if surface is mesh else bisect_edges(surface, edges).mesh.moved(new.points)


def _pull(
    points: FloatArray, mesh: SimplexMesh, nodes: IntArray, old: SimplexMesh, borders: Borders
) -> None:
    """Move nodes onto a surface, those of borders onto its borders, or halfway.

    Changes ``points``.
    """
    there = _nearest(old, points[nodes])[0]
    places, distance = borders.nearest_of_nodes(facets_of(mesh), nodes, points[nodes])
    is_on = np.isfinite(distance)
    there[is_on] = places[is_on]
    move_nodes(points, mesh.cells, nodes, there, tuning.LEAST_QUALITY)


def _along_borders(mesh: SimplexMesh, borders: Borders, limit: float) -> SimplexMesh:
    """Return the mesh with borders near the given ones, along the surface, too.

    Nodes of borders are moved there, and edges are divided, with ever lower least qualities.
    """
    for least in (tuning.LEAST_QUALITY, *tuning.LATER_QUALITIES) if borders.are_any else ():
        surface = facets_of(mesh)
        nodes, there = borders.nodes_off(surface, limit)
        if len(nodes):
            points = mesh.points.copy()
            move_nodes(points, mesh.cells, nodes, there, least)
            mesh, surface = mesh.moved(points), surface.moved(points)
        edges, middles = borders.edges_off(surface, limit)
        if not len(nodes) and not len(edges):
            break
        mesh = _with_nodes(mesh, surface, edges, middles, least)[0]
    return mesh


def _nearest(old: SimplexMesh, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the closest points of a surface, and their distances."""
    cells, weights, distance = old.locator.nearest(points)
    return np.einsum("ij,ijk->ik", weights, old.points[old.cells[cells]]), distance
