"""Bounds at the nodes of convex domains, with images of them, and on spheres."""

from collections.abc import Iterator

import numpy as np

from adaptsize._kernels.ordering import fill_tiles
from adaptsize._workers import Workers
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.background._mesh_arrays import bounding_box
from adaptsize.limiting.exact.candidates import ConvexNodes, entries_of_nodes, margin_for
from adaptsize.limiting.exact.field import (
    ComponentSolution,
    Entries,
    ExactField,
    Points,
    field_of_nodes,
    node_entries,
    sorted_entries,
)
from adaptsize.limiting.exact.solution import ExactSolution, SolvedComponent, as_solution
from adaptsize.limiting.periodic import Periodicity
from adaptsize.typing import FloatArray

# Nodes of a tile of a grid, which is a block of the kernels.
_TILES = {1: (32, 1, 1), 2: (4, 8, 1), 3: (4, 4, 2)}


def solve_convex(nodes: ConvexNodes) -> ComponentSolution:
    """Solve for bounds at the nodes of a convex domain."""
    h0, workers = nodes.h0, nodes.workers
    entries = entries_of_nodes(nodes, np.flatnonzero(np.isfinite(h0)).astype(np.int32))
    exact = field_of_nodes(entries, nodes.g, nodes.margin, workers.part(0.0, 0.1))
    h, source = h0.copy(), np.full(len(h0), -1, np.int32)
    for first, points in _slabs_of(nodes.domain):
        last = first + len(points.places)
        part = workers.part(0.1 + 0.9 * first / len(h), 0.1 + 0.9 * last / len(h))
        exact.lower_by_last(points, h[first:last], source[first:last], part)
    return ComponentSolution(h, source, exact)


def _slabs_of(domain: SimplexMesh | CartesianGrid) -> Iterator[tuple[int, Points]]:
    """Yield the nodes in blocks: all nodes of a mesh, a million at a time of a grid."""
    if not isinstance(domain, CartesianGrid):
        order = along_curve(domain.points)
        if domain.dim == 1:
            order = np.argsort(domain.points[:, 0], kind="stable").astype(np.int32)
        yield 0, Points(domain.points, order)
        return
    order, first = np.empty(0, np.int32), 0
    for slab, places in domain.slabs():
        shape = (slab.stop - slab.start, *domain.shape[1:])
        if len(order) != len(places):
            order = np.empty(len(places), np.int32)
            fill_tiles((*shape, 1, 1)[:3], _TILES[domain.dim], order)
        yield first, Points(places, order)
        first += len(places)


def with_images(
    solution: ExactSolution, periodicity: Periodicity, workers: Workers
) -> ExactSolution:
    r"""Return the exact solution of a periodic domain from that of its cell.

    Both the cell and the domain are convex, so that distances are straight and

    .. math:: h(x) = \min_L \min_y h_0(y) + g \, |x - y - L|

    with all translations L of the lattice.  Sources that another one in the cell makes unnecessary
    are unnecessary everywhere, so only images of the others are added.
    """
    (part,) = solution.parts
    found = part.found
    images = _images(found, periodicity)
    if images is None:
        return solution
    field = ExactField(found.field.g, None, found.field.linear, [*found.field.groups, images])
    h, source = found.h.copy(), found.source.copy()
    for first, points in _slabs_of(periodicity.domain):
        span = slice(first, first + len(points.places))
        field.lower_by_last(points, h[span], source[span], workers)
    h = periodicity.least(h)  # rounding may differ between paired nodes
    return as_solution(
        solution.h, [SolvedComponent(slice(None), ComponentSolution(h, source, field))]
    )


def _images(found: ComponentSolution, periodicity: Periodicity) -> Entries | None:
    """Return the images of sources that may lower a size in the cell."""
    every = Entries(found.field.table, np.empty(0), found.field.nodes)
    nodes, places, sizes = every.nodes, every.places, every.sizes
    if len(nodes) == 0:
        return None
    box = np.stack([places.min(axis=1), places.max(axis=1)])
    least, largest, g = sizes.min(axis=1), float(found.h.max()), found.field.g
    domain = periodicity.domain
    if isinstance(domain, CartesianGrid):
        lower, upper = domain.lower, domain.upper
    else:
        lower, upper = domain.points.min(axis=0), domain.points.max(axis=0)
    tables, named = [], []
    for shift in periodicity.shifts():
        gap = np.maximum(0.0, np.maximum(box[0] + shift - upper, lower - box[1] - shift))
        reach = least + g * np.linalg.norm(gap, axis=1) < largest
        if reach.any():
            moved = (places[reach] + shift).reshape(int(reach.sum()), -1)
            tables.append(np.concatenate([moved, sizes[reach]], axis=1))
            named.append(nodes[reach])
    return sorted_entries(np.concatenate(tables), np.concatenate(named)) if tables else None


def limit_points(
    points: FloatArray,
    bounds: FloatArray,
    n: int,
    g: float,
    workers: Workers,
    radius: float | None = None,
) -> ComponentSolution:
    r"""Return :math:`\min_j b_j + g |x_i - x_j|` at the first n points, and the j of each.

    Parameters
    ----------
    points : float64[m, dim]
        dim 2 or 3.
    bounds : float64[m]
        inf where there is none.
    n : int
        Sizes are returned at so many points.
    g : float
    workers : Workers
    radius : float, optional
        Radius of a sphere around 0 on which the points lie, and along which distances run.

    Returns
    -------
    ComponentSolution
        Sizes, bit for bit the same in any order of the points, and ``named``: each j, or i where no
        bound reaches.
    """
    margin = 0.0
    if radius is None:
        lower, upper = bounding_box(points, workers.threads)
        margin = margin_for(float(bounds.min()), g, float(np.linalg.norm(upper - lower)))
    nodes = np.flatnonzero(np.isfinite(bounds)).astype(np.int32)
    entries = node_entries(points[nodes], bounds[nodes], nodes, workers.threads)
    # Sizes inside of surfaces need the code for edges and faces, too: it is not compiled twice.
    linear = radius is None and points.shape[1] == 3
    field = field_of_nodes(entries, g, margin, workers, radius, linear=linear)
    wanted = Points(points[:n], along_curve(points[:n], workers.threads))
    h, source = field.lowered(wanted, bounds[:n], workers)
    return ComponentSolution(h, source, field)
