"""Regions between lines in the plane: what a box has outside of them, and without narrow parts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_values, place_text, refusal
from adaptsize._formats.coastal.outlines import Line, outline_of, refuse_crossings, rings_of
from adaptsize.typing import FloatArray, IndexArray

#: Names of the sides of a box, in the order of its corners from the lower left one.
SIDES = ("south", "east", "north", "west")
#: Name of the boundary of land that has none.
LAND = "land"
#: Opened regions overlap the part of the boundary that stays by this share of the radius.
_OVERLAP = 1.01
#: By this share of the radius, more than the narrow parts is left out.
_GAP = 1e-3
#: Corners of 60 degrees or more reach beyond a circle that touches both sides by less than this
#: times its radius, and than this share of the distance of the points that it touches.
_CORNER, _CORNER_SHARE = 1.0, 0.6


def nested(surfaces: npt.NDArray[Any]) -> tuple[IndexArray, IndexArray]:
    """Return how many others each ring is in, and the innermost of these, or -1."""
    import shapely

    corner = shapely.get_point(shapely.get_exterior_ring(surfaces), 0)
    inner, around = shapely.STRtree(surfaces).query(corner, predicate="within")
    depth = np.bincount(inner, minlength=len(surfaces))
    parent = np.full(len(surfaces), -1)
    direct = depth[around] == depth[inner] - 1
    parent[inner[direct]] = around[direct]
    return depth, parent


def sea_in_box(land: Sequence[Line], box: Any) -> list[Line]:
    """Return the lines around the part of a box that is not land.

    Parameters
    ----------
    land : sequence of Line
        Rings, which may reach beyond the box.
    box : array_like of float, shape (4,)
        Lower left and upper right corner.

    Returns
    -------
    list of Line
        Sides of the box are named `SIDES`, and the boundary of land without a name is `LAND`.
    """
    import shapely

    bounds = as_values("box", box, (4,))
    if not (bounds[2:] > bounds[:2]).all():
        raise refusal("box", f"must be (x0, y0, x1, y1) with x0 < x1 and y0 < y1, got {box!r}")
    x0, y0, x1, y1 = bounds
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])
    sides = [Line(corners[k : k + 2], SIDES[k], "box", closes=False) for k in range(4)]
    if not land:
        return sides
    region = shapely.difference(shapely.box(*bounds), _region(land))
    if region.is_empty:
        raise refusal("box", "must have a part outside of land, got none")
    named = [line._replace(name=line.name or LAND) for line in land]
    return _lines(region, [*sides, *named])


def without_narrow_parts(lines: Sequence[Line], width: float, notes: list[str]) -> list[Line]:
    """Return lines without parts of the domain, or of what is around it, narrower than a width.

    The domain is opened by discs of this diameter, then what is around it.  Corners of 60 degrees
    or more stay as they are, as do all other parts of the boundary.  Where a part is cut off, the
    boundary has the name of the nearest line.
    """
    import shapely

    radius = 0.5 * width
    region, removed = _opened(_region(lines), radius)
    if region.is_empty:
        raise refusal("least_width", f"must be smaller: no part is as wide as {width:g}")
    around = shapely.box(*shapely.buffer(region, 3.0 * width).bounds)
    land, filled = _opened(shapely.difference(around, region), radius)
    for parts, text in ((removed, "of the domain left out"), (filled, "of land or holes filled")):
        if len(parts):
            place = place_text(
                shapely.get_coordinates(shapely.point_on_surface(_largest(parts)))[0]
            )
            where = f"at {place}" if len(parts) == 1 else f"the largest at {place}"
            count = "1 part" if len(parts) == 1 else f"{len(parts)} parts"
            notes.append(f"{count} {text}, narrower than {width:g}, {where}")
    if not (len(removed) or len(filled)):
        return [*lines]
    return _lines(shapely.difference(around, land), lines)


def _largest(parts: npt.NDArray[Any]) -> Any:
    import shapely

    return parts[np.argmax(shapely.area(parts))]


def _region(lines: Sequence[Line]) -> Any:
    """Return what an odd number of rings contains."""
    import shapely

    outline = outline_of(lines, sorted({line.name for line in lines if line.name}), [])
    refuse_crossings(outline, lines)
    rings = [outline.points[ring[:, 0]] for ring in rings_of(outline.segments)]
    surfaces = shapely.polygons([shapely.linearrings(ring) for ring in rings])
    depth, parent = nested(surfaces)
    parts = [
        shapely.Polygon(rings[k], [rings[j] for j in np.flatnonzero(parent == k)])
        for k in np.flatnonzero(depth % 2 == 0)
    ]
    return shapely.union_all(parts)


def _opened(region: Any, radius: float) -> tuple[Any, npt.NDArray[Any]]:
    """Return a region without the parts into which no disc fits, and these parts.

    Parts that are only the tips of corners stay.
    """
    import shapely

    inner = shapely.buffer(region, -radius, quad_segs=16)
    wide = shapely.buffer(inner, _OVERLAP * radius, quad_segs=16)
    rest = shapely.get_parts(shapely.difference(region, wide))
    rest = rest[shapely.get_dimensions(rest) == 2]
    if not len(rest):
        return region, rest
    # The ends of each part, where it meets what stays.
    cuts = shapely.intersection(shapely.boundary(wide), region)
    cuts = shapely.get_parts(shapely.line_merge(shapely.union_all(cuts)))
    cuts = cuts[shapely.get_dimensions(cuts) == 1]
    if not len(cuts):
        return _without(region, rest, radius), rest
    part, cut = shapely.STRtree(cuts).query(rest, predicate="dwithin", distance=1e-9 * radius)
    count = np.bincount(part, minlength=len(rest))
    reach, chord = np.zeros((2, len(rest)))
    ends = [shapely.get_point(cuts, k) for k in (0, -1)]
    once = np.flatnonzero(count[part] == 1)
    chord[part[once]] = shapely.distance(ends[0], ends[1])[cut[once]]
    corners, of_part = shapely.get_coordinates(rest[part[once]], return_index=True)
    away = shapely.distance(shapely.points(corners), cuts[cut[once]][of_part])
    np.maximum.at(reach, part[once][of_part], away)
    is_corner = (reach <= _CORNER * radius) & (reach <= _CORNER_SHARE * chord)
    narrow = rest[(count != 1) | ~is_corner]
    return _without(region, narrow, radius), narrow


def _without(region: Any, parts: npt.NDArray[Any], radius: float) -> Any:
    """Return a region without parts, and a little more: what is left must not touch itself."""
    import shapely

    around = shapely.buffer(shapely.union_all(parts), _GAP * radius, quad_segs=2)
    return shapely.difference(region, around)


def _lines(region: Any, named: Sequence[Line]) -> list[Line]:
    """Return the boundary of a region as lines with the names of the nearest ones of others."""
    import shapely

    ends, of_line = [], []
    for k, line in enumerate(named):
        ring = line.points
        if line.closes and (ring[0] != ring[-1]).any():
            ring = np.vstack([ring, ring[:1]])
        ends.append(np.stack([ring[:-1], ring[1:]], axis=1))
        of_line.append(np.full(len(ring) - 1, k))
    tree = shapely.STRtree(shapely.linestrings(np.concatenate(ends)))
    line_of_segment = np.concatenate(of_line)
    found = []
    for ring in shapely.get_rings(shapely.get_parts(region)):
        points = shapely.get_coordinates(ring)
        middles = shapely.points(0.5 * (points[:-1] + points[1:]))
        nearest = line_of_segment[tree.nearest(middles)]
        found += _divided_by_name(points, nearest, named)
    return found


def _divided_by_name(points: FloatArray, nearest: IndexArray, named: Sequence[Line]) -> list[Line]:
    """Return a closed ring as lines, each along edges with the name of the nearest line."""
    names = np.array([named[k].name or "" for k in nearest])
    breaks = np.flatnonzero(names != np.roll(names, 1))
    if not len(breaks):
        line = named[nearest[0]]
        return [Line(points, line.name, line.source, closes=True)]
    n, start = len(names), breaks[0]
    found = []
    for first, last in zip(breaks, np.append(breaks[1:], start + n), strict=True):
        line = named[nearest[first]]
        own = points[np.arange(first, last + 1) % n]
        found.append(Line(own, line.name, line.source, closes=False))
    return found
