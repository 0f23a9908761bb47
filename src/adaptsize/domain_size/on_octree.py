"""Sizes in the part of an octree that lies in a domain."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from adaptsize._causes import CURVATURE, WIDTH, Cause
from adaptsize._size_function import SizeFunction
from adaptsize._size_report import NONE, SizeReport
from adaptsize.background import Octree, SimplexMesh
from adaptsize.background.interpolation import cell_gradients
from adaptsize.background.reshaping import parent_errors, refined
from adaptsize.background.topology import components_of
from adaptsize.domain_size.bounds import Bounds
from adaptsize.domain_size.request import Request
from adaptsize.geometry.distance.closest_points import Depths
from adaptsize.typing import BoolArray, FloatArray, IndexArray, LongArray

#: Tolerance for sizes interpolated between the nodes, relative to the size.
TOLERANCE = 0.05
# No leaf is longer than this many sizes, in the plane and in space.
_EDGE_OVER_SIZE = {2: 1.0, 3: 1.2}
# Leaves are refined if the error on their parents is above this many tolerances.  The error on
# them is at most about half of that.  This is repeated until none is above the second number.
_ON_PARENT = {2: (0.8, 1.2), 3: (1.4, 1.8)}
# Outside, sizes are at least this share of those at the boundary next to them.
_LEAST_SHARE = 0.5


class InnerCells(NamedTuple):
    """The cells that have a node inside, with copies of their nodes outside.

    An outside node is copied for each group of its cells that share inside nodes.  On the two
    sides of a gap there are different copies, so that no path leads through outside nodes.

    Parameters
    ----------
    mesh : SimplexMesh
    nodes : LongArray
        Node of the background of which each node is a copy.
    inside : BoolArray
    """

    mesh: SimplexMesh
    nodes: LongArray
    inside: BoolArray


class Shape(NamedTuple):
    """A domain as seen on an octree."""

    tree: Octree
    nodes: Depths
    """Depths of the nodes."""
    inner: InnerCells
    """The cells with an inside node."""
    width: FloatArray
    """Width of the domain at the closest points of the nodes of the octree, inf where the domain is
    not next to them."""
    curvature: FloatArray
    """Of the closest point of the boundary, at the nodes of the inner cells; nan far from it."""


def inner_cells(mesh: SimplexMesh, inside: BoolArray) -> InnerCells:
    """Return the cells with an inside node, of which there is at least one."""
    cells = mesh.cells[inside[mesh.cells].any(axis=1)].astype(np.int64)
    used = np.unique(cells[inside[cells]])
    number = np.zeros(mesh.n_points, np.int64)
    number[used] = np.arange(len(used))
    numbers = number[cells]
    corner, copies = _copies(cells, inside)
    numbers.reshape(-1)[corner] = len(used) + copies
    first = np.unique(copies, return_index=True)[1]
    nodes = np.concatenate([used, cells.reshape(-1)[corner[first]]])
    return InnerCells(SimplexMesh(mesh.points[nodes], numbers), nodes, inside[nodes])


def _copies(cells: LongArray, inside: BoolArray) -> tuple[IndexArray, IndexArray]:
    """Return the outside corners of cells (flat numbers), and the number of the copy for each."""
    corner = np.flatnonzero(~inside[cells])
    around = cells[corner // cells.shape[1]]
    # Corners at the same outside node are linked through each inside node that they share.
    row, column = np.nonzero(inside[around])
    shared = cells.reshape(-1)[corner[row]] * len(inside) + around[row, column]
    names, hub = np.unique(shared, return_inverse=True)
    links = np.column_stack([row, len(corner) + hub.reshape(-1)])
    return corner, components_of(links, len(corner) + len(names))[: len(corner)]


def limited_on_octree(
    shape: Shape, limits: tuple[float, float], request: Request
) -> tuple[FloatArray, SizeReport]:
    """Return the limited sizes at the nodes of the inner cells, and the report on the octree."""
    inner = shape.inner
    bounds: dict[Cause, FloatArray] = {}
    if request.per_radian > 0.0:
        bounds[CURVATURE] = _size_of_curvature(shape, request.per_radian, request.g)
    if request.across > 0.0:
        bounds[WIDTH] = shape.width[inner.nodes] / request.across
    bounds |= {cause: h[inner.nodes] for cause, h in request.external(shape.tree).items()}
    weights = _measures_inside(inner.mesh, -shape.nodes.depth[inner.nodes])
    limited = Bounds(inner.mesh, bounds, limits, weights).limited(request)
    h = _extrapolated(inner, limited.h, request.g)
    return h, _on_tree(shape, h, limited.report)


def _extrapolated(inner: InnerCells, h: FloatArray, g: float) -> FloatArray:
    """Return sizes that are lower at outside nodes where they fall towards the boundary.

    Limited sizes grow outwards from the boundary.  Interpolated between an inside and an outside
    node, they would be too large on the boundary.  They are replaced by those that the gradient
    in the cells that are completely inside gives, if these are smaller.
    """
    mesh, inside = inner.mesh, inner.inside
    whole = mesh.cells[inside[mesh.cells].all(axis=1)]
    gradient, counts = np.zeros(mesh.points.shape), np.zeros(mesh.n_points)
    slopes = cell_gradients(mesh, h)[inside[mesh.cells].all(axis=1)]
    for column in whole.T:
        np.add.at(gradient, column, slopes)
        np.add.at(counts, column, 1.0)
    gradient /= np.maximum(counts, 1.0)[:, None]
    total, links = np.zeros(mesh.n_points), np.zeros(mesh.n_points)
    for i, o in (mesh.edges.T, mesh.edges[:, ::-1].T):
        used = (counts[i] > 0.0) & ~inside[o]
        step = mesh.points[o[used]] - mesh.points[i[used]]
        change = np.einsum("nd,nd->n", gradient[i[used]], step)
        away = g * np.linalg.norm(step, axis=1)
        np.add.at(total, o[used], h[i[used]] + np.clip(change, -away, away))
        np.add.at(links, o[used], 1.0)
    known = links > 0.0
    result = h.copy()
    result[known] = np.minimum(h[known], (total / np.maximum(links, 1.0))[known])
    return np.maximum(result, _LEAST_SHARE * h)


def _size_of_curvature(shape: Shape, per_radian: float, g: float) -> FloatArray:
    """Return sizes that are 1 / (K kappa) on the boundary, interpolated between the nodes.

    With the slope m of these sizes along the boundary, a limited size has the slope
    sqrt(g^2 - m^2) across it.  Inside, the slope g is used instead, and limiting corrects sizes
    that are too large.  Sizes that grow from the end of a larger curvature have the slope g along
    the boundary and none across it.
    """
    kappa, depth = shape.curvature, shape.nodes.depth[shape.inner.nodes]
    with np.errstate(divide="ignore"):
        size = np.where(kappa > 0.0, 1.0 / (per_radian * kappa), np.inf)
    known = np.isfinite(size)
    m = _slopes(shape.inner.mesh, size)
    slope = np.where(depth < 0.0, np.sqrt(np.maximum(g**2 - m**2, 0.0)), g)
    return np.where(known, np.maximum(size + slope * depth, _LEAST_SHARE * size), np.inf)


def _slopes(mesh: SimplexMesh, values: FloatArray) -> FloatArray:
    """Return the mean length of the gradients in the cells at each node whose values are finite."""
    finite = np.isfinite(values[mesh.cells]).all(axis=1)
    slopes, counts = np.zeros(mesh.n_points), np.zeros(mesh.n_points)
    lengths = np.linalg.norm(cell_gradients(mesh, values)[finite], axis=1)
    np.add.at(slopes, mesh.cells[finite], lengths[:, None])
    np.add.at(counts, mesh.cells[finite], 1.0)
    return np.asarray(slopes / np.maximum(counts, 1.0))


def _measures_inside(mesh: SimplexMesh, phi: FloatArray) -> FloatArray:
    """Return the area or volume of the domain around each node, from its signed distance."""
    at = phi[mesh.cells]
    below = np.maximum(-at, 0.0).sum(axis=1)
    share = below / np.maximum(np.abs(at).sum(axis=1), 1e-300)
    n = mesh.cells.shape[1]
    measures = np.zeros(mesh.n_points)
    np.add.at(measures, mesh.cells, (share * mesh.measures / n)[:, None])
    return measures


def _on_tree(shape: Shape, h: FloatArray, report: SizeReport) -> SizeReport:
    """Return the report at the nodes of the octree, from that at the nodes of the inner cells."""
    bounds = {name: at_nodes(shape, bound) for name, bound in report.bounds.items()}
    cause = np.full(shape.tree.n_points, NONE, np.int8)
    largest_first = np.argsort(-h, kind="stable")
    cause[shape.inner.nodes[largest_first]] = report.cause[largest_first]
    cause.flags.writeable = False
    return replace(report, background=shape.tree, bounds=bounds, cause=cause)


def size_on_octree(shape: Shape, h: FloatArray, report: SizeReport) -> SizeFunction:
    """Return the size function on the octree.  Outside, nodes get the size of the nearest node."""
    from scipy.spatial import cKDTree

    tree, inner = shape.tree, shape.inner
    values = at_nodes(shape, h)
    unknown = np.flatnonzero(np.isinf(values))
    if len(unknown):
        nearest = cKDTree(inner.mesh.points).query(tree.points[unknown])[1]
        values[unknown] = values[inner.nodes[nearest]]
    return SizeFunction(tree, values, report=report)


def at_nodes(shape: Shape, h: FloatArray) -> FloatArray:
    """Return sizes at the nodes of the octree; inf where the domain is not next to them."""
    values = np.full(shape.tree.n_points, np.inf)
    np.minimum.at(values, shape.inner.nodes, h)
    return values


def adapted(shape: Shape, h: FloatArray, hmin: float, request: Request) -> Octree | None:
    """Return an octree that is finer where sizes need it, or None if they need it nowhere."""
    tree = shape.tree
    longest, (wanted, largest) = _EDGE_OVER_SIZE[tree.dim], _ON_PARENT[tree.dim]
    requested = np.maximum(_requested(shape, h, hmin, request), 1e-6 * tree.diagonal)
    edges = tree.leaf_sizes.max(axis=1)
    least = requested[tree.leaf_corners].min(axis=1)
    with np.errstate(divide="ignore"):  # inf outside
        times = np.ceil(np.log2(edges / (longest * least)))
    times = np.clip(times, 0, 3).astype(np.int64)
    # Shorter leaves hold the tolerance for sizes with any gradient that is usual.
    can = (times == 0) & (edges > 0.2 * least)
    error = np.where(can, leaf_errors(shape, h), 0.0)
    if not times.any() and error.max() <= largest * TOLERANCE:
        return None
    times[error > wanted * TOLERANCE] = 1
    finite = np.where(np.isfinite(requested), requested, tree.diagonal)

    def within(centres: FloatArray, sizes: FloatArray) -> BoolArray:
        nodes, weights, _ = tree.locator.weights(centres)
        size = (weights * finite[nodes]).sum(axis=1)
        depth = (weights * shape.nodes.depth[nodes]).sum(axis=1)
        inside = depth > -0.5 * np.linalg.norm(sizes, axis=1)
        return np.asarray(inside & (sizes.max(axis=1) > longest * size))

    return refined(tree, times, within)


def _requested(shape: Shape, h: FloatArray, hmin: float, request: Request) -> FloatArray:
    """Return the sizes that leaves must have, at the nodes of the octree, inf outside."""
    inner, depth = shape.inner, shape.nodes.depth
    # Outside, sizes are extrapolated; those at the boundary count.
    requested, grown = at_nodes(shape, h), request.g * np.maximum(-depth, 0.0)
    if request.across > 0.0:
        requested = np.minimum(requested, np.maximum(shape.width / request.across, hmin))
    requested += grown
    if request.per_radian > 0.0:
        with np.errstate(divide="ignore", invalid="ignore"):
            radius = np.where(shape.curvature > 0.0, 1.0 / shape.curvature, np.inf)
        longest = np.maximum(0.5 * radius, hmin)
        np.minimum.at(requested, inner.nodes, longest)
    return requested


def leaf_errors(shape: Shape, h: FloatArray) -> FloatArray:
    """Return relative errors of interpolation on the parents of the leaves."""
    values = at_nodes(shape, h)
    known = np.isfinite(values) & (shape.nodes.depth >= 0.0)
    near = np.isfinite(values)
    return parent_errors(shape.tree, np.where(near, values, 1.0), known, near)
