"""Surfaces that do not enclose a volume clearly: open ones, bodies that overlap or nearly touch."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_number, place_text
from adaptsize._kernels.crossings import find_crossings, new_crossings
from adaptsize.background import SimplexMesh
from adaptsize.background.location import parts_of
from adaptsize.background.simplex import cut_out
from adaptsize.errors import OpenSurfaceWarning
from adaptsize.geometry.distance.winding import WindingNumber
from adaptsize.remeshing.hole_filling import bodies_of, boundary_loops, fill_loop, merged_surface
from adaptsize.typing import FloatArray

#: Crossings less deep than this times the diagonal count as contacts.  It is above the rounding
#: of the single precision of STL files.
_SLACK = 1e-6
#: Pairs of bodies that are examined for overlaps in common planes, and for small distances: those
#: with the closest boxes first.
_MOST_PAIRS = 200
#: Pairs that are named.
_MOST_NAMED = 3


@dataclass(frozen=True)
class OverlappingBodies:
    """Components of a surface that penetrate each other or themselves."""

    pairs: tuple[tuple[int, int], ...]
    """Numbers of the components, from 1 in the order of their first nodes.  A component that
    intersects itself is paired with itself."""
    n_crossing: int
    """Number of triangles that cross others; 0 if only facets in common planes overlap."""
    depth: float
    """How far a triangle reaches to both sides of another one, where that is largest."""
    place: tuple[float, ...]
    """Where that is."""
    n_bodies: int
    """Number of components of the surface."""

    def __str__(self) -> str:
        """Return which bodies overlap, and the number, depth and place of the crossings."""
        which = [f"{a} and {b}" for a, b in self.pairs if a != b]
        itself = [str(a) for a, b in self.pairs if a == b]
        parts = []
        if which:
            parts.append(f"bodies {_listed(which)} overlap")
        if itself and self.n_bodies == 1:
            parts.append("the surface intersects itself")
        elif itself:
            many = len(itself) > 1
            verb = "intersect themselves" if many else "intersects itself"
            parts.append(f"{'bodies' if many else 'body'} {_listed(itself)} {verb}")
        place = place_text(self.place, 4)
        crossing = f": {self.n_crossing} triangles cross others" if self.n_crossing > 0 else ""
        return f"{' and '.join(parts)}{crossing}, by up to {self.depth:.3g} at {place}"


def overlapping_bodies(surface: SimplexMesh) -> OverlappingBodies | None:
    """Return the components of a surface that overlap or intersect themselves, or None.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space.  Coincident points count as one.

    Notes
    -----
    Bodies that touch do not overlap, whether in points, edges or whole facets, nor do bodies of
    which one is inside the other.  Penetrations up to 1e-6 of the diagonal count as contacts.

    Every pair of triangles whose boxes meet is tested.  Bodies without such a pair may overlap
    where their facets are in common planes.  Hence up to 2000 points of each are tested for being
    inside the other, for at most 200 pairs of bodies.

    Examples
    --------
    >>> points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.2, 0.2, 1], [2, 0.2, 0]]
    >>> print(overlapping_bodies(SimplexMesh(points, [[0, 1, 2], [3, 4, 5]])))
    bodies 1 and 2 overlap: 2 triangles cross others, by up to 0.2 at (0.5, 0.2, 0)
    """
    mesh = merged_surface(surface)
    body = bodies_of(mesh)
    cells, partners, depths, places = _crossings(mesh)
    both = np.sort(np.column_stack([body[cells], body[partners]]), axis=1)
    pairs = {(a, b) for a, b in np.unique(both, axis=0).tolist()}
    deepest = [(float(d), tuple(p.tolist())) for d, p in zip(depths, places, strict=True)]
    for pair, depth, place in _overlaps_in_common_planes(mesh, body, frozenset(pairs)):
        pairs.add(pair)
        deepest.append((depth, place))
    if not pairs:
        return None
    depth, place = max(deepest, key=lambda found: found[0])
    named = tuple(sorted((a + 1, b + 1) for a, b in pairs))
    return OverlappingBodies(named, len(cells), depth, place, int(body.max()) + 1)


def _listed(names: list[str]) -> str:
    """Return names in words, at most a few of them."""
    if len(names) > _MOST_NAMED:
        names = [*names[:_MOST_NAMED], f"{len(names) - _MOST_NAMED} more"]
    return ", ".join(names)


def _crossings(
    mesh: SimplexMesh,
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], FloatArray, FloatArray]:
    """Return the triangles that cross others, and partner, depth and place of the deepest one."""
    locator, n = mesh.locator, mesh.n_cells
    found, slack = new_crossings(n), _SLACK * mesh.diagonal * locator.scale
    for first, last in parts_of(n, 1024):
        find_crossings(locator.tree, slack, first, last, found)
    depths, partners, places = found[:3]
    rows = np.flatnonzero(depths > 0.0)
    cells = locator.cell_of_row[rows].astype(np.intp)
    others = locator.cell_of_row[partners[rows]].astype(np.intp)
    return cells, others, depths[rows] / locator.scale, places[rows] / locator.scale


def _overlaps_in_common_planes(
    mesh: SimplexMesh, body: npt.NDArray[np.intp], known: frozenset[tuple[int, int]]
) -> Iterator[tuple[tuple[int, int], float, tuple[float, ...]]]:
    """Yield pairs of bodies without crossing triangles of which one is partly in the other.

    With each, the depth and the place of the deepest sample.
    """
    slack = _SLACK * mesh.diagonal
    parts: dict[int, _Body] = {}
    for a, b in bodies_with_near_boxes(mesh, body, -slack)[:_MOST_PAIRS]:
        if (a, b) in known:
            continue
        for k in (a, b):
            if k not in parts:
                parts[k] = _Body.of(mesh, body == k)
        for one, other in ((a, b), (b, a)):
            inside = parts[one].partly_inside(parts[other], slack)
            if inside is not None:
                yield (a, b), *inside
                break


def bodies_with_near_boxes(
    mesh: SimplexMesh, body: npt.NDArray[np.intp], within: float
) -> list[tuple[int, int]]:
    """Return the pairs of bodies whose boxes are closer than a distance, the closest first.

    If the distance is negative, the boxes overlap by more than its absolute value.
    """
    count = int(body.max()) + 1
    if count == 1:
        return []
    corners = mesh.points[mesh.cells]
    low, high = np.full((2, count, 3), np.inf)
    np.minimum.at(low, body, corners.min(axis=1))
    np.minimum.at(high, body, -corners.max(axis=1))
    high = -high
    pairs: list[tuple[float, int, int]] = []
    for a in range(len(low) - 1):
        gap = np.maximum(low[a + 1 :] - high[a], low[a] - high[a + 1 :]).max(axis=1)
        pairs += [(float(gap[k]), a, a + 1 + int(k)) for k in np.flatnonzero(gap <= within)]
    return [(a, b) for _, a, b in sorted(pairs)]


class _Body(NamedTuple):
    """One component of a surface."""

    surface: SimplexMesh
    samples: FloatArray
    """Centroids of its triangles."""
    winding: WindingNumber

    @classmethod
    def of(cls, mesh: SimplexMesh, which: npt.NDArray[np.bool_]) -> _Body:
        cells = mesh.cells[which]
        surface = cut_out(mesh.points, cells)[0]
        # Points of a body that are examined for being inside another one.
        stride = -(-len(cells) // 2000)
        samples = mesh.points[cells[::stride]].mean(axis=1)
        return cls(surface, samples, WindingNumber(surface))

    def partly_inside(self, other: _Body, slack: float) -> tuple[float, tuple[float, ...]] | None:
        """Return the depth and place of the deepest sample inside, if others are outside."""
        away = other.surface.locator.nearest(self.samples)[2]
        inside = other.winding.contains(self.samples)
        deep = np.where(inside, away, -away)
        if deep.max() <= slack or deep.min() >= -slack:
            return None
        worst = int(np.argmax(deep))
        return float(deep[worst]), tuple(self.samples[worst].tolist())


#: Surfaces with more bodies than this are not examined for bodies that nearly touch.
_MOST_BODIES = 2000


@dataclass(frozen=True)
class OpenBoundary:
    """The open edges of a surface: edges of one triangle only."""

    n_edges: int
    """Number of open edges."""
    n_loops: int
    """Number of loops that they form: holes, and the rims of sheets."""
    n_loose: int
    """Number of open edges that are not part of a loop."""
    length: float
    """Length of the loop around the largest area; 0 if there is no loop."""
    place: tuple[float, ...]
    """Mean of the nodes of that loop, or of the open edges."""

    def __str__(self) -> str:
        """Return counts and the largest hole."""
        place = place_text(self.place, 4)
        edges = f"{self.n_edges} open edge" + ("s" if self.n_edges > 1 else "")
        if self.n_loops == 0:
            return f"{edges} around {place}"
        loops = f"{self.n_loops} loop" + ("s" if self.n_loops > 1 else "")
        largest = "the largest " if self.n_loops > 1 else ""
        return f"{edges} in {loops}, {largest}{self.length:.4g} long around {place}"


@dataclass(frozen=True)
class NearBodies:
    """Components of a surface that are closer to each other than a tolerance."""

    n_pairs: int
    """Number of pairs of components.  At most 200 are examined, those with the closest boxes."""
    distance: float
    """Smallest distance of a node, midpoint or centroid to the other component."""
    place: tuple[float, ...]
    """Where that is."""

    def __str__(self) -> str:
        """Return the number of pairs, and the distance and place of the closest one."""
        place = place_text(self.place, 4)
        pairs = (
            "1 pair of bodies is only"
            if self.n_pairs == 1
            else (f"{self.n_pairs} pairs of bodies are down to")
        )
        return f"{pairs} {self.distance:.3g} apart at {place}"


def open_boundary(surface: SimplexMesh, within: float = 0.0) -> OpenBoundary | None:
    """Return the open edges of a surface in space, or None if it is closed.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space.  Coincident points count as one.
    within : float
        Loops narrower than this are not counted: gaps that a generator with this tolerance
        closes.  The width is the area over half the length.

    Examples
    --------
    >>> points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> print(open_boundary(SimplexMesh(points, [[0, 1, 3], [1, 2, 3], [2, 0, 3]])))
    3 open edges in 1 loop, 3.414 long around (0.3333, 0.3333, 0)
    """
    within = as_number("within", within, lower=0.0)
    mesh = merged_surface(surface)
    if mesh.is_closed:
        return None
    n_in_loops, n_edges, n_loops = 0, 0, 0
    largest, length, around = 0.0, 0.0, None
    for loop in boundary_loops(mesh):
        n_in_loops += len(loop)
        a, b, c = mesh.points[fill_loop(mesh.points, loop)].transpose(1, 0, 2)
        area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        ends = mesh.points[loop]
        whole = float(np.linalg.norm(ends - np.roll(ends, -1, axis=0), axis=1).sum())
        if area > 0.5 * within * whole:
            n_edges, n_loops = n_edges + len(loop), n_loops + 1
            if area > largest:
                largest, length, around = area, whole, ends
    open_edges = mesh.facets[mesh.facet_cell_counts == 1]
    n_loose = len(open_edges) - n_in_loops
    if n_loose == 0 and n_loops == 0:
        return None
    if around is None:
        around = mesh.points[np.unique(open_edges)]
    place = around.mean(axis=0)
    # Coordinates of a mean smaller than this times the diagonal are 0.
    place[np.abs(place) < 1e-12 * mesh.diagonal] = 0.0
    return OpenBoundary(n_edges + n_loose, n_loops, n_loose, length, tuple(place.tolist()))


def near_bodies(
    surface: SimplexMesh, within: float, *, overlapping: OverlappingBodies | None = None
) -> NearBodies | None:
    """Return the components of a surface that are closer than a distance, or None.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space.  Coincident points count as one.
    within : float
        Distance in the unit of the coordinates.
    overlapping : OverlappingBodies or None
        Pairs to leave out, from `overlapping_bodies` of the same surface.

    Warns
    -----
    OpenSurfaceWarning
        If there are more than 2000 components.  Their distances are not examined then.

    Notes
    -----
    The distance is measured at the nodes, the midpoints of the edges and the centroids, so
    components that cross each other between these points may be missed: see `overlapping_bodies`.

    Examples
    --------
    >>> points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0.01], [1, 0, 0.01], [0, 1, 0.01]]
    >>> print(near_bodies(SimplexMesh(points, [[0, 1, 2], [3, 4, 5]]), 0.1))
    1 pair of bodies is only 0.01 apart at (0, 0, 0)
    """
    within = as_number("within", within, lower=0.0)
    mesh = merged_surface(surface)
    body = bodies_of(mesh)
    count = int(body.max()) + 1
    if count > _MOST_BODIES:
        warnings.warn(
            f"the surface has {count} bodies; whether they are closer to each other than the "
            f"tolerance was not examined, as there are more than {_MOST_BODIES}",
            OpenSurfaceWarning,
            stacklevel=2,
        )
    if not 1 < count <= _MOST_BODIES:
        return None
    known = () if overlapping is None else overlapping.pairs
    pairs = bodies_with_near_boxes(mesh, body, within)
    pairs = [(a, b) for a, b in pairs if (a + 1, b + 1) not in known]
    found: list[tuple[float, FloatArray]] = []
    for a, b in pairs[:_MOST_PAIRS]:
        best = min(
            (_nearest(mesh, body == one, body == other, within) for one, other in ((a, b), (b, a))),
            key=lambda candidate: candidate[0],
        )
        if best[0] <= within:
            found.append(best)
    if not found:
        return None
    distance, place = min(found, key=lambda candidate: candidate[0])
    return NearBodies(len(found), distance, tuple(place.tolist()))


def warn_of_surface(surface: SimplexMesh, tolerance: float) -> bool:
    """Warn of a surface whose volume a generator has to guess.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space.
    tolerance : float
        Allowed distance of the new boundary, in the unit of the coordinates.

    Returns
    -------
    bool
        Whether a warning says that bodies may be joined.

    Warns
    -----
    OpenSurfaceWarning
        If the surface is open, or has bodies that overlap or are closer to each other than the
        tolerance.
    """
    holes = open_boundary(surface, tolerance)
    if holes is not None:
        warnings.warn(
            f"the surface is open: {holes}; the generator closes or drops what it does not clearly "
            "enclose; see close_holes, or remesh the surface with target='triangles'",
            OpenSurfaceWarning,
            stacklevel=3,
        )
    overlapping = overlapping_bodies(surface)
    if overlapping is not None:
        warnings.warn(
            f"{overlapping}; the generator fills their union; join the bodies before meshing to "
            "keep what is intended",
            OpenSurfaceWarning,
            stacklevel=3,
        )
    near = near_bodies(surface, tolerance, overlapping=overlapping)
    if near is not None:
        warnings.warn(
            f"{near}, less than the tolerance of {tolerance:.3g}: they may be joined; "
            "lower the tolerance to keep them apart",
            OpenSurfaceWarning,
            stacklevel=3,
        )
    return overlapping is not None or near is not None


def _nearest(
    mesh: SimplexMesh,
    one: npt.NDArray[np.bool_],
    other: npt.NDArray[np.bool_],
    within: float,
) -> tuple[float, FloatArray]:
    """Return the smallest distance from samples of one body to another, and the sample."""
    target = mesh.points[mesh.cells[other]]
    low, high = target.min(axis=(0, 1)) - within, target.max(axis=(0, 1)) + within
    corners = mesh.points[mesh.cells[one]]
    middles = 0.5 * (corners + corners[:, [1, 2, 0]])
    samples = np.concatenate([corners, middles, corners.mean(axis=1, keepdims=True)], axis=1)
    samples = np.unique(samples.reshape(-1, 3), axis=0)
    samples = samples[((samples >= low) & (samples <= high)).all(axis=1)]
    if len(samples) == 0:
        return np.inf, np.full(3, np.nan)
    low, high = samples.min(axis=0) - within, samples.max(axis=0) + within
    close = ((target.max(axis=1) >= low) & (target.min(axis=1) <= high)).all(axis=1)
    if not close.any():
        return np.inf, np.full(3, np.nan)
    cells = mesh.cells[other][close]
    distance = cut_out(mesh.points, cells)[0].locator.nearest(samples)[2]
    first = int(np.argmin(distance))
    return float(distance[first]), samples[first]
