"""Coarse jagged solids, and the sizes in them by a graph of what sees what.

Slow, without a line of the library's solvers.  Two points of a solid see each other if no facet is
strictly between them and the middle between them is not outside.
"""

import math
from itertools import product
from typing import NamedTuple

import numba
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from solids_of_cubes import solid_of_cubes

from adaptsize import SimplexMesh

_NIL = 1e-10


def jagged_solid(seed, most=14, jitter=0.18):
    """Return tetrahedra of 4 to ``most`` unit cubes with common faces, all of their nodes moved.

    Every edge of the boundary is one of two facets.
    """
    rng = np.random.default_rng(seed)
    while True:
        mesh = _grown(rng, most)
        points = mesh.points + rng.uniform(-jitter, jitter, mesh.points.shape)
        edges = points[mesh.cells[:, 1:]] - points[mesh.cells[:, :1]]
        before = mesh.points[mesh.cells[:, 1:]] - mesh.points[mesh.cells[:, :1]]
        facets = np.sort(_facets(mesh), axis=1)
        sides = np.concatenate([facets[:, [0, 1]], facets[:, [0, 2]], facets[:, [1, 2]]])
        twice = np.unique(sides, axis=0, return_counts=True)[1] == 2
        upright = np.linalg.det(edges) * np.linalg.det(before) > 0.02
        if upright.all() and twice.all():
            return SimplexMesh(points, mesh.cells)


def _grown(rng, most):
    shape = rng.integers(2, 5, 3)
    kept = np.zeros(shape, bool)
    at = rng.integers(0, shape)
    kept[tuple(at)] = True
    wanted = min(int(rng.integers(4, most + 1)), max(4, int(0.7 * shape.prod())))
    while kept.sum() < wanted:
        cubes = np.argwhere(kept)
        at = cubes[rng.integers(len(cubes))].copy()
        at[rng.integers(3)] += rng.choice([-1, 1])
        if ((at >= 0) & (at < shape)).all():
            kept[tuple(at)] = True
    chosen = {tuple(cube) for cube in np.argwhere(kept)}

    def keep(middle):
        return np.array([tuple(m) in chosen for m in np.floor(middle).astype(int)])

    return solid_of_cubes(keep, tuple(shape), 0)


def random_bounds(seed, n):
    """Return bounds at about a third of n nodes, inf at the others."""
    rng = np.random.default_rng(seed)
    h0 = np.where(rng.random(n) < rng.uniform(0.05, 0.5), rng.uniform(0.05, 2.0, n), np.inf)
    h0[rng.integers(n)] = 0.1
    return h0


# Points are three numbers: with arrays, this takes five times as long to compile and to run.


@numba.njit(cache=True)
def _at(points, i):
    return points[i, 0], points[i, 1], points[i, 2]


@numba.njit(cache=True)
def _from(p, q):
    return q[0] - p[0], q[1] - p[1], q[2] - p[2]


@numba.njit(cache=True)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True)
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True)
def _along(p, t, a):
    return p[0] + t * a[0], p[1] + t * a[1], p[2] + t * a[2]


@numba.njit(cache=True)
def _distance(p, q):
    a = _from(p, q)
    return math.sqrt(_dot(a, a))


@numba.njit(cache=True)
def _solid_angle(facets, x):
    total = 0.0
    for f in range(len(facets)):
        a, b, c = (
            _from(x, _at(facets[f], 0)),
            _from(x, _at(facets[f], 1)),
            _from(x, _at(facets[f], 2)),
        )
        p, q, r = math.sqrt(_dot(a, a)), math.sqrt(_dot(b, b)), math.sqrt(_dot(c, c))
        volume = _dot(a, _cross(b, c))
        other = p * q * r + _dot(a, b) * r + _dot(b, c) * p + _dot(c, a) * q
        if abs(volume) > 1e-13 or other > 1e-11:
            total += 2.0 * math.atan2(volume, other)
    return total / (4.0 * math.pi)


@numba.njit(cache=True)
def _sees(facets, normals, p, q):
    for f in range(len(facets)):
        o, normal = _at(facets[f], 0), _at(normals, f)
        at_p, at_q = _dot(normal, _from(o, p)), _dot(normal, _from(o, q))
        if not ((at_p > _NIL and at_q < -_NIL) or (at_p < -_NIL and at_q > _NIL)):
            continue
        y = _along(p, at_p / (at_p - at_q), _from(p, q))
        outside = False
        for v in range(3):
            a, b = _at(facets[f], v), _at(facets[f], (v + 1) % 3)
            outside |= _dot(normal, _cross(_from(a, b), _from(a, y))) < -_NIL
        if not outside:
            return False
    return abs(_solid_angle(facets, _along(p, 0.5, _from(p, q)))) > 0.02


@numba.njit(cache=True)
def _in_line(ends, e):
    """Return the start, the direction and the length of an edge."""
    start = _at(ends[e], 0)
    edge = _from(start, _at(ends[e], 1))
    length = math.sqrt(_dot(edge, edge))
    return start, (edge[0] / length, edge[1] / length, edge[2] / length), length


@numba.njit(cache=True)
def _place(x, start, along):
    """Return how far along a line a point is, and its distance from the line."""
    s = _dot(_from(start, x), along)
    return s, _distance(_along(start, s, along), x)


@numba.njit(cache=True)
def _over_one_edge(facets, normals, ends, x, q, size, g, best):
    """Return the least of ``best`` and the sizes of paths from q over one edge to x."""
    for e in range(len(ends)):
        start, along, length = _in_line(ends, e)
        s, d = _place(x, start, along)
        f, r = _place(q, start, along)
        if d < 1e-9 or r < 1e-9:
            continue
        t = (f * d + s * r) / (d + r)
        value = size + g * math.hypot(s - f, d + r)
        if 0.0 < t < length and value < best:
            y = _along(start, t, along)
            if _sees(facets, normals, q, y) and _sees(facets, normals, y, x):
                best = value
    return best


@numba.njit(cache=True)
def _one_bend(facets, normals, ends, points, h0, g, best):
    for i in range(len(points)):
        for j in range(len(points)):
            x, q = _at(points, i), _at(points, j)
            if h0[j] + g * _distance(x, q) < best[i]:
                best[i] = _over_one_edge(facets, normals, ends, x, q, h0[j], g, best[i])


@numba.njit(cache=True)
def _visible(facets, normals, points, least, sizes, g):
    """Return float64[n, n]: distances, inf if hidden or of no use to the second point."""
    result = np.full((len(points), len(points)), np.inf)
    for i in range(len(points)):
        for j in range(len(points)):
            p, q = _at(points, i), _at(points, j)
            length = _distance(p, q)
            if least[i] + g * length < sizes[j] and _sees(facets, normals, p, q):
                result[i, j] = length
    return result


class Solid(NamedTuple):
    """The boundary of a solid, and points where paths may bend."""

    facets: np.ndarray
    """float64[f, 3, 3]"""
    normals: np.ndarray
    ends: np.ndarray
    """float64[r, 2, 3]: of the reflex edges."""
    every: np.ndarray
    """float64[n + k, 3]: the nodes, then points on reflex edges."""
    edges: list
    """For each of these the reflex edges that it lies on."""


def _solid(mesh, parts):
    facets = mesh.points[_facets(mesh)]
    normals = np.cross(facets[:, 1] - facets[:, 0], facets[:, 2] - facets[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    named = reflex_edges(mesh)
    ends = mesh.points[named]
    share = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, parts) / parts)  # denser at the ends
    between = (ends[:, :1] + share[:, None] * (ends[:, 1:] - ends[:, :1])).reshape(-1, 3)
    edges = [[] for _ in range(mesh.n_points)]
    for e, nodes in enumerate(named):
        for node in nodes:
            edges[node].append(e)
    edges += [[e] for e in range(len(named)) for _ in share]
    return Solid(facets, normals, ends, np.concatenate([mesh.points, between]), edges)


def oracle(mesh, h0, g, parts=8):
    """Return the sizes by straight paths, over one bend, and over more bends.

    The first two are exact for bounds at nodes.  The last ones are not too small: the shortest
    paths over ``parts - 1`` points on each reflex edge, whose bends are then moved along these
    edges until no path gets shorter.
    """
    solid, points = _solid(mesh, parts), mesh.points
    facets, normals, ends, every, _ = solid
    bounds = np.concatenate([h0, np.full(len(every) - len(points), np.inf)])
    lowest = (h0[None] + g * np.linalg.norm(every[:, None] - points[None], axis=2)).min(axis=1)
    length = _visible(facets, normals, every, lowest, np.full(len(every), np.inf), g)
    straight = (h0[:, None] + g * length[: len(points), : len(points)]).min(axis=0)
    straight = np.minimum(straight, h0)
    bent = straight.copy()
    _one_bend(facets, normals, ends, points, h0, g, bent)
    n = len(every)
    graph = np.full((n + 1, n + 1), np.inf)
    graph[:n, :n] = np.where(length > 0.0, g * length, np.inf)
    finite = np.flatnonzero(np.isfinite(bounds))
    least = bounds[finite].min()
    graph[n, finite] = np.maximum(bounds[finite] - least, 1e-300)
    # A dense graph would lose the shortest links; SciPy takes indices of 32 bits.
    links = tuple(k.astype(np.int32) for k in np.nonzero(np.isfinite(graph)))
    graph = coo_array((graph[links], links), shape=graph.shape).tocsr()
    far, before = dijkstra(graph, directed=True, indices=n, return_predecessors=True)
    far = least + far[: len(points)]
    for i in np.flatnonzero(far < straight):
        chain = [i]
        while before[chain[-1]] != n:
            chain.append(before[chain[-1]])
        far[i] = min(far[i], h0[chain[-1]] + g * _shortened(solid, chain))
    return straight, bent, np.minimum(far, bent)


def _shortened(solid, chain):
    """Return the length of a path of points, bends moved along their edges; inf if hidden."""
    best = np.inf
    for edges in product(*(solid.edges[k] for k in chain[1:-1])):
        ends = solid.ends[np.array(edges, int)]
        best = min(best, _tightened(solid.facets, solid.normals, solid.every[chain], ends))
    return best


@numba.njit(cache=True)
def _tightened(facets, normals, path, ends):
    """Move the bends of a path along edges until it is shortest; return its length."""
    for _ in range(200):
        moved = 0.0
        for k in range(1, len(path) - 1):
            start, along, long = _in_line(ends, k - 1)
            s, d = _place(_at(path, k - 1), start, along)
            f, r = _place(_at(path, k + 1), start, along)
            t = s if d + r == 0.0 else (s * r + f * d) / (d + r)
            new = _along(start, min(max(t, 0.0), long), along)
            moved = max(moved, _distance(new, _at(path, k)))
            path[k, 0], path[k, 1], path[k, 2] = new
        if moved < 1e-14:
            break
    length = 0.0
    for k in range(1, len(path)):
        p, q = _at(path, k - 1), _at(path, k)
        piece = _distance(p, q)
        if piece > 1e-9 and not _sees(facets, normals, p, q):
            return math.inf
        length += piece
    return length


def reflex_edges(mesh):
    """Return the edges of the boundary with more than half a turn inside, int64[r, 2]."""
    facets, inside = _facets(mesh), {}
    for f in facets:
        for v in range(3):
            inside.setdefault(tuple(sorted((f[v], f[(v + 1) % 3]))), []).append((f, f[(v + 2) % 3]))
    found = []
    for edge, ((first, _), (_, apex)) in ((e, s) for e, s in inside.items() if len(s) == 2):
        a, b, c = mesh.points[first]
        # The normals of facets point outwards.
        if np.cross(b - a, c - a) @ (mesh.points[apex] - a) > 1e-12:
            found.append(edge)
    return np.array(found, int).reshape(-1, 2)


def _facets(mesh):
    walls = mesh.boundary()
    return walls.nodes[walls.mesh.cells]
