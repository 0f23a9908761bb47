"""Inside test for surfaces that may be defective, by the generalised winding number."""

import numpy as np

from adaptsize._kernels.trees import new_stack
from adaptsize._kernels.winding import N_MOMENTS, fill_moments, wind
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import tree_over
from adaptsize.background.location import in_space
from adaptsize.background.merging import place_numbers
from adaptsize.geometry.distance.orientation import oriented
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

# Points between two progress reports: about 0.2 s.
_CHUNK = 50_000


class WindingNumber:
    """Winding number of a surface around points, by a tree of dipoles.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space or segments in the plane.

    Notes
    -----
    This is the generalised winding number of Jacobson et al. [1]_, summed over a tree as by
    Barill et al. [2]_.  It is harmonic away from the surface, an integer if the surface is
    closed, and varies smoothly from one integer to the next through holes.  Therefore holes,
    slivers, cracks and duplicate or overlapping facets are harmless.

    References
    ----------
    .. [1] A. Jacobson, L. Kavan, O. Sorkine-Hornung, "Robust inside-outside segmentation using
       generalized winding numbers", ACM Trans. Graph. 32 (2013) 33.
    .. [2] G. Barill, N. G. Dickson, R. Schmidt, D. I. W. Levin, A. Jacobson, "Fast winding
       numbers for soups and clouds", ACM Trans. Graph. 37 (2018) 43.
    """

    def __init__(self, surface: SimplexMesh) -> None:
        self._tree = tree_over(in_space(surface.points), surface.cells)[0]
        self._moments = np.empty((len(self._tree.boxes), N_MOMENTS))
        fill_moments(self._tree, self._moments)

    def __call__(self, points: FloatArray, report: ProgressCallback | None = None) -> FloatArray:
        """Return the winding number at points, float64[n]."""
        queries = in_space(points)
        n = len(queries)
        numbers = np.empty(n)
        stack = new_stack().box
        for first in range(0, n, _CHUNK):
            last = min(first + _CHUNK, n)
            # Parts of the surface are expanded as a whole beyond this number of their radii.
            wind(self._tree, self._moments, 1.5, queries[first:last], stack, numbers[first:last])
            if report is not None:
                report("sign", last / n)
        return numbers

    def contains(self, points: FloatArray, report: ProgressCallback | None = None) -> BoolArray:
        """Return whether the absolute winding number of each point exceeds one half."""
        # Tolerance for the error of the expansion: next to an open sheet the number is close to
        # 1/2.
        return np.asarray(np.abs(self(points, report)) > 0.5 + 0.05)


def winding_of(surface: SimplexMesh) -> tuple[WindingNumber, bool]:
    """Return the winding number of a surface, and whether it is an integer everywhere.

    If the surface is not closed, facets that contradict their neighbours are turned first: they
    may be the only defect.
    """
    is_whole = is_cycle(surface)
    if not is_whole:
        surface = oriented(surface)
        is_whole = is_cycle(surface)
    return WindingNumber(surface), is_whole


def is_cycle(surface: SimplexMesh) -> bool:
    """Return whether the oriented facets have no boundary, so that winding numbers are integers.

    Coincident nodes are identified.
    """
    cells = same_places(surface.points, surface.cells)[surface.cells].astype(np.int64)
    start, end = cells[:, 0], cells[:, 1]
    if surface.cell_dim == 2:  # the edges in both directions
        after = np.roll(cells, -1, axis=1)
        n = surface.n_points
        start, end = cells * n + after, after * n + cells
    return np.array_equal(np.sort(start, axis=None), np.sort(end, axis=None))


def same_places(points: FloatArray, cells: IntArray) -> IntArray:
    """Return for each point the number of its place, from 0; coincident points have the same.

    Points coincide if they differ by rounding relative to the extent of the points of cells.
    """
    used = points[cells]
    extent = float(np.linalg.norm(used.max(axis=(0, 1)) - used.min(axis=(0, 1))))
    # Corners closer to each other, in diagonals of the mesh, coincide when edges are matched.
    return place_numbers(points, 1e-9 * extent).astype(np.int32)
