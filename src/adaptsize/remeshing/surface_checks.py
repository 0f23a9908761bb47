"""Surfaces that do not enclose a volume clearly: open ones, bodies that overlap or nearly touch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from adaptsize._checks import as_number, check_type, place_text, warn_caller
from adaptsize._messages import Message
from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import cut_out
from adaptsize.background.topology import components_of, pairs_of_cells
from adaptsize.errors import OpenSurfaceWarning
from adaptsize.geometry.distance.winding import WindingNumber
from adaptsize.geometry.solid import SLACK as _SLACK
from adaptsize.geometry.solid import Solid
from adaptsize.remeshing import tuning
from adaptsize.remeshing.crossings import crossing_facets
from adaptsize.remeshing.hole_filling import bodies_of, boundary_loops, fill_loop, merged_surface
from adaptsize.remeshing.meshed_surface import surface_to_fill


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

    See `SimplexMesh.overlapping_bodies`.
    """
    bodies = _Bodies(surface)
    cells, partners, depths, places = crossing_facets(bodies.mesh)
    both = np.sort(np.column_stack([bodies.number[cells], bodies.number[partners]]), axis=1)
    pairs = {(a, b) for a, b in np.unique(both, axis=0).tolist()}
    deepest = list(zip(depths.tolist(), places, strict=True))
    slack = _SLACK * bodies.mesh.diagonal
    for a, b in bodies.near(-slack)[: tuning.MOST_PAIRS]:
        if (a, b) in pairs:
            continue
        # Facets in common planes do not cross.
        for one, other in ((a, b), (b, a)):
            samples = bodies[one].samples[
                :: -(-len(bodies[one].samples) // tuning.MOST_POINTS_OF_BODY)
            ]
            away = bodies[other].surface.locator.nearest(samples)[2]
            away = np.where(bodies[other].winding.contains(samples), away, -away)
            if away.max() > slack and away.min() < -slack:
                pairs.add((a, b))
                deepest.append((float(away.max()), samples[away.argmax()]))
                break
    if not pairs:
        return None
    depth, place = max(deepest, key=lambda found: found[0])
    named = tuple(sorted((a + 1, b + 1) for a, b in pairs))
    return OverlappingBodies(named, len(cells), depth, tuple(place.tolist()), len(bodies.low))


def _listed(names: list[str]) -> str:
    """Return names in words, at most a few of them."""
    if len(names) > tuning.MOST_NAMED:
        names = [*names[: tuning.MOST_NAMED], f"{len(names) - tuning.MOST_NAMED} more"]
    return ", ".join(names)


class _Bodies:
    """The components of a surface, numbered 0, 1, ... in the order of their first nodes."""

    def __init__(self, surface: SimplexMesh) -> None:
        self.mesh = merged_surface(surface)
        self.number = bodies_of(self.mesh)
        corners = self.mesh.points[self.mesh.cells]
        self.low, high = np.full((2, int(self.number.max()) + 1, 3), np.inf)
        np.minimum.at(self.low, self.number, corners.min(axis=1))
        np.minimum.at(high, self.number, -corners.max(axis=1))
        self.high = -high
        self._known: dict[int, _Body] = {}

    def __getitem__(self, number: int) -> _Body:
        """Return one of them."""
        if number not in self._known:
            cells = self.mesh.cells[self.number == number]
            self._known[number] = _Body(cut_out(self.mesh.points, cells)[0])
        return self._known[number]

    def near(self, within: float) -> list[tuple[int, int]]:
        """Return the pairs whose boxes are closer than a distance, the closest first.

        If the distance is negative, the boxes overlap by more than its absolute value.
        """
        pairs: list[tuple[float, int, int]] = []
        for a, (low, high) in enumerate(zip(self.low, self.high, strict=True)):
            gap = np.maximum(self.low[a + 1 :] - high, low - self.high[a + 1 :]).max(axis=1)
            pairs += [(float(gap[k]), a, a + 1 + int(k)) for k in np.flatnonzero(gap <= within)]
        return [(a, b) for _, a, b in sorted(pairs)]


class _Body:
    """One component of a surface."""

    def __init__(self, surface: SimplexMesh) -> None:
        self.surface = surface
        middles = (surface.points[rows].mean(axis=1) for rows in (surface.cells, surface.edges))
        self.samples = np.concatenate([surface.points, *middles])

    @cached_property
    def winding(self) -> WindingNumber:
        """Its winding number."""
        return WindingNumber(self.surface)

    def distance(self, other: _Body, within: float) -> tuple[float, list[float]]:
        """Return the smallest distance of a sample from another body, and the sample.

        Samples farther from the box of the other body than ``within`` are left out.
        """
        low, high = (getattr(other.surface.points, name)(axis=0) for name in ("min", "max"))
        near = (self.samples >= low - within) & (self.samples <= high + within)
        samples = self.samples[near.all(axis=1)]
        if len(samples) == 0:
            return np.inf, []
        distance = other.surface.locator.nearest(samples)[2]
        return float(distance.min()), samples[distance.argmin()].tolist()


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
    area: float = 0.0
    """Area of the triangles that close all loops."""

    def __str__(self) -> str:
        """Return counts and the largest hole."""
        place = place_text(self.place, 4)
        edges = f"{self.n_edges} open edge" + ("s" if self.n_edges > 1 else "")
        if self.n_loops == 0:
            return f"{edges} around {place}"
        loops = f"{self.n_loops} loop" + ("s" if self.n_loops > 1 else "")
        largest = "the largest " if self.n_loops > 1 else ""
        area = f"with an area of {self.area:.4g}"
        return f"{edges} in {loops} {area}, {largest}{self.length:.4g} long around {place}"


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

    See `SimplexMesh.open_boundary`.
    """
    within = as_number("within", within, lower=0.0)
    mesh = merged_surface(surface)
    if mesh.is_closed:
        return None
    n_in_loops, n_edges, n_loops, total = 0, 0, 0, 0.0
    largest, length, around = 0.0, 0.0, None
    for loop in boundary_loops(mesh):
        n_in_loops += len(loop)
        a, b, c = mesh.points[fill_loop(mesh.points, loop)].transpose(1, 0, 2)
        area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        ends = mesh.points[loop]
        whole = float(np.linalg.norm(ends - np.roll(ends, -1, axis=0), axis=1).sum())
        if area > 0.5 * within * whole:
            n_edges, n_loops, total = n_edges + len(loop), n_loops + 1, total + area
            if area > largest:
                largest, length, around = area, whole, ends
    open_edges = mesh.facets[mesh.facet_cell_counts == 1]
    n_loose = len(open_edges) - n_in_loops
    if n_loose == 0 and n_loops == 0:
        return None
    if around is None:
        around = mesh.points[np.unique(open_edges)]
    place = around.mean(axis=0)
    # Coordinates of the mean that are rounding become 0.
    place[np.abs(place) < 1e-12 * mesh.diagonal] = 0.0
    n_edges += n_loose
    return OpenBoundary(n_edges, n_loops, n_loose, length, tuple(place.tolist()), total)


def near_bodies(
    surface: SimplexMesh, within: float, *, overlapping: OverlappingBodies | None = None
) -> NearBodies | None:
    """Return the components of a surface that are closer than a distance, or None.

    See `SimplexMesh.near_bodies`.
    """
    within = as_number("within", within, lower=0.0)
    bodies = _Bodies(surface)
    count = len(bodies.low)
    if count > tuning.MOST_BODIES:
        warn_caller(
            f"the surface has {count} bodies; whether they are closer to each other than the "
            f"tolerance was not examined, as there are more than {tuning.MOST_BODIES}",
            OpenSurfaceWarning,
        )
        return None
    if overlapping is not None:
        check_type("overlapping", overlapping, OverlappingBodies)
    known = () if overlapping is None else overlapping.pairs
    pairs = [(a, b) for a, b in bodies.near(within) if (a + 1, b + 1) not in known]
    found: list[tuple[float, list[float]]] = []
    for a, b in pairs[: tuning.MOST_PAIRS]:
        one, other = bodies[a], bodies[b]
        found.append(min(one.distance(other, within), other.distance(one, within)))
    n_near = sum(distance <= within for distance, _ in found)
    if n_near == 0:
        return None
    distance, place = min(found)
    return NearBodies(n_near, distance, tuple(place))


@dataclass(frozen=True)
class InnerFacets:
    """Facets of a surface inside of the solid that it encloses."""

    n_facets: int
    """Number of facets with the solid on both sides."""
    place: tuple[float, ...]
    """The centroid of the largest one."""

    def __str__(self) -> str:
        """Return number and place."""
        facets = "1 facet has" if self.n_facets == 1 else f"{self.n_facets} facets have"
        return f"{facets} the solid on both sides, the largest at {place_text(self.place, 4)}"


def inner_facets(solid: Solid) -> InnerFacets | None:
    """Return the facets inside of a solid, or None.  Those of bodies that overlap do not count."""
    if solid.is_divided or not solid.is_closed or not solid.hidden.any():
        return None
    hidden, mesh = np.flatnonzero(solid.hidden), solid.surface
    largest = hidden[mesh.measures[hidden].argmax()]
    return InnerFacets(len(hidden), tuple(mesh.points[mesh.cells[largest]].mean(axis=0).tolist()))


@dataclass(frozen=True)
class TouchingBodies:
    """Parts of a surface that have only nodes or edges in common."""

    n_nodes: int
    """Number of common nodes."""
    place: tuple[float, ...]
    """The first of them."""

    def __str__(self) -> str:
        """Return number and place."""
        nodes = "1 node" if self.n_nodes == 1 else f"{self.n_nodes} nodes, the first"
        return f"parts of the surface touch at {nodes} at {place_text(self.place, 4)}"


def touching_bodies(solid: Solid) -> TouchingBodies | None:
    """Return where parts of the boundary of a solid have only nodes or edges in common, or None.

    Examples
    --------
    Two tetrahedra with a common corner:

    >>> ends = np.eye(3)
    >>> points = [[0, 0, 0], *ends, *-ends]
    >>> cells = [[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]]
    >>> mirrored = [[0, 4, 5], [0, 5, 6], [0, 6, 4], [4, 6, 5]]
    >>> print(touching_bodies(Solid(SimplexMesh(points, cells + mirrored))))
    parts of the surface touch at 1 node at (0, 0, 0)
    """
    surface = solid.surface
    kept = np.ones(surface.n_cells, bool) if solid.is_divided else ~solid.hidden
    if not kept.any():
        return None
    mesh = SimplexMesh(surface.points, surface.cells[kept])
    # Corners of triangles at one node belong together if a path over edges of two triangles joins
    # them.
    nodes = mesh.cells.ravel()
    cells, corners = np.divmod(pairs_of_cells(mesh, mesh.facet_cell_counts == 2), 3)
    links = []
    for step in (1, 2):
        one = 3 * cells[:, 0] + (corners[:, 0] + step) % 3
        ends = 3 * cells[:, 1:] + (corners[:, 1:] + [[1, 2]]) % 3
        other = ends[np.arange(len(one)), (nodes[ends] == nodes[one][:, None]).argmax(axis=1)]
        links.append(np.column_stack([one, other]))
    fans = components_of(np.concatenate(links), len(nodes))
    at = np.unique(np.column_stack([nodes, fans]), axis=0)[:, 0]
    shared = np.flatnonzero(np.bincount(at) > 1)
    if not len(shared):
        return None
    return TouchingBodies(len(shared), tuple(mesh.points[shared[0]].tolist()))


def doubts(
    surface: SimplexMesh, tolerance: float, solid: Solid | None = None
) -> Iterator[tuple[str, Any, str]]:
    """Yield why a generator has to guess the volume of a surface: name, record and text.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space.
    tolerance : float
        Allowed distance of the new boundary, in the unit of the coordinates.
    solid : Solid, optional
        What the surface encloses, if that is known.
    """
    holes = open_boundary(surface, tolerance)
    if holes is not None:
        text = (
            "the surface is open: {}; the generator closes or drops what it does not clearly "
            "enclose; {close_holes} closes the holes, {target:'triangles'} keeps a surface"
        )
        if surface_to_fill(surface).n_caps:
            text = "the surface is open: {}; flat caps close it; {target:'triangles'} keeps it open"
        yield "open_boundary", holes, Message(text, holes)
    overlapping = overlapping_bodies(surface)
    if overlapping is not None:
        text = (
            "the generator fills their union, without parts that are turned inside out; join the "
            "bodies before meshing to keep what is meant"
        )
        yield "overlapping_bodies", overlapping, f"{overlapping}; {text}"
    solid = Solid.of(merged_surface(surface)) if solid is None else solid
    inner = inner_facets(solid)
    if inner is not None:
        text = (
            "no interface is kept there; a body inside another one is a cavity only if its "
            "triangles have the other side"
        )
        yield "inner_facets", inner, f"{inner}; {text}"
    touching = None if inner is not None or overlapping is not None else touching_bodies(solid)
    if touching is not None:
        text = "the mesh is joined there and nowhere else; move them apart, or let them overlap"
        yield "touching_bodies", touching, f"{touching}; {text}"
    near = near_bodies(surface, tolerance, overlapping=overlapping)
    if near is not None and near.distance <= _SLACK * surface.diagonal:
        text = f"{near}: they are joined where they share a part of a face, without an interface"
        yield "near_bodies", near, text
    elif near is not None:
        text = f"{near}, less than the tolerance of {tolerance:.3g}: they may be joined; "
        yield "near_bodies", near, f"{text}lower the tolerance to keep them apart"


def warn_of_surface(surface: SimplexMesh, tolerance: float, solid: Solid | None = None) -> bool:
    """Warn of a surface whose volume a generator has to guess, with the texts of `doubts`.

    Returns
    -------
    bool
        Whether a warning says that bodies may be joined.

    Warns
    -----
    OpenSurfaceWarning
        If the surface is open, or has bodies that overlap or are closer to each other than the
        tolerance, or facets inside of the solid.
    """
    found = list(doubts(surface, tolerance, solid))
    for _, _, text in found:
        warn_caller(text, OpenSurfaceWarning)
    return any(name != "open_boundary" for name, _, _ in found)
