"""Moves of nodes that are taken back where cells become too flat."""

import math

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.smoothing import fill_quality
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.topology import marked
from adaptsize.geometry.boundary import facet_normals
from adaptsize.remeshing import tuning
from adaptsize.typing import FloatArray, IntArray


def move_nodes(
    points: FloatArray, cells: IntArray, nodes: IntArray, there: FloatArray, least: float
) -> None:
    """Move nodes to places, or halfway if cells would become worse than a least quality.

    Changes ``points``.
    """
    cells = cells[marked(nodes, len(points))[cells].any(axis=1)]
    for share in (1.0, 0.5):
        start, kept = points.copy(), np.minimum(worst_of_nodes(points, cells), least)
        points[nodes] += share * (there - points[nodes])
        take_back(points, cells, start, nodes, kept)


def take_back(
    points: FloatArray,
    cells: IntArray,
    old: FloatArray,
    nodes: npt.NDArray[np.integer],
    least: FloatArray,
) -> None:
    """Take back moves of nodes whose cells have less than the least quality, or turned far."""
    for _ in range(tuning.ROUNDS_OF_TAKING_BACK):  # taking back one move may spoil another
        worse = nodes[worst_of_nodes(points, cells, old)[nodes] < least[nodes]]
        worse = worse[(points[worse] != old[worse]).any(axis=1)]
        if len(worse) == 0:
            return
        points[worse] = old[worse]
    points[:] = old


def worst_of_nodes(
    points: FloatArray, cells: IntArray, before: FloatArray | None = None
) -> FloatArray:
    """Return the smallest quality of the cells around each node."""
    worst = np.ones(len(points))
    np.minimum.at(worst, cells, quality_of(points, cells, before)[:, None])
    return worst


def quality_of(points: FloatArray, cells: IntArray, before: FloatArray | None = None) -> FloatArray:
    """Return the quality of each cell.

    That of triangles in space is negative if they have turned far from where the points were.
    """
    if cells.shape[1] == points.shape[1] == 3:
        return _quality_in_space(points, cells, points if before is None else before)
    quality = np.empty(len(cells))
    fill_quality(read_only(points), read_only(cells), quality)
    return quality


def _quality_in_space(points: FloatArray, cells: IntArray, before: FloatArray) -> FloatArray:
    corners = points[cells]
    normals, was = facet_normals(corners), facet_normals(before[cells])
    twice, length = np.linalg.norm(normals, axis=1), np.linalg.norm(was, axis=1)
    squares = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=(1, 2))
    quality = 2.0 * math.sqrt(3.0) * twice / np.maximum(squares, np.finfo(float).tiny)
    turned = np.einsum("ij,ij->i", normals, was) < tuning.LEAST_COSINE * twice * length
    return np.asarray(np.where(turned, -quality, quality))
