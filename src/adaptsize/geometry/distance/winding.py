"""Inside test for surfaces that may be defective, by the generalised winding number."""

from __future__ import annotations

from typing import NamedTuple

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


class Rule(NamedTuple):
    """Which winding numbers of an oriented surface are those of its solid.

    If each edge is in two facets, they are above one half: what is turned inside out beside the
    solid, as where offset surfaces cross themselves, does not belong to it.  Of other surfaces the
    absolute value counts: facets beside holes may have either side outside, and bodies that touch
    along an edge or a face may be oriented differently.
    """

    is_closed: bool = False
    """Whether the surface has no holes, so that winding numbers are integers."""
    is_signed: bool = False
    """Whether each edge is in two facets, also."""

    def holds_for(self, numbers: FloatArray) -> BoolArray:
        """Return which winding numbers are those of the solid."""
        least = 0.5 if self.is_closed else 0.5 + tuning.WINDING_ERROR
        return np.asarray((numbers if self.is_signed else np.abs(numbers)) > least)


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
        rule: Rule | None = None,
    ) -> BoolArray:
        """Return which points are inside, by default by the absolute value."""
        return (Rule() if rule is None else rule).holds_for(self(points, report))
