"""Periodic meshes: opposite sides that match before remeshing match afterwards.

A generator keeps facets or remeshes them, but it does not remesh two sides in the same way.  So
cells are moved by the translations or rotations until both sides of a pair are one interface inside
the domain, which is remeshed once.  The cuts that this opens elsewhere are kept meanwhile.  Then
the cells are moved back, and the interior is remeshed, with the sides kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, product
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import one_of, refusal
from adaptsize.background import SimplexMesh
from adaptsize.background.merging import first_at_place
from adaptsize.background.splitting import halve_tetrahedra
from adaptsize.background.topology import marked
from adaptsize.errors import BackendError
from adaptsize.limiting.periodic import (
    as_periodicity,
    combined,
    inverse,
    moved,
    pairs_of,
    power,
)
from adaptsize.options import RemeshOptions
from adaptsize.remeshing import tuning
from adaptsize.remeshing.preparation import facet_numbers
from adaptsize.remeshing.protocol import NO_TAG, Task
from adaptsize.remeshing.sizing import Size
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray

#: Makes a mesh with sizes in which facets stay.
Remesh = Callable[[SimplexMesh, Size, IntArray], SimplexMesh]
# Places are the same if they are closer than this share of the diagonal.
_SAME = 1e-7


def remesh_periodic(
    mesh: SimplexMesh, motions: npt.ArrayLike, size: Size, remesh: Remesh
) -> SimplexMesh:
    """Return a new mesh whose opposite sides match.

    Parameters
    ----------
    mesh : SimplexMesh
        Each node is in a cell.
    motions : array_like
        As ``periodic`` of `limit_gradient`.
    size : callable
        On the sides, the smaller of the sizes at both places of a pair is used.
    remesh : callable

    Raises
    ------
    ValueError
        If the nodes or facets of the sides do not come in pairs, if motions do not commute, or if
        there are two nodes at a place of a cut.
    BackendError
        If a mesh cannot be moved back, or if edges on the sides stay far longer than their sizes.
    """
    cell = PeriodicCell(mesh, motions).with_cells_between()
    # left: the number of facets still to be divided, and the longest edge over its size.
    pending, left = cell.on_sides, (math.inf, math.inf)
    for turn in range(tuning.MOST_PERIODIC_TURNS):
        cell, pending = cell.divided(pending)
        joined = cell.joined(cell.centre(turn, pending))
        _refuse_doubled(cell.mesh, joined.is_cut | cell.on_sides)
        new, kept = joined.parted(remesh(joined.mesh, joined.size(size), joined.cut))
        rows = facet_numbers(new, kept[cell.mesh.facets[pending & joined.is_cut]])
        if (rows < 0).any():
            raise BackendError("mmg changed a facet of a side that it should keep")
        cell = _paired_again(new, motions, cell.mesh)
        long = cell.is_too_long(size)
        pending, before = marked(rows, len(new.facets)) | long, left
        left = int(pending.sum()), float(cell.longest(size).max())
        if turn + 1 >= cell.least_turns and (left[0] == 0 or _is_no_less(left, before)):
            break
        if long.any():
            # Facets inside that reach from one side to another would be cut again.
            new = remesh(cell.mesh, size, cell.mesh.facets[cell.on_sides])
            rows = facet_numbers(new, _same_nodes(cell.mesh, new)[cell.mesh.facets[pending]])
            cell = _paired_again(new, motions, cell.mesh)
            pending = marked(rows[rows >= 0], len(new.facets))
    cell.refuse_too_long(size)
    done = remesh(cell.mesh, size, cell.mesh.facets[cell.on_sides])
    if _paired_again(done, motions, cell.mesh).on_sides.sum() != cell.on_sides.sum():
        raise BackendError("mmg changed facets of the sides, which it should keep")
    return done


def _is_no_less(now: tuple[float, float], before: tuple[float, float]) -> bool:
    """Return whether neither of two numbers has become smaller."""
    return now[0] >= before[0] and now[1] >= before[1]


def _same_nodes(old: SimplexMesh, new: SimplexMesh) -> IntArray:
    """Return the node of a new mesh at the place of each node, -1 if there is none."""
    from scipy.spatial import cKDTree

    away, where = cKDTree(new.points).query(old.points)
    return np.where(away <= _SAME * old.diagonal, where, -1).astype(np.int32)


def _paired_again(new: SimplexMesh, motions: npt.ArrayLike, old: SimplexMesh) -> PeriodicCell:
    """Return the cell of a new mesh, whose nodes must be in pairs as those of the old one."""
    try:
        return PeriodicCell(new, motions)
    except ValueError as error:
        nodes = np.unique(new.facets[new.facet_cell_counts == 1])
        away = old.boundary().mesh.locator.nearest(new.points[nodes])[2]
        k = int(np.argmax(away))
        raise BackendError(
            "opposite sides no longer match after a run of mmg, which moves nodes up to "
            f"{away[k]:.3g} away from the given boundary, at {new.points[nodes[k]].tolist()}.  "
            f"Give a mesh with smaller cells at the sides ({error})"
        ) from error


def _refuse_doubled(mesh: SimplexMesh, facets: BoolArray) -> None:
    """Refuse other nodes at the places of nodes of facets: they could not be distinguished."""
    from scipy.spatial import cKDTree

    nodes = np.unique(mesh.facets[facets])
    away, near = cKDTree(mesh.points).query(mesh.points[nodes], k=2)
    double = np.flatnonzero(away[:, 1] <= _SAME * mesh.diagonal)
    if len(double):
        raise ValueError(
            "periodic needs one node at each place of the sides and of the facets at which cells "
            f"are moved, but nodes {np.sort(near[double[0]]).tolist()} are both at "
            f"{mesh.points[nodes[double[0]]].tolist()}, as on a crack"
        )


def refuse_unperiodic(
    task: Task, required_facets: npt.ArrayLike | None, given: RemeshOptions
) -> None:
    """Refuse what cannot be combined with ``periodic``."""
    if task == "surface to tetrahedra":
        raise refusal("periodic", "needs a mesh of the same cells: make tetrahedra first")
    if required_facets is not None or given["strict"]:
        raise refusal("periodic", "cannot be combined with required_facets or strict")
    one_of("backend", given["backend"], ("auto", "mmg"))


@dataclass(frozen=True, eq=False)
class PeriodicCell:
    """A mesh that is repeated by translations or rotations."""

    mesh: SimplexMesh
    motions: npt.ArrayLike
    maps: FloatArray = field(init=False)
    """float64[k, dim, dim + 1]: [R | t] of each motion."""
    label: IndexArray = field(init=False)
    """intp[n_points]: nodes that are images of each other have the same number; -1 elsewhere."""
    pairs: tuple[tuple[tuple[int, ...], IndexArray], ...] = field(init=False)
    """How often each motion is applied, and the facets and their images, intp[n, 2]."""

    def __post_init__(self) -> None:
        """Find the pairs of nodes and facets, and check them."""
        found = as_periodicity(self.mesh, self.motions)
        label = np.full(self.mesh.n_points, -1)
        nodes, label[nodes] = found.classes[0], found.classes[1]
        _refuse_order(found.maps, self.mesh)
        object.__setattr__(self, "maps", found.maps)
        object.__setattr__(self, "label", label)
        object.__setattr__(self, "pairs", tuple(_paired_facets(self.mesh, found.maps)))

    @cached_property
    def on_sides(self) -> BoolArray:
        """Which facets have an image, or are one."""
        rows = np.concatenate([pairs.ravel() for _, pairs in self.pairs])
        return marked(rows, len(self.mesh.facets))

    def divided(self, marks: BoolArray) -> tuple[PeriodicCell, BoolArray]:
        """Return the cell with at most one facet on a side per mesh cell, and marks of its facets.

        A mesh cell has one place.  With two facets on sides it can be joined to one neighbour only,
        or to none if they are images of each other.  So it gets a node in its middle.
        """
        mesh = self.mesh
        several = np.flatnonzero(self.on_sides[mesh.cell_facets].sum(axis=1) > 1)
        if len(several) == 0:
            return self, marks
        corners, n = mesh.cells[several], mesh.cells.shape[1]
        parts = np.repeat(corners[:, None], n, axis=1)
        parts[:, range(n), range(n)] = mesh.n_points + np.arange(len(several))[:, None]
        rest = ~marked(several, mesh.n_cells)
        tags = mesh.cell_tags
        if tags is not None:
            tags = np.concatenate([tags[rest], np.repeat(tags[several], n)])
        new = SimplexMesh(
            np.concatenate([mesh.points, mesh.points[corners].mean(axis=1)]),
            np.concatenate([mesh.cells[rest], parts.reshape(-1, n)]),
            cell_tags=tags, tagged_facets=mesh.tagged_facets, facet_tags=mesh.facet_tags,
            tag_names=mesh.tag_names,
        )  # fmt: skip
        found = marked(facet_numbers(new, mesh.facets[marks]), len(new.facets))
        return PeriodicCell(new, self.motions), found

    def longest(self, size: Size) -> FloatArray:
        """Return the longest edge of each facet on the sides over its size.

        The size of an edge is the largest one at its ends and its middle, so that sizes that jump
        do no harm.
        """
        corners = self.mesh.points[self.mesh.facets[self.on_sides]]
        longest = np.zeros(len(corners))
        for i, j in combinations(range(corners.shape[1]), 2):
            ends = corners[:, i], corners[:, j]
            sizes = [size(points) for points in (*ends, 0.5 * (ends[0] + ends[1]))]
            length = np.linalg.norm(ends[1] - ends[0], axis=1)
            longest = np.maximum(longest, length / np.max(sizes, axis=0))
        return longest

    def is_too_long(self, size: Size) -> BoolArray:
        """Return which facets on the sides have an edge that is much longer than its size."""
        found = np.flatnonzero(self.on_sides)
        return marked(found[self.longest(size) > tuning.LONGEST_ON_SIDES], len(self.mesh.facets))

    def refuse_too_long(self, size: Size) -> None:
        """Raise a BackendError if an edge on the sides is much longer than its size."""
        longest = self.longest(size)
        k = int(np.argmax(longest))
        if longest[k] > tuning.LONGEST_ON_SIDES:
            corners = self.mesh.points[self.mesh.facets[self.on_sides][k]]
            length = max(np.linalg.norm(a - b) for a, b in combinations(corners, 2))
            raise BackendError(
                f"edges on periodic sides must have about the requested sizes, but one of length "
                f"{length:.3g} at {corners.mean(axis=0).tolist()}, {longest[k]:.3g} times its "
                "size, could not be divided.  Give a mesh with smaller cells at the sides"
            )

    def with_cells_between(self) -> PeriodicCell:
        """Return the cell with at least three tetrahedra between the sides of each pair.

        Where fewer are, the cuts of the joined cells are nearly all of their boundary, and Mmg
        changes facets that it should keep.
        """
        cell = self
        while cell.mesh.cell_dim == 3 and cell.is_thin:
            if 8 * cell.mesh.n_cells > tuning.MOST_PERIODIC_CELLS:
                raise ValueError(
                    "periodic needs three cells or more between opposite sides, but there are "
                    f"fewer, and dividing all {cell.mesh.n_cells} would make more than "
                    f"{tuning.MOST_PERIODIC_CELLS}.  Give a mesh with smaller cells between them"
                )
            cell = PeriodicCell(halve_tetrahedra(cell.mesh), self.motions)
        return cell

    @property
    def is_thin(self) -> bool:
        """Whether two edges or fewer lead from one side of a pair to the other one.

        At the axis of a rotation the sides meet, so that this cannot be avoided.
        """
        for one in self.maps:
            pairs = pairs_of(self.mesh.points, moved(one, self.mesh.points), self.mesh.diagonal)
            if (pairs[:, 0] == pairs[:, 1]).any():
                continue
            near = [self._beside(marked(end, self.mesh.n_points)) for end in pairs.T]
            if (near[0] & near[1]).any():
                return True
        return False

    def _beside(self, nodes: BoolArray) -> BoolArray:
        """Return the nodes of all edges with one of the given nodes."""
        edges = self.mesh.edges
        return marked(edges[nodes[edges].any(axis=1)].ravel(), self.mesh.n_points)

    @property
    def least_turns(self) -> int:
        """Number of ways to join the cells so that each edge on the sides is inside once.

        In space, sides in several directions are crossed by the cuts.
        """
        return 1 + int(self.mesh.cell_dim == 3 and len(self.maps) > 1)

    def centre(self, turn: int, pending: BoolArray) -> FloatArray:
        """Return the point around which cells are joined.

        First it is a node of as many sides as possible, then a place near it that leaves the cuts
        elsewhere, then a facet that was cut in all turns before.
        """
        mesh = self.mesh
        if turn > 1 or (turn == 1 and self.least_turns == 1):
            return np.asarray(mesh.points[mesh.facets[np.argmax(pending)]].mean(axis=0))
        images = np.bincount(self.label[self.label >= 0])
        most = np.flatnonzero(np.isin(self.label, np.flatnonzero(images == images.max())))
        steps = np.stack([moved(one, mesh.points[most]) for one in self.maps]) - mesh.points[most]
        farthest = int(np.argmax(np.linalg.norm(steps, axis=2).min(axis=0)))
        corner = mesh.points[most[farthest]]
        return np.asarray(corner + tuning.PERIODIC_SHIFT * turn * steps[:, farthest].sum(axis=0))

    def joined(self, centre: FloatArray) -> JoinedCells:
        """Return the cells, each moved to where it is nearest to a point."""
        places = _Places.of(self.maps, self.mesh.diagonal)
        middles = self.mesh.points[self.mesh.cells].mean(axis=1)
        far = [np.linalg.norm(moved(one, middles) - centre, axis=1) for one in places.maps]
        place = np.argmin(far, axis=0)
        owner = _owners(self.mesh)
        for steps, pairs in self.pairs:
            first, second = owner[pairs].T
            # Cells on both sides of a facet are joined, also where the cut crosses the side.
            beside = places.before(place[first], steps)
            place[second] = np.where(beside >= 0, beside, place[second])
        return JoinedCells(self, places, place)


@dataclass(frozen=True)
class _Places:
    """The places to which cells are moved: how often by each motion, and the map to it."""

    steps: tuple[tuple[int, ...], ...]
    maps: FloatArray
    """float64[n, dim, dim + 1]"""
    number: dict[tuple[int, ...], int]
    """The number of the place for all steps, of which some may lead to the same place."""

    @classmethod
    def of(cls, maps: FloatArray, diagonal: float) -> _Places:
        """Return the different places up to one step away in each direction."""
        every = sorted(product((0, -1, 1), repeat=len(maps)), key=lambda s: sum(map(abs, s)))
        steps: list[tuple[int, ...]] = []
        found: list[FloatArray] = []
        number = {}
        scale = np.array([1.0] * maps.shape[1] + [diagonal])
        for one in every:
            there = power(maps, one)
            off = [np.abs((there - other) / scale).max() for other in found]
            same = [k for k, far in enumerate(off) if far < _SAME]
            number[one] = same[0] if same else len(found)
            if not same:
                steps.append(one)
                found.append(there)
        return cls(tuple(steps), np.stack(found), number)

    def before(self, place: IndexArray, steps: tuple[int, ...]) -> IndexArray:
        """Return the places fewer steps away, -1 where they are too far."""
        there = [self.number.get(tuple(np.subtract(one, steps).tolist()), -1) for one in self.steps]
        return np.array(there)[place]


@dataclass(frozen=True, eq=False)
class JoinedCells:
    """The cells of a periodic mesh, moved so that sides are inside."""

    cell: PeriodicCell
    places: _Places
    place: IndexArray
    """intp[n_cells]: the place of each cell."""

    @cached_property
    def _copies(self) -> tuple[IndexArray, IntArray]:
        """The nodes times the number of places plus the place, and the joined node of each."""
        n, mesh = len(self.places.maps), self.cell.mesh
        keys = np.unique(mesh.cells.astype(np.int64) * n + self.place[:, None])
        node, place = np.divmod(keys, n)
        points = moved(self.places.maps[place], mesh.points[node])
        joined = np.arange(len(keys))
        some = np.flatnonzero(self.cell.label[node] >= 0)
        joined[some] = some[first_at_place(points[some], _SAME * mesh.diagonal)]
        return keys, np.unique(joined, return_inverse=True)[1].astype(np.int32)

    @cached_property
    def mesh(self) -> SimplexMesh:
        """The joined cells: regions have the numbers of `regions`, facets those of `tags`."""
        (keys, joined), old = self._copies, self.cell.mesh
        n = len(self.places.maps)
        first = np.unique(joined, return_index=True)[1]
        node, place = np.divmod(keys[first], n)
        points = moved(self.places.maps[place], old.points[node])
        cells = joined[np.searchsorted(keys, old.cells.astype(np.int64) * n + self.place[:, None])]
        bare = SimplexMesh(points, cells)
        if old.tagged_facets is None:
            return replace(bare, cell_tags=self.regions[1])
        rows, numbers = self.tags(bare)[:2]
        return replace(
            bare, cell_tags=self.regions[1], tagged_facets=bare.facets[rows], facet_tags=numbers
        )

    @cached_property
    def regions(self) -> tuple[IntArray, IntArray]:
        """Tag and place of each region, int32[n, 2], and the region of each cell."""
        tags = self.cell.mesh.cell_tags
        own = np.zeros(len(self.place), np.int32) if tags is None else tags
        found, number = np.unique(np.column_stack([own, self.place]), axis=0, return_inverse=True)
        return found, number.ravel().astype(np.int32)

    def tags(self, joined: SimplexMesh) -> tuple[IntArray, IntArray, npt.NDArray[Any]]:
        """Return the facets with tags, their numbers, and what these stand for.

        Two sides that are one facet may have two tags: each row of the last array has a place, the
        tag on the side of the cells there, and the same for the other side.
        """
        old = self.cell.mesh
        tag_of = np.full(len(old.facets), NO_TAG)
        if old.tagged_facets is not None and old.facet_tags is not None:
            tag_of[facet_numbers(old, old.tagged_facets)] = old.facet_tags
        tags, facets = tag_of[old.cell_facets].ravel(), joined.cell_facets.ravel()
        places = np.repeat(self.place, old.cell_facets.shape[1])
        some = np.flatnonzero(tags != NO_TAG)
        some = some[np.argsort(facets[some], kind="stable")]
        rows, first, count = np.unique(facets[some], return_index=True, return_counts=True)
        ends = some[first], some[first + count - 1]
        sides = np.column_stack([part for one in ends for part in (places[one], tags[one])])
        found, number = np.unique(sides, axis=0, return_inverse=True)
        return rows, number.ravel().astype(np.int32), found

    @cached_property
    def _open(self) -> tuple[IntArray, IntArray]:
        """Joined facets that were inside or on a side, and what they were in the cell."""
        cell, corner = np.nonzero(self.mesh.facet_cell_counts[self.mesh.cell_facets] == 1)
        old = self.cell.mesh.cell_facets[cell, corner]
        is_open = (self.cell.mesh.facet_cell_counts[old] > 1) | self.cell.on_sides[old]
        return self.mesh.facets[self.mesh.cell_facets[cell, corner][is_open]], old[is_open]

    @property
    def cut(self) -> IntArray:
        """The facets that must stay, since those that match them are elsewhere."""
        return self._open[0]

    @property
    def is_cut(self) -> BoolArray:
        """Which facets of the cell are cut."""
        return marked(self._open[1], len(self.cell.mesh.facets))

    def size(self, size: Size) -> Size:
        """Return sizes in the joined cells; on joined sides, the smaller ones of both."""
        joined, back = self.mesh, [inverse(one) for one in self.places.maps]
        order = np.argsort(joined.cell_facets, axis=None, kind="stable")
        cells = order // joined.cell_facets.shape[1]
        start = np.cumsum(joined.facet_cell_counts) - joined.facet_cell_counts
        beside = self.place[cells[start]], self.place[cells[start + joined.facet_cell_counts - 1]]
        inside = np.flatnonzero(beside[0] != beside[1])
        sides = SimplexMesh(joined.points, joined.facets[inside]) if len(inside) else None

        def there(points: FloatArray, place: IndexArray) -> FloatArray:
            own = np.empty(points.shape)
            for number in np.unique(place):
                own[place == number] = moved(back[number], points[place == number])
            return size(own)

        def own(points: FloatArray) -> FloatArray:
            sizes = there(points, self.place[joined.locator.nearest(points)[0]])
            if sides is None:
                return sizes
            facet, _, away = sides.locator.nearest(points)
            on = np.flatnonzero(away <= _SAME * joined.diagonal)
            for place in beside:
                if len(on):
                    sizes[on] = np.minimum(sizes[on], there(points[on], place[inside[facet[on]]]))
            return sizes

        return own

    def parted(self, new: SimplexMesh) -> tuple[SimplexMesh, IntArray]:
        """Return a new mesh of the joined cells moved back, and its nodes on the cuts.

        The latter are given for each node of the cell, -1 for nodes that are not on a cut.

        Raises
        ------
        BackendError
            If the new mesh lacks nodes of the cuts, or regions.
        """
        n, old = len(self.places.maps), self.cell.mesh
        regions = self.regions[0][new.cell_tags]
        place = regions[:, 1]
        keys, local = np.unique(
            new.cells.astype(np.int64) * n + place[:, None], return_inverse=True
        )
        node, there = np.divmod(keys, n)
        back = np.stack([inverse(one) for one in self.places.maps])
        points = moved(back[there], new.points[node])
        at = self._origin(new, keys)
        # Copies of one node on a cut are the node that they were.
        number = np.where(at >= 0, at, old.n_points + np.arange(len(keys)))
        _, first, merged = np.unique(number, return_index=True, return_inverse=True)
        points[at >= 0] = old.points[at[at >= 0]]
        cells = merged.ravel()[local.reshape(new.cells.shape)].astype(np.int32)
        kept = np.full(old.n_points, -1, np.int32)
        kept[at[at >= 0]] = merged.ravel()[at >= 0]
        made = SimplexMesh(
            points[first], cells,
            cell_tags=None if old.cell_tags is None else regions[:, 0],
            tag_names=old.tag_names,
        )  # fmt: skip
        return self._tagged(made, new, place), kept

    def _origin(self, new: SimplexMesh, keys: IndexArray) -> IndexArray:
        """Return the node of the cell for copies of nodes of a new mesh, -1 if they are new."""
        from scipy.spatial import cKDTree

        n, (known, joined) = len(self.places.maps), self._copies
        on_cut = np.unique(self.cut)
        away, where = cKDTree(new.points).query(self.mesh.points[on_cut])
        if len(on_cut) and away.max() > 1e-3 * _SAME * self.mesh.diagonal:
            k = int(np.argmax(away))
            raise BackendError(
                f"mmg moved a node of a facet that it should keep: {away[k]:.3g} away from "
                f"{self.mesh.points[on_cut[k]].tolist()}, where cells were moved to"
            )
        kept = np.full(self.mesh.n_points, -1)
        kept[on_cut] = where
        some = kept[joined] >= 0
        node, place = np.divmod(known[some], n)
        old_keys = kept[joined[some]] * n + place
        order = np.argsort(old_keys)
        row = np.searchsorted(old_keys[order], keys).clip(max=max(len(order) - 1, 0))
        found = np.full(len(keys), -1)
        if len(order):
            same = old_keys[order][row] == keys
            found[same] = node[order][row[same]]
        lost = np.isin(keys // n, where) & (found < 0)
        if lost.any():
            raise BackendError("mmg changed the regions at a facet that it should keep")
        return found

    def _tagged(self, made: SimplexMesh, new: SimplexMesh, place: IntArray) -> SimplexMesh:
        """Return a mesh with the tags of facets: on a side, the tag that its cells had."""
        if self.cell.mesh.tagged_facets is None:
            return made
        meaning = self.tags(self.mesh)[2]
        number = np.full(len(new.facets), -1)
        if new.tagged_facets is not None and new.facet_tags is not None:
            number[facet_numbers(new, new.tagged_facets)] = new.facet_tags
        cell, corner = np.nonzero(number[new.cell_facets] >= 0)
        sides = meaning[number[new.cell_facets[cell, corner]]]
        tags = np.full(len(made.facets), NO_TAG)
        for at, tag in (sides[:, 2:].T, sides[:, :2].T):
            own = at == place[cell]
            tags[made.cell_facets[cell[own], corner[own]]] = tag[own]
        some = tags != NO_TAG
        return replace(
            made, tagged_facets=made.facets[some], facet_tags=tags[some].astype(np.int32)
        )


def _refuse_order(maps: FloatArray, mesh: SimplexMesh) -> None:
    """Refuse motions whose order matters."""
    low = mesh.points.min(axis=0)
    corners = low + mesh.diagonal * np.vstack([np.zeros(mesh.dim), np.eye(mesh.dim)])
    for i, one in enumerate(maps):
        for j, other in enumerate(maps[:i]):
            there, back = moved(one, moved(other, corners)), moved(other, moved(one, corners))
            if np.abs(there - back).max() > _SAME * mesh.diagonal:
                raise ValueError(
                    f"periodic must hold motions that may be applied in either order, but "
                    f"periodic[{j}] and periodic[{i}] lead to other places"
                )


def _owners(mesh: SimplexMesh) -> IndexArray:
    """Return a cell of each facet."""
    owner = np.empty(len(mesh.facets), np.intp)
    owner[mesh.cell_facets] = np.arange(mesh.n_cells)[:, None]
    return owner


def _paired_facets(mesh: SimplexMesh, maps: FloatArray) -> Any:
    """Yield how often motions are applied, and the facets of the boundary and their images.

    Raises
    ------
    ValueError
        If facets do not match although their nodes do.
    """
    outer = np.flatnonzero(mesh.facet_cell_counts == 1)
    for steps, whole in combined(maps):
        pairs = pairs_of(mesh.points, moved(whole, mesh.points), mesh.diagonal)
        image = np.full(mesh.n_points, -1, np.int32)
        image[pairs[:, 0]] = pairs[:, 1]
        sent = outer[(image[mesh.facets[outer]] >= 0).all(axis=1)]
        found = facet_numbers(mesh, image[mesh.facets[sent]]) if len(sent) else sent
        lost = sent[found < 0]
        if len(lost):
            _refuse_other_facets(mesh, lost, whole)
        some = (found >= 0) & (found != sent)
        if some.any():
            yield steps, np.column_stack([sent[some], found[some]])


def _refuse_other_facets(mesh: SimplexMesh, facets: IndexArray, motion: FloatArray) -> None:
    """Refuse facets that lie on a side after the motion but match none there."""
    middles = moved(motion, mesh.points[mesh.facets[facets]].mean(axis=1))
    outer = mesh.boundary().mesh
    away = outer.locator.nearest(middles)[2]
    off = np.flatnonzero(away <= _SAME * mesh.diagonal)
    if len(off):
        k = int(off[0])
        where = mesh.points[mesh.facets[facets[k]]].mean(axis=0)
        raise ValueError(
            "periodic needs facets in pairs: the nodes on opposite sides match, but the facet at "
            f"{where.tolist()} has no facet at {middles[k].tolist()}"
        )
