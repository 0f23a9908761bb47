"""Which nodes of a mesh or grid a source acts on, and the sizes that it requests there.

A source acts on the nodes of the cells (of a grid, the boxes) that it touches.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_plain_array
from adaptsize.background import AnyMesh, CartesianGrid, SimplexMesh
from adaptsize.background.interpolation import places_of
from adaptsize.background.migration import boundary_facets
from adaptsize.background.partitioned import local_mesh
from adaptsize.sizes import _on_grid
from adaptsize.typing import BoolArray, FloatArray, IntArray, LongArray

# Points within this distance, in diagonals of the mesh, count as inside, and cells whose distances
# from a point differ by less are equally close.
_INSIDE = 1e-9
# So many samples of a curve per spacing of a grid, or mean edge length of the cell that it passes.
_SAMPLES = 4.0

Nodes: TypeAlias = npt.NDArray[np.integer]
_Domain: TypeAlias = AnyMesh | CartesianGrid


class Touched(NamedTuple):
    """The nodes of the cells that contain points, or else of those that are closest to them."""

    which: LongArray
    """int64[k]: a point of each pair of a point and a node."""
    nodes: Nodes
    """int[k]"""
    distances: FloatArray
    """float64[n_points]: of each point, 0 inside."""
    spacing: FloatArray
    """float64[n_points]: of samples of a curve at each point."""

    @property
    def inside(self) -> BoolArray:
        """Which pairs are of points inside, bool[k]."""
        return np.asarray(self.distances[self.which] == 0.0)


def boundary_nodes(mesh: _Domain) -> Nodes:
    """Return the nodes on the boundary of the whole mesh or grid; collective."""
    if isinstance(mesh, CartesianGrid):
        return _on_grid.boundary_nodes(mesh)
    if isinstance(mesh, SimplexMesh):
        return mesh.boundary().nodes
    if mesh.cell_dim == 1:
        raise ValueError("the boundary of segments is not a mesh; cells must have 3 or 4 nodes")
    facets = boundary_facets(mesh)
    if mesh.ranks.allreduce(len(facets), "sum") == 0:
        raise ValueError("the mesh is closed: it has no boundary")
    return np.unique(facets).astype(np.int32)


def tagged_nodes(
    mesh: _Domain, kind: Literal["cell", "facet"], tags: int | Sequence[int]
) -> IntArray:
    """Return the nodes of cells or facets with some tags.  Refuse tags that do not occur."""
    if isinstance(mesh, CartesianGrid):
        raise ValueError(f"tags need a SimplexMesh, a grid has none; got {mesh!r}")
    name, local = f"{kind}_tags", local_mesh(mesh)
    own = None if local is None else getattr(local, name)
    every = mesh.ranks.allgather(None if own is None else np.unique(own))
    present = [found for found in every if found is not None]
    if not present:
        what = "region" if kind == "cell" else "facet"
        raise ValueError(f"tags must be {what} tags of the mesh, which has none ({name} is None)")
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


def touched(domain: _Domain, points: FloatArray) -> Touched:
    """Return the nodes of all cells that contain points, or else are closest; collective."""
    if isinstance(domain, CartesianGrid):
        away = np.linalg.norm(points - np.clip(points, domain.lower, domain.upper), axis=1)
        spacing = np.full(len(points), float(domain.spacing.min()) / _SAMPLES)
        return Touched(*_on_grid.nodes_around(domain, points), away, spacing)
    inside, local = _INSIDE * domain.diagonal, local_mesh(domain)
    away = np.full(len(points), np.inf)
    if local is not None:
        away = local.locator.nearest(points)[2]
    away = domain.ranks.allreduce(away, "min")
    which, cells = np.empty(0, np.int64), np.empty(0, np.int32)
    if local is not None:
        which, cells = local.locator.within(points, away + inside)
    corners = domain.points[domain.cells[cells]]
    lengths = [np.linalg.norm(step, axis=1) for _, step in _edges(corners)]
    widths = np.full(len(points), np.inf)
    np.minimum.at(widths, which, np.mean(lengths, axis=0))
    spacing = domain.ranks.allreduce(widths, "min") / _SAMPLES
    return Touched(
        np.repeat(which, domain.cell_dim + 1),
        domain.cells[cells].ravel(),
        np.where(away <= inside, 0.0, away),
        # Smaller cells are degenerate and need no denser samples.
        np.maximum(spacing, 1e-6 * domain.diagonal),
    )


def samples_along(
    domain: _Domain, curve: SimplexMesh
) -> tuple[Nodes, LongArray, FloatArray, BoolArray]:
    """Return the nodes that samples along segments touch, with a density adapted to the cells.

    Returns
    -------
    nodes : int[k]
    segments : int64[k]
    along : float64[k]
        The position of the sample on its segment, from 0 to 1.
    inside : bool[k]
        False if the sample lies outside the domain and the cell is only the closest one.
    """
    a, b = curve.points[curve.cells[:, 0]], curve.points[curve.cells[:, 1]]
    lengths = np.linalg.norm(b - a, axis=1)
    segment = np.arange(curve.n_cells)
    lower, upper = np.zeros(curve.n_cells), np.ones(curve.n_cells)
    found = []

    def visit(points: FloatArray, along: FloatArray) -> Touched:
        at = touched(domain, points)
        found.append((at.nodes, segment[at.which], along[at.which], at.inside))
        return at

    visit(a, lower)
    visit(b, upper)
    while len(segment) > 0:  # halve the pieces until they are short enough
        middle = 0.5 * (lower + upper)
        at = visit(a[segment] + middle[:, None] * (b - a)[segment], middle)
        # A piece far from the domain cannot touch it, however small the cells are.
        long = (upper - lower) * lengths[segment] > at.spacing + at.distances
        segment = np.repeat(segment[long], 2)
        lower, upper = (
            np.column_stack([lower[long], middle[long]]).ravel(),
            np.column_stack([middle[long], upper[long]]).ravel(),
        )
    nodes, segment, along, inside = (np.concatenate(part) for part in zip(*found, strict=True))
    return nodes, segment, along, inside


def nodes_beside_box(domain: _Domain, lower: FloatArray, upper: FloatArray) -> Nodes:
    """Return the nodes of the cells that meet a box; collective."""
    if isinstance(domain, CartesianGrid):
        return _on_grid.nodes_beside_ball(domain, lower, upper, 0.0)
    at = touched(domain, 0.5 * (lower + upper)[None])
    nodes, _, _, inside = samples_along(domain, _box_edges(lower, upper))
    meeting = domain.cells[_have_edge_in_box(domain, lower, upper)]
    return np.concatenate([meeting.ravel(), at.nodes[at.inside], nodes[inside]])


def nodes_beside_ball(domain: _Domain, centre: FloatArray, radius: float) -> Nodes:
    """Return the nodes of the cells that meet a ball; collective."""
    if isinstance(domain, CartesianGrid):
        return _on_grid.nodes_beside_ball(domain, centre, centre, radius)
    reach, local = radius + _INSIDE * domain.diagonal, local_mesh(domain)
    if local is None:
        return np.empty(0, np.int32)
    return local.cells[local.locator.within(centre[None], reach)[1]].ravel()


def _have_edge_in_box(mesh: AnyMesh, lower: FloatArray, upper: FloatArray) -> BoolArray:
    """Return which cells have an edge that intersects a box."""
    meets = np.zeros(len(mesh.cells), np.bool_)
    for start, step in _edges(mesh.points[mesh.cells]):
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
    return meets


def _box_edges(lower: FloatArray, upper: FloatArray) -> SimplexMesh:
    """Return the 2, 4 or 12 edges of a box as segments."""
    dim = len(lower)
    corner = np.arange(2**dim)
    points = np.where((corner[:, None] >> np.arange(dim)) & 1, upper, lower)
    edges = [(i, i | 1 << d) for i in corner for d in range(dim) if not i >> d & 1]
    return SimplexMesh(points, edges)


def _edges(corners: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    for i, j in combinations(range(corners.shape[1]), 2):
        yield corners[:, i], corners[:, j] - corners[:, i]


def lower(h0: FloatArray, nodes: Nodes, requested: npt.ArrayLike) -> None:
    """Lower ``h0`` (In/Out) at nodes, which may be repeated, to the requested sizes there."""
    np.minimum.at(h0, np.unravel_index(nodes, h0.shape), requested)


def lower_along(
    domain: _Domain, curve: SimplexMesh, size: FloatArray, g: float, h0: FloatArray
) -> None:
    """Lower ``h0`` (In/Out) to ``size + g |x - y|`` from points y of a curve."""
    nodes, segment, along, _ = samples_along(domain, curve)
    (a, b), place = curve.cells[segment].T, places_of(domain)
    samples = (1.0 - along)[:, None] * curve.points[a] + along[:, None] * curve.points[b]
    # An end of share 0 is ignored, because inf would give nan.
    at_samples = np.where(along < 1.0, size[a], 0.0) * (1.0 - along)
    at_samples += np.where(along > 0.0, size[b], 0.0) * along
    away = np.linalg.norm(place(nodes) - samples, axis=1)
    lower(h0, nodes, at_samples + g * away)
    # The closest point of the curve may be in another cell, or between two samples.
    unique = np.unique(nodes)
    at_nearest, distances = curve.locator.interpolate(size, place(unique))
    lower(h0, unique, at_nearest + g * distances)
