"""Removal of bores, bosses and text that are smaller than a length: ``remove_details``."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay

from adaptsize._checks import as_number, place_text
from adaptsize._defaults import CREASE_ANGLE
from adaptsize._messages import Message
from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import as_mesh, cut_out
from adaptsize.background.topology import rings, rows_among
from adaptsize.geometry.distance.winding import WindingNumber
from adaptsize.geometry.enclosed import cone_measures
from adaptsize.geometry.faces import Faces
from adaptsize.remeshing import tuning
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray


@dataclass(frozen=True)
class Detail:
    """A detail that was removed."""

    kind: Literal["cavity", "boss"]
    """What it was: a bore, pocket or engraving, or material that stood out."""
    place: tuple[float, ...]
    """The centre of its facets."""
    extent: float
    """Diagonal of the box around it."""
    volume: float
    """Of the material that was added or removed, >= 0."""


class Simplified(NamedTuple):
    """A surface, and the details that were removed from it."""

    mesh: SimplexMesh
    details: tuple[Detail, ...]

    def __str__(self) -> str:
        """Return their number, volume and the place of the largest."""
        if not self.details:
            return "no details removed"
        count = {kind: sum(d.kind == kind for d in self.details) for kind in ("cavity", "boss")}
        added = sum(d.volume for d in self.details if d.kind == "cavity")
        cut = sum(d.volume for d in self.details if d.kind == "boss")
        largest = max(self.details, key=lambda detail: detail.volume)
        return (
            f"removed {count['cavity']} cavities (volume {added:.3g} filled) and {count['boss']} "
            f"bosses (volume {cut:.3g} cut off), the largest at {place_text(largest.place, 4)}"
        )


class _Loop(NamedTuple):
    """A closed path of feature edges around a detail, seen from the face that it interrupts."""

    nodes: IndexArray
    """In the order of the facets of that face."""
    face_cell: int
    """A facet of that face."""
    cap: IntArray
    """Triangles that close the hole which the loop bounds in that face, int32[k, 3]."""
    width: float
    """Diameter of the largest circle in the cap, outside of what lies in its plane."""


def remove_details(
    surface: SimplexMesh, length: float, *, crease_angle: float = CREASE_ANGLE
) -> Simplified:
    """Return a surface without bores, pockets, bosses and text that are smaller than a length.

    A detail is what lies beyond closed loops of feature edges inside faces, such as the rim of a
    bore or the outline of a letter.  It is removed if no circle whose diameter is the length fits
    into the loops, and no such ball into the detail: a ball of that diameter cannot pass through
    the bore, or the boss is so thin.  Nearly plane triangles close the loops.  Everything else is
    kept as it is, so that edges stay sharp.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space, closed.
    length : float
        In the unit of the coordinates, > 0.
    crease_angle : float
        As of `size_function`, in degrees.

    Returns
    -------
    Simplified
        ``mesh``, the surface, and ``details``, what was removed and where.  ``str()`` gives a
        summary.

    Raises
    ------
    ValueError
        If the surface does not consist of triangles in space, or is open.

    Notes
    -----
    This is the opening and closing of the solid by a ball, restricted to details with sharp
    outlines.  Rounded rims are no loops of feature edges, so such details stay, as do those on
    rough surfaces, and slots that reach the edge of a face.

    Examples
    --------
    >>> from adaptsize.remeshing import remove_details
    >>> corners = [[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    >>> quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    >>> cells = [c for a, b, c, d in quads for c in ([a, b, c], [a, c, d])]
    >>> print(remove_details(SimplexMesh(corners, cells), 0.5))
    no details removed
    """
    surface = as_mesh("surface", surface)
    if surface.cell_dim != 2 or surface.dim != 3:
        raise ValueError(f"surface must consist of triangles in space, got {surface!r}")
    length = as_number("length", length, lower=0.0, strict=True)
    return SurfaceWithDetails.of(surface, crease_angle).removed(length)


class SurfaceWithDetails:
    """The loops of a surface around what may be a detail."""

    def __init__(self, mesh: SimplexMesh, tags: npt.NDArray[np.integer] | None, faces: Faces):
        self.mesh, self.tags, self.faces = mesh, tags, faces

    @classmethod
    def of(cls, surface: SimplexMesh, crease_angle: float) -> SurfaceWithDetails:
        """Return the loops of a surface."""
        faces = Faces.of(surface, crease_angle)
        if not faces.mesh.is_closed:
            text = "surface must be closed for details to be removed; {close_holes} closes holes"
            raise ValueError(Message(text))
        kept = np.flatnonzero(faces.rows >= 0)
        tags = None
        if surface.cell_tags is not None:
            tags = np.empty(faces.mesh.n_cells, surface.cell_tags.dtype)
            tags[faces.rows[kept]] = surface.cell_tags[kept]
        mesh = SimplexMesh(
            faces.mesh.points, faces.mesh.cells, cell_tags=tags, tag_names=surface.tag_names
        )
        return cls(mesh, tags, faces)

    def removed(self, length: float) -> Simplified:
        """Return the surface without the details below a length."""
        loops = [
            loop
            for nodes, cell in _inner_paths(self.faces)
            if (loop := self._loop(nodes, cell, length)) is not None
        ]
        mesh, cells = self.mesh, self.mesh.cells
        edges = [np.column_stack([loop.nodes, np.roll(loop.nodes, -1)]) for loop in loops]
        if not loops:
            return Simplified(mesh, ())
        cut = np.zeros(len(mesh.edges), np.bool_)
        cut[rows_among(np.sort(np.concatenate(edges), axis=1), mesh.edges)] = True
        part = _parts_between(mesh, cut)
        area = np.asarray(np.bincount(part, mesh.measures), np.float64)
        sides = [self._sides(loop, part) for loop in loops]
        stays = self._largest_in_each_body(part, area)
        for k in np.flatnonzero(~stays).tolist():
            stays[k] = self._is_large(cells[part == k], _caps(loops, sides, k), length)
        new = [cells[stays[part]]]
        for loop, (inner, outer) in zip(loops, sides, strict=True):
            if stays[inner] != stays[outer]:
                new.append(loop.cap if stays[outer] else loop.cap[:, ::-1])
        details = self._described(part, ~stays, loops, sides, length)
        tags = None
        if self.tags is not None:
            tags = np.concatenate([self.tags[stays[part]], np.zeros(sum(map(len, new[1:])), int)])
        left = np.concatenate(new)
        made, _ = cut_out(mesh.points, left, cell_tags=tags, tag_names=mesh.tag_names)
        return Simplified(made, details) if made.is_closed else Simplified(mesh, ())

    def _largest_in_each_body(self, part: IndexArray, area: FloatArray) -> BoolArray:
        """Return which parts are the largest of a connected body: a body is no detail."""
        body = np.empty(len(area), np.intp)
        body[part] = _parts_between(self.mesh, np.zeros(len(self.mesh.edges), np.bool_))
        order = np.lexsort([area, body])
        largest = np.zeros(len(area), np.bool_)
        largest[order[np.flatnonzero(np.diff(body[order], append=-1))]] = True
        return largest

    def _loop(self, nodes: IndexArray, cell: int, length: float) -> _Loop | None:
        """Return a loop if it is nearly plane and narrow."""
        points = self.mesh.points[nodes]
        centre = points.mean(axis=0)
        normal = np.cross(points - centre, np.roll(points, -1, axis=0) - centre).sum(axis=0)
        area = np.linalg.norm(normal)
        if area == 0.0:
            return None
        normal /= area
        if np.abs((points - centre) @ normal).max() > tuning.FLAT * length:
            return None
        axes = np.linalg.svd(normal[None, :])[2][1:].T
        if np.linalg.det(np.column_stack([axes, normal])) < 0.0:
            axes = axes[:, ::-1]
        flat = (points - centre) @ axes
        width = self._width(flat, (centre, axes, normal), length)
        if width >= length:
            return None
        # Seen from the face, the loop is the outline of a hole, so the cap runs the other way.
        triangles = _triangulated(flat)
        if triangles is None:
            return None
        return _Loop(nodes, cell, nodes[triangles][:, ::-1].astype(np.int32), width)

    def _width(
        self, flat: FloatArray, plane: tuple[FloatArray, FloatArray, FloatArray], least: float
    ) -> float:
        """Return the diameter of the largest circle in a loop, outside of facets in its plane.

        Circles through three points of the loop, and of other feature edges in its plane, which is
        given by its origin, axes and normal.
        """
        mesh, spacing, (centre, axes, normal) = self.mesh, tuning.SPACING_ON_LOOP * least, plane
        ends = (mesh.points[self.faces.features] - centre) @ axes
        height = np.abs((mesh.points[self.faces.features] - centre) @ normal)
        low, high = flat.min(axis=0), flat.max(axis=0)
        inside = (height <= tuning.IN_PLANE * least).all(axis=1)
        inside &= ((ends >= low - spacing) & (ends <= high + spacing)).all(axis=(1, 2))
        around = np.stack([flat, np.roll(flat, -1, axis=0)], axis=1)
        segments = np.concatenate([around, ends[inside]])
        lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
        if lengths.sum() > tuning.MOST_ON_LOOP * spacing:
            return np.inf
        samples = np.unique(np.concatenate([_divided(s, spacing) for s in segments]), axis=0)
        if len(samples) < 3 or min(high - low) <= 1e-9 * max(high - low):
            return 0.0
        middles, radii = _circles(samples[Delaunay(samples).simplices])
        wide = np.flatnonzero((2.0 * radii >= least) & _contains(flat, middles))
        if len(wide) == 0:
            return 0.0
        off = mesh.locator.nearest(centre + middles[wide] @ axes.T)[2]
        return float(2.0 * radii[wide][off > tuning.IN_PLANE * least].max(initial=0.0))

    def _sides(self, loop: _Loop, part: IndexArray) -> tuple[int, int]:
        """Return the parts beyond a loop and on the side of its face."""
        outer = int(part[loop.face_cell])
        mesh = self.mesh
        edges = np.sort(np.column_stack([loop.nodes, np.roll(loop.nodes, -1)]), axis=1)
        rows = rows_among(edges, mesh.edges)
        start, ring = rings(mesh.cell_facets, len(mesh.edges))
        around = {int(part[c]) for row in rows for c in ring[start[row] : start[row + 1]]}
        others = around - {outer}
        return (others.pop() if len(others) == 1 else outer), outer

    def _is_large(self, cells: IntArray, caps: list[IntArray], length: float) -> bool:
        """Return whether a ball of a diameter fits into a part that caps close."""
        closed = cut_out(self.mesh.points, np.concatenate([cells, *caps]))[0]
        middle = closed.points.mean(axis=0)
        volume = abs(float(cone_measures(closed, middle).sum()))
        if not closed.is_closed:
            return True
        if volume < np.pi / 6.0 * length**3:
            return False
        low, high = closed.points.min(axis=0), closed.points.max(axis=0)
        step = max(
            tuning.SPACING_IN_GRID * length,
            float((np.prod(high - low) / tuning.MOST_IN_GRID) ** (1.0 / 3.0)),
        )
        number = np.maximum(np.ceil((high - low) / step), 1).astype(int)
        points = low + step * (np.indices(number).reshape(3, -1).T + 0.5)
        points = points[np.abs(WindingNumber(closed)(points)) > 0.5]
        radius = closed.locator.nearest(points)[2].max(initial=0.0)
        return bool(radius + 0.5 * np.sqrt(3.0) * step > 0.5 * length + 0.5 * step)

    def _described(
        self,
        part: IndexArray,
        gone: BoolArray,
        loops: Sequence[_Loop],
        sides: Sequence[tuple[int, int]],
        length: float,
    ) -> tuple[Detail, ...]:
        """Return the details: parts that are gone and touch each other are one."""
        pairs = np.array([pair for pair in sides if gone[list(pair)].all()], np.intp).reshape(-1, 2)
        n = len(gone)
        graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (n, n))
        group = connected_components(graph, directed=False)[1]
        found = []
        for k in np.unique(group[gone]):
            members = np.flatnonzero(gone & (group == k))
            cells = self.mesh.cells[np.isin(part, members)]
            caps = [
                loop.cap[:, ::-1] if inner in members else loop.cap
                for loop, (inner, outer) in zip(loops, sides, strict=True)
                if (inner in members) != (outer in members)
            ]
            closed, _ = cut_out(self.mesh.points, np.concatenate([cells, *caps]))
            volume = float(cone_measures(closed, closed.points.mean(axis=0)).sum())
            if abs(volume) <= tuning.NO_DETAIL * length**3:  # a facet that was replaced by its cap
                continue
            corners = self.mesh.points[cells].reshape(-1, 3)
            low, high = corners.min(axis=0), corners.max(axis=0)
            place, extent = tuple((0.5 * (low + high)).tolist()), float(np.linalg.norm(high - low))
            found.append(Detail("boss" if volume > 0.0 else "cavity", place, extent, abs(volume)))
        return tuple(sorted(found, key=lambda detail: detail.place))


def _inner_paths(faces: Faces) -> list[tuple[IndexArray, int]]:
    """Return the closed paths of feature edges that interrupt faces, and a facet of each face.

    These are the connected parts of the boundary of a face, except the one of largest extent.
    """
    mesh = faces.mesh
    is_feature = rows_among(mesh.edges, faces.features) >= 0
    cell, v = np.nonzero(is_feature[mesh.cell_facets])
    starts, ends = (mesh.cells[cell, (v + k) % 3].astype(np.int64) for k in (1, 2))
    face = faces.face[cell].astype(np.int64)
    keys, number = np.unique(
        np.concatenate([face * mesh.n_points + starts, face * mesh.n_points + ends]),
        return_inverse=True,
    )
    half = len(starts)
    graph = coo_matrix((np.ones(half), (number[:half], number[half:])), (len(keys),) * 2)
    piece = connected_components(graph, directed=False)[1][number[:half]]
    by_face: dict[int, dict[int, list[int]]] = defaultdict(lambda: defaultdict(list))
    for k, (f, p) in enumerate(zip(face.tolist(), piece.tolist(), strict=True)):
        by_face[f][p].append(k)
    found, known = [], set()
    for pieces in by_face.values():
        if len(pieces) < 2:
            continue
        extent = {p: np.ptp(mesh.points[starts[rows]], axis=0).max() for p, rows in pieces.items()}
        outer = max(extent, key=lambda p: float(extent[p]))
        for p, rows in pieces.items():
            following = dict(zip(starts[rows].tolist(), ends[rows].tolist(), strict=True))
            path = _closed_path(following) if p != outer and len(following) == len(rows) else None
            if path is not None and frozenset(path) not in known:
                known.add(frozenset(path))
                found.append((np.array(path), int(cell[rows[0]])))
    return found


def _closed_path(following: dict[int, int]) -> list[int] | None:
    """Return the nodes of a path that visits all nodes once, or None if there is none."""
    path = [next(iter(following))]
    while (node := following.get(path[-1], -1)) != path[0]:
        if node < 0 or len(path) > len(following):
            return None
        path.append(node)
    return path if len(path) == len(following) else None


def _parts_between(mesh: SimplexMesh, cut: BoolArray) -> IndexArray:
    """Return the number of the part of each cell if a surface is cut along some edges."""
    start, ring = rings(mesh.cell_facets, len(mesh.edges))
    rows = np.flatnonzero(~cut & (np.diff(start) > 1))
    # Around an edge of more than two cells, all of them are connected.
    first = np.repeat(ring[start[rows]], np.diff(start)[rows])
    others = np.concatenate([ring[start[r] : start[r + 1]] for r in rows]) if len(rows) else first
    graph = coo_matrix((np.ones(len(first)), (first, others)), (mesh.n_cells,) * 2)
    return np.asarray(connected_components(graph, directed=False)[1])


def _caps(loops: Sequence[_Loop], sides: Sequence[tuple[int, int]], part: int) -> list[IntArray]:
    """Return the caps that close a part, oriented like it."""
    return [
        loop.cap[:, ::-1] if inner == part else loop.cap
        for loop, (inner, outer) in zip(loops, sides, strict=True)
        if inner != outer and part in (inner, outer)
    ]


def _divided(segment: FloatArray, spacing: float) -> FloatArray:
    """Return points on a segment, its first end included, not farther apart than a spacing."""
    n = max(int(np.ceil(np.linalg.norm(segment[1] - segment[0]) / spacing)), 1)
    return np.asarray(segment[0] + (np.arange(n) / n)[:, None] * (segment[1] - segment[0]))


def _circles(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the centres and radii of circles through triples of points in the plane."""
    a, b, c = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    twice = 2.0 * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
    b2, c2 = (b**2).sum(axis=1), (c**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (c[:, 1] * b2 - b[:, 1] * c2) / twice
        y = (b[:, 0] * c2 - c[:, 0] * b2) / twice
    off = np.column_stack([x, y])
    good = np.isfinite(off).all(axis=1)
    return (a + off)[good], np.linalg.norm(off[good], axis=1)


def _contains(polygon: FloatArray, points: FloatArray) -> BoolArray:
    """Return which points are inside a polygon, by the number of its edges to their right."""
    inside = np.zeros(len(points), np.bool_)
    x, y = points.T
    for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if y0 != y1:
            passed = (y0 <= y) != (y1 <= y)
            inside ^= passed & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return inside


def _triangulated(polygon: FloatArray) -> IntArray | None:
    """Return triangles between the corners of a polygon in the plane, turned like it.

    Ears are cut off, the one with the shortest chord first.  None if no ear is left, as where the
    polygon crosses itself.
    """
    x, y = polygon.T
    sign = 1.0 if np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0.0 else -1.0
    left, triangles = np.arange(len(polygon)), []
    while len(left) > 3:
        a, b, c = (polygon[np.roll(left, k)] for k in (1, 0, -1))
        twice = sign * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
        chord = np.linalg.norm(c - a, axis=1)
        convex = np.flatnonzero(twice > 1e-12 * np.maximum(chord, 1e-300) ** 2)
        for k in convex[np.argsort(chord[convex], kind="stable")]:
            ear = np.array([left[k - 1], left[k], left[(k + 1) % len(left)]])
            others = polygon[np.setdiff1d(left, ear)]
            if not _touches(polygon[ear], sign, others):
                triangles.append(ear)
                left = np.delete(left, k)
                break
        else:
            return None
    triangles.append(left)
    return np.array(triangles, np.int32)


def _touches(corners: FloatArray, sign: float, points: FloatArray) -> bool:
    """Return whether one of the points is in a triangle or on its boundary."""
    inside = np.ones(len(points), np.bool_)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        d = points - a
        inside &= sign * ((b - a)[0] * d[:, 1] - (b - a)[1] * d[:, 0]) >= 0.0
    return bool(inside.any())
