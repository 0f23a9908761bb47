"""Shortest paths on small surfaces of triangles, by all strips of triangles that are straight.

Nothing here knows of adaptsize, of windows that end early, or of angles at nodes: every node may be
a bend.  A cone of straight lines from a node is unfolded through all triangles beyond each edge,
until it is longer than a path along edges.
"""

import numpy as np


def distances(points, cells, tolerance=1e-10):
    """Return the lengths of the shortest paths between all nodes, float64[n, n]."""
    length = np.linalg.norm(points[:, None] - points, axis=2)
    known = np.full(length.shape, np.inf)
    np.fill_diagonal(known, 0.0)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        i, j = cells[:, a], cells[:, b]
        known[i, j] = known[j, i] = length[i, j]
    known = _closed(known)
    beyond = {}
    for t, cell in enumerate(cells):
        for k in range(3):
            edge = frozenset((int(cell[k - 1]), int(cell[k - 2])))
            beyond.setdefault(edge, []).append((t, int(cell[k])))
    straight = known.copy()
    for t, cell in enumerate(cells):
        for k in range(3):
            i, a, b = (int(cell[k - w]) for w in range(3))
            limit = known[i][np.isfinite(known[i])].max()
            p, q = _apex(np.zeros(2), np.array([length[i, a], 0.0]), length[i, b], length[a, b])
            stack = [(t, a, b, p, q, p, q)]
            while stack:
                t0, a, b, p, q, first, last = stack.pop()
                for t1, c in beyond[frozenset((a, b))]:
                    if t1 == t0:
                        continue
                    at = _across(p, q, length[a, c], length[b, c])
                    away = np.hypot(*at)
                    after, before = _turn(first, at), _turn(at, last)
                    if min(after, before) >= -tolerance * away:
                        straight[i, c] = min(straight[i, c], away)
                    for ends in ((a, c, p, at, first, at), (c, b, at, q, at, last)):
                        left, right = ends[4], ends[5]
                        if ends[0] == a and before < 0.0:
                            right = last
                        if ends[1] == b and after < 0.0:
                            left = first
                        if _turn(left, right) > 1e-14 and _nearest(ends[2], ends[3]) < limit:
                            stack.append((t1, *ends[:4], left, right))
    return _closed(np.minimum(straight, straight.T))


def limited(points, cells, h0, g):
    """Return the sizes that bounds at nodes allow."""
    with np.errstate(invalid="ignore"):
        return (h0[:, None] + g * distances(points, cells)).min(axis=0)


def _closed(lengths):
    """Return the lengths of paths (Floyd and Warshall)."""
    lengths = lengths.copy()
    for k in range(len(lengths)):
        lengths = np.minimum(lengths, lengths[:, k, None] + lengths[k])
    return lengths


def _turn(a, b):
    return a[0] * b[1] - a[1] * b[0]


def _apex(p, q, to_p, to_q):
    """Return q, and a point at given distances from p and q, to the left of the way to it."""
    edge = np.hypot(*(q - p))
    along = (to_p**2 - to_q**2 + edge**2) / (2.0 * edge)
    height = np.sqrt(max(to_p**2 - along**2, 0.0))
    u = (q - p) / edge
    return q, p + along * u + height * np.array([-u[1], u[0]])


def _across(p, q, to_p, to_q):
    """Return the node beyond the edge from p to q, which runs counterclockwise around 0."""
    return _apex(q, p, to_q, to_p)[1]


def _nearest(p, q):
    """Return the distance of a segment from 0."""
    e = q - p
    share = np.clip(-(p @ e) / (e @ e), 0.0, 1.0)
    return np.hypot(*(p + share * e))
