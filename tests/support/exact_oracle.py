"""References for exact limiting on meshes: slow, and without a line of the library's solvers.

In the plane a graph of what sees what, where sight is a walk through the cells
(`mesh_sight`).  The domain is the mesh itself: whatever has no common node is apart.
In space bounds from below (straight lines) and above (paths over a fine graph).  Linear data on
edges and faces: samples of them as sources.
"""

from itertools import combinations, permutations, product
from typing import Any, NamedTuple

import numpy as np
from mesh_sight import fill_sizes, new_scratch, relax_corners, sees
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from adaptsize import SimplexMesh

#: Of the extent: how far a node may be from a line that counts as passing through it.
TOLERANCE = 1e-11

#: Angles of more than half a turn by less than this are taken for straight walls.
STRAIGHT = 1e-10


class PlaneDomain(NamedTuple):
    """A mesh of triangles as `mesh_sight` wants it, and where shortest paths may bend."""

    mesh: Any
    tolerance: float
    corners: np.ndarray
    """int64[c]: nodes of the boundary with more than half a turn inside, or with two sectors."""
    beside: np.ndarray
    """int64[c, 2]: the nodes before and after them on the boundary, -1 if not one each."""


def plane_domain(mesh):
    """Return the domain of a mesh of triangles; cells given twice count once."""
    points, cells = mesh.points, np.unique(np.sort(mesh.cells, axis=1), axis=0).astype(np.int64)
    u, v = points[cells[:, 1]] - points[cells[:, 0]], points[cells[:, 2]] - points[cells[:, 0]]
    turn = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    cells[turn < 0.0] = cells[turn < 0.0][:, [0, 2, 1]]
    ends = np.concatenate([cells[:, [k, (k + 1) % 3]] for k in range(3)])
    keys = ends.min(axis=1) * len(points) + ends.max(axis=1)
    number = np.unique(keys, return_inverse=True)[1].ravel()
    of_edges = _rows(number, np.tile(np.arange(len(cells)), 3))
    of_nodes = _rows(cells.T.ravel(), np.tile(np.arange(len(cells)), 3), len(points))
    extent = float(np.ptp(points, axis=0).max())
    arrays = (points, cells, number.reshape(3, -1).T.copy(), *of_edges, *of_nodes)
    flat = np.abs(turn) <= 1e-12 * extent**2
    corners, beside = _corners(points, cells, ends, np.bincount(number)[number], flat)
    return PlaneDomain(arrays, TOLERANCE * extent, corners, beside)


def _rows(rows, values, n=None):
    """Return compressed rows: where each begins, and the values in order of the rows."""
    counts = np.bincount(rows, minlength=0 if n is None else n)
    return np.concatenate([[0], np.cumsum(counts)]), values[np.argsort(rows, kind="stable")]


def _corners(points, cells, ends, n_cells, flat):
    """Return the nodes at which paths may bend, and their neighbours on the boundary."""
    angles = np.zeros(len(points))
    for k in range(3):
        a, b = (points[cells[:, (k + s) % 3]] - points[cells[:, k]] for s in (1, 2))
        cross = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        angles += np.bincount(
            cells[:, k], np.arctan2(cross, np.einsum("ij,ij->i", a, b)), len(points)
        )
    before, after = np.full((2, len(points)), -1)
    walls = ends[n_cells == 1]
    before[walls[:, 1]], after[walls[:, 0]] = walls[:, 0], walls[:, 1]
    at_walls = np.bincount(walls.ravel(), minlength=len(points))
    is_odd = at_walls > 2
    is_odd[ends[n_cells > 2]] = True
    is_corner = is_odd | ((at_walls > 0) & (angles > np.pi + STRAIGHT))
    is_odd[cells[flat]] = True  # the direction of their edges says nothing
    before[is_odd] = -1
    corners = np.flatnonzero(is_corner)
    return corners, np.column_stack([before, after])[corners]


def plane_sees(domain, pairs):
    """Return for pairs of nodes, int[k, 2], whether the straight lines stay in the domain."""
    scratch = new_scratch()
    return np.array([sees(p, q, domain.mesh, domain.tolerance, scratch) for p, q in pairs])


def plane_sizes(domain, h0, g, nodes=None):
    """Return min over nodes y of h0(y) + g * (length of the shortest path), float64[k].

    At all nodes or at those given.  inf where nothing comes; a node in no cell keeps h0.
    Only starts that could improve on paths along the edges are examined.
    """
    h0 = np.asarray(h0, float)
    least = _edge_sizes(*domain.mesh[:2], h0, g)
    nodes = np.arange(len(h0)) if nodes is None else np.asarray(nodes)
    sources = np.flatnonzero(np.isfinite(h0))
    none, no_pairs = np.empty(0, np.int64), np.empty((0, 2), np.int64)
    place = (domain.mesh, domain.tolerance, g)
    corners, sizes = domain.corners, np.empty(len(domain.corners))
    fill_sizes(corners, least[corners], sources, h0[sources], none, no_pairs, *place, sizes)
    relax_corners(corners, sizes, domain.beside, *place)
    starts = np.concatenate([sources, corners])
    sizes = np.concatenate([h0[sources], sizes])
    result = np.empty(len(nodes))
    fill_sizes(nodes, least[nodes], starts, sizes, corners, domain.beside, *place, result)
    return result


def straight_sizes(points, h0, g, starts=None):
    """Return min over j of h0_j + g |x_i - y_j|, float64[n]: exact if convex, else a lower bound.

    ``starts`` are the places y of h0, the points themselves if not given.
    """
    finite = np.isfinite(h0)
    starts, sizes = (points if starts is None else starts)[finite], h0[finite]
    result = np.empty(len(points))
    step = max(1, 4_000_000 // max(1, len(starts)))
    for first in range(0, len(points), step):
        some = points[first : first + step]
        squares = sum((some[:, a, None] - starts[:, a]) ** 2 for a in range(points.shape[1]))
        result[first : first + step] = (sizes + g * np.sqrt(squares)).min(axis=1, initial=np.inf)
    return result


def graph_sizes(n, i, j, lengths, h0, g):
    """Return the least of h0 and paths over the edges (i, j) of a graph, float64[n]."""
    # One more node, from which each bound is an edge; lengths of 0 would be none.
    finite = np.flatnonzero(np.isfinite(h0))
    least = h0[finite].min(initial=np.inf)
    tiny = 1e-300
    weight = np.concatenate([np.maximum(g * lengths, tiny), np.maximum(h0[finite] - least, tiny)])
    rows, columns = np.concatenate([i, np.full(len(finite), n)]), np.concatenate([j, finite])
    order = np.lexsort((weight, columns, rows))  # the shortest of several edges comes first
    rows, columns, weight = rows[order], columns[order], weight[order]
    is_first = np.ones(len(rows), bool)
    is_first[1:] = (np.diff(rows) != 0) | (np.diff(columns) != 0)
    entries = (weight[is_first], (rows[is_first], columns[is_first]))
    graph = coo_matrix(entries, shape=(n + 1, n + 1)).tocsr()
    return least + dijkstra(graph, directed=True, indices=n)[:n]


def edge_sizes(mesh, h0, g):
    """Return the sizes by paths along the edges of a mesh, float64[n]: an upper bound."""
    return _edge_sizes(mesh.points, mesh.cells, h0, g)


def _edge_sizes(points, cells, h0, g):
    pairs = permutations(range(cells.shape[1]), 2)
    i, j = np.concatenate([cells[:, list(pair)] for pair in pairs]).T
    lengths = np.linalg.norm(points[i] - points[j], axis=1)
    return graph_sizes(len(points), i, j, lengths, h0, g)


def fine_graph_sizes(mesh, h0, g, parts):
    """Return the sizes by paths within the cells from one point of `samples` to the next.

    An upper bound in any domain, which falls to the exact sizes as ``parts`` grows.
    """
    found = samples(mesh, h0, parts)
    sizes = np.where(np.arange(len(found.places)) < mesh.n_points, found.sizes, np.inf)
    a, b = np.array(list(permutations(range(found.in_cells.shape[1]), 2))).T
    i, j = found.in_cells[:, a].ravel(), found.in_cells[:, b].ravel()
    lengths = np.linalg.norm(found.places[i] - found.places[j], axis=1)
    return graph_sizes(len(sizes), i, j, lengths, sizes, g)[: mesh.n_points]


class Samples(NamedTuple):
    """Points on the nodes, edges and faces of a mesh, the nodes first."""

    places: np.ndarray
    """float64[s, dim]"""
    sizes: np.ndarray
    """float64[s]: linear data there, inf on edges and faces with a free node."""
    in_cells: np.ndarray
    """int64[m, p]: which of them are in each cell."""
    weights: np.ndarray
    """int64[p, dim + 1]: where in the cell, in parts, for its nodes in ascending order."""


def samples(mesh, h0, parts, *, inside=False):
    """Return samples that cut every edge in ``parts``, faces in parts^2, and so on.

    Those in the inside of the cells only if wanted: no minimum of linear data is there.
    """
    cells = np.sort(mesh.cells, axis=1)
    width = cells.shape[1]
    places, sizes = [mesh.points], [np.asarray(h0, float)]
    in_cells, weights = [cells], [parts * np.eye(width, dtype=int)]
    n = mesh.n_points
    for k in range(2, width + inside):
        steps = np.array([w for w in product(range(1, parts), repeat=k) if sum(w) == parts], int)
        steps = steps.reshape(-1, k)
        local = np.array(list(combinations(range(width), k)))
        faces, number = np.unique(cells[:, local].reshape(-1, k), axis=0, return_inverse=True)
        corners = mesh.points[faces]
        places.append(np.einsum("sk,fkd->fsd", steps / parts, corners).reshape(-1, mesh.dim))
        sizes.append((sizes[0][faces] @ (steps.T / parts)).ravel())
        own = number.reshape(len(cells), -1, 1) * len(steps) + np.arange(len(steps))
        in_cells.append(n + own.reshape(len(cells), -1))
        for vertices in local:
            weights.append(np.zeros((len(steps), width), int))
            weights[-1][:, vertices] = steps
        n += len(faces) * len(steps)
    return Samples(
        np.concatenate(places), np.concatenate(sizes),
        np.concatenate(in_cells, axis=1), np.concatenate(weights),
    )  # fmt: skip


def refined_triangles(mesh, h0, parts):
    """Return the mesh with every triangle cut in parts^2, the old nodes first, and h0 there."""
    found = samples(mesh, h0, parts, inside=True)
    column = {tuple(w): k for k, w in enumerate(found.weights[:, :2])}
    cells = []
    for i, j in product(range(parts), repeat=2):
        if i + j < parts:
            cells.append([(i, j), (i + 1, j), (i, j + 1)])
        if i + j < parts - 1:
            cells.append([(i + 1, j), (i + 1, j + 1), (i, j + 1)])
    columns = np.array([[column[corner] for corner in cell] for cell in cells])
    return SimplexMesh(found.places, found.in_cells[:, columns].reshape(-1, 3)), found.sizes
