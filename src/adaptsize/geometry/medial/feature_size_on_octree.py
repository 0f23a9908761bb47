"""Local feature size on an octree or a mesh, from the medial axis."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize.background import SimplexMesh
from adaptsize.background.topology import components_of
from adaptsize.geometry.distance.closest_points import Boundary, Depths, SurfaceBoundary
from adaptsize.geometry.distance.fast_marching import march_through_mesh
from adaptsize.geometry.distance.orientation import oriented
from adaptsize.geometry.medial.deepest_points import climb
from adaptsize.geometry.medial.points import MedialAxis
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

# Nodes closer to the boundary, in diagonals of the background, are on it.
_ON_BOUNDARY = 1e-12
# The segment between a node and a point of the medial axis is assumed to be in the domain if the
# balls around them, the latter enlarged by this factor, overlap.
_OVERLAP = 1.2
# At outside nodes, the feature size is at least this share of that of their inside neighbours.
_OUTSIDE_SHARE = 0.5


class InnerCells(NamedTuple):
    """The cells that have a node inside, with copies of their nodes outside."""

    mesh: SimplexMesh
    nodes: npt.NDArray[np.int64]
    """Node of the background of which each node is a copy."""
    inside: BoolArray


def feature_size_on_mesh(
    mesh: SimplexMesh,
    boundary: Boundary,
    nodes: Depths,
    medial: MedialAxis,
    crease_angle: float | None,
    report: ProgressCallback,
) -> FloatArray:
    """Return the feature size as `adaptsize.feature_size`, for checked arguments.

    Parameters
    ----------
    mesh : SimplexMesh
    boundary : Boundary
    nodes : Depths
        Depths of the nodes.
    medial : MedialAxis
    crease_angle : float or None
        Smallest turn at a corner of a plane boundary, in degrees; None: edges are ignored.
    report : callable
    """
    inner = inner_cells(mesh, nodes)
    return feature_size_around(mesh, boundary, nodes, medial, inner, crease_angle, report)[0]


def feature_size_around(
    mesh: SimplexMesh,
    boundary: Boundary,
    nodes: Depths,
    medial: MedialAxis,
    inner: InnerCells | None,
    crease_angle: float | None,
    report: ProgressCallback,
) -> tuple[FloatArray, FloatArray]:
    """Return the feature size at the nodes of a mesh, and at those of its cells inside.

    Parameters
    ----------
    mesh, boundary, nodes, medial, crease_angle, report
        As for `feature_size_on_mesh`.
    inner : InnerCells or None
        As returned by `inner_cells`.

    Returns
    -------
    size : float64[mesh.n_points]
        The smallest if a node outside has several copies.
    of_inner : float64[inner.mesh.n_points]
        Empty if ``inner`` is None.
    """
    inside = _is_inside(mesh, nodes)
    seeds = medial.distances.copy()
    centres = _add_deepest(mesh, boundary, nodes.depth, inside, seeds)
    size = np.where(inside, np.inf, seeds + nodes.depth)
    if inner is None:
        return size, np.empty(0)
    marched = march_through_mesh(
        inner.mesh,
        np.where(inner.inside, seeds[inner.nodes], np.inf),
        report=report,
        text="marching from the medial axis",
    )
    _correct(inner, nodes.depth[inner.nodes], medial, centres, boundary, marched)
    marched += nodes.depth[inner.nodes]
    _bound_outside(inner, marched)
    if crease_angle is not None and mesh.dim == 2 and isinstance(boundary, SurfaceBoundary):
        lengths = edge_lengths(boundary.surface, crease_angle)
        if np.isfinite(lengths).any():
            nearest = boundary.surface.locator.nearest(inner.mesh.points)[0]
            along = lengths[nearest] + np.abs(nodes.depth[inner.nodes])
            grown = march_through_mesh(inner.mesh, along, report=report, text="marching from edges")
            marched = np.minimum(marched, grown)
    np.minimum.at(size, inner.nodes, marched)
    return size, marched


def _is_inside(mesh: SimplexMesh, nodes: Depths) -> BoolArray:
    """Return which nodes of a mesh are inside or on the boundary."""
    return np.asarray(nodes.depth >= -_ON_BOUNDARY * mesh.diagonal)


def _correct(
    inner: InnerCells,
    depth: FloatArray,
    medial: MedialAxis,
    centres: FloatArray,
    boundary: Boundary,
    distances: FloatArray,
) -> None:
    """Lower marched distances (In/Out) to those of the nearest points of the medial axis.

    Paths of marching bend in large cells.  A point is used if its straight distance is one within
    the domain: the balls around the node and the point must nearly overlap.
    """
    from scipy.spatial import cKDTree

    points = np.concatenate([medial.points, centres])
    if len(points) == 0:
        return
    radii = np.concatenate([medial.radii, boundary.distance(centres)])
    straight, nearest = cKDTree(points).query(inner.mesh.points)
    joined = straight <= _OVERLAP * radii[nearest] + np.abs(depth)
    distances[joined] = np.minimum(distances, straight)[joined]


def _bound_outside(inner: InnerCells, size: FloatArray) -> None:
    """Bound sizes (In/Out) from below at outside nodes, where distances are differences."""
    edges = inner.mesh.edges
    least = np.full(len(size), np.inf)
    for a, b in ((0, 1), (1, 0)):
        from_inside = inner.inside[edges[:, b]]
        np.minimum.at(least, edges[from_inside, a], size[edges[from_inside, b]])
    outside = ~inner.inside & np.isfinite(least)
    size[outside] = np.maximum(size[outside], _OUTSIDE_SHARE * least[outside])


def inner_cells(mesh: SimplexMesh, nodes: Depths) -> InnerCells | None:
    """Return the cells with an inside node, so that no path leads through outside nodes.

    An outside node is copied for each group of its cells that share inside nodes.  On the two
    sides of a gap there are different copies.

    Parameters
    ----------
    mesh : SimplexMesh
    nodes : Depths
        Depths of the nodes.

    Returns
    -------
    InnerCells or None
        None if no node is inside.
    """
    inside = _is_inside(mesh, nodes)
    if not inside.any():
        return None
    cells = mesh.cells[inside[mesh.cells].any(axis=1)].astype(np.int64)
    numbers = cells.copy()
    corner, copies = _copies(cells, inside)
    used = np.unique(cells[inside[cells]])
    number = np.zeros(mesh.n_points, np.int64)
    number[used] = np.arange(len(used))
    numbers = number[cells]
    numbers.reshape(-1)[corner] = len(used) + copies
    of_copy = np.empty(len(used) + int(copies.max(initial=-1)) + 1, np.int64)
    of_copy[: len(used)] = used
    of_copy[len(used) + copies] = cells.reshape(-1)[corner]
    inner = SimplexMesh(mesh.points[of_copy], numbers)
    return InnerCells(inner, of_copy, inside[of_copy])


def _copies(
    cells: npt.NDArray[np.int64], inside: BoolArray
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the outside corners of cells (flat numbers), and the number of the copy for each."""
    width = cells.shape[1]
    corner = np.flatnonzero(~inside[cells])
    if len(corner) == 0:
        return corner, corner
    cell = corner // width
    outer = cells.reshape(-1)[corner]
    rows, hubs = [], []
    for v in range(width):
        other = cells[cell, v]
        linked = np.flatnonzero(inside[other])
        rows.append(linked)
        hubs.append(outer[linked] * len(inside) + other[linked])
    row, hub = np.concatenate(rows), np.unique(np.concatenate(hubs), return_inverse=True)[1]
    n = len(corner)
    links = np.column_stack([row, n + hub.reshape(-1)])
    return corner, components_of(links, n + int(hub.max()) + 1)[:n]


def _add_deepest(
    mesh: SimplexMesh,
    boundary: Boundary,
    depth: FloatArray,
    inside: BoolArray,
    seeds: FloatArray,
) -> FloatArray:
    """Lower distances (In/Out) around the centres of balls that touch on all sides.

    Returns the centres.  They are next to nodes that are deeper than all neighbours, where no
    point of the axis is near.
    """
    edges = mesh.edges
    highest = np.full(mesh.n_points, -np.inf)
    known = np.isfinite(seeds)
    for a, b in ((0, 1), (1, 0)):
        np.maximum.at(highest, edges[:, a], depth[edges[:, b]])
        known[edges[:, a]] |= np.isfinite(seeds[edges[:, b]])
    deepest = np.flatnonzero(inside & ~known & (depth >= highest))
    if len(deepest) == 0:
        return np.empty((0, mesh.dim))
    ring = edges[np.isin(edges, deepest).any(axis=1)]
    reach = np.zeros(mesh.n_points)
    lengths = np.linalg.norm(mesh.points[ring[:, 0]] - mesh.points[ring[:, 1]], axis=1)
    np.maximum.at(reach, ring, lengths[:, None])
    centres, reached = climb(boundary, mesh.points[deepest], reach[deepest])
    number = np.full(mesh.n_points, -1)
    number[deepest[reached]] = np.arange(len(centres))
    for a, b in ((0, 1), (1, 0)):
        at = number[ring[:, a]]
        own, other = at[at >= 0], ring[at >= 0, b]
        away = np.linalg.norm(mesh.points[other] - centres[own], axis=1)
        np.minimum.at(seeds, other, away)
    away = np.linalg.norm(mesh.points[deepest[reached]] - centres, axis=1)
    seeds[deepest[reached]] = np.minimum(seeds[deepest[reached]], away)
    return centres


def edge_lengths(line: SimplexMesh, crease_angle: float) -> FloatArray:
    """Return for each segment the length of the edge between corners that it belongs to.

    Parameters
    ----------
    line : SimplexMesh
        Segments in the plane.
    crease_angle : float
        Nodes where the line turns by more are corners, in degrees; so are ends and branch points.

    Returns
    -------
    float64[n_cells]
        inf for closed lines without corners.
    """
    whole = oriented(line)[0]
    passed, one, other, turn = _passages(whole)
    smooth = turn <= np.radians(crease_angle)
    edge = components_of(np.column_stack([one[smooth], other[smooth]]), whole.n_cells)
    n = int(edge.max()) + 1
    has_corner = np.zeros(n, np.bool_)
    is_smooth = np.zeros(whole.n_points, np.bool_)
    is_smooth[passed[smooth]] = True
    has_corner[edge[(~is_smooth[whole.cells]).any(axis=1)]] = True
    total = np.bincount(edge, whole.measures, n)
    return np.asarray(np.where(has_corner, total, np.inf)[edge])


def _passages(
    line: SimplexMesh,
) -> tuple[npt.NDArray[np.intp], IntArray, IntArray, FloatArray]:
    """Return the nodes where two segments meet, these segments, and the turning angles."""
    ring_ptr, ring = line.rings
    nodes = np.flatnonzero(np.diff(ring_ptr) == 2)
    one, other = (ring[ring_ptr[nodes] + k] for k in range(2))
    sides = []
    for segment in (one, other):
        far = line.cells[segment].sum(axis=1) - nodes
        sides.append(line.points[far] - line.points[nodes])
    cross = sides[0][:, 0] * sides[1][:, 1] - sides[0][:, 1] * sides[1][:, 0]
    between = np.arctan2(np.abs(cross), (sides[0] * sides[1]).sum(axis=1))
    return nodes, one, other, np.pi - between
