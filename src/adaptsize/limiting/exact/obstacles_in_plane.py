"""Obstacles in the plane: corners and lines of sight in a domain that is not convex."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from adaptsize._kernels import exact_plane as kernels
from adaptsize._kernels.exact import new_block
from adaptsize._kernels.exact_plane import COLUMNS, CONE, CORNER, KIND, ROW
from adaptsize._kernels.sight import ANY, NARROW, Sight, new_rays
from adaptsize._workers import Workers
from adaptsize.background._curve import along_curve, boxes_over
from adaptsize.background._mesh_arrays import read_only
from adaptsize.geometry.plane_boundary import PlaneBoundary
from adaptsize.limiting import tuning
from adaptsize.limiting.exact.field import (
    Entries,
    ExactField,
    Points,
    node_table,
    sorted_entries,
)
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback


def favours_expansion(n_corners: int, n_nodes: int) -> bool:
    """Return whether lines of sight take longer than triangular expansion."""
    return n_corners > tuning.FEW_CORNERS and n_corners * n_corners > n_nodes


def has_many_corners(n_corners: int, n_nodes: int) -> bool:
    """Return whether lines of sight take many times as long as fast marching."""
    is_slow = n_corners * n_corners > tuning.MANY_CORNERS * n_nodes
    return is_slow and favours_expansion(n_corners, n_nodes)


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane domain, as the kernels use it, and its corners along a Morton curve."""

    boundary: PlaneBoundary
    sight: Sight
    nodes: IntArray
    """int32[c]: the corners."""
    table: FloatArray
    """float64[c, COLUMNS]: as entries."""
    walls: FloatArray
    """float64[c, 5]: unit vectors along the two walls, and the length of the shortest edge there;
    the sector extends counterclockwise from the first wall to the second."""
    sizes: FloatArray
    """float64[c]"""
    merge: Callable[[FloatArray, FloatArray, BoolArray], None] | None = None
    """Merges sizes at corners, directions of arrival and whether sources lower the corner (all
    In/Out) with those that other processes have found; None if there are none."""


def plane_of(points: FloatArray, boundary: PlaneBoundary) -> Plane:
    """Return the walls with a tree over them, and the corners without sizes."""
    ends = boundary.walls
    ends = ends[along_curve(0.5 * (ends[:, :2] + ends[:, 2:]))]
    boxes = boxes_over(
        np.minimum(ends[:, :2], ends[:, 2:]),
        np.maximum(ends[:, :2], ends[:, 2:]),
        np.zeros(len(ends)),
    )
    sight = Sight(ends, boxes, boundary.first, boundary.sectors, boundary.slack)
    order = along_curve(points[boundary.corners])
    nodes = boundary.corners[order]
    sizes = np.full(len(nodes), np.inf)
    table = _in_plane(node_table(points[nodes], sizes))
    rows = boundary.rows[nodes]
    table[:, ROW], table[:, CORNER] = rows, 1.0
    table[:, KIND] = np.where(boundary.free[order], ANY, NARROW)
    walls = boundary.sectors[boundary.first[rows]]
    walls[:, 4] = boundary.reach[order]
    return Plane(boundary, sight, nodes, table, walls, sizes)


def _in_plane(table: FloatArray) -> FloatArray:
    """Return entries that act in all directions with the columns for lines of sight."""
    wide = np.zeros((len(table), COLUMNS))
    wide[:, :CONE] = table
    wide[:, KIND], wide[:, ROW] = ANY, -1.0
    return wide


def at_nodes(entries: Entries, plane: Plane) -> Entries:
    """Return sources at nodes, with one entry for each sector of the node."""
    rows, node = plane.boundary.rows, entries.nodes[:, 0]
    row = np.where(node < len(rows), rows[np.minimum(node, len(rows) - 1)], -1)
    table = _in_plane(entries.table)
    table[:, ROW] = row
    return sorted_entries(*_by_sectors(table, entries.nodes, plane))


def _by_sectors(table: FloatArray, nodes: IntArray, plane: Plane) -> tuple[FloatArray, IntArray]:
    """Return entries, those at boundary nodes once for each sector and acting there only."""
    first, row = plane.boundary.first, table[:, ROW].astype(np.int64)
    counts = np.where(row >= 0, np.diff(first)[row], 1)
    which = np.repeat(np.arange(len(row)), counts)
    within = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    table, nodes = table[which], nodes[which]
    on = row[which] >= 0
    table[on, CONE : KIND + 1] = plane.boundary.sectors[first[row[which[on]]] + within[on]]
    return table, nodes


def along_walls(entries: Entries, points: FloatArray, facets: IntArray) -> Entries:
    """Return sources on edges; those on walls act on the side of the domain only."""
    table, n = _in_plane(entries.table), len(points)
    if len(facets) == 0:  # the mesh is a part, without walls
        return entries._replace(table=table)
    key = np.sort(facets, axis=1).astype(np.int64) @ [n, 1]
    order = np.argsort(key)
    own = entries.nodes.astype(np.int64) @ [n, 1]
    at = order[np.minimum(np.searchsorted(key, own, sorter=order), len(order) - 1)]
    on = key[at] == own
    along = points[facets[at[on], 1]] - points[facets[at[on], 0]]
    along /= np.hypot(*along.T)[:, None]
    table[on, CONE:KIND] = np.hstack([along, -along])
    table[on, KIND] = NARROW
    return entries._replace(table=table)


def with_corners(
    entries: Entries, g: float, plane: Plane, linear: bool, report: ProgressCallback
) -> Entries:
    """Return entries together with the corners that they lower (In/Out: plane)."""
    n = len(plane.nodes)
    if n == 0:
        return entries
    source = np.full(n, -1, np.int32)
    order = np.arange(n, dtype=np.int32)
    places, rows = plane.table[:, :2].copy(), plane.table[:, ROW].astype(np.int32)
    field = ExactField(g, plane.sight, linear=linear, groups=[entries])
    field.lower_by_last(Points(places, order, rows), plane.sizes, source, Workers(1, report))
    lowered = source >= 0
    arrivals = np.zeros((n, 2))
    acting = entries.table[source[lowered]]
    arrivals[lowered] = places[lowered] - _start_points(acting, places[lowered], g)
    if plane.merge is not None:
        plane.merge(plane.sizes, arrivals, lowered)
    table, serves = plane.table.copy(), np.zeros(n, np.bool_)
    corners = (read_only(places), read_only(order), table, plane.walls)
    state, edges = (plane.sizes, arrivals, lowered, serves), True if linear else None
    kernels.solve_corners((0, 0), corners, state, g, edges, plane.sight, new_block(2), new_rays())
    return _together(entries, plane, table, serves)


def with_known_corners(entries: Entries, plane: Plane, h: FloatArray, into: FloatArray) -> Entries:
    """Return entries together with the corners at which paths bend (In/Out: plane).

    ``h``, ``into``: the sizes at all nodes, and the last straight pieces of the paths there, 0 at
    nodes that keep their bounds.
    """
    nodes, table = plane.nodes, plane.table.copy()
    plane.sizes[:] = table[:, 4] = h[nodes]
    serves = np.zeros(len(nodes), np.bool_)
    kernels.set_wedges(table, plane.walls, into[nodes], plane.sight.slack, serves)
    return _together(entries, plane, table, serves & into[nodes].any(axis=1))


def _together(entries: Entries, plane: Plane, table: FloatArray, serves: BoolArray) -> Entries:
    """Return entries together with the corners that serve."""
    named = np.full((len(table), 2), -1, np.int32)
    named[:, 0] = plane.nodes
    is_free = table[:, KIND] == ANY
    free, own = serves & is_free, serves & ~is_free
    parts = [(entries.table, entries.nodes), (table[own], named[own])]
    parts.append(_by_sectors(table[free], named[free], plane))
    tables, nodes = zip(*parts, strict=True)
    return sorted_entries(np.concatenate(tables), np.concatenate(nodes))


def _start_points(table: FloatArray, x: FloatArray, g: float) -> FloatArray:
    """Return the points of entries, one for each x, whose bounds allow the least size there."""
    start, edge = table[:, :2], table[:, 2:4] - table[:, :2]
    length2 = np.einsum("ij,ij->i", edge, edge)
    with np.errstate(invalid="ignore", divide="ignore"):
        rise = table[:, 5] - table[:, 4]
        t = np.einsum("ij,ij->i", edge, x - start) / length2
        height = np.linalg.norm(x - start - t[:, None] * edge, axis=1)
        t -= rise * height / np.sqrt(length2 * (g * g * length2 - rise * rise))
    is_edge = np.isfinite(table[:, 5])
    points: FloatArray = start + np.where(is_edge, t, 0.0)[:, None] * edge
    return points
