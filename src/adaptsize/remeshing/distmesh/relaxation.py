"""Smoothing: nodes are pushed apart until the edges have the requested lengths.

The loop is that of [1]_: Delaunay triangulation, linear repulsive forces along the edges, and
projection of nodes that left the domain onto its boundary.  The differences are:

* Steps are divided by the number of neighbours, so that nodes with many neighbours do not
  oscillate.
* The scale is the median of length over size, which a few bad cells do not shift.
* Nodes are added and removed during the iteration, as in [2]_.
* Corners are detected.
* Late steps are shorter.

References
----------
.. [1] P.-O. Persson, G. Strang, "A simple mesh generator in MATLAB", SIAM Review 46 (2004)
   329-345.
.. [2] F. J. Bossen, P. S. Heckbert, "A pliant method for anisotropic mesh generation", 5th
   International Meshing Roundtable (1996) 63-74.
"""

from typing import NamedTuple

import numpy as np

from adaptsize.background.topology import edges_of
from adaptsize.remeshing.distmesh import tuning
from adaptsize.remeshing.distmesh.implicit_domain import BoundaryFacets, DistanceDomain
from adaptsize.remeshing.distmesh.nodes import Triangulation, adapted, uncovered, with_corners
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

#: A node this near to the boundary is on it, in sizes.
ON_BOUNDARY = 1e-3


class Relaxed(NamedTuple):
    """Converged nodes."""

    points: FloatArray
    n_fixed: int
    """Number of leading nodes that are fixed: given ones, and in the plane detected corners."""
    n_steps: int
    n_triangulations: int
    last_move: float
    """Mean length of the last step, in sizes, as if it had not been shortened."""
    converged: bool


def triangulate(domain: DistanceDomain, points: FloatArray, h: FloatArray) -> IntArray:
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
    cells = np.ascontiguousarray(cells[_are_inside(domain, points, cells, h)])
    negative = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]]) < 0.0
    cells[negative, :2] = cells[negative, 1::-1]
    return np.asarray(cells)


def _are_inside(
    domain: DistanceDomain, points: FloatArray, cells: IntArray, h: FloatArray
) -> BoolArray:
    """Return which cells have their centroids deep enough in the domain."""
    corners = points[cells]
    longest = np.linalg.norm(np.ptp(corners, axis=1), axis=1)
    inside = domain.depth(domain.phi(points))[cells].max(axis=1) > longest
    unsure = np.flatnonzero(~inside)
    centroids, wanted = corners[unsure].mean(axis=1), h[cells[unsure]].mean(axis=1)
    depth = domain.depth(domain.phi(centroids))
    # The slope is only a bound.  Where it is not sharp enough, the gradient is used.
    near = (depth > 0.0) & (depth <= tuning.INSIDE * wanted)
    depth[near] = domain.depths(centroids[near], wanted[near])
    inside[unsure] = depth > tuning.INSIDE * wanted
    return np.asarray(inside)


def relax(
    domain: DistanceDomain,
    points: FloatArray,
    *,
    n_fixed: int,
    max_iter: int,
    max_nodes: float,
    report: ProgressCallback,
) -> Relaxed:
    """Return the smoothed nodes, some added and some removed.  The first ``n_fixed`` are fixed."""
    points = uncovered(domain, points)
    adapt_until = min(tuning.ADAPT_UNTIL, max_iter // 2)
    known: Triangulation | None = None
    seeks_corners = domain.may_have_corners
    count, k, mean, converged = 0, 0, np.inf, False
    for k in range(1, max_iter + 1):
        report("moving nodes", k / max_iter)
        h, n = domain.size(points), len(points)
        way = 0.0 if known is None else np.linalg.norm(points - known.points, axis=1) / h
        if known is None or np.quantile(way, 1.0 - tuning.MOVED_SHARE) > tuning.MOVED:
            cells = triangulate(domain, points, h)
            known = Triangulation(points, edges_of(cells, n), domain.skin(points, cells))
            count += 1
        changed = None
        if k % tuning.ADAPT_EVERY == 0 and k <= adapt_until:
            changed = adapted(domain, points, h, known, n_fixed)
            if changed is not None and len(changed) > max_nodes:
                changed = None
        elif (
            k % tuning.ADAPT_EVERY == tuning.ADAPT_EVERY // 2
            and k > tuning.ADAPT_EVERY
            and seeks_corners
        ):
            skin_edges = edges_of(known.skin.facets, n)
            changed, n_fixed = with_corners(domain, points, h, skin_edges, n_fixed)
        if changed is not None:
            points, known = changed, None
            continue
        shortened = tuning.SHORTENING ** max(0, k - tuning.ADAPT_UNTIL)
        move = shortened * _forces(points, known.edges, h)
        move[:n_fixed] = 0.0
        moved = _put_back(domain, points + move, h, known.skin, n_fixed)
        mean = float((np.linalg.norm(moved - points, axis=1) / h).mean()) / shortened
        points = moved
        converged = mean < tuning.CONVERGED
        # Only when the rules above have been applied.
        if converged and k >= tuning.FEWEST_STEPS:
            break
    return Relaxed(points, n_fixed, k, count, mean, converged)


def _forces(points: FloatArray, edges: IntArray, h: FloatArray) -> FloatArray:
    """Return the steps from the forces along the edges, float64[n, dim]."""
    n, dim = points.shape
    i, j = edges.T
    edge = points[i] - points[j]
    length = np.linalg.norm(edge, axis=1)
    wanted = 0.5 * (h[i] + h[j])
    # The number of nodes determines the mean edge length.
    scale = np.clip(np.median(length / wanted), *tuning.SCALES)
    excess = np.maximum(tuning.PRESSURE[dim] * scale * wanted - length, 0.0)
    force = excess / np.maximum(length, 1e-12 * wanted)
    move = np.empty((n, dim))
    for d in range(dim):
        along = force * edge[:, d]
        move[:, d] = np.bincount(i, along, n) - np.bincount(j, along, n)
    n_neighbours = np.bincount(edges.ravel(), minlength=n)
    move *= (tuning.STEP_PER_FORCE / np.maximum(n_neighbours, 1))[:, None]
    way = np.linalg.norm(move, axis=1)
    far = way > tuning.LONGEST_STEP * h
    move[far] *= (tuning.LONGEST_STEP * h[far] / way[far])[:, None]
    return move


def _put_back(
    domain: DistanceDomain, points: FloatArray, h: FloatArray, skin: BoundaryFacets, n_fixed: int
) -> FloatArray:
    """Return the nodes, with outside nodes and boundary nodes projected onto the boundary."""
    outside = domain.phi(points) > 0.0
    moving = outside | skin.nodes
    moving[:n_fixed] = False
    at = np.flatnonzero(moving)
    there = domain.project(
        points[at],
        h[at],
        tolerance=ON_BOUNDARY,
        max_steps=tuning.STEPS_BACK,
        walls=skin.walls_of(at),
    )
    near = np.linalg.norm(there - points[at], axis=1) < tuning.REACH_OF_BOUNDARY * h[at]
    points[at] = np.where((outside[at] | near)[:, None], there, points[at])
    return points
