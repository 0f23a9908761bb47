"""Source tracking: the limited size straight from where it comes from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._kernels import track as kernels
from adaptsize._kernels.march import fill_stars
from adaptsize._kernels.source import BEND
from adaptsize.limiting.domain import (
    clearance_of,
    creases_of,
    flat_boundary,
    is_convex,
    outward_in_plane,
    pieces_of,
    sides_of,
    turns_of,
)
from adaptsize.limiting.fast_marching import solve_edge_based
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.limiting.solution import Solution
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh

# Nodes taken between two reports, which also let Ctrl-C through.
_CHUNK = 50_000

# A candidate must be lower by more than rounding to count.
KEEP = 1.0 - 1e-13

# Most moves of a source over neighbouring edges and triangles each time a node is taken.
POLISH = 5

# Nodes taken per node before sizes go along edges only, which always comes to an end.
_PATIENCE = 20

# Rounds of second chances for nodes between two sources.
_SECOND_CHANCES = 4


Heap: TypeAlias = tuple[FloatArray, IntArray, IntArray, npt.NDArray[np.int64]]


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackedSolution(Solution):
    """Limited sizes and, for each node, where its size comes from."""

    find_sources: Callable[[], tuple[IntArray, FloatArray, FloatArray]]
    """Returns the sources, the sizes at their nodes, and where paths bend."""
    is_convex: bool = False
    """Whether no straight line leaves the domain."""

    @cached_property
    def _sources(self) -> tuple[IntArray, FloatArray, FloatArray]:
        return self.find_sources()

    @property
    def source(self) -> IntArray:
        """int32[n, dim]: the nodes of the source, ascending, -1 where there are fewer.

        i itself where node i keeps ``h0``.
        """
        return self._sources[0]

    @property
    def source_sizes(self) -> FloatArray:
        """float64[n, dim]: the sizes at them, inf where there are fewer."""
        return self._sources[1]

    @property
    def bent(self) -> FloatArray:
        """float64[n, 4] if paths bend on edges, else no rows.

        For the nodes of such paths a point of space and the size there, from which the size comes
        over the edge that is the source; nan for others.
        """
        return self._sources[2]


class Work(NamedTuple):
    """What `track` changes."""

    axes: tuple[int, ...]
    state: FloatArray
    source: IntArray
    heap: Heap


class _Surroundings(NamedTuple):
    """What is around each node (see `track`)."""

    nbr_ptr: npt.NDArray[np.int64]
    nbr: IntArray
    cells: IntArray
    ring_ptr: npt.NDArray[np.int64]
    ring: IntArray
    crease_ptr: IntArray
    crease: IntArray
    patch: IntArray
    clearance: FloatArray
    outward: FloatArray


class Tracks(NamedTuple):
    """What tracking knows in the end."""

    axes: tuple[int, ...]
    state: FloatArray

    near: _Surroundings
    convex: bool
    dense: bool
    """Whether two neighbours have finite bounds."""
    source: IntArray
    """As in `track`: with `BEND` for creases."""
    bent: FloatArray


class _Obstacles(NamedTuple):
    """What the kernels need to know of a domain that is not convex (see `_Surroundings`)."""

    crease_ptr: IntArray
    crease: IntArray
    patch: IntArray
    clearance: FloatArray
    outward: FloatArray


_NO_OBSTACLES = _Obstacles(
    np.zeros(1, np.int32),
    np.empty(0, np.int32),
    np.full(1, -1, np.int32),
    np.empty(0),
    np.zeros((1, 3)),
)


def solve_source_tracking(
    mesh: SimplexMesh,
    h0: FloatArray,
    slope: float,
    *,
    domain_is_convex: bool | Literal["auto"] = "auto",
    polish: int = POLISH,
    face_sources: bool = True,
    residual: bool,
    report: ProgressCallback,
) -> TrackedSolution:
    r"""Solve the limiting equation by tracking where sizes come from.

    Every node carries a source (a node, an edge, or in space a triangle of the mesh) and hands
    it on along edges of the mesh.  The neighbour k takes it if

    .. math:: \min_{y \in S} h_0(y) + g |x_k - y|

    is below its size and it sees the minimum y; the distance is exact however far away y is.
    Where the straight line leaves the domain the path bends at the node that
    hands on, or, in space, along a reflex edge of the boundary there.  The same
    idea is known from vector distance transforms [1]_ and any-angle path planning [2]_.

    Parameters
    ----------
    mesh : SimplexMesh
        ``cell_dim == dim``: segments on a line, triangles in the plane, tetrahedra.
    h0 : float64[n]
        Bounds, inf allowed, finite at one node at least.
    slope : float
        The gradient limit, one number >= 0.
    domain_is_convex : bool or "auto", optional
        True trusts the caller and looks for no obstacles; then sizes of a domain that is
        not convex come out too small.  False looks for obstacles in any case.
    polish : int, optional
        Most moves over neighbouring edges and triangles in search of a better
        source each time a node is taken; 0: none.
    face_sources : bool, optional
        Whether ``h0`` counts as linear on edges and triangles, or as given at the
        nodes only.
    residual : bool
        Whether to spend one more sweep on the residual (0 is told otherwise).
    report : callable

    Returns
    -------
    TrackedSolution
        ``residual`` is the largest (h_i - h_j - g |x_i - x_j|) / h_i over the edges.

    Notes
    -----
    *Convex domain.*  Every candidate is admissible, so that no size is below the exact
    one by more than rounding; sizes are exact for sources at nodes, but for rare nodes
    (none in two-source problems on Delaunay meshes of up to 640k random points; a few
    in 100 000 with thousands of sources) whose source is handed on by no neighbour.

    *Other domains.*  Sizes are lengths of paths inside the domain.  In the plane they were exact
    to rounding for point sources around slits, stars, mazes and holes of 40 corners: a path is
    pulled straight, wound around what hides a source, and slides along the boundary.  In space
    they were exact behind a wall, over two parallel edges; a path over an edge is straight once
    it is turned about that edge.  Over a second edge at an angle to the first the size is
    right to second order (1 % of the nodes behind a window with 30 000 nodes, by .5 % at most).
    Sight is cut short by
    certificates (see visibility.py), which may overlook a hole that lies between two
    neighbouring nodes and their common source, narrower than the edge a that joins them:
    sizes behind it are then too small by the detour, of the order of g a^2 / R at distance R.

    *Everywhere.*  Along every edge h_i - h_j <= g |x_i - x_j| to rounding.  Cells without measure,
    folds and facets of three cells are obstacles to sight, not to paths along edges.
    Limiting the result again changes nothing with ``face_sources=False``; otherwise
    kinks of the limited size count as linear data the second time, and it changes by O(g a).

    O(n log n) time; about 60 bytes per node and ``4 k (k - 1)`` per cell of k nodes, 4 k more
    where sight is limited.

    References
    ----------
    .. [1] P.-E. Danielsson, "Euclidean distance mapping", Comput. Graph. Image
       Process. 14 (1980) 227-248.
    .. [2] K. Daniel, A. Nash, S. Koenig, A. Felner, "Theta*: Any-angle path planning
       on grids", J. Artif. Intell. Res. 39 (2010) 533-579.
    """
    if mesh.dim == 1:
        return _along_line(mesh, h0, slope, residual, report)
    n = mesh.n_points
    work = begin(mesh, h0)
    dense = kernels.start_from_cells(
        work.axes, mesh.cells, h0, slope, face_sources, KEEP, work.state, work.source
    )
    kernels.push_lowered(work.state, h0, *work.heap)
    taken, tracks = 0, None
    if work.heap[3][0] > 0:
        many = 2 * np.count_nonzero(np.isfinite(h0)) > n
        convex, sight = _shape(mesh, domain_is_convex, near_sources=bool(many))
        moves = polish if dense and face_sources else 0
        # To resume the work the cells around nodes are needed.
        rings = residual or not convex or (mesh.dim == 3 and moves > 0)
        bent = np.empty((n if mesh.dim == 3 and not convex else 1, 7))
        near = _surroundings(mesh, rings, sight)
        tracks = Tracks(work.axes, work.state, near, convex, bool(dense), work.source, bent)
        contested = np.zeros(n, np.uint8)
        taken = follow(work, tracks, h0, slope, moves, contested, report)
        report("limiting the gradient", 1.0)
    return finish(mesh, work, tracks, h0, slope, taken, residual=residual)


def follow(
    work: Work,
    tracks: Tracks,
    h0: FloatArray,
    slope: float,
    moves: int,
    contested: npt.NDArray[np.uint8],
    report: ProgressCallback,
) -> int:
    """Track (In/Out: work, tracks.bent, contested) until the heap is empty; return nodes taken."""
    n, dim = len(h0), len(work.axes)
    hidden = not tracks.convex
    refused = np.full((n + 1 if hidden else 1, dim), -1, np.int32)
    known = (work.source, refused, tracks.bent)
    problem = (work.state, work.axes, *tracks.near, h0, slope, *known, *work.heap, contested)
    taken, chances = 0, _SECOND_CHANCES
    while work.heap[3][0] > 0:
        straight = taken < _PATIENCE * n
        taken += kernels.track(*problem, hidden, straight, moves, KEEP, _CHUNK)
        report("limiting the gradient", min(taken / n, 1.0))
        if work.heap[3][0] == 0 and straight and chances > 0 and contested.any():
            chances -= 1
            alone = _alone(n, dim) if hidden else work.source
            kernels.offer_once_more(*problem, hidden, KEEP, alone)
    return taken


def finish(
    mesh: SimplexMesh,
    work: Work,
    tracks: Tracks | None,
    h0: FloatArray,
    slope: float,
    taken: int,
    *,
    residual: bool,
) -> TrackedSolution:
    """Return what was found; sources and residual are told apart when they are asked for."""
    h = work.state[: mesh.n_points, mesh.dim].copy()
    bent = np.empty((1, 7)) if tracks is None else tracks.bent
    near = None if tracks is None else tracks.near
    return TrackedSolution(
        h,
        taken,
        partial(_residual_of, mesh, near, h, slope) if residual else 0.0,
        memory=tracks,
        find_sources=partial(_source_sizes, mesh.points, h, h0, slope, work.source, bent),
        is_convex=tracks is None or tracks.convex,
    )


def _residual_of(
    mesh: SimplexMesh, near: _Surroundings | None, h: FloatArray, slope: float
) -> float:
    """Return the largest (h_i - h_j - g |x_i - x_j|) / h_i over the edges."""
    if near is None:
        near = _surroundings(mesh, False, _NO_OBSTACLES)
    work = begin(mesh, h)
    return float(kernels.largest_edge_excess(work.state, work.axes, near.nbr_ptr, near.nbr, slope))


def _along_line(
    mesh: SimplexMesh, h0: FloatArray, slope: float, residual: bool, report: ProgressCallback
) -> TrackedSolution:
    """Solve on segments of a line, where sizes along edges are exact; sources are the nodes."""
    limit = Slope(np.array([slope]))
    found = solve_edge_based(mesh, h0, limit, residual=residual, report=report)
    return as_tracked(found)


def as_tracked(found: Solution) -> TrackedSolution:
    """Return sizes along edges as tracked ones: the source of a node of a line is itself."""

    def find_sources() -> tuple[IntArray, FloatArray, FloatArray]:
        source = np.arange(len(found.h), dtype=np.int32)[:, None]
        return source, found.h[:, None].copy(), np.empty((0, 4))

    return TrackedSolution(
        found.h,
        found.iterations,
        found.missed_by,
        memory=found.memory,
        find_sources=find_sources,
    )


def begin(mesh: SimplexMesh, h0: FloatArray) -> Work:
    """Return sizes h0, every node its own source, and an empty heap."""
    n = mesh.n_points
    state = np.empty((n + 1, mesh.dim + 1))  # the last row is work space of the kernels
    state[:n, : mesh.dim] = mesh.points
    state[:n, mesh.dim] = h0
    return Work((0,) * mesh.dim, state, _alone(n, mesh.dim), empty_heap(n))


def empty_heap(n: int) -> Heap:
    """Return an empty heap for n nodes (see heap.py)."""
    return np.empty(n), np.empty(n, np.int32), np.full(n, -1, np.int32), np.zeros(1, np.int64)


def _alone(n: int, dim: int) -> IntArray:
    """Return every node as its own source."""
    source = np.full((n, dim), -1, np.int32)
    source[:, 0] = np.arange(n)
    return source


def _source_sizes(
    points: FloatArray,
    h: FloatArray,
    h0: FloatArray,
    slope: float,
    source: IntArray,
    bent: FloatArray,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the sources, the sizes at their nodes, and ``bent`` without what is not used.

    Creases become plain edges; ``bent`` is nan for other sources.
    """
    sizes = np.where(source < 0, np.inf, h0[source])
    alone = np.flatnonzero((source[:, 1:] < 0).all(axis=1))
    sizes[alone, 0] = h[source[alone, 0]]
    along_crease = source[:, -1] == BEND
    if not along_crease.any():
        return source, sizes, np.empty((0, 4))
    bent = np.where(along_crease[:, None], bent[:, :4], np.nan)
    ends, come_from = points[source[along_crease, :2]], bent[along_crease]
    away = np.linalg.norm(ends - come_from[:, None, :3], axis=2)
    sizes[along_crease, :2] = come_from[:, 3:] + slope * away
    source = source.copy()
    source[along_crease, -1] = -1
    return source, sizes, bent


def _shape(
    mesh: SimplexMesh, domain_is_convex: bool | Literal["auto"], *, near_sources: bool
) -> tuple[bool, _Obstacles]:
    """Return whether the domain is convex, and if not where straight lines are in danger."""
    if domain_is_convex is True:
        return True, _NO_OBSTACLES
    boundary = flat_boundary(mesh)
    turns = turns_of(mesh.points, boundary)
    if domain_is_convex == "auto" and is_convex(mesh.points, boundary, turns):
        return True, _NO_OBSTACLES
    pieces = pieces_of(mesh.n_points, boundary, turns)
    # Sources on the boundary are farther away than it: then the bounds are of no use.
    clearance = clearance_of(mesh.points, boundary.facets) if near_sources else np.empty(0)
    if mesh.dim == 3:
        creases = creases_of(mesh.n_points, turns)
        return False, _Obstacles(*creases, pieces, clearance, _NO_OBSTACLES.outward)
    outward = outward_in_plane(mesh.n_points, mesh.points, boundary)
    return False, _Obstacles(*sides_of(mesh.n_points, boundary), pieces, clearance, outward)


def _surroundings(mesh: SimplexMesh, need_rings: bool, obstacles: _Obstacles) -> _Surroundings:
    """Return the neighbours of the nodes, and the cells around them if needed."""
    n = mesh.n_points
    ring_ptr = np.empty(n + 1, np.int64)
    star = np.empty((mesh.cells.size, mesh.dim), np.int32)
    ring = np.empty(mesh.cells.size if need_rings else 0, np.int32)
    fill_stars(mesh.cells, ring_ptr, star, ring)
    nbr = star.reshape(-1)
    nbr_ptr = np.empty(n + 1, np.int64)
    kernels.compact_neighbours((0,) * mesh.dim, ring_ptr, nbr, np.full(n, -1, np.int32), nbr_ptr)
    return _Surroundings(nbr_ptr, nbr, mesh.cells, ring_ptr, ring, *obstacles)
