"""Paths of metrics around the corners of a plane domain that is not convex."""

from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import shortest_path

from adaptsize._kernels.metric_sources import Scratch, Sources, list_entering, new_scratch
from adaptsize._kernels.sight import Sight, View, fill_seen, new_view
from adaptsize.background import SimplexMesh
from adaptsize.background._mesh_arrays import read_only
from adaptsize.geometry.boundary import flat_boundary
from adaptsize.geometry.convexity import is_convex
from adaptsize.geometry.plane_boundary import plane_boundary
from adaptsize.limiting.exact.obstacles_in_plane import plane_of
from adaptsize.typing import FloatArray, IntArray, LongArray

# Sources that a corner may see first.
_GUESSES = 64

# The least eigenvalue from which on a metric counts as not below another one at the same place.
_EQUAL = 1.0 - 1e-12


class PlaneDomain(NamedTuple):
    """A plane domain that is not convex."""

    sight: Sight
    rows: IntArray
    """int32[n]: rows of the nodes in the sectors, -1 inside."""
    corners: IntArray
    """int32[c]: nodes at which shortest paths may bend."""

    def view(self) -> View:
        """Return the domain with scratch for one thread."""
        return new_view(self.sight, self.rows)


def plane_domain_of(mesh: SimplexMesh) -> PlaneDomain | None:
    """Return the domain of triangles in the plane; None if it is convex."""
    boundary = flat_boundary(mesh)
    if len(boundary.facets) == 0 or is_convex(mesh.points, boundary):
        return None
    found = plane_boundary(mesh, boundary)
    rows = np.full(mesh.n_points, -1, np.int32)
    rows[: len(found.rows)] = found.rows
    plane = plane_of(mesh.points, found)
    return PlaneDomain(plane.sight, read_only(rows), np.asarray(plane.nodes, np.int32))


def around_corners(
    points: FloatArray, sources: Sources, g: float, domain: PlaneDomain
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return sizes and directions with which sources come to corners, and the corners, int32[k].

    The growth is isotropic, so that a metric keeps its directions around a corner, and only the
    length of the path counts.  What another metric dominates at a corner, it dominates behind it.
    """
    corners, dim = domain.corners, points.shape[1]
    n = len(corners)
    view, scratch = domain.view(), new_scratch(dim)
    seen = np.empty((n, n), np.bool_)
    fill_seen(points, corners.astype(np.int64), view, seen)
    between = np.linalg.norm(points[corners, None] - points[None, corners], axis=2)
    # Zeros would count as no edge: corners at one place are apart by less than rounding.
    between = shortest_path(np.where(seen, np.maximum(between, 1e-300), 0.0), directed=False)
    here = [_entering(points, sources, g, int(c), view, scratch) for c in corners]
    h, r, nodes = [], [], []
    for i in range(n):
        reached = [j for j in range(n) if np.isfinite(between[i, j]) and len(here[j][0])]
        if not reached:
            continue
        by = np.concatenate([here[j][0] for j in reached])
        length = np.concatenate([here[j][1] + between[j, i] for j in reached])
        sizes, directions = sources.h[by] + g * length[:, None], sources.r[by]
        kept = undominated(sizes, directions)
        h.append(sizes[kept])
        r.append(directions[kept])
        nodes.append(np.full(len(kept), corners[i], np.int32))
    if not h:
        return np.empty((0, dim)), np.empty((0, dim, dim)), np.empty(0, np.int32)
    return np.concatenate(h), np.concatenate(r), np.concatenate(nodes)


def _entering(
    points: FloatArray, sources: Sources, g: float, corner: int, view: View, scratch: Scratch
) -> tuple[LongArray, FloatArray]:
    """Return sources that a corner sees, without those dominated there, and their distances."""
    distance = np.linalg.norm(sources.x - points[corner], axis=1)
    order = np.argsort(sources.h.max(axis=1) + g * distance, kind="stable")
    entering, axes = np.empty(len(order) + 1, np.int64), (0,) * points.shape[1]
    for first in range(0, len(order), _GUESSES):
        guesses = order[first : first + _GUESSES].astype(np.int64)
        given = (axes, points, corner, sources, g, guesses, entering, scratch, view)
        if (count := list_entering(*given)) >= 0:
            found = entering[:count]
            kept = undominated(sources.h[found] + g * distance[found, None], sources.r[found])
            return found[kept], distance[found[kept]]
    return np.empty(0, np.int64), np.empty(0)


def undominated(h: FloatArray, r: FloatArray) -> LongArray:
    """Return the metrics at one place that are nowhere above another one, which is kept."""
    left = np.argsort(np.log(h).sum(axis=1), kind="stable")
    kept = []
    while len(left):
        t = left[0]  # of the least volume: no other one dominates it
        kept.append(t)
        factor = (r[t].T / h[t][:, None]) @ (r[left] * h[left][:, None, :])
        left = left[np.linalg.svd(factor, compute_uv=False)[:, -1] ** 2 < _EQUAL]
    return np.array(kept, np.int64)
