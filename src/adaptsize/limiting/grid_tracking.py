"""Source tracking on Cartesian grids: the limited size straight from where it comes from."""

from __future__ import annotations

import itertools
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels import track_grid as kernels
from adaptsize._kernels.visibility_grid import measure_clearance
from adaptsize.background.padding import buckets_for, pad, strides_of_padded, unpad
from adaptsize.limiting.source_tracking import TrackedSolution
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import CartesianGrid

# Nodes accepted between two reports, which also let Ctrl-C through: about 0.1 s.
_CHUNK = 500_000

# A candidate must be lower by more than rounding to count.
KEEP = 1.0 - 1e-14

# Isolated sources offer themselves to all nodes so many steps around.  With 2000 of them among
# 90 000 nodes of a square 0 or 1 node was wrong, without these offers 6 to 22.
_REACH = 6

# That may cost so many offers per node, of a fifth of the time of accepting it.
_OFFERS = 10

# Most moves of a source over neighbouring segments each time a node is accepted.
POLISH = 5

# Nodes accepted per node of the grid before sources stay where they are; so it comes to an end.
_PATIENCE = 20


class Geometry(NamedTuple):
    """The padded grid as the kernels take it; a grid of one axis as a column of a square one."""

    strides: tuple[int, ...]
    per_stride: tuple[float, ...]
    steps: npt.NDArray[np.int64]
    offsets: FloatArray
    partners: npt.NDArray[np.int64]
    n_axes: int
    n_near: int
    spacing: tuple[float, float, float]
    slope: float


class Tracks(NamedTuple):
    """Where sizes come from, and what may hide it."""

    source: IntArray
    end: IntArray
    clear: npt.NDArray[np.uint8]
    hidden: bool


class Memory(NamedTuple):
    """What tracking knows in the end; arrays are padded."""

    u: FloatArray
    bounds: FloatArray
    geometry: Geometry
    tracks: Tracks


def solve_grid_tracking(
    grid: CartesianGrid,
    h0: FloatArray,
    slope: float,
    *,
    polish: int = POLISH,
    face_sources: bool = True,
    residual: bool,
    report: ProgressCallback,
) -> TrackedSolution:
    r"""Solve the limiting equation on a Cartesian grid by tracking where sizes come from.

    The field is

    .. math:: h(x_k) = \min_y \; h_0(y) + g \, d(x_k, y)

    over the nodes y with finite ``h0`` and, with ``face_sources``, the segments between two
    such nodes that are corners of one box, on which ``h0`` counts as linear.  In the plane
    that is the lower of the two ways to cut each box into two triangles with linear ``h0``.
    :math:`d` is the length of the shortest path in the domain: the cubical complex of
    the active nodes, that is all nodes, edges, faces and boxes of which every corner is
    active.  So sizes go from node to node along the axes exactly as in fast marching, never
    across the diagonal of a box with an inactive corner.

    A diagonal counts if all corners of its face or box have finite ``h0`` or only its own two:
    where data turn a corner it would be a short cut.  In space what lies between three nodes
    does not count; where smooth data begin to be too steep that costs O(a^(4/3)), spacing a.

    Every node hands its source on to its neighbours (8 in the plane, 6 in space), which
    take it if its closed-form value is below their size and the straight line stays in the
    domain.  If it does not, the path bends at the node that hands on, and later may bend at a
    neighbour of that instead.  The same idea is known from vector distance transforms
    [1]_ and any-angle path planning [2]_.

    Parameters
    ----------
    grid : CartesianGrid
    h0 : float64[shape]
        inf allowed; what inactive nodes hold does not matter.
    slope : float
        The gradient limit, one number >= 0.
    polish : int, optional
        Most moves of a source over neighbouring segments, and of a bend over neighbouring
        nodes, each time a node is accepted; 0: none.
    face_sources : bool, optional
        Whether ``h0`` counts as linear between neighbours, or as given at the nodes only.
    residual : bool
        Whether to measure the residual (0 is told otherwise).
    report : callable

    Returns
    -------
    TrackedSolution
        ``h`` has the shape of the grid, inf at inactive nodes.  ``source`` int32[n_points, 1]
        on a line, else int32[n_points, dim], numbers nodes as ``grid.points``; inactive nodes
        and those that nothing reaches have themselves.  ``residual`` is the largest
        (h_i - h_j - g |x_i - x_j|) / max h over the edges.

    Notes
    -----
    *Whole grids.*  Every candidate is one of the formula, so that no size is below the exact
    one by more than rounding.  For sources at isolated nodes sizes are exact but for rare
    nodes that belong to a source of which no neighbour does.  For dense data the foot is
    searched downhill from the sources of the neighbours, which finds the least where
    ``h0`` is smooth; the result is then of second order in the mean.

    *With inactive nodes.*  Sizes are lengths of paths in the domain.  In the plane shortest paths
    bend at nodes, and sizes are exact with the same exceptions; in space they bend
    anywhere on edges, but here at nodes only, which costs up to
    ``g a^2 / 8 (1/r + 1/s)`` at distances r and s from an edge of length a.

    *Everywhere.*  Along every edge h_i - h_j <= g |x_i - x_j| to rounding.  Limiting the result
    again changes nothing with ``face_sources=False``; otherwise kinks of the limited size count
    as linear data the second time, and it changes by O(g a).

    O(n) time; besides ``h0`` and the result (of which the sources are 12 dim bytes per node) 32
    bytes per node, 4 more where neighbours both have finite ``h0``, 1 more with inactive nodes.

    References
    ----------
    .. [1] P.-E. Danielsson, "Euclidean distance mapping", Comput. Graph. Image
       Process. 14 (1980) 227-248.
    .. [2] K. Daniel, A. Nash, S. Koenig, A. Felner, "Theta*: Any-angle path planning
       on grids", J. Artif. Intell. Res. 39 (2010) 533-579.
    """
    bounds = _pad(grid, h0)
    geometry = _geometry(grid, slope)
    u = bounds.copy()
    tracks = _begin(grid, bounds, geometry, face_sources and polish > 0)
    _start(grid, u, bounds, geometry, tracks)
    seeds = np.flatnonzero(tracks.source != np.arange(u.size)).astype(np.int32)
    accepted = accept_all(grid, u, bounds, geometry, tracks, polish, seeds, report)
    memory = Memory(u, bounds, geometry, tracks)
    return finish(grid, memory, slope, accepted, residual=residual)


def finish(
    grid: CartesianGrid, memory: Memory, slope: float, accepted: int, *, residual: bool
) -> TrackedSolution:
    """Return what was found; sources and residual are told when they are asked for."""
    h = _unpad(grid, memory.u)
    return TrackedSolution(
        h,
        accepted,
        partial(_largest_edge_excess, grid, h, slope) if residual else 0.0,
        memory=memory,
        find_sources=partial(_sources, grid, memory.u, memory.bounds, memory.tracks),
        is_convex=not memory.tracks.hidden,
    )


def _pad(grid: CartesianGrid, values: FloatArray) -> FloatArray:
    """Return padded values; those of one axis in the middle of three columns."""
    padded = pad(grid, values)
    if grid.dim > 1:
        return padded
    column = np.full((padded.size, 3), np.nan)
    column[:, 1] = padded
    return column.ravel()


def _unpad(grid: CartesianGrid, padded: FloatArray) -> FloatArray:
    if grid.dim == 1:
        padded = np.ascontiguousarray(padded.reshape(-1, 3)[:, 1])
    return unpad(grid, padded)


def _geometry(grid: CartesianGrid, slope: float) -> Geometry:
    dim = max(grid.dim, 2)
    strides = strides_of_padded(grid) if grid.dim > 1 else (3, 1)
    spacing = np.append(grid.spacing, [grid.spacing[0]] * (dim - grid.dim))
    vectors = [v for v in itertools.product((-1, 0, 1), repeat=dim) if any(v)]
    vectors.sort(key=lambda v: sum(map(abs, v)))
    offsets = np.zeros((len(vectors), 4))
    offsets[:, :dim] = vectors * spacing
    offsets[:, 3] = np.linalg.norm(offsets, axis=1)
    return Geometry(
        strides,
        tuple(1.0 / s for s in strides),
        (np.array(vectors) * strides).sum(axis=1).astype(np.int64),
        offsets,
        _partners(np.array(vectors)),
        2 * dim,
        len(vectors) if dim == 2 else 2 * dim,
        (float(spacing[0]), float(spacing[1]), float(spacing[2]) if dim == 3 else 1.0),
        float(slope),
    )


def _partners(vectors: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return which steps share a box, as `adaptsize._kernels.track_grid.track_grid` asks."""
    m, dim = vectors.shape
    partners = np.full((28 + m, m + 1), -1, np.int64)
    partners[13 + vectors @ (9, 3, 1)[:dim], 0] = np.arange(m)
    partners[27] = [m, *range(m)]
    for step, vector in enumerate(vectors):
        apart = np.abs(vectors - vector).max(axis=1)
        shared = np.flatnonzero(apart == 1)
        partners[28 + step, : len(shared) + 1] = [len(shared), *shared]
    return partners


def _begin(grid: CartesianGrid, bounds: FloatArray, geometry: Geometry, segments: bool) -> Tracks:
    """Return every node as its own source."""
    end = np.full(1, -2, np.int32)
    if segments:
        finite = np.isfinite(bounds)
        has_neighbour = np.zeros(bounds.size, bool)
        for step in geometry.steps[geometry.steps > 0]:
            pair = finite[step:] & finite[:-step]
            has_neighbour[step:] |= pair
            has_neighbour[:-step] |= pair
        if has_neighbour.any():
            end = np.where(has_neighbour, -1, -2).astype(np.int32)
    hidden = grid.active is not None and not grid.active.all()
    tracks = Tracks(
        np.arange(bounds.size, dtype=np.int32),
        end,
        np.zeros(bounds.size if hidden else 1, np.uint8),
        hidden,
    )
    if hidden:
        measure_clearance(bounds, geometry.strides, geometry.steps, tracks.clear)
    return tracks


def _start(
    grid: CartesianGrid,
    u: FloatArray,
    bounds: FloatArray,
    geometry: Geometry,
    tracks: Tracks,
) -> None:
    """Lower the neighbours of all nodes with finite bounds, and of isolated ones more around."""
    strides, per_stride, *_, spacing, slope = geometry
    sources = np.flatnonzero(np.isfinite(bounds)).astype(np.int32)
    reach = reach_of(grid, sources.size)
    if tracks.end.size > 1 or reach < 1:
        least_distance = float(1.0 / np.sqrt((1.0 / grid.spacing**2).sum()))
        kernels.start_grid(u, bounds, *geometry, *tracks, KEEP, least_distance)
        return
    sources = sources[np.argsort(bounds[sources], kind="stable")]
    shape = grid.shape if grid.dim > 1 else (grid.shape[0], 1)
    kernels.offer_around(
        u,
        strides,
        per_stride,
        shape,
        spacing,
        slope,
        sources,
        reach,
        tracks.source,
        tracks.clear,
        tracks.hidden,
        KEEP,
    )


def reach_of(grid: CartesianGrid, n_sources: int) -> int:
    """Return within how many steps so many isolated sources offer themselves."""
    offers = (_OFFERS * grid.n_points / n_sources) ** (1.0 / max(grid.dim, 2))
    return min(_REACH, int((offers - 1.0) / 2.0))


def accept_all(
    grid: CartesianGrid,
    u: FloatArray,
    bounds: FloatArray,
    geometry: Geometry,
    tracks: Tracks,
    polish: int,
    seeds: IntArray,
    report: ProgressCallback,
) -> int:
    """March from the seeds, which are lowered already; return how many nodes were accepted."""
    if seeds.size == 0:
        return 0
    diagonal = float(np.linalg.norm(geometry.spacing[: max(grid.dim, 2)]))
    rises = geometry.slope * float(grid.spacing.min()), geometry.slope * diagonal
    queue = buckets_for(u, seeds, *rises)
    accepted, newly = 0, _CHUNK
    while newly == _CHUNK:
        moves = polish if accepted < _PATIENCE * grid.n_points else 0
        newly = kernels.track_grid(u, bounds, *geometry, *tracks, moves, KEEP, *queue, _CHUNK)
        accepted += newly
        report("limiting the gradient", min(accepted / grid.n_points, 1.0))
    report("limiting the gradient", 1.0)
    return accepted


def _sources(
    grid: CartesianGrid, u: FloatArray, bounds: FloatArray, tracks: Tracks
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the nodes of the source of each node, numbered without border, and their sizes."""
    number = np.full(u.size, -1, np.int32)
    _inside(grid, number)[...] = np.arange(grid.n_points, dtype=np.int32).reshape(grid.shape)
    own = _inside(grid, tracks.source).ravel()
    nodes = np.full((grid.n_points, grid.dim), -1, np.int32)
    sizes = np.full((grid.n_points, grid.dim), np.inf)
    nodes[:, 0], sizes[:, 0] = number[own], u[own]
    if tracks.end.size > 1 and grid.dim > 1:
        end = _inside(grid, tracks.end).ravel()
        long = np.flatnonzero(end >= 0)
        sizes[long, 0], sizes[long, 1] = bounds[own[long]], bounds[end[long]]
        nodes[long, 1] = number[end[long]]
    if tracks.hidden:
        sizes[np.isnan(sizes)] = np.inf
    return nodes, sizes, np.empty((0, 4))


def _inside(grid: CartesianGrid, padded: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return a view of padded values in the shape of the grid."""
    if grid.dim == 1:
        return padded.reshape(-1, 3)[1:-1, 1]
    return padded.reshape([n + 2 for n in grid.shape])[(slice(1, -1),) * grid.dim]


def _largest_edge_excess(grid: CartesianGrid, h: FloatArray, slope: float) -> float:
    """Return the largest h_i - h_j - g |x_i - x_j| over the edges, relative to the largest h."""
    finite = np.where(np.isfinite(h), h, np.nan)
    excess = 0.0
    for axis in range(grid.dim):
        rise = np.abs(np.diff(finite, axis=axis))
        rise = rise[~np.isnan(rise)]
        excess = max(excess, float(rise.max(initial=0.0)) - slope * float(grid.spacing[axis]))
    return excess / float(np.nanmax(finite))
