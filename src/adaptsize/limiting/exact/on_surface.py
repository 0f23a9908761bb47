"""The exact method on triangles in space: shortest paths by windows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels import surface_fans as fans
from adaptsize._kernels import surface_windows as kernels
from adaptsize._kernels.topology import join_cells
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.topology import components_of, rings, unique_rows
from adaptsize.limiting import tuning
from adaptsize.limiting.problem import PointBounds
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

# Windows between two calls of Python, some tenths of a second.
_AT_ONCE = 500_000

# Points of the surface this close to each other, relative to its diagonal, are the same.
_TOUCHING = 1e-9


@dataclass(frozen=True)
class OnSurface:
    """Limited sizes on a surface, and where they come from."""

    h: FloatArray
    named: IntArray
    """int32[n, 3]: the nodes of the last root of each path, padded with -1; a node whose bound is
    kept is its own; ``n + k`` is the k-th point."""
    bend: FloatArray
    """float64[n, 3]: the place of this node if the path bends there, else nan."""
    proved: BoolArray
    """Nodes whose size is known to be exact."""
    gap: float
    """Estimate of the largest error of the others."""
    n_sources: int


class _Canonical(NamedTuple):
    """A surface with numbers that depend on nothing but the places of the nodes and their bounds.

    So sizes are the same for any numbering, bit for bit, unless nodes with the same bound coincide.
    """

    node: IntArray
    """int32[n]: the number of each node; nodes at no distance from each other share it."""
    first: IntArray
    """int32[k]: for each number, one of its nodes with the smallest bound."""
    points: FloatArray
    """float64[k, 3]: their places times ``scale``."""
    scale: float
    """A power of two that makes the largest coordinate about 1."""
    factor: float
    """Lengths between ``points`` times this are lengths times g."""
    cells: IntArray
    """int32[m, 3]: unique triangles; segments have a node twice."""
    number: IntArray
    """int32[n_cells]: row of each cell in ``cells``, -1 if it has none."""


def limit_on_surface(
    mesh: SimplexMesh,
    h0: FloatArray,
    g: float,
    given: PointBounds | None,
    linear: bool,
    report: ProgressCallback,
) -> OnSurface:
    r"""Return :math:`\min_y h_0(y) + g\, d(x, y)` at the nodes of triangles in space.

    d is the length of the shortest path on the triangles.

    Parameters
    ----------
    mesh : SimplexMesh
    h0 : float64[n]
    g : float
    given : PointBounds, optional
        Bounds at points, which act from the closest points of the surface.
    linear : bool
        Whether h0 is linear on the triangles; if not, it is a bound at the nodes only.
    report : callable
    """
    whole, surface, at_edge = _unfolded(mesh, h0, g)
    n = len(whole.first)
    held = None if given is None else _Held.of(mesh, whole, given, g)
    base = _least(whole, h0, held)
    bound = h0[whole.first] - base
    steep, waves = np.ones(len(whole.cells), np.bool_), np.empty(0, np.int32)
    if linear:
        steep, waves = _acting(surface, bound)
    start, at = bound.copy(), None
    if held is not None:
        held.lower(mesh, whole, g, base, start)
        at = held.for_kernel(whole, base)
        steep |= (start < bound)[whole.cells].any(axis=1)
    n_points = 0 if given is None else len(given.sizes)
    mode = kernels.Mode(n + n_points, steep, 0.0)
    room = (int(np.diff(surface.ring_ptr).max(initial=0)) + 4) * (at_edge + 4)
    n_held = 0 if at is None else len(at[0])
    n_rows = 4 * n + len(waves) + room + 3 * at_edge * n_held
    front = _new_front(start, n_rows, len(surface.length))
    _start(surface, front, mode, bound, waves)
    if at is not None:
        kernels.start_at_points(surface, front, mode, *at)
    front, spent = _propagate_exactly(surface, front, mode, room, report)
    gap, exact_to = 0.0, np.inf
    if spent:
        front, gap = _finish_roughly(surface, front, mode, room, report)
        exact_to = float(front.dropped[0])
    moved = (front.root >= 0) | (front.h < bound)
    h = np.minimum(h0, np.where(moved, base + front.h, h0[whole.first])[whole.node])
    unused = ~mesh.in_a_cell
    h[unused] = h0[unused]
    named, bend = _origins(whole, mesh, front, n_points, h0 <= h)
    used = np.unique(front.root[front.root >= 0])
    proved = (front.h <= exact_to)[whole.node]
    return OnSurface(h, named, bend, proved, gap, len(used))


def _unfolded(mesh: SimplexMesh, h0: FloatArray, g: float) -> tuple[_Canonical, fans.Surface, int]:
    """Return the surface with other numbers, and what `_surface_of` returns of it."""
    whole = _canonical(mesh, h0, g)
    surface, most = _surface_of(whole)
    if not surface.length.all():
        whole = _merged(whole, surface, h0)
        surface, most = _surface_of(whole)
    return whole, surface, most


def _canonical(mesh: SimplexMesh, h0: FloatArray, g: float) -> _Canonical:
    """Return the surface with other numbers; nodes along a Morton curve."""
    largest = float(np.abs(mesh.points).max())
    scale = float(np.ldexp(1.0, -np.frexp(largest)[1])) if largest > 0.0 else 1.0
    order = np.lexsort((h0, *mesh.points.T))
    points = mesh.points[order] * scale
    along = along_curve(points)
    first: IntArray = order[along].astype(np.int32)
    node = np.empty(len(first), np.int32)
    node[first] = np.arange(len(first), dtype=np.int32)
    cells, number = unique_rows(node[mesh.cells], len(first))
    return _Canonical(node, first, points[along], scale, g / scale, cells, number)


def _merged(whole: _Canonical, surface: fans.Surface, h0: FloatArray) -> _Canonical:
    """Return the surface with one node for those that edges of no length join.

    Triangles of which two nodes are left are kept as segments, unless they are edges of others.
    With g = 0, one node is left of each component.
    """
    sides = np.flatnonzero(surface.length == 0.0)
    rows, k = whole.cells[sides // 3], sides % 3
    every = np.arange(len(sides))
    pairs = np.column_stack([rows[every, (k == 0) * 1], rows[every, 2 - (k == 2)]])
    parent = np.arange(len(whole.first), dtype=np.int32)
    join_cells(read_only(np.ascontiguousarray(pairs)), parent)
    kept, inverse = np.unique(parent, return_inverse=True)
    number: IntArray = inverse.astype(np.int32)
    n = len(kept)
    by_bound = np.lexsort((h0[whole.first], number))
    first = by_bound[np.unique(number[by_bound], return_index=True)[1]]
    cells = np.sort(number[whole.cells], axis=1)
    width = (np.diff(cells, axis=1) > 0).sum(axis=1)
    full = cells[width == 2].astype(np.int64)
    edges = np.concatenate([full[:, :2], full[:, 1:], full[:, ::2]])
    is_edge = np.isin(cells[:, 0].astype(np.int64) * n + cells[:, 2], edges @ [n, 1])
    chosen = (width == 2) | ((width == 1) & ~is_edge)
    unique, row = unique_rows(cells[chosen], n)
    new = np.full(len(cells), -1, np.int32)
    new[chosen] = row
    return whole._replace(
        node=number[whole.node],
        first=whole.first[first],
        points=whole.points[kept],
        cells=unique,
        number=new[whole.number],
    )


def _surface_of(whole: _Canonical) -> tuple[fans.Surface, int]:
    """Return lengths, angles and kinds of nodes, and the largest number of triangles at an edge."""
    n, m = len(whole.first), len(whole.cells)
    beyond = np.empty(3 * m, np.int32)
    surface = fans.Surface(
        read_only(whole.cells),
        beyond,
        np.empty(3 * m),
        np.empty((3 * m, 2)),
        np.empty(3 * m),
        *rings(whole.cells, n),
        np.zeros(n, np.int8),
        np.zeros(n),
    )
    scratch = np.empty(n, np.int32), np.empty(3 * m, np.int32)
    most = int(fans.connect_sides(surface.cells, beyond, *scratch))
    fans.measure(whole.points, whole.factor, surface)
    is_segment = (np.diff(whole.cells, axis=1) == 0).any(axis=1)
    surface.kind[whole.cells[is_segment]] = fans.COMPLEX
    fans.classify(surface)
    return surface, most


class _Held(NamedTuple):
    """Points of the surface with bounds, and the triangles that hold them."""

    places: FloatArray
    """float64[k, 3]: a row for each pair of a point and a triangle."""
    sizes: FloatArray
    numbers: IntArray
    """int32[k]: of the points."""
    cells: IntArray
    """int32[k]: of the mesh."""
    node: IntArray
    """int32[k]: one of their nodes in the other numbers."""
    rows: IntArray
    """int32[k]: of the triangles there."""
    weights: FloatArray
    """float64[k, 3]: of the nodes of these, nan if they have no area."""

    @classmethod
    def of(cls, mesh: SimplexMesh, whole: _Canonical, given: PointBounds, g: float) -> _Held:
        """Return them, moved to the closest points of the surface."""
        chosen = np.flatnonzero(np.isfinite(given.sizes))
        places, sizes = given.points[chosen], given.sizes[chosen]
        near, weights, away = mesh.locator.nearest(places)
        off = away > _TOUCHING * mesh.diagonal
        feet = np.einsum("iv,ivd->id", weights, mesh.points[mesh.cells[near]])
        places = np.where(off[:, None], feet, places)
        sizes = np.where(off, sizes + g * away, sizes)
        which, cells = mesh.locator.within(places, _TOUCHING * mesh.diagonal)
        rows = whole.number[cells]
        order = np.lexsort((sizes[which], *places[which].T, rows))
        which, cells, rows = which[order], cells[order], rows[order]
        weights, used = np.full((len(rows), 3), np.nan), np.flatnonzero(rows >= 0)
        corners = whole.points[whole.cells[rows[used]]]
        weights[used] = _weights(corners, places[which[used]] * whole.scale)
        numbers, node = chosen[which].astype(np.int32), whole.node[mesh.cells[cells, 0]]
        return cls(places[which], sizes[which], numbers, cells, node, rows, weights)

    def lower(
        self, mesh: SimplexMesh, whole: _Canonical, g: float, base: FloatArray, start: FloatArray
    ) -> None:
        """Lower the start at the nodes of triangles without area that hold points (In/Out)."""
        flat = np.isnan(self.weights[:, 0])
        for corner in mesh.cells[self.cells[flat]].T:
            node = whole.node[corner]
            length = np.linalg.norm(mesh.points[corner] - self.places[flat], axis=1)
            np.minimum.at(start, node, self.sizes[flat] - base[node] + g * length)

    def for_kernel(
        self, whole: _Canonical, base: FloatArray
    ) -> tuple[IntArray, FloatArray, FloatArray, IntArray]:
        """Return the arguments of `surface_windows.start_at_points`."""
        full = ~np.isnan(self.weights[:, 0])
        roots = (len(whole.first) + self.numbers[full]).astype(np.int32)
        sizes = (self.sizes - base[self.node])[full]
        return self.rows[full], self.weights[full], sizes, roots


def _least(whole: _Canonical, h0: FloatArray, held: _Held | None) -> FloatArray:
    """Return for each node the least bound of its component, which sizes are measured from.

    So lengths are not lost to rounding beside sizes that they are far below.
    """
    number = np.arange(len(whole.first), dtype=np.int32)
    join_cells(read_only(whole.cells), number)
    least = np.full(len(number), np.inf)
    np.minimum.at(least, number, h0[whole.first])
    if held is not None:
        np.minimum.at(least, number[held.node], held.sizes)
    return np.where(np.isfinite(least), least, 0.0)[number]


def _weights(corners: FloatArray, points: FloatArray) -> FloatArray:
    """Return weights of the corners of triangles at points in them; nan if there is no area."""
    p, q = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(p, q)
    away = points - corners[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        area = np.einsum("id,id->i", normal, normal)
        second = np.einsum("id,id->i", np.cross(away, q), normal) / area
        third = np.einsum("id,id->i", np.cross(p, away), normal) / area
        weights = np.maximum(np.column_stack([1.0 - second - third, second, third]), 0.0)
        found: FloatArray = weights / weights.sum(axis=1)[:, None]
    return found


def _new_front(start: FloatArray, n_rows: int, n_sides: int) -> kernels.Front:
    """Return a front with sizes at nodes and no windows."""
    n = len(start)
    return kernels.Front(
        start,
        np.full(n, -1, np.int32),
        np.zeros(n, np.int32),
        np.zeros(n),
        np.full(n, np.inf),
        np.empty((n_rows, 5)),
        np.empty((n_rows, 2), np.int32),
        np.empty(n_rows, np.int32),
        np.full(n_sides, -1, np.int32),
        np.empty(2 * n_rows),
        np.empty(2 * n_rows, np.int32),
        np.zeros(4, np.int64),
        np.array([np.inf]),
    )


def _acting(surface: fans.Surface, h0: FloatArray) -> tuple[BoolArray, IntArray]:
    """Return the triangles into which bounds at nodes act, and the sides into which edges do.

    h0 is linear on the triangles.  One on which it rises by at most 1 per unit of length is bounded
    by h0 at least as strongly as by any path through it from one of its own points.  The same holds
    for paths from an edge into a triangle where h0 rises from the edge more slowly than they do.
    """
    sizes, length = h0[surface.cells], surface.length.reshape(-1, 3)
    x, y = surface.apex.reshape(-1, 3, 2).transpose(2, 0, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (sizes[:, 1] - sizes[:, 0]) / length[:, 2]
        across = (sizes[:, 2] - sizes[:, 0] - along * x[:, 2]) / y[:, 2]
        steep = ~(along * along + across * across <= 1.0)
        rows = np.flatnonzero(steep)
        sizes, length, x, y = sizes[rows], length[rows], x[rows], y[rows]
        first, last = sizes[:, [1, 0, 0]], sizes[:, [2, 2, 1]]
        slope = (last - first) / length
        rate = np.sqrt((1.0 - slope) * (1.0 + slope))
        acts = (np.abs(slope) < 1.0) & (sizes - first - slope * x > rate * y)
    at, k = np.nonzero(acts)
    return steep, (3 * rows[at] + k).astype(np.int32)


def _start(
    surface: fans.Surface, front: kernels.Front, mode: kernels.Mode, h0: FloatArray, waves: IntArray
) -> None:
    """Queue the nodes that act by their own bounds, and the windows of edges (In/Out: front)."""
    acts = np.zeros(len(h0), np.bool_)
    acts[surface.cells[mode.steep]] = True
    nodes = np.flatnonzero(acts & np.isfinite(front.h)).astype(np.int32)
    n, k, cells = len(waves), waves % 3, surface.cells[waves // 3]
    every = np.arange(n)
    first, last = h0[cells[every, (k == 0) * 1]], h0[cells[every, 2 - (k == 2)]]
    length = surface.length[waves]
    slope = (last - first) / length
    front.rows[:n, 0], front.rows[:n, 1], front.rows[:n, 2] = 0.0, length, -slope
    front.rows[:n, 3], front.rows[:n, 4] = np.sqrt((1.0 - slope) * (1.0 + slope)), first
    front.where[:n, 0], front.where[:n, 1] = waves, mode.first_wave + waves
    front.tally[kernels.USED] = n
    key = np.concatenate([front.h[nodes], np.minimum(first, last)])
    _fill_queue(front, key, np.concatenate([-1 - nodes, every]))


def _fill_queue(front: kernels.Front, key: FloatArray, item: npt.NDArray[Any]) -> None:
    """Queue only the given items (In/Out: front); what is sorted is a heap."""
    order, n = np.argsort(key, kind="stable"), len(key)
    front.key[:n], front.item[:n] = key[order], item[order]
    front.tally[kernels.QUEUED] = n


def _restart(surface: fans.Surface, front: kernels.Front) -> None:
    """Queue all nodes, too, but those from which no path to a node further away may start.

    These are more than two edges below the sizes that are processed next.
    """
    reach, queued = np.zeros(len(front.h)), int(front.tally[kernels.QUEUED])
    longest = surface.length.reshape(-1, 3).max(axis=1)
    for nodes in surface.cells.T:
        np.maximum.at(reach, nodes, longest)
    acts = np.isfinite(front.h) & (front.h + 2.0 * reach >= front.key[0])
    nodes = np.flatnonzero(acts).astype(np.int32)
    front.sent[nodes] = np.inf
    key = np.concatenate([front.key[:queued], front.h[nodes]])
    _fill_queue(front, key, np.concatenate([front.item[:queued], -1 - nodes]))


def _enlarged(front: kernels.Front, room: int) -> kernels.Front:
    """Return a front with arrays of twice the size, or more, for its windows."""
    more = len(front.rows) + room

    def longer(array: FloatArray, n: int) -> FloatArray:
        return np.concatenate([array, np.empty((n, *array.shape[1:]), array.dtype)])

    of_rows = {name: longer(getattr(front, name), more) for name in ("rows", "where", "free")}
    of_queue = {name: longer(getattr(front, name), 2 * more) for name in ("key", "item")}
    return front._replace(**of_rows, **of_queue)


def _propagate_exactly(
    surface: fans.Surface,
    front: kernels.Front,
    mode: kernels.Mode,
    room: int,
    report: ProgressCallback,
) -> tuple[kernels.Front, bool]:
    """Process all windows unless these are too many; return whether any are left."""
    n, limit = len(front.h), tuning.WINDOWS_PER_NODE
    spent = True
    for per_node in (*(w for w in tuning.FORECASTS if w < limit), limit):
        most = max(per_node * n, tuning.LEAST_WINDOWS)
        front, spent = _propagate(surface, front, mode, room, most, report)
        dear = max(limit * n, front.tally[kernels.DONE] + tuning.DROPPING * n, tuning.LEAST_WINDOWS)
        if not spent or _forecast(surface, front) > dear:
            break
    return front, spent


def _forecast(surface: fans.Surface, front: kernels.Front) -> float:
    """Return how many windows there will be in all.

    On a smooth surface, the front of the windows from one source grows like the distance, and each
    node costs as many as there are in the front: the power 3/2 of the share of nodes behind it.
    """
    cells = surface.cells
    piece = components_of(np.concatenate([cells[:, :2], cells[:, 1:]]), len(front.h))
    reached = np.zeros(len(front.h), np.bool_)
    reached[piece[np.isfinite(front.h)]] = True
    settled = np.count_nonzero(front.h <= front.key[0]) / np.count_nonzero(reached[piece])
    return float(front.tally[kernels.DONE] / max(settled, 1e-9) ** 1.5)


def _propagate(
    surface: fans.Surface,
    front: kernels.Front,
    mode: kernels.Mode,
    room: int,
    most: float,
    report: ProgressCallback,
) -> tuple[kernels.Front, bool]:
    """Process windows until none are left, or so many in all; return whether any are left."""
    while True:
        until = min(int(front.tally[kernels.DONE]) + _AT_ONCE, most)
        status = kernels.propagate(surface, front, mode, room, int(until))
        if status == kernels.FINISHED:
            return front, False
        if status == kernels.FULL:
            front = _enlarged(front, room)
        elif until == most:
            return front, True
        report("limiting the gradient", None)


def _finish_roughly(
    surface: fans.Surface,
    front: kernels.Front,
    mode: kernels.Mode,
    room: int,
    report: ProgressCallback,
) -> tuple[kernels.Front, float]:
    """Drop narrow windows from now on; return the front, and an estimate of its largest error.

    The estimate is the change of the sizes if windows of up to twice the width are dropped.
    """
    n, sizes = len(front.h), []
    front = _enlarged(front, n + room)
    for share in (2.0, 1.0):
        last = (
            front
            if share == 1.0
            else front._replace(**{name: array.copy() for name, array in front._asdict().items()})
        )
        rough = mode._replace(narrow=share * tuning.NARROW)
        _restart(surface, last)
        last, _ = _propagate(surface, last, rough, room, np.inf, report)
        sizes.append(last.h)
    with np.errstate(invalid="ignore"):
        change = np.abs(sizes[0] - sizes[1])
    return last, float(change.max(where=np.isfinite(change), initial=0.0))


def _origins(
    whole: _Canonical, mesh: SimplexMesh, front: kernels.Front, n_points: int, own: BoolArray
) -> tuple[IntArray, FloatArray]:
    """Return ``named`` and ``bend`` of `OnSurface`; ``own``: nodes that keep their bounds."""
    n, total = len(whole.first), len(own)
    root = np.where(front.root < 0, np.arange(n, dtype=np.int32), front.root)
    named = np.full((n, 3), -1, np.int32)
    at_node, at_edge = root < n, root >= n + n_points
    named[:, 0] = np.where(at_node, whole.first[np.where(at_node, root, 0)], root - n + total)
    sides = root[at_edge] - (n + n_points)
    rows, k = whole.cells[sides // 3], sides % 3
    every = np.arange(len(sides))
    named[at_edge, 0] = whole.first[rows[every, (k == 0) * 1]]
    named[at_edge, 1] = whole.first[rows[every, 2 - (k == 2)]]
    bends = at_node & (front.root >= 0)
    bends[bends] = front.root[root[bends]] >= 0
    place = np.where(bends[:, None], mesh.points[np.where(bends, named[:, 0], 0)], np.nan)
    named, place = named[whole.node], place[whole.node]
    named[own] = -1
    named[own, 0], place[own] = np.flatnonzero(own), np.nan
    return named, place
