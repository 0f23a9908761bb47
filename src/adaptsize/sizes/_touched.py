"""Which cells of a mesh a point, a curve, a box or a ball touches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_plain_array
from adaptsize.background import SimplexMesh
from adaptsize.sizes._lowering import Nearby, Pieces
from adaptsize.typing import BoolArray, FloatArray, IntArray

# Points within this distance, in diagonals of the mesh, count as inside, and cells whose distances
# from a point differ by less are equally close.
_INSIDE = 1e-9
# Samples of a curve per mean edge length of the cell that it passes.
_SAMPLES_PER_CELL = 4.0
# Cells that are smaller, in diagonals of the mesh, are degenerate and need no denser samples.
_SMALLEST_SPACING = 1e-6


class Touched(NamedTuple):
    """The cells that contain points, or else those that are closest to them."""

    which: npt.NDArray[np.int64]
    """int64[k]: a point of each pair of a point and a cell."""
    cells: IntArray
    """int32[k]"""
    distances: FloatArray
    """float64[n]: distance of each point from the mesh, 0 inside."""


class SourceMesh:
    """A mesh as sources see it.

    On one of many processes it is a part, and a subclass replaces what depends on the whole mesh.
    """

    speaks = True
    """Whether to warn; one process does."""

    def __init__(self, mesh: SimplexMesh | None, shape: tuple[int, int]) -> None:
        self.mesh = mesh
        self.dim, self.cell_dim = shape
        self.points = np.empty((0, self.dim)) if mesh is None else mesh.points
        self.cells = np.empty((0, self.cell_dim + 1), np.int32) if mesh is None else mesh.cells

    @property
    def diagonal(self) -> float:
        """Diagonal of the whole mesh."""
        assert self.mesh is not None
        return self.mesh.diagonal

    def least(self, values: FloatArray) -> FloatArray:
        """Return the smallest of the values that processes have for each of the same items."""
        return values

    def boundary_nodes(self) -> IntArray:
        """Return the nodes on the boundary of the whole mesh."""
        assert self.mesh is not None
        return self.mesh.boundary().nodes

    def every_tag(self, kind: Literal["cell", "facet"]) -> IntArray | None:
        """Return the tags that occur in the whole mesh; None if it has none."""
        tags = None if self.mesh is None else getattr(self.mesh, f"{kind}_tags")
        return None if tags is None else np.unique(tags)

    def tagged_nodes(self, kind: Literal["cell", "facet"], tags: int | Sequence[int]) -> IntArray:
        """Return the nodes of cells or facets with some tags.  Refuse tags that do not occur."""
        name, present = f"{kind}_tags", self.every_tag(kind)
        if present is None:
            raise ValueError(f"tags need a mesh with {name}, which this one does not have")
        wanted = np.atleast_1d(as_plain_array("tags", tags))
        missing = wanted[~np.isin(wanted, present)]
        if len(missing) > 0:
            listed = ", ".join(str(tag) for tag in present)
            raise ValueError(f"tags must be among the {name} {listed}, got {missing[0]}")
        own = None if self.mesh is None else getattr(self.mesh, name)
        if self.mesh is None or own is None:
            return np.empty(0, np.int32)
        rows = self.mesh.cells if kind == "cell" else self.mesh.tagged_facets
        assert rows is not None  # given together with facet_tags
        nodes: IntArray = np.unique(rows[np.isin(own, wanted)])
        return nodes

    def touched(self, points: FloatArray) -> Touched:
        """Return all cells that contain points, or else all that are closest to them."""
        inside = _INSIDE * self.diagonal
        away = np.full(len(points), np.inf)
        if self.mesh is not None:
            away = self.mesh.locator.nearest(points)[2]
        away = self.least(away)
        which, cells = np.empty(0, np.int64), np.empty(0, np.int32)
        if self.mesh is not None:
            which, cells = self.mesh.locator.within(points, away + inside)
        return Touched(which, cells, np.where(away <= inside, 0.0, away))


def as_source_mesh(mesh: SimplexMesh | SourceMesh) -> SourceMesh:
    """Return a mesh as sources see it."""
    return mesh if isinstance(mesh, SourceMesh) else SourceMesh(mesh, (mesh.dim, mesh.cell_dim))


def cell_inside(mesh: SourceMesh, point: FloatArray) -> IntArray:
    """Return the cells that contain a point."""
    at = mesh.touched(point[None])
    cells: IntArray = at.cells[at.distances[at.which] == 0.0]
    return cells


def cells_along(
    mesh: SourceMesh, curve: SimplexMesh
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
        at = mesh.touched(points)
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


def nodes_of(mesh: SourceMesh, cells: IntArray, which: npt.NDArray[np.int64]) -> Nearby:
    """Return the nodes of ``cells[k]``, which belong to the point or piece ``which[k]``."""
    nodes = mesh.cells[cells].ravel()
    return Nearby(np.repeat(which, mesh.cell_dim + 1), nodes, mesh.points[nodes])


def pieces_along(mesh: SourceMesh, curve: SimplexMesh) -> Pieces:
    """Return samples of a curve as pieces of it."""
    cells, segments, along, _ = cells_along(mesh, curve)
    return Pieces(segments, along, along, nodes_of(mesh, cells, np.arange(len(cells))))


def cells_within(mesh: SourceMesh, curve: SimplexMesh) -> IntArray:
    """Return the cells that contain samples of a curve, without cells that are only closest."""
    cells, _, _, inside = cells_along(mesh, curve)
    return cells[inside]


def cells_with_edge_in_box(mesh: SourceMesh, lower: FloatArray, upper: FloatArray) -> IntArray:
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


def cells_with_edge_in_ball(mesh: SourceMesh, centre: FloatArray, radius: float) -> IntArray:
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


def _edges_of_cells(mesh: SourceMesh) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield the first node and the vector of the edges of all cells, one per cell at a time."""
    return _edges(mesh.points[mesh.cells])


def _edges(corners: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    for i, j in combinations(range(corners.shape[1]), 2):
        yield corners[:, i], corners[:, j] - corners[:, i]


def _spacing(mesh: SourceMesh, at: Touched) -> FloatArray:
    """Return the distance between samples at points, given the cells that these touch."""
    corners = mesh.points[mesh.cells[at.cells]]
    lengths = [np.linalg.norm(step, axis=1) for _, step in _edges(corners)]
    widths = np.full(len(at.distances), np.inf)
    np.minimum.at(widths, at.which, np.mean(lengths, axis=0))
    return np.maximum(mesh.least(widths) / _SAMPLES_PER_CELL, _SMALLEST_SPACING * mesh.diagonal)
