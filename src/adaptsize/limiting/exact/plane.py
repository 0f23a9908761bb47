"""Corners and lines of sight in a plane domain that is not convex."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize._kernels import exact_corners as kernels
from adaptsize._kernels.exact_corners import Corners
from adaptsize._kernels.exact_plane import Seen, Sight
from adaptsize._kernels.sight import NARROW, Walls
from adaptsize.geometry.boundary import PlaneBoundary
from adaptsize.limiting.exact.field import Wave
from adaptsize.limiting.exact.work import along_curve, boxes_over, with_tree
from adaptsize.typing import FloatArray, IntArray


class Plane(NamedTuple):
    """A plane domain, as the kernels use it."""

    boundary: PlaneBoundary
    sight: Sight
    corners: Corners

    def without_sizes(self) -> Plane:
        """Return the same domain with reset corners."""
        n = len(self.corners.rows)
        turns, arrivals = np.zeros((n, 2), np.bool_), np.zeros((n, 2, 2))
        corners = self.corners._replace(sizes=np.full(n, np.inf), turns=turns, arrivals=arrivals)
        return self._replace(corners=corners)


def plane_of(points: FloatArray, boundary: PlaneBoundary) -> Plane:
    """Return the walls with a tree over them, and the corners without sizes."""
    ends = boundary.walls
    order = along_curve(0.5 * (ends[:, :2] + ends[:, 2:]))
    ends = np.ascontiguousarray(ends[order])
    lower, upper = np.minimum(ends[:, :2], ends[:, 2:]), np.maximum(ends[:, :2], ends[:, 2:])
    boxes, n_leaves = boxes_over(lower, upper, np.zeros(len(ends)))
    sight = Sight(Walls(ends, boxes, n_leaves, boundary.slack), boundary.sectors)
    rows = boundary.rows[boundary.corners]
    n = len(rows)
    corners = Corners(
        rows,
        np.ascontiguousarray(points[boundary.corners]),
        np.ascontiguousarray(boundary.sectors.cones[boundary.sectors.first[rows]]),
        boundary.free,
        np.full(n, np.inf),
        np.zeros((n, 2), np.bool_),
        np.zeros((n, 2, 2)),
    )
    return Plane(boundary, sight, corners)


def at_nodes(wave: Wave, plane: Plane) -> Wave:
    """Return sources at nodes, with one entry for each sector of the node."""
    rows, sectors = plane.boundary.rows, plane.sight.sectors
    node = wave.nodes[:, 0]
    row = np.where(node < len(rows), rows[np.minimum(node, len(rows) - 1)], -1)
    counts = np.where(row >= 0, np.diff(sectors.first)[row], 1)
    which = np.repeat(np.arange(len(row)), counts)
    within = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    at = np.where(row[which] >= 0, sectors.first[row[which]] + within, 0)
    on = row[which] >= 0
    cones = np.where(on[:, None], sectors.cones[at], wave.seen.cones[which])
    kinds = np.where(on, sectors.kinds[at], wave.seen.kinds[which]).astype(np.int8)
    entries = wave.seen.entries
    again = with_tree(entries.places[which], entries.sizes[which], entries.counts[which])
    is_corner = wave.seen.is_corner[which]
    return Wave(
        Seen(again, cones, kinds, row[which].astype(np.int32), is_corner), wave.nodes[which]
    )


def along_walls(wave: Wave, points: FloatArray, facets: IntArray) -> Wave:
    """Return sources on edges; those on walls act on the side of the domain only."""
    sides = {(min(a, b), max(a, b)): a < b for a, b in facets.tolist()}
    cones, kinds = wave.seen.cones.copy(), wave.seen.kinds.copy()
    for k, (a, b) in enumerate(wave.nodes.tolist()):
        forward = sides.get((a, b))
        if forward is not None:
            along = points[b] - points[a] if forward else points[a] - points[b]
            along = along / np.hypot(*along)
            cones[k] = [*along, *-along]
            kinds[k] = NARROW
    return wave._replace(seen=wave.seen._replace(cones=cones, kinds=kinds))


def solve_corners(g: float, plane: Plane, wave: Wave) -> Wave | None:
    """Return the corners that the sources of a wave lower, as new sources."""
    corners = plane.corners
    if len(corners.rows) == 0:
        return None
    before = [array.copy() for array in (corners.sizes, corners.turns, corners.arrivals)]
    kernels.solve_corners(corners, wave.seen, plane.sight, g, (0, 0))
    changed = corners.sizes < before[0]
    changed |= (corners.turns != before[1]).any(axis=1)
    changed |= (corners.arrivals != before[2]).any(axis=(1, 2))
    return _as_sources(plane, np.flatnonzero(changed).astype(np.int32))


def _as_sources(plane: Plane, which: IntArray) -> Wave | None:
    """Return corners as sources for their wedges or, where paths are free, their sectors."""
    corners, sectors = plane.corners, plane.sight.sectors
    number, cones, kinds = [], [], []
    for side in range(2):
        c = which[corners.turns[which, side] & ~corners.free[which]]
        edges, arrivals = corners.edges[c], corners.arrivals[c, side]
        pair = [edges[:, :2], arrivals] if side == 0 else [arrivals, edges[:, 2:]]
        number.append(c)
        cones.append(np.concatenate(pair, axis=1))
        kinds.append(np.full(len(c), NARROW, np.int8))
    for c in which[corners.free[which] & np.isfinite(corners.sizes[which])].tolist():
        row = corners.rows[c]
        rows = slice(sectors.first[row], sectors.first[row + 1])
        number.append(np.full(rows.stop - rows.start, c))
        cones.append(sectors.cones[rows])
        kinds.append(sectors.kinds[rows])
    c = np.concatenate(number).astype(np.int32)
    if len(c) == 0:
        return None
    order = along_curve(np.ascontiguousarray(corners.places[c]))
    c = c[order]
    places, sizes = np.zeros((len(c), 2, 2)), np.full((len(c), 2), np.inf)
    places[:, 0], sizes[:, 0] = corners.places[c], corners.sizes[c]
    entries = with_tree(places, sizes, np.ones(len(c), np.int8))
    nodes = np.full((len(c), 2), -1, np.int32)
    nodes[:, 0] = plane.boundary.corners[c]
    seen = Seen(
        entries,
        np.concatenate(cones)[order],
        np.concatenate(kinds)[order],
        corners.rows[c],
        np.ones(len(c), np.bool_),
    )
    return Wave(seen, nodes)


def joined(first: Wave, second: Wave | None) -> Wave:
    """Return one wave with the entries of two."""
    if second is None:
        return first
    a, b = first.seen.entries, second.seen.entries
    places = np.concatenate([a.places, b.places])
    order = along_curve(np.ascontiguousarray(places[:, 0]))
    entries = with_tree(
        places[order],
        np.concatenate([a.sizes, b.sizes])[order],
        np.concatenate([a.counts, b.counts])[order],
    )
    cones = np.concatenate([first.seen.cones, second.seen.cones])[order]
    kinds = np.concatenate([first.seen.kinds, second.seen.kinds])[order]
    rows = np.concatenate([first.seen.rows, second.seen.rows])[order]
    is_corner = np.concatenate([first.seen.is_corner, second.seen.is_corner])[order]
    nodes = np.concatenate([first.nodes, second.nodes])[order]
    return Wave(Seen(entries, cones, kinds, rows, is_corner), nodes)
