"""Which cells of a mesh a point, a curve, a box or a ball touches, and sizes at their nodes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_plain_array
from adaptsize.background import AnyMesh, SimplexMesh
from adaptsize.background.migration import boundary_facets
from adaptsize.background.partitioned import local_mesh
from adaptsize.typing import BoolArray, FloatArray, IntArray, LongArray

# Points within this distance, in diagonals of the mesh, count as inside, and cells whose distances
# from a point differ by less are equally close.
_INSIDE = 1e-9


class Touched(NamedTuple):
    """The cells that contain points, or else those that are closest to them."""

    which: LongArray
    """int64[k]: a point of each pair of a point and a cell."""
    cells: IntArray
    """int32[k]"""
    distances: FloatArray
    """float64[n]: distance of each point from the mesh, 0 inside."""


def boundary_nodes(mesh: AnyMesh) -> IntArray:
    """Return the nodes on the boundary of the whole mesh; collective."""
    if isinstance(mesh, SimplexMesh):
        return mesh.boundary().nodes
    if mesh.cell_dim == 1:
        raise ValueError("the boundary of segments is not a mesh; cells must have 3 or 4 nodes")
    facets = boundary_facets(mesh)
    if mesh.ranks.allreduce(len(facets), "sum") == 0:
        raise ValueError("the mesh is closed: it has no boundary")
    return np.unique(facets).astype(np.int32)


def tagged_nodes(
    mesh: AnyMesh, kind: Literal["cell", "facet"], tags: int | Sequence[int]
) -> IntArray:
    """Return the nodes of cells or facets with some tags.  Refuse tags that do not occur."""
    name, local = f"{kind}_tags", local_mesh(mesh)
    own = None if local is None else getattr(local, name)
    every = mesh.ranks.allgather(None if own is None else np.unique(own))
    present = [found for found in every if found is not None]
    if not present:
        raise ValueError(f"tags need a mesh with {name}, which this one does not have")
    wanted = np.atleast_1d(as_plain_array("tags", tags))
    missing = wanted[~np.isin(wanted, np.concatenate(present))]
    if len(missing) > 0:
        listed = ", ".join(str(tag) for tag in np.unique(np.concatenate(present)))
        raise ValueError(f"tags must be among the {name} {listed}, got {missing[0]}")
    if local is None or own is None:
        return np.empty(0, np.int32)
    rows = local.cells if kind == "cell" else local.tagged_facets
    assert rows is not None  # given together with facet_tags
    nodes: IntArray = np.unique(rows[np.isin(own, wanted)])
    return nodes


def touched(mesh: AnyMesh, points: FloatArray) -> Touched:
    """Return all cells that contain points, or else all that are closest to them; collective."""
    inside, local = _INSIDE * mesh.diagonal, local_mesh(mesh)
    away = np.full(len(points), np.inf)
    if local is not None:
        away = local.locator.nearest(points)[2]
    away = mesh.ranks.allreduce(away, "min")
    which, cells = np.empty(0, np.int64), np.empty(0, np.int32)
    if local is not None:
        which, cells = local.locator.within(points, away + inside)
    return Touched(which, cells, np.where(away <= inside, 0.0, away))


def cell_inside(mesh: AnyMesh, point: FloatArray) -> IntArray:
    """Return the cells that contain a point."""
    at = touched(mesh, point[None])
    cells: IntArray = at.cells[at.distances[at.which] == 0.0]
    return cells


def cells_along(
    mesh: AnyMesh, curve: SimplexMesh
) -> tuple[IntArray, IntArray, FloatArray, BoolArray]:
    """Return the cells at samples along segments, with a density adapted to the cells.

    Returns
    -------
    cells : int32[k]
        The cells around each sample, or else the closest ones.
    segments : int32[k]
        The segment of the sample.
    along : float64[k]
        Its place, 0 at the first node of the segment to 1 at the second.
    inside : bool[k]
        Whether the sample is in the mesh.
    """
    a, b = curve.points[curve.cells[:, 0]], curve.points[curve.cells[:, 1]]
    lengths = np.linalg.norm(b - a, axis=1)
    segment = np.arange(curve.n_cells, dtype=np.int32)
    lower, upper = np.zeros(curve.n_cells), np.ones(curve.n_cells)
    found = []

    def visit(points: FloatArray, along: FloatArray) -> Touched:
        at = touched(mesh, points)
        inside = at.distances[at.which] == 0.0
        found.append((at.cells, segment[at.which], along[at.which], inside))
        return at

    visit(a, lower)
    visit(b, upper)
    while len(segment) > 0:  # halve the pieces until they are short enough
        middle = 0.5 * (lower + upper)
        at = visit(a[segment] + middle[:, None] * (b - a)[segment], middle)
        # A piece far from the mesh cannot touch it, however small the cells are.
        long = (upper - lower) * lengths[segment] > _spacing(mesh, at) + at.distances
        segment = np.repeat(segment[long], 2)
        lower, upper = (
            np.column_stack([lower[long], middle[long]]).ravel(),
            np.column_stack([middle[long], upper[long]]).ravel(),
        )
    cells, segment, along, inside = (np.concatenate(part) for part in zip(*found, strict=True))
    return cells, segment, along, inside


def nodes_of(mesh: AnyMesh, cells: IntArray, which: LongArray) -> Nearby:
    """Return the nodes of ``cells[k]``, which belong to the point or piece ``which[k]``."""
    nodes = mesh.cells[cells].ravel()
    return Nearby(np.repeat(which, mesh.cell_dim + 1), nodes, mesh.points[nodes])


def pieces_along(mesh: AnyMesh, curve: SimplexMesh) -> Pieces:
    """Return samples of a curve as pieces of it."""
    cells, segments, along, _ = cells_along(mesh, curve)
    return Pieces(segments, along, along, nodes_of(mesh, cells, np.arange(len(cells))))


def cells_within(mesh: AnyMesh, curve: SimplexMesh) -> IntArray:
    """Return the cells that contain samples of a curve, without cells that are only closest."""
    cells, _, _, inside = cells_along(mesh, curve)
    return cells[inside]


def cells_with_edge_in_box(mesh: AnyMesh, lower: FloatArray, upper: FloatArray) -> IntArray:
    """Return the cells with an edge that intersects a box."""
    meets = np.zeros(len(mesh.cells), np.bool_)
    for start, step in _edges_of_cells(mesh):
        first, last = np.zeros(len(start)), np.ones(len(start))
        hit = np.ones(len(start), np.bool_)
        for d in range(mesh.dim):
            moving = step[:, d] != 0.0
            rate = np.where(moving, step[:, d], 1.0)
            one, two = (lower[d] - start[:, d]) / rate, (upper[d] - start[:, d]) / rate
            first = np.where(moving, np.maximum(first, np.minimum(one, two)), first)
            last = np.where(moving, np.minimum(last, np.maximum(one, two)), last)
            hit &= moving | ((start[:, d] >= lower[d]) & (start[:, d] <= upper[d]))
        meets |= hit & (first <= last)
    return np.flatnonzero(meets).astype(np.int32)


def cells_with_edge_in_ball(mesh: AnyMesh, centre: FloatArray, radius: float) -> IntArray:
    """Return the cells with an edge that intersects a ball."""
    meets = np.zeros(len(mesh.cells), np.bool_)
    for start, step in _edges_of_cells(mesh):
        squared = np.maximum((step**2).sum(axis=1), np.finfo(np.float64).tiny)
        along = np.clip(((centre - start) * step).sum(axis=1) / squared, 0.0, 1.0)
        closest = start + along[:, None] * step
        meets |= np.linalg.norm(closest - centre, axis=1) <= radius
    return np.flatnonzero(meets).astype(np.int32)


def box_edges(lower: FloatArray, upper: FloatArray) -> SimplexMesh:
    """Return the 2, 4 or 12 edges of a box as segments."""
    dim = len(lower)
    corner = np.arange(2**dim)
    points = np.where((corner[:, None] >> np.arange(dim)) & 1, upper, lower)
    edges = [(i, i | 1 << d) for i in corner for d in range(dim) if not i >> d & 1]
    return SimplexMesh(points, edges)


def _edges_of_cells(mesh: AnyMesh) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield the first node and the vector of the edges of all cells, one per cell at a time."""
    return _edges(mesh.points[mesh.cells])


def _edges(corners: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    for i, j in combinations(range(corners.shape[1]), 2):
        yield corners[:, i], corners[:, j] - corners[:, i]


def _spacing(mesh: AnyMesh, at: Touched) -> FloatArray:
    """Return the distance between samples at points, given the cells that these touch."""
    corners = mesh.points[mesh.cells[at.cells]]
    lengths = [np.linalg.norm(step, axis=1) for _, step in _edges(corners)]
    widths = np.full(len(at.distances), np.inf)
    np.minimum.at(widths, at.which, np.mean(lengths, axis=0))
    # So many samples of a curve per mean edge length of the cell that it passes.
    spacing: FloatArray = mesh.ranks.allreduce(widths, "min") / 4.0
    # Smaller cells are degenerate and need no denser samples.
    return np.maximum(spacing, 1e-6 * mesh.diagonal)


_Integers = IntArray | LongArray


class Nearby(NamedTuple):
    """Pairs of a point, or a piece of a curve, and a node of a cell that it touches."""

    which: LongArray
    """int64[k]: the point or the piece."""
    nodes: _Integers
    """int[k]: flat index of the node."""
    coordinates: FloatArray
    """float64[k, dim]: those of the node."""


class Pieces(NamedTuple):
    """Pieces of a curve that lie in a cell each, or outside; samples have the length 0."""

    segments: _Integers
    """int[n]"""
    first: FloatArray
    """float64[n]: start of the piece, 0 at the first node of the segment to 1 at the second."""
    last: FloatArray
    """float64[n]: its end."""
    nearby: Nearby


def lower_at_points(
    points: FloatArray, size: FloatArray, nearby: Nearby, g: float, h0: FloatArray
) -> None:
    """Lower ``h0`` (In/Out) to ``size + g |x - points|``."""
    distance = np.linalg.norm(nearby.coordinates - points[nearby.which], axis=1)
    _lower(h0, nearby.nodes, size[nearby.which] + g * distance)


def lower_along(
    curve: SimplexMesh, size: FloatArray, pieces: Pieces, g: float, h0: FloatArray
) -> None:
    """Lower ``h0`` (In/Out) to the least of ``size + g |x - y|`` over y on pieces of a curve."""
    a, b = curve.cells[pieces.segments].T
    shares = (pieces.first, pieces.last)
    start, stop = (
        (1.0 - t)[:, None] * curve.points[a] + t[:, None] * curve.points[b] for t in shares
    )
    at_start, at_stop = (_size_between(t, size[a], size[b]) for t in shares)
    k, nodes, x = pieces.nearby
    requested = _least_from_segment(x, start[k], stop[k], at_start[k], at_stop[k], g)
    _lower(h0, nodes, requested)
    # The closest point of the curve may lie in a cell that is not at the node.
    unique, place = np.unique(nodes, return_index=True)
    at_nearest, distances = curve.locator.interpolate(size, x[place])
    _lower(h0, unique, at_nearest + g * distances)


def _lower(h0: FloatArray, nodes: npt.NDArray[Any], requested: FloatArray) -> None:
    np.minimum.at(h0, np.unravel_index(nodes, h0.shape), requested)


def _size_between(t: FloatArray, at_a: FloatArray, at_b: FloatArray) -> FloatArray:
    """Return sizes between two ends.  An end of share 0 is ignored, because inf would give nan."""
    size: FloatArray = np.where(t < 1.0, at_a, 0.0) * (1.0 - t) + np.where(t > 0.0, at_b, 0.0) * t
    return size


def _least_from_segment(
    x: FloatArray, a: FloatArray, b: FloatArray, at_a: FloatArray, at_b: FloatArray, g: float
) -> FloatArray:
    """Return the minimum of ``s(y) + g |x - y|`` over y on segments with sizes linear along them.

    With the slope m of the size along the segment, the foot of x at t and its height H, the
    minimum is at ``t - m H / sqrt(g^2 - m^2)``, clipped to the segment, or at an end if
    ``|m| >= g``.
    """
    length = np.linalg.norm(b - a, axis=1)
    along = (b - a) / np.where(length > 0.0, length, 1.0)[:, None]
    foot = ((x - a) * along).sum(axis=1)
    height = np.linalg.norm(x - a - foot[:, None] * along, axis=1)
    ends = np.minimum(
        at_a + g * np.linalg.norm(x - a, axis=1), at_b + g * np.linalg.norm(x - b, axis=1)
    )
    # Where a size is inf at one end it is inf up to the other: only the ends count.
    linear = np.isfinite(at_a) & np.isfinite(at_b) & (length > 0.0)
    rise = np.where(linear, at_b, 0.0) - np.where(linear, at_a, 0.0)
    slope = rise / np.where(length > 0.0, length, 1.0)
    linear &= np.abs(slope) < g
    root = np.sqrt(np.where(linear, g**2 - slope**2, 1.0))
    t = np.clip(foot - slope * height / root, 0.0, length)
    between = at_a + slope * t + g * np.hypot(height, t - foot)
    return np.asarray(np.where(linear, np.minimum(between, ends), ends))
