"""The solid that a surface encloses, also if bodies overlap, touch or are inside of each other."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.contacts import CORNERS, Contacts, Pieces, divide_facets, list_contacts
from adaptsize._kernels.trees import DEPTH
from adaptsize._pickling import once
from adaptsize.background import SimplexMesh
from adaptsize.background.location import parts_of
from adaptsize.background.merging import first_at_place
from adaptsize.background.simplex import cut_out
from adaptsize.background.topology import components_of
from adaptsize.geometry import tuning
from adaptsize.geometry.boundary import facet_normals
from adaptsize.geometry.distance.orientation import (
    MERGE_SHARE,
    is_cycle,
    merged_cells,
    oriented,
    rule_of,
)
from adaptsize.geometry.distance.winding import Rule, WindingNumber
from adaptsize.geometry.enclosed import cone_measures
from adaptsize.geometry.repair import repair_triangles
from adaptsize.geometry.shells import pieces_of, shells_of, surplus_of
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray

#: Distances up to this times the diagonal are contacts.  It is above the rounding of the single
#: precision of STL files.
SLACK = 1e-6
#: Room for the parts of one facet.
_MOST_PARTS = 4096
#: Parts of unions are joined within this times the diagonal.  Their corners are computed twice, and
#: differ by rounding where facets meet at small angles.
_JOIN = 1e-7
#: Volumes of a union before and after its parts are joined differ by less than this times area and
#: diagonal.
_SAME = 1e-7


class Sides(NamedTuple):
    """Winding numbers on both sides of the facets of a surface, or of parts of facets."""

    owner: IndexArray
    """intp[n]: the facet of each part.  A facet that no other one meets is one part."""
    front: FloatArray
    """float64[n]: the number on the side to which the normal points, 0 outside."""
    back: FloatArray
    area: FloatArray
    """float64[n]"""
    is_repeated: BoolArray
    """bool[n]: whether a part is also a part of a facet of a smaller number."""
    centre: FloatArray
    """float64[n, 3]: a point in each part."""
    corners: FloatArray
    """float64[m, 3, 3]: triangles that make up the parts."""
    part: IndexArray
    """intp[m]: the part that each belongs to."""
    rule: Rule
    """Which winding numbers are those of the solid."""

    @property
    def is_lost(self) -> BoolArray:
        """Which parts do not have the solid on exactly one side, or are repeated.

        See `Rule`.
        """
        inside = (self.rule.holds_for(numbers) for numbers in (self.front, self.back))
        return self._matters(np.equal(*inside) | self.is_repeated)

    @property
    def is_inward(self) -> BoolArray:
        """Which other parts have the solid on the side to which the normal points."""
        return self._matters(~self.is_lost & self.rule.holds_for(self.front))

    def _matters(self, which: BoolArray) -> BoolArray:
        """Return which parts these are, none if they have hardly any area: folds of slivers."""
        is_small = self.area[which].sum() <= tuning.NEGLIGIBLE_AREA * self.area.sum()
        return np.zeros_like(which) if is_small else which

    def skin(self) -> tuple[FloatArray, IndexArray]:
        """Return the triangles of the boundary of the solid, with normals outward, and owners."""
        part = self.part[~self.is_lost[self.part]]
        corners = self.corners[~self.is_lost[self.part]]
        turned = self.is_inward[part, None, None]
        return np.where(turned, corners[:, [1, 0, 2]], corners), self.owner[part]


class Solid:
    """The region where the winding number of a surface is above one half, see `Rule`.

    For bodies that overlap it is their union.  Facets are oriented first.  Of a surface with holes,
    the winding number is not an integer, and the region is closed by a smooth cap in each hole.
    What it encloses is what everything else refers to: sizes, predicted numbers, volume, topology,
    and distances of new boundaries.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space.

    Notes
    -----
    Winding numbers jump across the surface only.  So a facet that no other one meets has the same
    numbers on both sides everywhere.  A facet is divided where others meet it [1]_, and each part
    is a part of the boundary of the union if it has the solid on one side.  Distances below 1e-6 of
    the diagonal are contacts.

    References
    ----------
    .. [1] Q. Zhou, E. Grinspun, D. Zorin, A. Jacobson, "Mesh arrangements for solid geometry", ACM
       Trans. Graph. 35 (2016) 39.

    Examples
    --------
    >>> from adaptsize import CartesianGrid
    >>> box = CartesianGrid([0.0] * 3, 1.0, (2, 2, 2)).mesh.boundary().mesh
    >>> points = np.concatenate([box.points, box.points + [0.5, 0.0, 0.0]])
    >>> solid = Solid(SimplexMesh(points, np.concatenate([box.cells, box.cells + box.n_points])))
    >>> round(solid.volume, 9), solid.is_divided
    (1.5, True)
    """

    def __init__(self, surface: SimplexMesh) -> None:
        self._tags, self._names = surface.cell_tags, surface.tag_names
        #: The surface with merged nodes and consistent orientation.
        self.surface = oriented(surface)
        target = first_at_place(surface.points, MERGE_SHARE * surface.diagonal)
        given = merged_cells(surface.cells, target)
        #: bool[n_cells]: facets that were flipped for that.
        self.flipped: BoolArray = (given != self.surface.cells).any(axis=1)
        self._inner = np.zeros(surface.n_cells, np.bool_)
        counts = self.surface.facet_cell_counts
        if counts.max() > 2 and counts.min() > 1 and not is_cycle(self.surface):
            self._inner = surplus_of(self.surface)
            if not self._inner.any():
                self._inner = shells_of(self.surface).is_inner
        rows = np.flatnonzero(~self._inner)
        self._outline = self.surface
        if len(rows) < surface.n_cells:
            self._outline = cut_out(self.surface.points, self.surface.cells[rows])[0]
        self._rows = rows
        self.rule = rule_of(self._outline)
        #: Whether the surface has no holes, so that winding numbers are integers.
        self.is_closed = self.rule.is_closed
        self.winding = WindingNumber(self._outline)

    @classmethod
    def of(cls, surface: SimplexMesh) -> Solid:
        """Return the solid of a surface, which is kept with it: all refer to the same one."""
        return once(surface, "_solid", lambda: cls(surface))

    @cached_property
    def _sides(self) -> Sides:
        return sides_of(self._outline, self.winding, self.rule)

    def contains(self, points: FloatArray) -> BoolArray:
        """Return which points are inside of the solid."""
        return self.winding.contains(points, rule=self.rule)

    @cached_property
    def volume(self) -> float:
        """The volume of the solid; nan if the surface is not closed, or too many facets meet.

        The latter is found by the sum of normals times areas, which is zero for closed surfaces.
        """
        skin = self._parts
        total = 0.5 * facet_normals(skin.points[skin.cells]).sum(axis=0)
        if not self.is_closed or np.abs(total).max() > tuning.GAP * float(skin.measures.sum()):
            return np.nan
        return abs(float(cone_measures(skin, skin.points.mean(axis=0)).sum()))

    @cached_property
    def hidden(self) -> BoolArray:
        """bool[n_cells]: facets of which no part bounds the solid.

        These are facets inside of bodies, and between bodies that share them.  Of a surface with
        holes, also facets of sheets; none if these are all.
        """
        hidden = self._inner.copy()
        sides = self._sides
        kept = np.bincount(sides.owner, ~sides.is_lost, len(self._rows))
        if kept.any():
            hidden[self._rows] = kept == 0
        return hidden

    @cached_property
    def is_divided(self) -> bool:
        """Whether facets bound the solid with a part only, as those of bodies that overlap do."""
        sides = self._sides
        if sides.is_lost.all():  # nothing is enclosed
            return False
        return bool((sides.is_lost & ~self.hidden[self._rows][sides.owner]).any())

    @cached_property
    def _parts(self) -> SimplexMesh:
        """The boundary of the solid.  If facets are divided, nodes of their parts do not match."""
        tags, names = self._tags, self._names
        if self.is_divided:
            corners, owner = self._sides.skin()
            cells = np.arange(3 * len(corners)).reshape(-1, 3)
            tags = None if tags is None else tags[self._rows[owner]]
            points = corners.reshape(-1, 3)
            return SimplexMesh(points, cells, cell_tags=tags, tag_names=names)
        kept = ~self.hidden
        if not kept.any():
            kept[:] = True
        tags = None if tags is None else tags[kept]
        return cut_out(self.surface.points, self.cells[kept], cell_tags=tags, tag_names=names)[0]

    @cached_property
    def _joined(self) -> tuple[SimplexMesh, IntArray]:
        """The boundary of the solid and the nodes of the surface at its nodes, -1 at new ones."""
        parts = self._parts
        if not (self.is_divided and self.is_closed):
            parts = _merged(parts)
            return parts, np.full(parts.n_points, -1, np.int32)
        mesh, nodes = _conforming(parts, self.surface.points)
        volume = abs(float(cone_measures(mesh, mesh.points.mean(axis=0)).sum()))
        most = _SAME * mesh.diagonal * float(mesh.measures.sum())
        if is_cycle(mesh) and abs(volume - self.volume) <= most:
            return mesh, nodes
        parts = _merged(self._without_cracks(parts))
        return parts, np.full(parts.n_points, -1, np.int32)

    def _without_cracks(self, parts: SimplexMesh) -> SimplexMesh:
        """Return the parts of the boundary but for the walls of cracks.

        Bodies that touch are apart by the rounding of coordinates in files.
        """
        normals = facet_normals(parts.points[parts.cells])
        lengths = np.linalg.norm(normals, axis=1)[:, None]
        away = tuning.CRACK * parts.diagonal * normals / np.maximum(lengths, np.finfo(float).tiny)
        is_wall = self.contains(parts.points[parts.cells].mean(axis=1) + away)
        if is_wall.all():
            return parts
        tags = None if parts.cell_tags is None else parts.cell_tags[~is_wall]
        cells = parts.cells[~is_wall]
        return cut_out(parts.points, cells, cell_tags=tags, tag_names=parts.tag_names)[0]

    @property
    def skin(self) -> SimplexMesh:
        """The boundary of the solid, with normals outward and the tags of the facets.

        It consists of facets of the surface.  Those that others divide are triangulated anew, with
        nodes where facets meet.  If the parts do not fit together, because too many facets meet
        within rounding, some nodes of the parts do not match, and the skin is not closed.
        Of a surface with holes, it consists of the facets where the winding number crosses one
        half.
        """
        return self._joined[0]

    @property
    def nodes_of_skin(self) -> IntArray:
        """int32[n]: the node of the surface at each node of the skin of a union, -1 at new ones."""
        return self._joined[1]

    def is_opening(self, points: FloatArray) -> BoolArray:
        """Return which points may be on the boundary of the solid far away from the surface.

        A surface with holes does not say how they are closed.  The boundary of the solid is a
        smooth cap there, on which the winding number is one half.  A mesh generator closes holes
        by cells of its own, so that all points are accepted where the number is between 1/4 and
        3/4: about a quarter of the width of the hole to both sides.  A closed surface has no
        opening.
        """
        if self.is_closed:
            return np.zeros(len(points), np.bool_)
        number = np.abs(self.winding(points))
        return np.asarray((number > tuning.OPENING[0]) & (number < tuning.OPENING[1]))

    @cached_property
    def cells(self) -> IntArray:
        """The facets of the surface; those that bound the solid have normals outward.

        If facets are divided, they have the orientation of the surface.
        """
        cells = np.array(self.surface.cells)
        if self.is_closed and not self.is_divided:
            sides = self._sides
            turned = self._rows[np.unique(sides.owner[sides.is_inward])]
            cells[turned, :2] = cells[turned, 1::-1]
        return cells


def _merged(parts: SimplexMesh) -> SimplexMesh:
    """Return triangles with common nodes at the same places, so that they share edges."""
    target = first_at_place(parts.points, MERGE_SHARE * parts.diagonal)
    cells = merged_cells(parts.cells, target)
    return cut_out(parts.points, cells, cell_tags=parts.cell_tags, tag_names=parts.tag_names)[0]


def _conforming(parts: SimplexMesh, known: FloatArray) -> tuple[SimplexMesh, IntArray]:
    """Return triangles with common nodes and edges, and the known points at nodes, -1 at others."""
    n = len(known)
    points = np.concatenate([known, parts.points])
    within = _JOIN * parts.diagonal
    target = first_at_place(points, within)
    found = repair_triangles(points, (target[n:][parts.cells]).astype(np.int32), within)
    tags = None if parts.cell_tags is None else parts.cell_tags[found.owner]
    mesh, nodes = cut_out(points, found.cells, cell_tags=tags, tag_names=parts.tag_names)
    return mesh, np.where(nodes < n, nodes, -1).astype(np.int32)


def sides_of(surface: SimplexMesh, winding: WindingNumber, rule: Rule) -> Sides:
    """Return the winding numbers on both sides of the parts of a surface.

    If it is closed, they are integers, and the same ones at facets that no others meet.
    """
    contacts = _contacts_of(surface)
    met = np.unique(contacts.owner)
    corners = surface.points[surface.cells]
    whole = np.setdiff1d(np.arange(surface.n_cells), met)
    owner, centre, triangles, part = _divided(surface, contacts, met)
    owner = np.concatenate([whole, owner])
    centre = np.concatenate([corners[whole].mean(axis=1), centre])
    triangles = np.concatenate([corners[whole], triangles])
    part = np.concatenate([np.arange(len(whole)), len(whole) + part])
    normals = facet_normals(corners)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)[:, None]
    away = tuning.BESIDE_FACET * SLACK * surface.diagonal * normals[owner]
    spans = 0.5 * np.linalg.norm(facet_normals(triangles), axis=1)
    area = np.asarray(np.bincount(part, spans, len(owner)), np.float64)
    place = _places_without_jump(surface, met, owner, len(whole)) if rule.is_closed else None
    first = number = np.arange(len(owner))
    if place is not None:
        piece = pieces_of(surface)
        is_alone = ~np.isin(piece, piece[met])[owner]
        asked = np.where(is_alone, place, place.max() + 1 + number)
        first, number = np.unique(asked, return_index=True, return_inverse=True)[1:]
    front, back = (winding(centre[first] + side * away[first])[number] for side in (1.0, -1.0))
    if place is not None:
        sides = np.asarray(np.rint(np.column_stack([front, back])), np.float64)
        front, back = _of_most(sides, place, area).T
    repeated = np.zeros(len(owner), np.bool_)
    repeated[_repeated(surface, contacts, owner, centre)] = True
    return Sides(owner, front, back, area, repeated, centre, triangles, part, rule)


def _places_without_jump(
    surface: SimplexMesh, met: IndexArray, owner: IndexArray, n_whole: int
) -> IndexArray:
    """Return a number for each part; parts with the same one have the same winding numbers.

    These are facets that meet no others, and are connected by edges between two facets.
    """
    n, n_edges = surface.n_cells, len(surface.edges)
    free = np.setdiff1d(np.arange(n), met)
    beside = np.column_stack([np.repeat(free, 3), n + surface.cell_facets[free].ravel()])
    beside = beside[surface.facet_cell_counts[beside[:, 1] - n] == 2]
    label = components_of(beside, n + n_edges)[owner]
    label[n_whole:] = n + n_edges + np.arange(len(owner) - n_whole)
    return label


def _of_most(sides: FloatArray, place: IndexArray, area: FloatArray) -> FloatArray:
    """Return the rows that most of the area of each place has, unless much area has others.

    Winding numbers at slivers may be wrong by rounding.  Facets with different ones are connected
    where others cross exactly along edges.
    """
    rows, number = np.unique(np.column_stack([place, sides]), axis=0, return_inverse=True)
    number = number.reshape(-1)
    sums = np.bincount(number, area)
    order = np.lexsort((sums, rows[:, 0]))
    last = np.append(rows[order][1:, 0] != rows[order][:-1, 0], True)
    most = order[last][np.cumsum(np.append(False, last[:-1]))]
    of_row = np.empty(len(rows), np.intp)
    of_row[order] = most
    few = sums <= tuning.MINORITY * sums[of_row]
    return rows[np.where(few, of_row, np.arange(len(rows)))[number], 1:]


class _Found(NamedTuple):
    """Contacts of facets, in the order of their owners, with coordinates of the mesh."""

    owner: IndexArray
    partner: IndexArray
    is_flat: BoolArray
    ends: FloatArray


def _contacts_of(surface: SimplexMesh) -> _Found:
    locator, n = surface.locator, surface.n_cells
    slack = SLACK * surface.diagonal * locator.scale
    found, room = [], 4096
    for first, last in parts_of(n, 1024):
        while True:
            rows = Contacts(
                np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room, np.bool_),
                np.empty((room, 6)), np.empty(DEPTH, np.int64),
            )  # fmt: skip
            count = list_contacts(locator.tree, slack, first, last, rows)
            if count <= room:
                break
            room = 2 * count
        found.append(_Found(*(values[:count].copy() for values in rows[:4])))
    owner, partner, is_flat, ends = (np.concatenate(x) for x in zip(*found, strict=True))
    owner, partner = (locator.cell_of_row[rows].astype(np.intp) for rows in (owner, partner))
    order = np.argsort(owner, kind="stable")
    return _Found(owner[order], partner[order], is_flat[order], ends[order])


def _divided(
    surface: SimplexMesh, contacts: _Found, met: IndexArray
) -> tuple[IndexArray, FloatArray, FloatArray, IndexArray]:
    """Return owner and a point of the parts of facets, and triangles and their parts."""
    locator = surface.locator
    row = np.empty(surface.n_cells, np.int64)
    row[locator.cell_of_row] = np.arange(surface.n_cells)
    start = np.searchsorted(contacts.owner, [*met.tolist(), surface.n_cells])
    slack = SLACK * surface.diagonal * locator.scale
    done, room, made = 0, 4 * (len(met) + len(contacts.owner)) + 64, []
    while done < len(met):
        pieces = Pieces(
            np.empty(room, np.int32), np.empty((room, 3)), np.empty((4 * room, 3, 3)),
            np.empty(4 * room, np.int32), np.empty((_MOST_PARTS, CORNERS, 2)),
            np.empty(_MOST_PARTS, np.int64),
        )  # fmt: skip
        count, n, m = divide_facets(
            locator.tree, row[met[done:]], start[done:], contacts.ends, slack, pieces
        )
        if count == 0:
            room *= 2
            continue
        made.append((pieces.owner[:n], pieces.centre[:n], pieces.corners[:m], pieces.part[:m]))
        done += count
    if not made:
        none: IndexArray = np.empty(0, np.intp)
        return none, np.empty((0, 3)), np.empty((0, 3, 3)), none
    first = np.cumsum([0, *(len(one[0]) for one in made[:-1])])
    owner = np.concatenate([one[0] for one in made])
    centre, corners = (np.concatenate([one[k] for one in made]) for k in (1, 2))
    part = np.concatenate([one[3] + k for one, k in zip(made, first, strict=True)])
    return locator.cell_of_row[owner], centre / locator.scale, corners / locator.scale, part


def _repeated(
    surface: SimplexMesh, contacts: _Found, owner: IndexArray, centre: FloatArray
) -> IndexArray:
    """Return the parts that lie in a facet of a smaller number in the same plane."""
    flat = contacts.is_flat & (contacts.partner < contacts.owner)
    pairs = np.unique(np.column_stack([contacts.owner[flat], contacts.partner[flat]]), axis=0)
    order = np.argsort(owner, kind="stable")
    begin, end = (np.searchsorted(owner[order], pairs[:, 0], side) for side in ("left", "right"))
    which = np.repeat(np.arange(len(pairs)), end - begin)
    offset = np.arange(len(which)) - np.repeat(np.cumsum(end - begin) - (end - begin), end - begin)
    part = order[begin[which] + offset]
    inside = _contain(surface.points[surface.cells[pairs[which, 1]]], centre[part])
    return np.unique(part[inside])


def _contain(corners: FloatArray, points: FloatArray) -> BoolArray:
    """Return which triangles contain a point of their plane, up to rounding."""
    normals = facet_normals(corners)
    inside = np.ones(len(points), np.bool_)
    for v in range(3):
        along = corners[:, (v + 1) % 3] - corners[:, v]
        turn = np.cross(along, points - corners[:, v])
        inside &= np.einsum("ij,ij->i", turn, normals) >= 0.0
    return inside
