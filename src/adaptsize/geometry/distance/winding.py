"""Inside test for surfaces that may be defective, by the generalised winding number."""

import numpy as np

from adaptsize._kernels.trees import new_stack
from adaptsize._kernels.winding import N_MOMENTS, fill_moments, wind
from adaptsize._progress import silent
from adaptsize._workers import in_all_threads
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import tree_over
from adaptsize.background.location import in_space
from adaptsize.geometry import tuning
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback

# Points per chunk of a thread: some 10 ms.
_CHUNK = 2048


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

        def task(first: int, last: int) -> None:
            stack, own = new_stack().box, numbers[first:last]
            wind(self._tree, self._moments, tuning.FAR_IN_RADII, queries[first:last], stack, own)

        in_all_threads(task, n, _CHUNK, "sign", report or silent)
        return numbers

    def contains(
        self,
        points: FloatArray,
        report: ProgressCallback | None = None,
        *,
        is_closed: bool = False,
    ) -> BoolArray:
        """Return which points are inside of the solid of an oriented surface, see `is_inside`."""
        return is_inside(self(points, report), is_closed=is_closed)


def is_inside(numbers: FloatArray, *, is_closed: bool) -> BoolArray:
    """Return whether winding numbers of an oriented surface are those of its solid.

    If the surface is closed, they are above one half: what is turned inside out beside it, as where
    offset surfaces cross themselves, is no solid.  The facets of a surface with holes may have
    either side outside, so that the absolute value counts.
    """
    if is_closed:
        return np.asarray(numbers > 0.5)
    return np.asarray(np.abs(numbers) > 0.5 + tuning.WINDING_ERROR)
