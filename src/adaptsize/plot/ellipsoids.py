"""Ellipses and ellipsoids that show a metric: long where edges may be long."""

from __future__ import annotations

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.metrics import Metric
from adaptsize.plot.scene import Scene, clip_axis
from adaptsize.typing import FloatArray, IntArray

#: Corners of an ellipse; rings and columns of an ellipsoid.
_AROUND, _RINGS, _COLUMNS = 40, 8, 14


def scene_of_metric(mesh: SimplexMesh, metric: Metric, n_glyphs: int, clip: str | None) -> Scene:
    """Return glyphs at about evenly distributed nodes, coloured by the smallest size.

    Of tetrahedra, nodes near the plane through the middle are shown.  All glyphs have the same
    length, because sizes usually differ too much to be seen.
    """
    used = np.unique(mesh.cells)
    points = mesh.points[used]
    if mesh.cell_dim == 3:
        extents = np.ptp(points, axis=0)
        axis = "xyz".index(clip_axis(clip, 3, extents, solid=True) or "y")
        spacing = _spacing(np.delete(extents, axis), n_glyphs)
        middle = points[:, axis].min() + 0.5 * extents[axis]
        away = np.abs(points[:, axis] - middle)
        near = away <= max(0.5 * spacing, away.min())  # at least one node
        used, points = used[near], points[near]
    else:
        extents = np.sort(np.ptp(points, axis=0))[::-1]
        spacing = _spacing(extents[:2], n_glyphs)
    chosen = _spread(points, spacing)
    nodes, at = used[chosen], points[chosen]
    sizes = metric.sizes[nodes]
    largest = np.where(np.isfinite(sizes), sizes, 0.0).max(axis=1, keepdims=True)
    largest[largest == 0.0] = 1.0
    # Thinner glyphs could not be seen.  They leave 5 % of the distance between them.
    axes = np.clip(sizes / largest, 0.04, 1.0) * (0.475 * spacing)
    corners, cells = _unit_circle() if mesh.dim == 2 else _unit_sphere()
    placed = at[:, None, :] + np.einsum("nij,nj,kj->nki", metric.directions[nodes], axes, corners)
    full = np.zeros((len(nodes) * len(corners), 3))
    full[:, : mesh.dim] = placed.reshape(-1, mesh.dim)
    shifted = cells + len(corners) * np.arange(len(nodes))[:, None, None]
    triangles = shifted.reshape(-1, 3).astype(np.int32)
    values = np.repeat(sizes[:, 0], len(cells))
    return Scene(full, triangles, values, mesh.dim == 2, False, "smallest size", plain=True)


def _spacing(extents: FloatArray, n: int) -> float:
    """Return the distance between so many points in a rectangle."""
    return float(np.sqrt(max(extents.prod(), 1e-12 * extents.max() ** 2) / n)) or 1.0


def _spread(points: FloatArray, spacing: float) -> IntArray:
    """Return points that are at least so far from each other, the first one of a row wins."""
    from scipy.spatial import cKDTree

    # Points near the middle of squares first: the result looks like a grid where it can.
    square = np.floor((points - points.min(axis=0)) / spacing)
    off = np.linalg.norm(points - points.min(axis=0) - (square + 0.5) * spacing, axis=1)
    order = np.argsort(off, kind="stable")
    near = cKDTree(points[order]).query_ball_point(points[order], spacing * 0.999)
    taken = np.zeros(len(points), np.bool_)
    for k, others in enumerate(near):
        taken[k] = not taken[others].any()
    return np.asarray(order[taken], np.int32)


def _unit_circle() -> tuple[FloatArray, IntArray]:
    """Return the corners of a disc, and its triangles around the middle."""
    angle = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    corners = np.vstack([[0.0, 0.0], np.column_stack([np.cos(angle), np.sin(angle)])])
    rim = np.arange(_AROUND)
    return corners, np.column_stack([0 * rim, 1 + rim, 1 + (rim + 1) % _AROUND]).astype(np.int32)


def _unit_sphere() -> tuple[FloatArray, IntArray]:
    """Return the corners of a sphere and its triangles."""
    up = np.pi * np.arange(_RINGS + 1) / _RINGS
    round_ = 2.0 * np.pi * np.arange(_COLUMNS) / _COLUMNS
    a, b = (x.ravel() for x in np.meshgrid(up, round_, indexing="ij"))
    corners = np.column_stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)])
    i, j = (x.ravel() for x in np.meshgrid(np.arange(_RINGS), np.arange(_COLUMNS), indexing="ij"))
    here, right = i * _COLUMNS + j, i * _COLUMNS + (j + 1) % _COLUMNS
    below, opposite = here + _COLUMNS, right + _COLUMNS
    lower = np.column_stack([here, below, opposite])[i < _RINGS - 1]
    upper = np.column_stack([here, opposite, right])[i > 0]
    return corners, np.vstack([lower, upper]).astype(np.int32)
