"""The boundary of a solid, for lines of sight."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adaptsize._kernels.space_sight import Sight, Stars, Walls
from adaptsize.background._curve import along_curve
from adaptsize.limiting.exact.work import boxes_over
from adaptsize.typing import FloatArray, IntArray

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh
    from adaptsize.geometry.boundary import FlatBoundary


# Distances below this share of the diagonal are zero.
_SLACK = 1e-11


# Cells with a smaller ratio of volume to the cube of the longest edge have no volume.
NO_VOLUME = 1e-12


def build_sight(mesh: SimplexMesh, boundary: FlatBoundary) -> Sight:
    """Return the boundary of a mesh of tetrahedra, for lines of sight."""
    points, facets = mesh.points, boundary.facets
    corners = points[facets]
    diagonal, rounding = scales_of(points, facets)
    origin, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(e1, e2)
    area = np.linalg.norm(normal, axis=1)
    height = heights_of(corners, area)
    keep = height > NO_VOLUME * diagonal
    order = np.flatnonzero(keep)
    order = order[along_curve(np.ascontiguousarray(corners[keep].mean(axis=1)))]
    square = area[order, None] ** 2
    rows = np.empty((len(order), 14))
    rows[:, :3] = origin[order]
    rows[:, 3:6] = normal[order] / area[order, None]
    rows[:, 6:9] = np.cross(e2[order], normal[order]) / square
    rows[:, 9:12] = np.cross(normal[order], e1[order]) / square
    slack = _SLACK * diagonal
    # The normal of a sliver is uncertain, and so is the side on which a distant point lies.
    rows[:, 12] = np.maximum(slack, 4.0 * rounding * diagonal / height[order])
    rows[:, 13] = np.minimum(slack / height[order], 1e-3)
    boxes = boxes_over(corners[order].min(axis=1), corners[order].max(axis=1), np.zeros(len(order)))
    return Sight(Walls(rows, boxes, len(boxes) // 2, slack), _stars_at(mesh, np.unique(facets)))


def scales_of(points: FloatArray, facets: IntArray) -> tuple[float, float]:
    """Return the diagonal of the domain, and the rounding error of a coordinate."""
    used = points[facets]
    diagonal = float(np.linalg.norm(np.ptp(used, axis=(0, 1))))
    return diagonal, float(np.finfo(float).eps * np.abs(used).max())


def heights_of(corners: FloatArray, area: FloatArray) -> FloatArray:
    """Return the smallest heights of triangles, given twice their areas."""
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    heights = np.zeros_like(area)
    np.divide(area, longest, out=heights, where=longest > 0.0)
    return heights


def _stars_at(mesh: SimplexMesh, nodes: IntArray) -> Stars:
    """Return the cells with a volume at boundary nodes."""
    rows = np.full(mesh.n_points, -1, np.int32)
    rows[nodes] = np.arange(len(nodes))
    cells = mesh.cells[(rows[mesh.cells] >= 0).any(axis=1)]
    edges = mesh.points[cells[:, 1:]] - mesh.points[cells[:, :1]]
    volume = np.einsum("ij,ij->i", edges[:, 0], np.cross(edges[:, 1], edges[:, 2]))
    longest = np.abs(edges).max(axis=(1, 2), initial=0.0)
    flat = np.abs(volume) <= NO_VOLUME * longest**3
    turned = volume < 0.0
    cells[turned, 2:] = cells[turned, 3:1:-1]
    cells = cells[~flat]
    # Even permutations: seen from the first vertex, the three others are right-handed.
    around = [[0, 1, 2, 3], [1, 0, 3, 2], [2, 0, 1, 3], [3, 0, 2, 1]]
    star = np.concatenate([cells[:, order] for order in around])
    star = star[rows[star[:, 0]] >= 0]
    row = rows[star[:, 0]]
    star = star[np.argsort(row, kind="stable"), 1:]
    first = np.zeros(len(nodes) + 1, np.int32)
    first[1:] = np.cumsum(np.bincount(row, minlength=len(nodes)))
    return Stars(mesh.points, rows, first, np.ascontiguousarray(star))
