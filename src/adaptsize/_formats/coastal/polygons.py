"""Polygons and lines in the plane as a mesh of triangles whose boundary they are."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._calls import recorded
from adaptsize._checks import as_number, as_points, describe, place_text, refusal, warn_caller
from adaptsize._formats.coastal.outlines import (
    Line,
    Outline,
    outline_of,
    refuse_crossings,
    rings_of,
)
from adaptsize._formats.coastal.regions import nested, sea_in_box, without_narrow_parts
from adaptsize.background import SimplexMesh
from adaptsize.background.enclosing import enclosing_diameter
from adaptsize.background.flipping import flip_edges
from adaptsize.background.merging import merge_equal_points
from adaptsize.errors import InputWarning
from adaptsize.typing import FloatArray, IndexArray, IntArray

#: The longest edge of the boundary over the diameter, so that nodes carry sizes along it.
_LONGEST_EDGE = 1.0 / 50.0
#: Lines that would cross if they were simplified by this share of the diameter stay as they are.
_FINEST = 1e-5
#: Lines are simplified by at least this share of the least width.
_SIMPLER = 0.2
#: Barycentric coordinates of a new node: triangles must not become flat.
_LEAST_SHARE = 0.01


#: A polygon, several, or those of each name.
Rings: TypeAlias = npt.ArrayLike | Sequence[npt.ArrayLike] | Mapping[str, npt.ArrayLike]


@recorded("polygons", reads=True)
def polygons(
    outer: Any,
    holes: Rings = (),
    islands: Rings = (),
    *,
    box: npt.ArrayLike | None = None,
    least_width: float = 0.0,
    tolerance: float = 0.0,
) -> SimplexMesh:
    """Return the domain between polygons in the plane, as a mesh of triangles.

    The mesh is a constrained Delaunay triangulation [1]_ with some nodes inside.  It is a
    domain for `size_function` and `remesh`, not a mesh to compute on.

    Parameters
    ----------
    outer : array_like of float, shape (n, 2), list of these, mapping or path-like
        A polygon, its corners in order in any orientation, or several.  The last point may
        repeat the first.

        Or a mapping from names to lines or lists of lines, that are rings together:
        ``{"open sea": line, "land": [coast, pier]}``.  The name of each part of the boundary is
        kept.  A line along a part of another ring names this part.

        Or a file for `read`, such as GeoJSON or a shapefile, or an object with
        ``__geo_interface__``, such as those of shapely and geopandas, or a SimplexMesh of
        segments.
    holes, islands : array_like of float, shape (n, 2), list of these, or mapping, optional
        Polygons inside others, and also their names: ``{"pier": ring, "island": [ring, ring]}``.
    box : array_like of float, shape (4,), optional
        Lower left and upper right corner of a box.  The polygons are then land, which may reach
        beyond the box, and the domain is the part of the box outside of them: the sea.  The sides
        of the box that remain are named ``"south"``, ``"east"``, ``"north"`` and ``"west"``, the
        shore ``"land"`` unless it has names.
    least_width : float, default 0
        Parts of the domain narrower than this are left out, and parts of what is around it, such as
        spits and small islands, become part of it, with a warning that has their number.  Corners
        of 60 degrees or more stay.  Lines are then simplified by at least a fifth of it.  Choose
        the smallest size: narrower parts cannot be meshed with it.
    tolerance : float, default 0
        Lines are simplified by at most this distance, over the diameter of the smallest circle
        around all of them, 0 to 1, and rings in circles of this radius are left out, with a
        warning.

    Returns
    -------
    SimplexMesh
        Triangles of positive orientation, whose boundary are the given lines.  Edges longer than
        1/50 of the diameter are divided.  ``tagged_facets`` are the parts with names, in
        ``tag_names``; tags count from 1 in the order of the names.

    Raises
    ------
    ValueError
        If lines cross or touch, a ring is open, a hole is not inside another ring, or a
        coordinate is not finite.  The message has the place.

    Warns
    -----
    InputWarning
        If points are repeated, or rings or narrow parts are left out.

    Notes
    -----
    A point is in the domain if an odd number of rings contains it, as for `SignedDistance`.  So a
    ring in a hole bounds another part of the domain.

    50 000 points take about 2.5 seconds.

    References
    ----------
    .. [1] L. P. Chew, "Constrained Delaunay triangulations", Algorithmica 4 (1989) 97-108.

    Examples
    --------
    >>> square = [(0, 0), (4, 0), (4, 4), (0, 4)]
    >>> domain = polygons(square, holes={"pier": [(1, 1), (2, 1), (2, 2)]})
    >>> float(domain.measures.sum().round(9)), dict(domain.tag_names)
    (15.5, {(1, 1): 'pier'})

    Lines of two names that are a ring together:

    >>> shore, sea = [(0, 0), (2, 1), (4, 0)], [(4, 0), (4, -3), (0, -3), (0, 0)]
    >>> dict(polygons({"land": shore, "open sea": sea}).tag_names)
    {(1, 1): 'land', (1, 2): 'open sea'}

    The sea in a box, around land that reaches out of it:

    >>> land = [(-5, -5), (9, -5), (9, 1), (2, 2), (-5, 1)]
    >>> sea = polygons({"shore": land}, box=(0, 0, 4, 4))
    >>> [name for _, name in sorted(sea.tag_names.items())]
    ['east', 'north', 'shore', 'west']

    >>> polygons([(0, 0), (4, 4), (4, 0), (0, 4)])
    Traceback (most recent call last):
    ...
    ValueError: outer crosses or touches itself at (2, 2)
    """
    from adaptsize._formats.coastal import polygon_files

    share = as_number("tolerance", tolerance, lower=0.0, upper=1.0)
    width = as_number("least_width", least_width, lower=0.0)
    notes: list[str] = []
    if isinstance(outer, str | os.PathLike):
        content = polygon_files.read_file(outer, notes)
    elif hasattr(outer, "__geo_interface__"):
        content = polygon_files.of_geojson(outer.__geo_interface__, notes)
    else:
        content = polygon_files.Content(_lines_of("outer", outer))
    lines = [*content.lines, *_lines_of("holes", holes), *_lines_of("islands", islands)]
    in_holes = content.in_holes
    with polygon_files.naming(outer):
        if box is not None:
            lines, in_holes = sea_in_box(lines, box), None
        if width > 0.0:
            lines, in_holes = without_narrow_parts(lines, width, notes), None
        mesh = domain_of(lines, notes, share, in_holes, least=_SIMPLER * width)
    if notes:
        warn_caller("; ".join(notes), InputWarning)
    return mesh


def _lines_of(what: str, given: Any) -> list[Line]:
    """Return the rings or lines in an argument."""
    if isinstance(given, Mapping):
        named: list[Line] = []
        for name, part in given.items():
            if not isinstance(name, str) or not 0 < len(name) <= 100:
                raise ValueError(
                    f"{what} must have names of 1 to 100 letters, got {describe(name)}"
                )
            named += [line._replace(name=name) for line in _lines_of(f"{what}[{name!r}]", part)]
        # Those of the outer boundary are parts of rings; if they do not meet, one is wrong.
        closes = what != "outer" or len(named) == 1
        return [line._replace(closes=closes, is_hole=what != "outer") for line in named]
    if isinstance(given, SimplexMesh):
        return _segments_of(what, given)
    is_list = isinstance(given, Sequence | np.ndarray) and not isinstance(given, str)
    if not is_list or (isinstance(given, np.ndarray) and given.ndim == 0):
        raise ValueError(f"{what} must be polygons, got {describe(given)}")
    is_one = len(given) > 0 and _is_point(given[0])
    rings = {what: given} if is_one else {f"{what}[{k}]": ring for k, ring in enumerate(given)}
    is_hole = not what.startswith("outer")
    return [
        Line(as_points(name, ring, 2), None, name, is_hole=is_hole) for name, ring in rings.items()
    ]


def _segments_of(what: str, mesh: SimplexMesh) -> list[Line]:
    if mesh.cell_dim != 1 or mesh.dim != 2:
        raise ValueError(f"{what} must be segments in the plane, got {mesh!r}")
    tags = np.zeros(mesh.n_cells, np.int32) if mesh.cell_tags is None else mesh.cell_tags
    names = [mesh.tag_names.get((1, tag), str(tag)) if tag else None for tag in tags.tolist()]
    return [
        Line(ends, name, f"{what}, segment {k}", closes=False)
        for k, (ends, name) in enumerate(zip(mesh.points[mesh.cells], names, strict=True))
    ]


def _is_point(given: Any) -> bool:
    if isinstance(given, np.ndarray):
        return given.ndim == 1
    return isinstance(given, Sequence) and len(given) > 0 and np.isscalar(given[0])


def domain_of(
    lines: Sequence[Line],
    notes: list[str],
    share: float = 0.0,
    in_holes: FloatArray | None = None,
    *,
    least: float = 0.0,
) -> SimplexMesh:
    """Return the domain between lines, see `polygons`.

    Parameters
    ----------
    lines : sequence of Line
    notes : list of str
        In/Out: what was changed.
    share : float
        Tolerance over the diameter.
    in_holes : float64[k, 2] or None
        Points, one or more in each hole and none in the domain; None if they are not known.
    least : float
        Smallest tolerance, as a length.
    """
    import shapely

    names = sorted({line.name for line in lines if line.name is not None})
    n_notes = len(notes)
    outline = outline_of(lines, names, notes)
    refuse_crossings(outline, lines)
    rings = rings_of(outline.segments)
    diameter = enclosing_diameter(outline.points)
    length = max(share * diameter, least)
    if length > 0.0:
        simple = _simplified(outline, rings, (lines, names), length, notes)
        try:
            return domain_of(simple, notes, 0.0, in_holes)
        except ValueError:
            # The lines alone do not cross, and GEOS does not promise that simpler ones do not.
            del notes[n_notes:]
            share = 0.0 if length < _FINEST * diameter else 0.5 * length / diameter
            return domain_of(lines, notes, share, in_holes)
    longest = _LONGEST_EDGE * diameter
    parts = [_divided(outline.points[ring[:, 0]], longest) for ring in rings]
    surfaces = shapely.polygons([shapely.linearrings(corners) for corners, _ in parts])
    depth, parent = nested(surfaces)
    _refuse_outside(outline, rings, lines, depth)
    _check_holes(surfaces[depth % 2 == 1], in_holes)
    cut = [
        shapely.Polygon(parts[k][0], [parts[j][0] for j in np.flatnonzero(parent == k)])
        for k in np.flatnonzero(depth % 2 == 0)
    ]
    try:
        corners = shapely.get_coordinates(shapely.constrained_delaunay_triangles(cut))
    except shapely.GEOSException as error:
        raise ValueError(f"a ring is too small or too thin to be divided ({error})") from error
    corners = corners.reshape(-1, 4, 2)[:, 2::-1].reshape(-1, 2)  # closed, and clockwise
    given = np.concatenate([points for points, _ in parts])
    points, number = merge_equal_points(np.concatenate([given, corners]))
    start = np.arange(len(given), dtype=np.int32)
    counts = [len(points) for points, _ in parts]
    end = np.concatenate([np.roll(own, -1) for own in np.split(start, np.cumsum(counts)[:-1])])
    edges = np.column_stack([start, end])
    tags = outline.tags[np.concatenate([r[p[1], 1] for r, p in zip(rings, parts, strict=True)])]
    cells = number[len(given) :].reshape(-1, 3)
    inner = _with_inner_nodes(SimplexMesh(points, cells), np.sort(edges, axis=1))
    return SimplexMesh(
        inner.points,
        inner.cells,
        tagged_facets=edges[tags > 0] if names else None,
        facet_tags=tags[tags > 0] if names else None,
        tag_names={(1, k + 1): name for k, name in enumerate(names)},
    )


def _simplified(
    outline: Outline,
    rings: list[IndexArray],
    given: tuple[Sequence[Line], list[str]],
    length: float,
    notes: list[str],
) -> list[Line]:
    """Return lines with fewer points, at most ``length`` from the given ones, that do not cross."""
    import shapely

    lines, names = given
    chains, new, n_small = [], [], 0
    for ring in rings:
        points = outline.points[ring[:, 0]]
        if shapely.minimum_bounding_radius(shapely.multipoints(points)) < length:
            n_small += 1
            continue
        tags = outline.tags[ring[:, 1]]
        breaks = np.flatnonzero(tags != np.roll(tags, 1))
        if not len(breaks):  # the start stays: it must not depend on how the ring lies
            away = np.linalg.norm(points - points.mean(axis=0), axis=1)
            breaks = np.lexsort((*points.T, -np.round(away / away.max(), 9)))[:1]
        turned = np.roll(ring, -breaks[0], axis=0)
        for part in np.split(np.arange(len(ring)), (breaks - breaks[0])[1:]):
            nodes = turned[np.append(part, part[-1] + 1) % len(ring), 0]
            chains.append(outline.points[nodes])
            edge = turned[part[0], 1]
            name = names[outline.tags[edge] - 1] if outline.tags[edge] else None
            new.append(lines[outline.line[edge]]._replace(name=name, closes=False))
    if not chains:
        raise refusal("tolerance", f"must be smaller: all rings are in circles of {length:.3g}")
    if n_small:
        notes.append(f"{n_small} rings in circles of the tolerance, {length:.3g}, left out")
    whole = shapely.MultiLineString(chains)
    parts = shapely.get_parts(shapely.simplify(whole, length, preserve_topology=True))
    return [
        line._replace(points=shapely.get_coordinates(part))
        for line, part in zip(new, parts, strict=True)
    ]


def _divided(points: FloatArray, longest: float) -> tuple[FloatArray, IndexArray]:
    """Return the points of a ring with long edges divided evenly, and the old edge of each."""
    step = np.roll(points, -1, axis=0) - points
    count = np.maximum(np.ceil(np.hypot(*step.T) / longest), 1).astype(np.intp)
    edge = np.repeat(np.arange(len(points)), count)
    share = (np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)) / count[edge]
    return points[edge] + share[:, None] * step[edge], edge


def _refuse_outside(
    outline: Outline, rings: list[IndexArray], lines: Sequence[Line], depth: IndexArray
) -> None:
    for ring, n_around in zip(rings, depth, strict=True):
        line = lines[outline.line[ring[0, 1]]]
        if n_around == 0 and line.is_hole:
            place = place_text(outline.points[ring[0, 0]])
            raise ValueError(f"{line.source} is not inside another ring, near {place}")


def _check_holes(holes: npt.NDArray[Any], in_holes: FloatArray | None) -> None:
    """Raise a ValueError if a hole is without a point, where points are known."""
    import shapely

    if in_holes is None:
        return
    tree = shapely.STRtree(shapely.points(in_holes))
    has_point = np.isin(np.arange(len(holes)), tree.query(holes, predicate="contains")[0])
    if not has_point.all():
        place = place_text(shapely.get_coordinates(holes[~has_point][0])[0])
        raise ValueError(f"the ring near {place} is not a hole; lines inside cannot be read")


def _with_inner_nodes(mesh: SimplexMesh, boundary: IntArray) -> SimplexMesh:
    """Return a Delaunay triangulation with more nodes inside, the boundary as it is.

    They carry sizes away from the boundary.  The places are 2 000 of the R2 sequence in the box
    around the domain: evenly spread, with no three in a line.
    """
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    golden = np.array([0.7548776662466927, 0.5698402909980532])
    new = low + (np.arange(1, 2001)[:, None] * golden % 1.0) * (high - low)
    new = new[mesh.locator.nearest(new)[2] == 0.0]
    while len(new):
        cell, shares, _ = mesh.locator.nearest(new)
        good = np.flatnonzero(shares.min(axis=1) > _LEAST_SHARE)
        split, first = np.unique(cell[good], return_index=True)
        if not len(split):
            break
        chosen = good[first]
        number = mesh.n_points + np.arange(len(split))
        a, b, c = mesh.cells[split].T
        parts = [
            np.column_stack(three) for three in ((a, b, number), (b, c, number), (c, a, number))
        ]
        cells = np.concatenate([np.delete(mesh.cells, split, axis=0), *parts])
        mesh = flip_edges(SimplexMesh(np.concatenate([mesh.points, new[chosen]]), cells), boundary)
        new = np.delete(new, chosen, axis=0)
    return mesh
