"""Meshes whose cells are bisected until a size function is known everywhere in them."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.bisection import add_edges, bisect_cells
from adaptsize.background import tuning
from adaptsize.background.simplex import SimplexMesh
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray

#: Takes points, float64[n, dim], and returns sizes, float64[n]: positive, or inf.
SizeAt: TypeAlias = Callable[[FloatArray], FloatArray]
#: Ratio where the lower bound of the sizes is not positive.
_FARTHEST = 1e300


class Resolved(NamedTuple):
    """A mesh whose cells were bisected.

    Parameters
    ----------
    mesh : SimplexMesh
        The old nodes first.  With tags and names, without data.
    parents : int64[n_cells]
        The cell of the old mesh of which each cell is a part.
    node_parents : int32[n_new, 2]
        The ends, earlier nodes, of the edge in whose middle each new node lies.
    curves : int32[n, 2]
        The edges passed as ``curves``, bisected with the mesh; rows sorted.
    is_complete : bool
        False if cells had to stay larger because of ``max_points``.
    """

    mesh: SimplexMesh
    parents: IndexArray
    node_parents: IntArray
    curves: IntArray
    is_complete: bool

    def extended(self, nodal: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return nodal values of the old mesh on this one: new nodes get the mean of the ends.

        So they stay linear in the old cells; inf where one of the ends is inf.  Integers and
        booleans are those of one end.
        """
        if nodal.dtype.kind in "biu":
            return np.asarray(nodal[self._first_ends()])
        return _extended(nodal, self.node_parents)

    def _first_ends(self) -> IndexArray:
        """Return an old node for each node: the first end of its edge, or that of this end."""
        known = self.mesh.n_points - len(self.node_parents)
        found = np.arange(self.mesh.n_points)
        for new in _generations(self.node_parents, known):
            found[known + new] = found[self.node_parents[new, 0]]
        return found

    def after(self, before: Resolved) -> Resolved:
        """Return what became of a mesh that was divided to ``before``, and that to this one."""
        return self._replace(
            parents=before.parents[self.parents],
            node_parents=np.concatenate([before.node_parents, self.node_parents]),
            is_complete=before.is_complete and self.is_complete,
        )


def resolved(
    mesh: SimplexMesh,
    size: SizeAt,
    *,
    g: float | None = None,
    is_proved: bool = True,
    samples: FloatArray | None = None,
    factor: float | None = None,
    accuracy: float | None = None,
    curves: IntArray | None = None,
    max_points: float = np.inf,
) -> Resolved:
    r"""Return a mesh bisected until no cell is much larger than the smallest size in it.

    A cell with longest edge l is divided at the middle of that edge while

    .. math:: l > f \, \bigl( h(m) - g r \bigr),

    where m is its centroid, r the distance from m to its farthest corner, and f the factor.  If
    the gradient of h is at most g, the right-hand side is a lower bound of f h in the cell, so
    that no small size is missed, however small it is and wherever it is.  A larger cell is left
    alone if the size at m is the mean of those at the corners up to a share, and the lower bound
    of h is at least half of the largest of them.  Cells beside divided ones are divided at their
    longest edges until the mesh is conforming [1]_, which keeps the angles of triangles above half
    of the smallest one.

    Parameters
    ----------
    mesh : SimplexMesh
        Segments, triangles or tetrahedra.
    size : callable
    g : float, optional
        Bound on the gradient of the size; without it, 0 in the rule.
    is_proved : bool
        Whether the gradient is at most g for certain.  If not, or without g, the size is
        also sampled: at corners, and at ``samples``, or if there are none, at the middles of edges.
        Small sizes between these points may then be missed.
    samples : float64[n, dim], optional
        More points where the size is evaluated, such as the nodes of a background.
    factor : float, optional
        Of the rule; by default `tuning.EDGE_OVER_SIZE`.
    accuracy : float, optional
        Cells on which the sizes are linear up to this share stay larger, by default
        `tuning.NEARLY_LINEAR`; with 0, none does.
    curves : int32[n, 2], optional
        Edges of cells of which the halves are returned.
    max_points : float
        Division ends when there are about so many nodes.  The cells that are largest compared with
        the sizes are divided first.

    Returns
    -------
    Resolved

    References
    ----------
    .. [1] M.-C. Rivara, "Algorithms for refining triangular grids suitable for adaptive and
       multigrid techniques", Int. J. Numer. Meth. Eng. 20 (1984) 745-756.

    Examples
    --------
    A small size at a point inside a square of two triangles, which is not at a node:

    >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> def size(x):
    ...     return 1e-3 + 0.25 * np.hypot(x[:, 0] - 0.3, x[:, 1] - 0.6)
    >>> fine = resolved(mesh, size, g=0.25).mesh
    >>> bool(size(fine.points).min() < 1.5e-3), fine.n_points < 1000
    (True, True)
    """
    division, sampled = _Division(mesh), None
    if not is_proved or g is None:
        has_samples = samples is not None and len(samples) > 0
        sampled = "nodes" if has_samples else "edges"
    if samples is not None and sampled == "nodes":
        division.place(samples, np.asarray(size(samples), np.float64))
    factor = tuning.EDGE_OVER_SIZE if factor is None else factor
    accuracy = tuning.NEARLY_LINEAR if accuracy is None else accuracy
    rule = _Rule(division, size, g or 0.0, factor, accuracy, sampled)
    is_complete = division.all_within(rule, max_points)
    fine = division.mesh()
    halves = np.empty((0, 2), np.int32)
    if curves is not None and len(curves):
        halves = np.sort(division.divided(curves)[0], axis=1)
    return Resolved(fine, division.owner, division.node_parents, halves, is_complete)


def bisected(
    mesh: SimplexMesh, h: FloatArray, factor: float, max_cells: float = np.inf
) -> Resolved:
    """Return a mesh bisected until no longest edge is above ``factor`` times the size in its cell.

    Parameters
    ----------
    mesh : SimplexMesh
        Segments, triangles or tetrahedra.
    h : float64[n_points]
        Sizes at the nodes, finite and positive; linear in the cells of this mesh.  That of a
        part of a cell is the mean at its corners.
    factor : float
    max_cells : float
        Division ends when there are about so many cells.

    Returns
    -------
    Resolved
        See `resolved` for the parts of cells.
    """
    division = _Division(mesh)
    # Division adds as many nodes as it divides edges, each with at least one cell.
    most = mesh.n_points + max_cells - mesh.n_cells
    is_complete = division.all_within(_NodalRule(division, h, factor), most)
    nothing = np.empty((0, 2), np.int32)
    return Resolved(division.mesh(), division.owner, division.node_parents, nothing, is_complete)


class _NodalRule:
    """The longest edge of cells over a multiple of the mean size at their corners."""

    def __init__(self, division: _Division, h: FloatArray, factor: float) -> None:
        self._division, self._nodal, self._factor = division, h, factor

    def __call__(self, cells: IndexArray) -> FloatArray:
        division, known = self._division, len(self._nodal)
        ends = division.ends[known:]
        self._nodal = _extended(self._nodal, ends)
        corners = division.cells[cells]
        mean = self._nodal[corners].mean(axis=1)
        return _ratios(division.points[corners], self._factor * mean)


class _Rule:
    """The longest edge of cells over the largest one that a function of points allows."""

    def __init__(
        self,
        division: _Division,
        size: SizeAt,
        g: float,
        factor: float,
        accuracy: float,
        sampled: str | None,
    ) -> None:
        self._division, self._size, self._g = division, size, g
        self._factor, self._accuracy, self._sampled_at = factor, accuracy, sampled
        self._nodal = np.empty(0)

    def __call__(self, cells: IndexArray) -> FloatArray:
        division, known = self._division, len(self._nodal)
        self._nodal = np.append(self._nodal, self._size(division.points[known:]))
        corners = division.points[division.cells[cells]]
        nodal = self._nodal[division.cells[cells]]
        middle = corners.mean(axis=1)
        there = np.array(self._size(middle), np.float64)
        away = corners - middle[:, None]
        least = there - self._g * np.sqrt(np.einsum("ijk,ijk->ij", away, away).max(axis=1))
        with np.errstate(invalid="ignore"):  # inf at all corners
            off = np.abs(nodal.mean(axis=1) - there) / there
        if self._sampled_at is not None:
            found, most = self._sampled(cells, corners, nodal)
            least, off = np.minimum(least, found), np.maximum(off, most)
        is_known = np.isinf(least)
        if self._accuracy > 0.0:
            is_known |= (off <= self._accuracy) & (least >= tuning.HIDDEN * nodal.max(axis=1))
        return np.where(is_known, 0.0, _ratios(corners, self._factor * least))

    def _sampled(
        self, cells: IndexArray, corners: FloatArray, nodal: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the least size at corners and at samples or middles of edges.

        Also return how much the sizes at middles of edges differ from linear ones.
        """
        least = nodal.min(axis=1)
        if self._sampled_at == "nodes":
            return np.minimum(least, self._division.least(cells)), np.zeros(len(cells))
        pairs = _pairs(corners)
        middles = corners[:, pairs].mean(axis=2)
        between = np.asarray(self._size(middles.reshape(-1, middles.shape[2])))
        between = between.reshape(middles.shape[:2])
        with np.errstate(invalid="ignore"):
            off = np.abs(nodal[:, pairs].mean(axis=2) - between) / between
        return np.minimum(least, between.min(axis=1)), np.nan_to_num(off).max(axis=1)


def _extended(nodal: npt.NDArray[Any], parents: IntArray) -> npt.NDArray[Any]:
    """Return nodal values followed by those of new nodes in the middles of edges."""
    known = len(nodal)
    values = longer(nodal, known + len(parents))
    for new in _generations(parents, known):
        values[known + new] = values[parents[new]].mean(axis=1)
    return values


def _generations(parents: IntArray, first: int) -> list[IndexArray]:
    """Return the rows of new nodes, those first whose parents are no new nodes, and so on."""
    left, is_known, found = np.arange(len(parents)), np.zeros(first + len(parents), np.bool_), []
    is_known[:first] = True
    while len(left):
        ready = is_known[parents[left]].all(axis=1)
        found.append(left[ready])
        is_known[first + left[ready]] = True
        left = left[~ready]
    return found


def _pairs(corners: FloatArray) -> IntArray:
    return np.array(list(combinations(range(corners.shape[1]), 2)), np.int32)


def _ratios(corners: FloatArray, longest: FloatArray) -> FloatArray:
    """Return the longest edges over the largest ones allowed."""
    one, other = _pairs(corners).T
    edges = corners[:, one] - corners[:, other]
    lengths = np.sqrt(np.einsum("ijk,ijk->ij", edges, edges).max(axis=1))
    with np.errstate(divide="ignore"):
        ratio = lengths / longest
    return np.where(longest > 0.0, np.minimum(ratio, _FARTHEST), _FARTHEST)


class _Division:
    """The arrays of a mesh that is divided, with room for more nodes and cells."""

    def __init__(self, mesh: SimplexMesh) -> None:
        self._old = mesh
        self._counts = np.array([mesh.n_points, mesh.n_cells, 0], np.int64)
        self._points, self._cells = mesh.points.copy(), mesh.cells.copy()
        self._ends = np.zeros((mesh.n_points, 2), np.int32)
        self._owner = np.arange(mesh.n_cells)
        self._flags = tuple(np.zeros(n, np.uint8) for n in (mesh.n_cells, mesh.n_cells))
        self._is_end = np.zeros(mesh.n_points, np.uint8)
        self._table = self._new_table()
        self._samples = _no_samples(mesh.cells.shape[1])

    @property
    def points(self) -> FloatArray:
        """The nodes, the old ones first."""
        return self._points[: self._counts[0]]

    @property
    def n_old(self) -> int:
        """Number of nodes of the given mesh."""
        return self._old.n_points

    @property
    def ends(self) -> IntArray:
        """The ends of the edges in whose middles the nodes are; of old nodes, nothing."""
        return self._ends[: self._counts[0]]

    @property
    def cells(self) -> IntArray:
        """The cells."""
        return self._cells[: self._counts[1]]

    @property
    def owner(self) -> IndexArray:
        """The old cell of each cell."""
        return self._owner[: self._counts[1]].copy()

    @property
    def node_parents(self) -> IntArray:
        """The ends of the edges in whose middles the new nodes are."""
        return self._ends[self._old.n_points : self._counts[0]].copy()

    def least(self, cells: IndexArray) -> FloatArray | float:
        """Return the least value of the samples in cells."""
        return self._samples[4][cells] if len(self._samples[0]) else np.inf

    def place(self, points: FloatArray, values: FloatArray) -> None:
        """Assign samples to the cells that they are in."""
        cells, weights, away = self._old.locator.nearest(points)
        near = away <= 1e-9 * self._old.diagonal
        cells, weights, values = cells[near], weights[near], values[near]
        order = np.argsort(cells, kind="stable")
        cells, n = cells[order], len(cells)
        first = np.full(self._old.n_cells, -1, np.int32)
        following = np.full(n, -1, np.int32)
        starts = np.flatnonzero(np.diff(cells, prepend=-1))
        first[cells[starts]] = starts
        inner = np.flatnonzero(np.diff(cells, append=-1) == 0)
        following[inner] = inner + 1
        least = np.full(self._old.n_cells, np.inf)
        np.minimum.at(least, cells, values[order])
        self._samples = (first, following, weights[order].copy(), values[order].copy(), least)

    def all_within(self, rule: Callable[[IndexArray], FloatArray], max_points: float) -> bool:
        """Divide cells until the rule is at most 1 in all of them; whether that was possible."""
        ratio, new = np.empty(0), np.arange(self._counts[1])
        for _ in range(tuning.MOST_ROUNDS):
            ratio = np.append(ratio, np.zeros(self._counts[1] - len(ratio)))
            ratio[new] = rule(new)
            largest = ratio.max(initial=0.0)
            if largest <= 1.0:
                return True
            if self._counts[0] >= max_points:
                return False
            # Largest first: what is left when there is no more room is all of about one ratio.
            is_wanted = ratio > max(1.0, 0.5 * largest)
            new = self.divide(is_wanted)
        return False

    def divide(self, wanted: BoolArray) -> IndexArray:
        """Divide cells, and others until the mesh is conforming; return the numbers of parts."""
        is_wanted, is_new = self._flags
        is_wanted[:] = 0
        is_wanted[: len(wanted)] = wanted
        is_new[:] = 0
        self._is_end[:] = 0
        while not bisect_cells(
            self._points, self._ends, self._cells, self._owner,
            (*self._flags, self._is_end), self._table, self._samples, self._counts, False,
        ):  # fmt: skip
            self._grow()
        return np.flatnonzero(self._flags[1][: self._counts[1]])

    def _grow(self) -> None:
        """Double the room for nodes, cells and edges."""
        n_points, n_cells = 2 * len(self._points) + 64, 2 * len(self._cells) + 64
        self._points, self._ends = longer(self._points, n_points), longer(self._ends, n_points)
        self._is_end = longer(self._is_end, n_points)
        self._cells, self._owner = longer(self._cells, n_cells), longer(self._owner, n_cells)
        self._flags = tuple(longer(flags, n_cells) for flags in self._flags)
        first, following, weights, values, least = self._samples
        if len(first):
            first, least = longer(first, n_cells), longer(least, n_cells)
            self._samples = first, following, weights, values, least
        self._table = self._new_table()

    def _new_table(self) -> tuple[IndexArray, IntArray]:
        """Return the hash table of all edges that were divided."""
        start = self._old.n_points
        n_slots = 1 << int(2 * (len(self._points) - start) + 128).bit_length()
        table = np.full(n_slots, -1, np.int64), np.zeros(n_slots, np.int32)
        add_edges(self._ends[: self._counts[0]], start, table)
        self._counts[2] = self._counts[0] - start
        return table

    def divided(self, simplices: IntArray) -> tuple[IntArray, IndexArray]:
        """Return facets or edges of the old mesh as they are divided, and the row of each."""
        n = len(simplices)
        counts = np.array([self._counts[0], n, self._counts[2]], np.int64)
        parts, owner = simplices.astype(np.int32).copy(), np.arange(n)
        is_end = np.ones(len(self._points), np.uint8)
        while True:
            flags = np.zeros(len(parts), np.uint8)
            if bisect_cells(
                self._points, self._ends, parts, owner, (flags, flags, is_end),
                self._table, _no_samples(simplices.shape[1]), counts, True,
            ):  # fmt: skip
                return parts[: counts[1]], owner[: counts[1]]
            parts, owner = (longer(rows, 2 * len(rows) + 64) for rows in (parts, owner))

    def mesh(self) -> SimplexMesh:
        """Return the mesh as it is now, with the tags of the old one."""
        old = self._old
        if self._counts[1] == old.n_cells:
            return old
        facets, tags = old.tagged_facets, old.facet_tags
        if facets is not None and tags is not None and old.cell_dim > 1:
            facets, row = self.divided(facets)
            tags = tags[row]
        return SimplexMesh(
            self.points,
            self.cells,
            cell_tags=None if old.cell_tags is None else old.cell_tags[self.owner],
            tagged_facets=facets,
            facet_tags=tags,
            tag_names=old.tag_names,
        )


def longer(rows: npt.NDArray[Any], n: int) -> npt.NDArray[Any]:
    """Return rows followed by zeros, n in all."""
    room = np.zeros((n, *rows.shape[1:]), rows.dtype)
    room[: len(rows)] = rows
    return room


def _no_samples(width: int) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
    nothing = np.empty(0, np.int32)
    return nothing, nothing, np.empty((0, width)), np.empty(0), np.empty(0)
