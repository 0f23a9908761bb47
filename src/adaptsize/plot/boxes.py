"""The visible faces of a grid or an octree: boxes in 2-D, outer faces in 3-D."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.background import CartesianGrid, Octree
from adaptsize.background.splitting_grid import whole_boxes
from adaptsize.background.topology import unique_rows
from adaptsize.plot.scene import Scene, behind_the_cut, clip_axis, scene_of_cells
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: Finer grids are drawn with this number of nodes along an axis.  More cannot be distinguished.
_MOST_NODES = {2: 512, 3: 256}
# Corners of a box are numbered row by row, the last axis fastest; these go round a square.
_AROUND = [0, 2, 3, 1]


def scene_of_grid(
    grid: CartesianGrid, values: FloatArray, *, label: str, clip: str | None
) -> Scene:
    """Return the visible faces of a grid after the clip: of boxes whose nodes are all active."""
    clip = clip_axis(clip, grid.dim, grid.upper - grid.lower, solid=grid.dim == 3)
    shown = [_some_of(n, _MOST_NODES[grid.dim]) for n in grid.shape]
    axes = [axis[i] for axis, i in zip(grid.axes, shown, strict=True)]
    shape = tuple(len(axis) for axis in axes)
    kept = np.ones([n - 1 for n in shape], np.bool_)
    if grid.active is not None:
        kept = whole_boxes(grid.active[np.ix_(*shown)])
    if not kept.any():
        raise ValueError("active must leave at least one box with all its nodes, got none")
    if clip is not None:
        d = "xyz".index(clip)
        # Of the boxes that there are, as the middle of a mesh is that of its cells.
        there = np.flatnonzero(kept.any(axis=tuple(e for e in range(grid.dim) if e != d)))
        middle = 0.5 * (axes[d][1:] + axes[d][:-1])
        stays = np.zeros(len(middle), np.bool_)
        stays[there] = behind_the_cut(middle[there], d)
        kept &= stays.reshape([-1 if e == d else 1 for e in range(grid.dim)])
    quads = _outer_faces(kept, shape)
    nodes, cells = _renumbered(quads)
    indices = np.unravel_index(nodes, shape)
    points = np.zeros((len(nodes), 3))
    for d, i in enumerate(indices):
        points[:, d] = axes[d][i]
    at_nodes = values[tuple(which[i] for which, i in zip(shown, indices, strict=True))]
    return scene_of_cells(points, cells, at_nodes, label=label, flat=grid.dim == 2)


def scene_of_octree(tree: Octree, values: FloatArray, *, label: str, clip: str | None) -> Scene:
    """Return the visible faces of the leaves of an octree after the clip."""
    clip = clip_axis(clip, tree.dim, np.subtract(tree.upper, tree.lower), solid=tree.dim == 3)
    corners = tree.leaf_corners
    if clip is not None:
        d = "xyz".index(clip)
        corners = corners[behind_the_cut(tree.leaf_centres[:, d], d)]
    quads = corners[:, _AROUND]
    if tree.dim == 3:
        faces = np.concatenate(
            [corners[:, _on_side(d, side)][:, _AROUND] for d, side in product(range(3), (0, 1))]
        )
        number = unique_rows(faces, tree.n_points)[1]
        quads = faces[np.bincount(number)[number] == 1]
    nodes, cells = _renumbered(quads)
    points = np.zeros((len(nodes), 3))
    points[:, : tree.dim] = tree.points[nodes]
    return scene_of_cells(points, cells, values[nodes], label=label, flat=tree.dim == 2)


def _renumbered(quads: npt.NDArray[Any]) -> tuple[npt.NDArray[np.int64], IntArray]:
    """Return the nodes that occur, and the same quadrilaterals numbered by their places."""
    nodes, places = np.unique(quads, return_inverse=True)
    cells: IntArray = np.asarray(places, dtype=np.int32).reshape(quads.shape)
    return nodes, cells


def _some_of(n: int, most: int) -> npt.NDArray[np.int64]:
    """Return up to ``most`` of n indices, evenly, the first and the last among them."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.int64))


def _on_side(d: int, side: int) -> list[int]:
    """Return the corners of a 3-D box on one side of it, row by row."""
    return [corner for corner in range(8) if corner >> (2 - d) & 1 == side]


def _outer_faces(kept: BoolArray, shape: tuple[int, ...]) -> npt.NDArray[Any]:
    """Return the boxes of a 2-D grid, the outer faces of those of a 3-D one, int64[n, 4]."""
    strides = np.cumprod([1, *shape[:0:-1]])[::-1]
    if len(shape) == 2:
        first = np.argwhere(kept) @ strides
        return _squares(first, strides[0], strides[1])
    faces = []
    for d in range(3):
        across = np.moveaxis(kept, d, 0)
        changes = np.diff(across, axis=0, prepend=False, append=False)
        first = np.argwhere(np.moveaxis(changes, 0, d)) @ strides
        faces.append(_squares(first, *(strides[e] for e in range(3) if e != d)))
    return np.concatenate(faces)


def _squares(first: npt.NDArray[Any], right: int, up: int) -> npt.NDArray[Any]:
    """Return four nodes each, round a square, from the first one and two strides."""
    return np.stack([first, first + right, first + right + up, first + up], axis=1)
