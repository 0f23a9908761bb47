"""Moves of nodes that are taken back where cells become too flat."""

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.smoothing import fill_quality
from adaptsize.background._mesh_arrays import read_only
from adaptsize.remeshing import tuning
from adaptsize.typing import FloatArray, IntArray


def take_back(
    points: FloatArray,
    cells: IntArray,
    old: FloatArray,
    nodes: npt.NDArray[np.integer],
    least: FloatArray,
) -> None:
    """Take back moves of nodes whose cells have less than the least quality."""
    for _ in range(tuning.ROUNDS_OF_TAKING_BACK):  # taking back one move may spoil another
        worse = nodes[worst_of_nodes(points, cells)[nodes] < least[nodes]]
        worse = worse[(points[worse] != old[worse]).any(axis=1)]
        if len(worse) == 0:
            return
        points[worse] = old[worse]
    points[:] = old


def worst_of_nodes(points: FloatArray, cells: IntArray) -> FloatArray:
    """Return the smallest quality of the cells around each node."""
    worst = np.ones(len(points))
    np.minimum.at(worst, cells, quality_of(points, cells)[:, None])
    return worst


def quality_of(points: FloatArray, cells: IntArray) -> FloatArray:
    """Return the quality of each cell."""
    quality = np.empty(len(cells))
    fill_quality(read_only(points), read_only(cells), quality)
    return quality
