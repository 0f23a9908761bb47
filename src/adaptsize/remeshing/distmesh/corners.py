"""Detection of corners of the domain and, in space, of its edges; nodes are placed there.

Two boundary neighbours with different normals have a corner between them if their
tangents meet on the boundary.  On a smooth boundary they meet outside.  The tangents are
recomputed nearer to the intersection, so the method also works for curved sides.
"""

from __future__ import annotations

import numpy as np

from adaptsize.remeshing.distmesh.density import spread
from adaptsize.remeshing.distmesh.implicit_domain import ImplicitDomain
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: Cosine of the least angle between the normals beside a corner (40 degrees).
_SHARP = 0.77
#: The tangents meet this near to the boundary, in sizes.
_MEETING = 0.02
#: A node this near to a corner is moved there; a node still nearer counts as there, in sizes.
_BRING, _THERE = 0.5, 1e-4
#: Tangents are recomputed at this share of the distance from the corner.
_NEARER = 0.2
_ROUNDS = 3


def with_corners(
    domain: ImplicitDomain,
    points: FloatArray,
    h: FloatArray,
    skin_edges: IntArray,
    n_fixed: int,
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
    corners = spread(corners, sizes, _BRING)
    if len(corners) == 0:
        return None, n_fixed
    way, node = cKDTree(points).query(corners)
    near = way < _BRING * h[node]
    is_fixed = near & (node < n_fixed)
    there = near & (way < _THERE * h[node])
    used, first = np.unique(node[near & ~is_fixed], return_index=True)
    chosen = np.flatnonzero(near & ~is_fixed)[first]
    new = corners[~near]
    points = points.copy()
    points[used] = corners[chosen]
    if domain.dim == 3:
        moved = (near & ~is_fixed & ~there).any() or len(new) > 0
        return (np.concatenate([points, new]) if moved else None), n_fixed
    if len(used) + len(new) == 0:
        return None, n_fixed
    free = np.ones(len(points), np.bool_)
    free[:n_fixed] = False
    free[used] = False
    ordered = np.concatenate([points[:n_fixed], points[used], new, points[free]])
    return ordered, n_fixed + len(used) + len(new)


def _between(
    domain: ImplicitDomain, points: FloatArray, h: FloatArray, pairs: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return where the tangents at two neighbours meet on the boundary, and sizes there."""
    a, b = points[pairs[:, 0]], points[pairs[:, 1]]
    size = 0.5 * (h[pairs[:, 0]] + h[pairs[:, 1]])
    for turn in range(_ROUNDS):
        corner, good = _meeting(domain, a, b, size)
        a, b, size, corner = a[good], b[good], size[good], corner[good]
        if turn < _ROUNDS - 1 and len(a):
            both = np.concatenate(
                [corner + _NEARER * (a - corner), corner + _NEARER * (b - corner)]
            )
            both, _ = domain.project(both, np.tile(size, 2), tolerance=1e-6, max_steps=5)
            a, b = both[: len(a)], both[len(a) :]
    on_it = np.abs(domain.depths(corner, size)) < _MEETING * size
    return corner[on_it], size[on_it]


def _meeting(
    domain: ImplicitDomain, a: FloatArray, b: FloatArray, size: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return where the tangents at a and b meet, and which of them meet near the midpoint."""
    u, v = _normals(domain, a, size), _normals(domain, b, size)
    middle = 0.5 * (a + b)
    cosine = np.einsum("ij,ij->i", u, v)
    sharp = np.abs(cosine) < _SHARP
    # middle + p u + q v lies on both tangents.
    along_u = np.einsum("ij,ij->i", u, a - middle)
    along_v = np.einsum("ij,ij->i", v, b - middle)
    below = np.where(sharp, 1.0 - cosine**2, 1.0)
    p = (along_u - cosine * along_v) / below
    q = (along_v - cosine * along_u) / below
    move = p[:, None] * u + q[:, None] * v
    return middle + move, sharp & (np.linalg.norm(move, axis=1) < size)


def _normals(domain: ImplicitDomain, points: FloatArray, h: FloatArray) -> FloatArray:
    gradient = domain.gradient(points, domain.phi(points), h)
    length = np.linalg.norm(gradient, axis=1)
    return np.asarray(gradient / np.where(length > 0.0, length, 1.0)[:, None])
