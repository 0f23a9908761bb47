"""Insertion of nodes where edges are too long or nodes are missing, removal of surplus nodes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize.remeshing.distmesh.implicit_domain import ImplicitDomain
from adaptsize.remeshing.distmesh.rejection import Size
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: Edges shorter or longer than this lose a node or get one at their midpoint, in sizes.
_TOO_SHORT, _TOO_LONG = 0.6, 1.55
#: The same if edges are too short or too long on average.
_RATHER_SHORT, _RATHER_LONG = 0.85, 1.15
#: A point of the domain this far from all nodes gets a node, in sizes.  In the ideal lattices
#: no point is further away than 0.61.
_TOO_FAR = 0.85
#: Edges between boundary nodes run along the boundary if their middle is this near, in lengths.
_ALONG = 0.2


class MeshEdges(NamedTuple):
    """Nodes and edges of a mesh with sizes."""

    points: FloatArray
    edges: IntArray
    on_boundary: BoolArray
    h: FloatArray
    n_fixed: int


def adapted(
    domain: ImplicitDomain, size: Size, mesh: MeshEdges, probes: FloatArray, max_nodes: float
) -> FloatArray | None:
    """Return the nodes with some removed and some added at the end, or None without changes.

    None is also returned if there would be more than ``max_nodes`` nodes.
    """
    points, edges, on_boundary, h, n_fixed = mesh
    i, j = edges.T
    ratio = np.linalg.norm(points[i] - points[j], axis=1) / (0.5 * (h[i] + h[j]))
    short, long = _short_and_long(ratio, len(points), points.shape[1])
    candidates = np.concatenate([short, long])
    middles = 0.5 * (points[i[candidates]] + points[j[candidates]])
    length = ratio[candidates] * 0.5 * (h[i[candidates]] + h[j[candidates]])
    depth = domain.depths(middles, length)
    both = on_boundary[i[candidates]] & on_boundary[j[candidates]]
    # Edges across a narrow part are short because the part is narrow.
    across = both & (depth > _ALONG * length)
    inside = depth > -_ALONG * length
    removed = _chosen(edges[short[~across[: len(short)]]], mesh)
    is_new = inside[len(short) :]
    new = spread(middles[len(short) :][is_new], h[i[long[is_new]]], 1.0)
    kept = np.ones(len(points), np.bool_)
    kept[removed] = False
    kept[:n_fixed] = True
    changed = np.concatenate([points[kept], new])
    changed = uncovered(domain, size, changed, probes)
    same = len(removed) == 0 and len(changed) == len(points)
    return None if same or len(changed) > max_nodes else changed


def _short_and_long(
    ratio: FloatArray, n_points: int, dim: int
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return which edges lose a node, and which get one, the worst first.

    If edges are too long on average, nodes are missing, and the longest edges are split too.
    """
    order = np.argsort(ratio)
    sorted_ratio = ratio[order]
    n_short = int(np.searchsorted(sorted_ratio, _TOO_SHORT))
    n_long = len(ratio) - int(np.searchsorted(sorted_ratio, _TOO_LONG))
    surplus = n_points * (float(np.median(ratio)) ** dim - 1.0)
    limits = np.searchsorted(sorted_ratio, [_RATHER_SHORT, _RATHER_LONG])
    n_short = max(n_short, min(int(-surplus), int(limits[0])))
    n_long = max(n_long, min(int(surplus), len(ratio) - int(limits[1])))
    return order[:n_short], order[::-1][:n_long]


def _chosen(short: IntArray, mesh: MeshEdges) -> npt.NDArray[np.int64]:
    """Return one node of each short edge, such that no two of them share a short edge."""
    gone: list[int] = []
    touched: set[int] = set()
    for a, b in short.tolist():
        if a in touched or b in touched:
            continue
        touched.update((a, b))
        # Prefer interior nodes to boundary nodes, and later nodes because the first are fixed.
        first, last = (a, b) if a < b else (b, a)
        node = first if mesh.on_boundary[last] and not mesh.on_boundary[first] else last
        if node >= mesh.n_fixed:
            gone.append(node)
    return np.array(gone, np.int64)


def uncovered(
    domain: ImplicitDomain, size: Size, points: FloatArray, probes: FloatArray
) -> FloatArray:
    """Return the nodes, and new nodes near points of the domain that are far from all nodes."""
    from scipy.spatial import cKDTree

    if len(probes) == 0:
        return points
    h = size(probes)
    far = np.ones(len(probes), np.bool_)
    if len(points):
        far = cKDTree(points).query(probes)[0] > _TOO_FAR * h
    new = spread(probes[far], h[far], _TOO_FAR)
    return np.concatenate([points, new])


def spread(points: FloatArray, h: FloatArray, factor: float) -> FloatArray:
    """Return points chosen greedily, at least ``factor * h`` from those already chosen."""
    from scipy.spatial import cKDTree

    if len(points) < 2:
        return points
    tree = cKDTree(points)
    free = np.ones(len(points), np.bool_)
    taken = []
    for i in range(len(points)):
        if free[i]:
            taken.append(i)
            free[tree.query_ball_point(points[i], factor * h[i])] = False
    return points[taken]


def far_from(fixed: FloatArray, points: FloatArray, size: Size) -> FloatArray:
    """Return the points that are not too near to the fixed ones."""
    from scipy.spatial import cKDTree

    if len(fixed) == 0 or len(points) == 0:
        return points
    return np.asarray(points[cKDTree(fixed).query(points)[0] > _TOO_SHORT * size(points)])
