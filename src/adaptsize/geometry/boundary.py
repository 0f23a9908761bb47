"""The boundary of a flat domain: its walls.

The *walls* are defined as follows:

* A facet of one cell is a wall, and so are both faces of a crack or slit.
* A facet of several cells is a wall if all of them lie on the same side of it (a fold).
* Duplicate cells have no effect.
* Cells without measure are removed as long as one of their facets has no other cell, such as flat
  cells on the hull.  The remaining ones join the cells on both sides, for example between an edge
  and the two halves that it should have.
* Where the nodes on the two sides of a line do not match and no such cell fills the gap, there is
  a crack, with passages at the nodes that both sides share.

Nodes in no cell are not in the domain.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels import flat_boundary as kernels
from adaptsize._workers import Workers
from adaptsize.background import SimplexMesh
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.topology import have_different_nodes, roots_of, unique_rows
from adaptsize.typing import BoolArray, FloatArray, IntArray, LongArray

# Cells per chunk of a thread, a millisecond.
_CELLS = 1 << 16


class FlatBoundary(NamedTuple):
    """The walls of triangles in the plane or of tetrahedra.

    Parameters
    ----------
    facets : int32[f, dim]
        The domain to the left (2-D), normals outward (3-D).
    cells : int32[f]
        A cell with measure at each facet.
    is_simple : bool
        Whether no wall is shared by several cells.
    alias : int32[n_points]
        Representative of each node, if cells join coincident nodes.
    has_flat : bool
        Whether any cell has no measure.
    """

    facets: IntArray
    cells: IntArray
    is_simple: bool
    alias: IntArray | None = None
    has_flat: bool = False


class OtherParts(NamedTuple):
    """What `flat_boundary` needs of the other parts of a mesh."""

    ids: LongArray
    """int64[n_points]: global numbers of the nodes of this part."""
    total: Callable[[npt.NDArray[np.uint64]], npt.NDArray[np.uint64]]
    """Adds to nodal numbers those of the other parts at the same nodes; collective."""


def facet_normals(corners: FloatArray) -> FloatArray:
    """Return the normals of segments in the plane, or of triangles, float64[f, dim, dim].

    They have the length of the segment, or twice the area of the triangle.
    """
    edges = corners[:, 1:] - corners[:, :1]
    if corners.shape[2] == 2:
        return np.column_stack([edges[:, 0, 1], -edges[:, 0, 0]])
    return np.asarray(np.cross(edges[:, 0], edges[:, 1]))


def flat_boundary(
    mesh: SimplexMesh, threads: int = 1, others: OtherParts | None = None
) -> FlatBoundary:
    """Return the walls of a mesh of triangles in the plane or of tetrahedra.

    O(n_cells); facets inside the mesh are never listed.  With ``others``, few facets between two
    parts are walls: those all of whose nodes are on the boundary of the whole mesh, or at which
    cells overlap.  Cells with coincident nodes are left as they are then.
    """
    points, cells = mesh.points, mesh.cells
    sums, found = _sums(points, cells, threads, None if others is None else others.ids)
    if others is not None:
        sums = others.total(sums)
    elif found & kernels.HAS_COINCIDENT:
        merged, alias = _without_short_edges(points, cells)
        sums, found = _sums(points, merged, 1, None)
        return _walls(points, merged, sums, found, threads)._replace(alias=alias, has_flat=True)
    return _walls(points, cells, sums, found, threads)


def _walls(
    points: FloatArray, cells: IntArray, sums: npt.NDArray[np.uint64], found: int, threads: int
) -> FlatBoundary:
    """Return the walls, given the sums and the result of `kernels.sum_facets`."""
    n = len(points)
    has_flat = bool(found & kernels.HAS_FLAT)
    rows, side, cell = _facets_at(points, cells, sums != 0, threads)
    if len(rows) == 0:  # only folds
        return FlatBoundary(rows, cell, False, has_flat=has_flat)
    unique, group = unique_rows(rows, n)
    if has_flat:
        removed = np.zeros(len(group), np.bool_)
        times = np.bincount(group, minlength=len(unique)).astype(np.int32)
        kernels.remove_flat_cells(group, side, cell, times, removed)
        rows, side, cell, group = rows[~removed], side[~removed], cell[~removed], group[~removed]
    joined = np.zeros(len(unique), bool)
    joined[group[side == 0]] = True
    left, right = (np.bincount(group[side == s], minlength=len(unique)) for s in (1, -1))
    is_wall = ((left == 0) != (right == 0)) & ~joined
    owner = np.zeros(len(unique), np.int32)
    owner[group] = cell
    facets = unique[is_wall]
    flip = left[is_wall] == 0
    facets[flip, :2] = facets[flip, 1::-1]
    is_simple = bool((left + right)[is_wall].max(initial=1) == 1)
    return FlatBoundary(facets, owner[is_wall], is_simple, has_flat=has_flat)


def _sums(
    points: FloatArray, cells: IntArray, threads: int, ids: LongArray | None
) -> tuple[npt.NDArray[np.uint64], int]:
    """Return the sums and the result of `kernels.sum_facets`."""
    n, m = len(points), len(cells)
    axes = (0,) * points.shape[1]
    # Smallest number of cells for a second thread.
    n_parts = 1 if m < 100_000 else threads
    step, given = max(-(-m // n_parts), 1), read_only(cells)  # all cells may be flat
    sums, found = np.zeros((n_parts, n), np.uint64), np.zeros(n_parts, np.int64)

    def add(first: int, last: int) -> None:
        k = first // step
        found[k] = kernels.sum_facets(points, axes, given[first:last], ids, sums[k])

    def merge(first: int, last: int) -> None:
        np.sum(sums[:, first:last], axis=0, out=sums[0, first:last])

    workers = Workers(threads)
    workers.in_chunks(add, m, step)
    if n_parts > 1:
        workers.in_chunks(merge, n)
    return sums[0], int(np.bitwise_or.reduce(found))


def _facets_at(
    points: FloatArray, cells: IntArray, marked: BoolArray, threads: int
) -> tuple[IntArray, npt.NDArray[np.int8], IntArray]:
    """Return the facets all of whose nodes are marked, as from `kernels.list_facets`."""
    given, axes = read_only(cells), (0,) * points.shape[1]
    room = 64 + 8 * int(np.count_nonzero(marked))  # enough but for piles
    found = [_FacetsAt.of(0, len(axes))] * max(1, -(-len(cells) // _CELLS))

    def task(first: int, last: int) -> None:
        own = _FacetsAt.of(min(room, (len(axes) + 1) * (last - first)), len(axes))
        count = kernels.list_facets(points, axes, given[first:last], marked, *own)
        if count > len(own.cells):
            own = _FacetsAt.of(count, len(axes))
            kernels.list_facets(points, axes, given[first:last], marked, *own)
        own.cells[:count] += first
        found[first // _CELLS] = _FacetsAt._make(column[:count] for column in own)

    Workers(threads).in_chunks(task, len(cells), _CELLS)
    rows, side, cell = (np.concatenate(columns) for columns in zip(*found, strict=True))
    return rows, side, cell


class _FacetsAt(NamedTuple):
    """What `kernels.list_facets` fills."""

    rows: IntArray
    sides: npt.NDArray[np.int8]
    cells: IntArray

    @classmethod
    def of(cls, room: int, dim: int) -> "_FacetsAt":
        """Return room for some facets."""
        return cls(
            np.empty((room, dim), np.int32), np.empty(room, np.int8), np.empty(room, np.int32)
        )


def _without_short_edges(points: FloatArray, cells: IntArray) -> tuple[IntArray, IntArray]:
    """Return the cells with coincident nodes of a cell merged, and the representatives."""
    pairs = [cells[:, [v, w]] for v in range(cells.shape[1]) for w in range(v)]
    short = [rows[(points[rows[:, 0]] == points[rows[:, 1]]).all(axis=1)] for rows in pairs]
    parent = roots_of(np.concatenate(short), len(points))
    merged = parent[cells]
    return np.ascontiguousarray(merged[have_different_nodes(merged)]), parent


class PlaneTurns(NamedTuple):
    """Turning angles of the boundary of a plane domain at its nodes.

    Parameters
    ----------
    nodes : int32[b]
    into, out : float64[b, 2]
        From the node before, and to the node behind.
    once : bool[b]
        Whether one wall enters and one leaves; else ``into`` and ``out`` are those of any.
    angles : float64[b]
        Positive where the domain is convex; nan at the end of a slit, and unless ``once``.
    """

    nodes: IntArray
    into: FloatArray
    out: FloatArray
    once: BoolArray
    angles: FloatArray


def turns_in_plane(points: FloatArray, facets: IntArray) -> PlaneTurns:
    """Return the angle by which the boundary turns at each of its nodes."""
    # Few of all nodes are on the boundary: arrays over all nodes would take longer than the rest.
    nodes = np.unique(facets).astype(np.int32)
    start, end = np.searchsorted(nodes, facets).T
    n_out, n_in = (np.bincount(ends, minlength=len(nodes)) for ends in (start, end))
    once = (n_out == 1) & (n_in == 1)
    before, after = np.zeros(len(nodes), np.int64), np.zeros(len(nodes), np.int64)
    after[start], before[end] = end, start
    place = points[nodes]
    into, out = place - place[before], place[after] - place
    cross = into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0]
    dot = np.einsum("ij,ij->i", into, out)
    angles = np.where(once & ((cross != 0.0) | (dot > 0.0)), np.arctan2(cross, dot), np.nan)
    return PlaneTurns(nodes, into, out, once, angles)
