"""Bodies of a surface that overlap, and bodies that intersect themselves."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.crossings import WORK, find_crossings
from adaptsize.background import SimplexMesh
from adaptsize.geometry.distance.winding import WindingNumber
from adaptsize.remeshing.hole_filling import bodies_of, merged_surface
from adaptsize.typing import FloatArray

#: Crossings less deep than this times the diagonal count as contacts.  It is above the rounding
#: of the single precision of STL files.
_SLACK = 1e-6
#: A compiled loop cannot be interrupted.  One call should take about this long.
_SECONDS_PER_CALL = 0.3
#: Pairs of bodies without crossing triangles that are examined, those with the closest boxes first.
_MOST_PAIRS = 200
#: Points of a body that are examined for being inside another one.
_MOST_SAMPLES = 2000
#: Pairs that are named.
_MOST_NAMED = 3
#: Rows of the stack of a descent in a tree.
_STACK = 64


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
        place = ", ".join(f"{x:.4g}" for x in self.place)
        crossing = f": {self.n_crossing} triangles cross others" if self.n_crossing > 0 else ""
        return f"{' and '.join(parts)}{crossing}, by up to {self.depth:.3g} at ({place})"


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
    found = _Overlaps(mesh, body)
    crossing = _crossings(mesh)
    if crossing is not None:
        found.add(body[crossing.cells], body[crossing.partners], crossing.depths, crossing.places)
    for overlap in _overlaps_in_common_planes(mesh, body, found.pairs):
        found.add(*overlap)
    if not found.pairs:
        return None
    return OverlappingBodies(
        tuple(sorted((a + 1, b + 1) for a, b in found.pairs)),
        0 if crossing is None else len(crossing.cells),
        found.depth,
        tuple(found.place.tolist()),
        int(body.max()) + 1,
    )


def _listed(names: list[str]) -> str:
    """Return names in words, at most a few of them."""
    if len(names) > _MOST_NAMED:
        names = [*names[:_MOST_NAMED], f"{len(names) - _MOST_NAMED} more"]
    return ", ".join(names)


@dataclass
class _Overlaps:
    """The pairs found so far, and the deepest place."""

    mesh: SimplexMesh
    body: npt.NDArray[np.intp]
    pairs: set[tuple[int, int]] = field(default_factory=set)
    depth: float = 0.0
    place: FloatArray = field(default_factory=lambda: np.zeros(3))

    def add(
        self,
        one: npt.NDArray[np.intp],
        other: npt.NDArray[np.intp],
        depths: FloatArray,
        places: FloatArray,
    ) -> None:
        ends = np.sort(np.column_stack([one, other]), axis=1)
        self.pairs |= {(a, b) for a, b in np.unique(ends, axis=0).tolist()}
        worst = int(np.argmax(depths))
        if depths[worst] > self.depth:
            self.depth, self.place = float(depths[worst]), places[worst]


class _Crossings(NamedTuple):
    cells: npt.NDArray[np.intp]
    partners: npt.NDArray[np.intp]
    depths: FloatArray
    places: FloatArray


def _crossings(mesh: SimplexMesh) -> _Crossings | None:
    """Return the triangles that cross others, and for each the deepest crossing."""
    tree = mesh.locator.tree
    n = mesh.n_cells
    depths, partners, places = np.zeros(n), np.zeros(n, np.int32), np.zeros((n, 3))
    slack = _SLACK * mesh.diagonal * tree.scale
    stack, work = np.empty(_STACK, np.int64), np.empty((WORK, 4))
    first, step = 0, 1024
    while first < n:
        last = min(first + step, n)
        begin = time.perf_counter()
        find_crossings(
            tree.points, tree.cells, tree.boxes, slack, first, last,
            depths, partners, places, stack, work,
        )  # fmt: skip
        seconds = time.perf_counter() - begin
        step = 2 * step if seconds < 0.5 * _SECONDS_PER_CALL else max(step // 2, 1)
        first = last
    rows = np.flatnonzero(depths > 0.0)
    if len(rows) == 0:
        return None
    cells = tree.cell_of_place[rows].astype(np.intp)
    others = tree.cell_of_place[partners[rows]].astype(np.intp)
    return _Crossings(cells, others, depths[rows] / tree.scale, places[rows] / tree.scale)


def _overlaps_in_common_planes(
    mesh: SimplexMesh, body: npt.NDArray[np.intp], known: set[tuple[int, int]]
) -> Iterator[tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], FloatArray, FloatArray]]:
    """Yield pairs of bodies without crossing triangles of which one is partly in the other."""
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
                yield np.array([a]), np.array([b]), *inside
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
        nodes, local = np.unique(cells, return_inverse=True)
        surface = SimplexMesh(mesh.points[nodes], local.reshape(cells.shape))
        stride = -(-len(cells) // _MOST_SAMPLES)
        samples = mesh.points[cells[::stride]].mean(axis=1)
        return cls(surface, samples, WindingNumber(surface))

    def partly_inside(self, other: _Body, slack: float) -> tuple[FloatArray, FloatArray] | None:
        """Return the depth and place of the deepest sample inside, if others are outside."""
        away = other.surface.locator.nearest(self.samples)[2]
        inside = other.winding.contains(self.samples)
        deep = np.where(inside, away, -away)
        if deep.max() <= slack or deep.min() >= -slack:
            return None
        worst = int(np.argmax(deep))
        return deep[worst : worst + 1], self.samples[worst : worst + 1]
