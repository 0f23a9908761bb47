"""Nodes pushed and pulled until the edges between them have the wanted lengths.

The loop is that of [1]_: Delaunay triangulation, forces along the edges, nodes that left the domain
put back to its boundary.  The force is that of [2]_, which also pulls, falls off for far
neighbours, and was found to reach the same quality in half the steps of the linear one; and the
number of nodes is adapted on the way.

References
----------
.. [1] P.-O. Persson, G. Strang, "A simple mesh generator in MATLAB", SIAM Review 46 (2004)
   329-345.
.. [2] F. J. Bossen, P. S. Heckbert, "A pliant method for anisotropic mesh generation", 5th
   International Meshing Roundtable (1996) 63-74.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize.background import topology
from adaptsize.remeshing._density import MeshEdges, adapted, uncovered
from adaptsize.remeshing._implicit_domain import ImplicitDomain
from adaptsize.remeshing._rejection import Size
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

#: Edges want to be longer than they can by this factor: the pressure drives nodes to the boundary.
_PRESSURE = {2: 1.2, 3: 1.15}
#: Length of a step, in forces over the number of neighbours.  The force changes by up to 2.2 per
#: unit of length, so that this is half of what is stable for nodes that swing against each other.
_STEP = {2: 0.9, 3: 1.2}
#: Nodes are connected anew when one of 100 moved further than this since, in sizes.
_STALE = 0.1
#: No node moves further in one step, in sizes.
_LONGEST = 0.25
#: Nodes are added and removed in each tenth step of the first part.
_ADAPT_EVERY = 10
_ADAPT_SHARE = 0.6
#: A node this near to the boundary is on it, in sizes.
ON_BOUNDARY = 1e-3
#: Cells this deep in the domain at least are part of it, in sizes.
_INSIDE = 1e-3
#: The mean way of a step at which nodes have come to rest, in sizes.
_AT_REST = {2: 2.5e-3, 3: 2.5e-3}


class Relaxed(NamedTuple):
    """Nodes at rest."""

    points: FloatArray
    n_steps: int
    n_triangulations: int
    last_move: float
    """Mean length of the last step, in sizes."""
    at_rest: bool


def triangulate(
    domain: ImplicitDomain, points: FloatArray, phi: FloatArray, h: FloatArray
) -> IntArray:
    """Return the Delaunay cells whose centroids lie in the domain, positive, int32[m, dim + 1].

    Raises
    ------
    ValueError
        If there are too few nodes for a cell.
    """
    from scipy.spatial import Delaunay, QhullError

    try:
        cells = Delaunay(points).simplices.astype(np.int32)
    except (QhullError, ValueError) as error:
        raise ValueError(
            "size must be small enough to put nodes into the domain, got sizes for which "
            f"{len(points)} nodes suffice"
        ) from error
    corners = points[cells]
    longest = np.linalg.norm(np.ptp(corners, axis=1), axis=1)
    inside = domain.depth(phi[cells]).max(axis=1) > longest
    unsure = np.flatnonzero(~inside)
    depth = domain.depth(domain.phi(corners[unsure].mean(axis=1)))
    inside[unsure] = depth > _INSIDE * h[cells[unsure]].mean(axis=1)
    cells = np.ascontiguousarray(cells[inside])
    negative = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]]) < 0.0
    cells[negative, :2] = cells[negative, 1::-1]
    return np.asarray(cells)


def boundary_nodes(cells: IntArray, n_points: int) -> BoolArray:
    """Return which nodes lie on facets of one cell only."""
    facets, cell_facets = topology.facets_of(cells, n_points)
    single = np.bincount(cell_facets.ravel(), minlength=len(facets)) == 1
    on_boundary = np.zeros(n_points, np.bool_)
    on_boundary[facets[single]] = True
    return on_boundary


def relax(
    domain: ImplicitDomain,
    size: Size,
    points: FloatArray,
    probes: FloatArray,
    *,
    n_fixed: int,
    max_iter: int,
    max_nodes: float,
    report: ProgressCallback,
) -> Relaxed:
    """Return the nodes moved, some added and some removed; the first ``n_fixed`` as they are."""
    points = uncovered(domain, size, points, probes)
    adapt_until = int(_ADAPT_SHARE * max_iter)
    connected = None
    n_triangulations, k, mean = 0, 0, np.inf
    at_rest = False
    for k in range(1, max_iter + 1):
        report("moving nodes", k / max_iter)
        h, phi = size(points), domain.phi(points)
        if connected is None or _is_stale(points, connected, h):
            cells = triangulate(domain, points, phi, h)
            edges = topology.edges_of(cells, len(points))
            on_boundary = boundary_nodes(cells, len(points))
            connected = points
            n_triangulations += 1
        if k % _ADAPT_EVERY == 0 and k <= adapt_until:
            mesh = MeshEdges(points, edges, on_boundary, h, n_fixed)
            changed = adapted(domain, size, mesh, probes)
            if changed is not None and len(changed) <= max_nodes:
                points, connected = changed, None
                continue
        move = _forces(points, edges, h)
        move[:n_fixed] = 0.0
        moved = _put_back(domain, points + move, h, on_boundary, n_fixed)
        way = np.linalg.norm(moved - points, axis=1) / h
        points, mean = moved, float(way.mean())
        at_rest = mean < _AT_REST[domain.dim]
        if at_rest and k >= min(adapt_until, 3 * _ADAPT_EVERY):
            break
    return Relaxed(points, k, n_triangulations, mean, at_rest)


def _is_stale(points: FloatArray, connected: FloatArray, h: FloatArray) -> bool:
    way = np.linalg.norm(points - connected, axis=1) / h
    return bool(np.quantile(way, 0.99) > _STALE)


def _forces(points: FloatArray, edges: IntArray, h: FloatArray) -> FloatArray:
    """Return the steps that the forces along the edges ask for, float64[n, dim]."""
    n, dim = points.shape
    i, j = edges.T
    edge = points[i] - points[j]
    length = np.linalg.norm(edge, axis=1)
    wanted = 0.5 * (h[i] + h[j])
    # With as many nodes as there are, edges cannot be shorter or longer on the whole.
    scale = np.sqrt((length @ length) / (wanted @ wanted))
    x4 = (length / (_PRESSURE[dim] * scale * wanted)) ** 4
    force = (1.0 - x4) * np.exp(-x4) * wanted / np.maximum(length, 1e-12 * wanted)
    move = np.empty((n, dim))
    for d in range(dim):
        along = force * edge[:, d]
        move[:, d] = np.bincount(i, along, n) - np.bincount(j, along, n)
    n_neighbours = np.bincount(edges.ravel(), minlength=n)
    move *= (_STEP[dim] / np.maximum(n_neighbours, 1))[:, None]
    way = np.linalg.norm(move, axis=1)
    far = way > _LONGEST * h
    move[far] *= (_LONGEST * h[far] / way[far])[:, None]
    return move


def _put_back(
    domain: ImplicitDomain,
    points: FloatArray,
    h: FloatArray,
    on_boundary: BoolArray,
    n_fixed: int,
) -> FloatArray:
    """Return the nodes with those outside, and those of the boundary, on the boundary."""
    depth = domain.depth(domain.phi(points))
    there = (depth < 0.0) | (on_boundary & (depth < 0.5 * h))
    there[:n_fixed] = False
    points[there], _ = domain.project(points[there], h[there], tolerance=ON_BOUNDARY, max_steps=2)
    return points
