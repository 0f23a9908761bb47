"""Insertion and removal of nodes by edge lengths, and nodes at corners and edges of the domain."""

from typing import NamedTuple

import numpy as np

from adaptsize.remeshing.distmesh import tuning
from adaptsize.remeshing.distmesh.implicit_domain import BoundaryFacets, DistanceDomain
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray, LongArray


class Triangulation(NamedTuple):
    """The last triangulation."""

    points: FloatArray
    """Positions of the nodes at that time."""
    edges: IntArray
    skin: BoundaryFacets


def adapted(
    domain: DistanceDomain, points: FloatArray, h: FloatArray, mesh: Triangulation, n_fixed: int
) -> FloatArray | None:
    """Return the nodes with some removed and some added at the end, or None without changes."""
    edges, on_boundary = mesh.edges, mesh.skin.nodes
    i, j = edges.T
    ratio = np.linalg.norm(points[i] - points[j], axis=1) / (0.5 * (h[i] + h[j]))
    short, long = _short_and_long(ratio, len(points), points.shape[1])
    candidates = np.concatenate([short, long])
    middles = 0.5 * (points[i[candidates]] + points[j[candidates]])
    length = ratio[candidates] * 0.5 * (h[i[candidates]] + h[j[candidates]])
    depth = domain.depths(middles, length)
    to_wall = domain.to_walls(middles, depth)
    both = on_boundary[i[candidates]] & on_boundary[j[candidates]]
    # Edges across a narrow part are short because the part is narrow.
    across = both & (to_wall > tuning.ALONG * length)
    inside = depth > -tuning.ALONG * length
    removed = _chosen(edges[short[~across[: len(short)]]], on_boundary, n_fixed)
    is_new = inside[len(short) :]
    new = spread(middles[len(short) :][is_new], h[i[long[is_new]]], 1.0)
    changed = uncovered(domain, np.concatenate([np.delete(points, removed, axis=0), new]))
    return None if len(removed) == 0 and len(changed) == len(points) else changed


def _short_and_long(ratio: FloatArray, n_points: int, dim: int) -> tuple[IndexArray, IndexArray]:
    """Return which edges lose a node, and which get one, the worst first.

    If edges are too long on average, nodes are missing, and the longest edges are split too.
    """
    order = np.argsort(ratio)
    sorted_ratio = ratio[order]
    n_short = int(np.searchsorted(sorted_ratio, tuning.TOO_SHORT))
    n_long = len(ratio) - int(np.searchsorted(sorted_ratio, tuning.TOO_LONG))
    surplus = n_points * (float(np.median(ratio)) ** dim - 1.0)
    limits = np.searchsorted(sorted_ratio, tuning.SHORT_AND_LONG)
    n_short = max(n_short, min(int(-surplus), int(limits[0])))
    n_long = max(n_long, min(int(surplus), len(ratio) - int(limits[1])))
    return order[:n_short], order[::-1][:n_long]


def _chosen(short: IntArray, on_boundary: BoolArray, n_fixed: int) -> LongArray:
    """Return one node of each short edge, such that no two of them share a short edge."""
    gone: list[int] = []
    touched: set[int] = set()
    for a, b in short.tolist():
        if a in touched or b in touched:
            continue
        touched.update((a, b))
        # Prefer interior nodes to boundary nodes, and later nodes because the first are fixed.
        first, last = (a, b) if a < b else (b, a)
        node = first if on_boundary[last] and not on_boundary[first] else last
        if node >= n_fixed:
            gone.append(node)
    return np.array(gone, np.int64)


def uncovered(domain: DistanceDomain, points: FloatArray) -> FloatArray:
    """Return the nodes, and new nodes at probes of the domain that are far from all nodes."""
    from scipy.spatial import cKDTree

    probes = domain.probes
    h = domain.size(probes)
    far = cKDTree(points).query(probes)[0] > tuning.FAR_FROM_NODES * h
    new = spread(probes[far], h[far], tuning.FAR_FROM_NODES)
    return np.concatenate([points, new])


def spread(points: FloatArray, h: FloatArray, factor: float) -> FloatArray:
    """Return points chosen greedily, at least ``factor * h`` from those already chosen."""
    from scipy.spatial import cKDTree

    tree = cKDTree(points)
    free = np.ones(len(points), np.bool_)
    taken = []
    for i in range(len(points)):
        if free[i]:
            taken.append(i)
            free[tree.query_ball_point(points[i], factor * h[i])] = False
    return points[taken]


def far_from(domain: DistanceDomain, fixed: FloatArray, points: FloatArray) -> FloatArray:
    """Return the points that are not too near to the fixed ones."""
    from scipy.spatial import cKDTree

    return np.asarray(
        points[cKDTree(fixed).query(points)[0] > tuning.TOO_SHORT * domain.size(points)]
    )


def with_corners(
    domain: DistanceDomain, points: FloatArray, h: FloatArray, skin_edges: IntArray, n_fixed: int
) -> tuple[FloatArray | None, int]:
    """Return the nodes with some moved to corners, or added there.

    In the plane these nodes are fixed afterwards.  In space they lie on an edge and may move
    along it.  The forces push them out of the domain, and the projection puts them back onto
    the edge, if it is convex.

    Parameters
    ----------
    skin_edges : int32[m, 2]
        Edges of the boundary of the mesh.

    Returns
    -------
    points : float64[n, dim] or None
        None if all corners have nodes already.
    n_fixed : int
    """
    from scipy.spatial import cKDTree

    corners, sizes = _between(domain, points, h, skin_edges)
    corners = spread(corners, sizes, tuning.BRING_TO_CORNER)
    way, node = cKDTree(points).query(corners)
    near = way < tuning.BRING_TO_CORNER * h[node]
    free = near & (node >= n_fixed)
    used, first = np.unique(node[free], return_index=True)
    moved, new = corners[free][first], corners[~near]
    if domain.dim == 3:
        if len(new) == 0 and (way < tuning.AT_CORNER * h[node])[free].all():
            return None, n_fixed
        points = points.copy()
        points[used] = moved
        return np.concatenate([points, new]), n_fixed
    if len(used) + len(new) == 0:
        return None, n_fixed
    rest = np.delete(points, np.append(np.arange(n_fixed), used), axis=0)
    fixed = np.concatenate([points[:n_fixed], moved, new])
    return np.concatenate([fixed, rest]), len(fixed)


def _between(
    domain: DistanceDomain, points: FloatArray, h: FloatArray, pairs: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return where the tangents at two neighbours meet on the boundary, and sizes there."""
    a, b = points[pairs[:, 0]], points[pairs[:, 1]]
    size = 0.5 * (h[pairs[:, 0]] + h[pairs[:, 1]])
    for turn in range(tuning.ROUNDS_OF_TANGENTS):
        corner, good = _meeting(domain, a, b, size)
        a, b, size, corner = a[good], b[good], size[good], corner[good]
        if turn < tuning.ROUNDS_OF_TANGENTS - 1 and len(a):
            both = np.concatenate(
                [
                    corner + tuning.NEARER_CORNER * (a - corner),
                    corner + tuning.NEARER_CORNER * (b - corner),
                ]
            )
            both = domain.project(
                both, np.tile(size, 2), tolerance=1e-6, max_steps=tuning.STEPS_BESIDE_CORNER
            )
            a, b = both[: len(a)], both[len(a) :]
    on_it = np.abs(domain.depths(corner, size)) < tuning.CORNER_OFF_BOUNDARY * size
    return corner[on_it], size[on_it]


def _meeting(
    domain: DistanceDomain, a: FloatArray, b: FloatArray, size: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return where the tangents at a and b meet, and which of them meet near the midpoint."""
    u, v = domain.normals(a, size), domain.normals(b, size)
    middle = 0.5 * (a + b)
    cosine = np.einsum("ij,ij->i", u, v)
    sharp = np.abs(cosine) < tuning.CORNER_COSINE
    # middle + p u + q v lies on both tangents.
    along_u = np.einsum("ij,ij->i", u, a - middle)
    along_v = np.einsum("ij,ij->i", v, b - middle)
    below = np.where(sharp, 1.0 - cosine**2, 1.0)
    p = (along_u - cosine * along_v) / below
    q = (along_v - cosine * along_u) / below
    move = p[:, None] * u + q[:, None] * v
    return middle + move, sharp & (np.linalg.norm(move, axis=1) < size)
