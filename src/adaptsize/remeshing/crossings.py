"""Facets of a surface that cross others, and sizes with which an adapted surface has none.

Where two parts of a surface are closer than the tolerance, facets of the requested sizes may leave
the given surface by more than the distance between them, and cross.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.crossings import find_crossings, new_crossings
from adaptsize.background import SimplexMesh
from adaptsize.background.location import parts_of
from adaptsize.geometry.solid import SLACK
from adaptsize.remeshing import tuning
from adaptsize.remeshing.sizing import Size
from adaptsize.typing import FloatArray


class CrossingFacets(NamedTuple):
    """The facets that cross others; for each, the other one, depth and place of the deepest."""

    cells: npt.NDArray[np.intp]
    others: npt.NDArray[np.intp]
    depths: FloatArray
    places: FloatArray


def crossing_facets(surface: SimplexMesh, slack: float = SLACK) -> CrossingFacets:
    """Return the facets that cross others by more than ``slack`` times the diagonal.

    Those of files cross by what the coordinates have been rounded.  It costs .03 s for 20 000
    triangles.
    """
    locator, n = surface.locator, surface.n_cells
    found = new_crossings(n)
    for first, last in parts_of(n, 1024):
        find_crossings(locator.tree, slack * surface.diagonal * locator.scale, first, last, found)
    depths, partners, places = found[:3]
    rows = np.flatnonzero(depths > 0.0)
    cells = locator.cell_of_row[rows].astype(np.intp)
    others = locator.cell_of_row[partners[rows]].astype(np.intp)
    return CrossingFacets(cells, others, depths[rows] / locator.scale, places[rows] / locator.scale)


def smaller_at(size: Size, places: FloatArray) -> Size:
    """Return sizes that are a share of the given ones at places, and grow off these."""
    least = tuning.SIZE_AT_CROSSINGS * size(places)

    def smaller(points: FloatArray) -> FloatArray:
        sizes = size(points)
        for place, at_place in zip(places, least, strict=True):
            away = np.linalg.norm(points - place, axis=1)
            sizes = np.minimum(sizes, at_place + tuning.GROWTH_OFF_CROSSINGS * away)
        return sizes

    return smaller
