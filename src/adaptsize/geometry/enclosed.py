"""The volume that a closed surface encloses, and the area that closed curves enclose."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from adaptsize.typing import FloatArray

if TYPE_CHECKING:  # child processes of generators import this file, and no kernels
    from adaptsize.background import SimplexMesh


def enclosed_measure(skin: SimplexMesh) -> float:
    """Return the enclosed volume or area.

    NaN if the surface or curve is not closed and oriented (see `is_oriented`).
    """
    if not is_oriented(skin):
        return math.nan
    return abs(float(cone_measures(skin, skin.points.mean(axis=0)).sum()))


def is_oriented(skin: SimplexMesh) -> bool:
    """Whether each facet has two cells, and all cells have the same side in common."""
    if not (skin.facet_cell_counts == 2).all():
        return False
    cells = skin.cells.astype(np.int64)
    if skin.cell_dim == 1:
        starts = cells[:, 0]
    else:
        starts = (cells * skin.n_points + np.roll(cells, -1, axis=1)).ravel()
    return len(np.unique(starts)) == len(starts)  # no two along an edge in the same direction


def cone_measures(skin: SimplexMesh, apex: FloatArray) -> FloatArray:
    """Return the signed volumes or areas between an apex and the cells of a surface or curve.

    Parameters
    ----------
    skin : SimplexMesh
        Triangles in space, or segments in the plane.
    apex : float64[dim] or float64[n_cells, 1, dim]
        One point, or one per cell.

    Returns
    -------
    float64[n_cells]
        Their sum over a closed surface does not depend on the apex, except for rounding.
    """
    determinants: FloatArray = np.linalg.det(skin.points[skin.cells] - apex)
    return determinants / math.factorial(skin.dim)
