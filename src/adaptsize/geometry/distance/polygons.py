"""Exact inside test for polygons in the plane."""

import numpy as np

from adaptsize._kernels.polygons import mark_inside
from adaptsize._kernels.trees import new_stack
from adaptsize.background._curve import along_curve, boxes_over_leaves
from adaptsize.typing import BoolArray, FloatArray


class Polygons:
    """Polygons in a binary tree of boxes over their segments.

    All polygons form one closed chain, which runs from the first corner of each to that of the
    next one along a Morton curve, and back in the end.

    Parameters
    ----------
    polygons : list of float64[n, 2]
        Corners in order, without repetition of the first.
    """

    def __init__(self, polygons: list[FloatArray]) -> None:
        order = along_curve(np.array([corners[0] for corners in polygons]))
        back = [polygons[i][:1] for i in order[-2::-1]]
        chain = np.concatenate([c for i in order for c in (polygons[i], polygons[i][:1])] + back)
        n_leaves = 1 << (len(chain) - 2).bit_length()
        missing = n_leaves + 1 - len(chain)
        self._chain = np.pad(chain, ((0, missing), (0, 0)), mode="edge")
        start, end = self._chain[:-1], self._chain[1:]
        self._boxes = boxes_over_leaves(np.minimum(start, end), np.maximum(start, end))

    def contains(self, points: FloatArray) -> BoolArray:
        """Return which points an odd number of polygons contains."""
        inside = np.empty(len(points), np.bool_)
        given = np.ascontiguousarray(points)
        mark_inside(self._chain, self._boxes, given, new_stack().box, inside)
        return inside
