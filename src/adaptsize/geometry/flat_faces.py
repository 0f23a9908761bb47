"""Faces of a solid that are plane but for the rounding of coordinates, as in files.

A plane face whose coordinates are rounded to, say, nine digits becomes bumpy: its triangles tilt by
the noise over their heights, and hide points from each other that see each other along the face.
"""

import numpy as np

from adaptsize.background.topology import components_of, places_among
from adaptsize.geometry.boundary import facet_normals
from adaptsize.geometry.convexity import Ridges, norms
from adaptsize.typing import FloatArray, IntArray

# Distances from a plane below this share of the diagonal are rounding.
_PLANE = 1e-15


def with_flat_faces(points: FloatArray, facets: IntArray, ridges: Ridges) -> FloatArray:
    """Return points, those on faces that are plane but for noise moved into common planes.

    No node moves by more than a few times the noise, which is found from the boundary.  The same
    array is returned if the noise is below 1e-12 of the diagonal or above 1e-5, or not clearly
    smaller than all other features of the boundary.

    Parameters
    ----------
    points : float64[n, 3]
    facets : int32[f, 3]
    ridges : Ridges
        The edges of the facets.
    """
    diagonal = diagonal_of(points, facets)
    offsets = _offsets_at(ridges, points, facets) / diagonal
    noise = _noise_in(offsets)
    if noise == 0.0:
        return points
    face: IntArray = components_of(ridges.facets[offsets <= noise], len(facets)).astype(np.int32)
    pairs = np.unique(np.column_stack([facets.ravel(), np.repeat(face, 3)]), axis=0)
    node, plane = pairs[np.bincount(face)[pairs[:, 1]] > 1].T
    middle = points[facets].mean(axis=(0, 1))
    moved = (points - middle) / diagonal
    normals, away, _ = _planes_of(moved, facets, face, node, plane)
    furthest = np.zeros(len(normals))
    np.maximum.at(furthest, plane, np.abs(away))
    is_flat = furthest[plane] <= noise  # else the face is curved
    node, plane = node[is_flat], plane[is_flat]
    for _ in range(4):  # Newton's method: the noise is squared in each step
        normals, away, arms = _planes_of(moved, facets, face, node, plane)
        if np.abs(away).max(initial=0.0) <= _PLANE:
            break
        nodes = np.unique(node)
        column = places_among(nodes, len(points))[node]
        moved[nodes] += _least_step(column, plane, normals, away, arms)[: len(nodes)]
    new = points.copy()
    new[node] = middle + diagonal * moved[node]
    return new if np.abs(new - points).max() <= 3.0 * noise * diagonal else points


def diagonal_of(points: FloatArray, facets: IntArray) -> float:
    """Return the diagonal of the box around facets."""
    return float(np.linalg.norm([np.ptp(column[facets]) for column in points.T]))


def _offsets_at(ridges: Ridges, points: FloatArray, facets: IntArray) -> FloatArray:
    """Return the noise of coordinates that would explain the angle at each ridge."""
    normals = facet_normals(points.take(facets, axis=0))
    areas = norms(normals)
    normals /= np.maximum(areas, 1e-300)[:, None]
    first, second = ridges.facets.T
    normal, other = normals.take(first, axis=0), normals.take(second, axis=0)
    start, end = points.take(ridges.ends[:, 0], axis=0), points.take(ridges.ends[:, 1], axis=0)
    to_apex = points.take(ridges.apex[:, 1], axis=0) - start
    rise = np.abs(np.einsum("ra,ra->r", normal, to_apex))
    # The apex of one facet is so far from the ridge, in heights of the other facet.
    lever = norms(end - start) * norms(to_apex) / np.maximum(areas[first], 1e-300)
    is_fold = np.einsum("ra,ra->r", normal, other) <= 0.0
    return np.where(ridges.regular & ~is_fold, rise / (1.0 + lever), np.inf)


def _noise_in(offsets: FloatArray) -> float:
    """Return the noise that offsets show, if few are just above it; else 0."""
    rough = np.sort(offsets[(offsets > 1e-12) & (offsets < 1e-3)])
    levels = 10.0 ** np.arange(-11.5, -4.9, 0.5)
    below, gap = np.searchsorted(rough, levels), np.searchsorted(rough, 30.0 * levels)
    found = (below >= 10) & (gap - below <= 0.05 * below)
    return 3.0 * float(levels[found.argmax()]) if found.any() else 0.0


def _planes_of(
    points: FloatArray, facets: IntArray, face: IntArray, node: IntArray, plane: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the unit normals of faces, and for pairs of a node and its plane where the node is.

    The latter is its distance from the plane and its position in units of the face.
    """
    n = int(face.max()) + 1
    normals = _sums(face, facet_normals(points[facets]), n)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    count = np.maximum(np.bincount(plane, minlength=n), 1)
    arms = points[node] - (_sums(plane, points[node], n) / count[:, None])[plane]
    away = np.einsum("ra,ra->r", normals[plane], arms)
    reach = np.zeros(n)
    np.maximum.at(reach, plane, np.linalg.norm(arms, axis=1))
    return normals, away, arms / reach[plane][:, None]


def _sums(group: IntArray, rows: FloatArray, n: int) -> FloatArray:
    return np.column_stack([np.bincount(group, column, n) for column in rows.T])


def _least_step(
    column: IntArray, plane: IntArray, normals: FloatArray, away: FloatArray, arms: FloatArray
) -> FloatArray:
    """Return the least displacements that move nodes into planes, which turn and move too.

    These are linear equations: one for each pair of a node and a plane.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import lsqr

    m, n_nodes = len(column), int(column.max()) + 1
    axes = np.arange(3)
    entries = np.column_stack([normals[plane], arms, np.ones(m)])
    columns = np.column_stack(
        [
            3 * column[:, None] + axes,
            3 * (n_nodes + plane[:, None]) + axes,
            3 * (n_nodes + len(normals)) + plane,
        ]
    )
    rows = np.repeat(np.arange(m), 7)
    shape = (m, 3 * n_nodes + 4 * len(normals))
    equations = coo_array((entries.ravel(), (rows, columns.ravel())), shape=shape).tocsr()
    step = lsqr(equations, -away, atol=1e-12, btol=1e-12, iter_lim=1000)[0]
    return np.asarray(step[: 3 * n_nodes].reshape(-1, 3))
