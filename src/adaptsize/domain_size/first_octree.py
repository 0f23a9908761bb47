"""The octree with which the refinement by the size of an implicit domain starts."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from adaptsize.background import Octree
from adaptsize.geometry.implicit_surface import Implicit
from adaptsize.typing import BoolArray, FloatArray

#: Cells along the longest side of the box, in the plane and in space: everywhere, ...
_COARSEST = {2: 32, 3: 16}
#: ... and where the zero level is not nearly straight in a cell.
_FINEST = {2: 512, 3: 128}
# A function is nearly linear in a cell if it is, at the corners, up to this share of its change.
_STRAIGHT = 0.1
# The zero level may pass through a cell if the value at its centre is below this multiple of the
# change to the corners.
_MARGIN = 1.2


def octree_around(function: Implicit, lower: FloatArray, upper: FloatArray) -> Octree:
    """Return an octree that shows all parts of the zero level of a function.

    Cells through which the zero level may pass are refined while the function is not nearly
    linear in them: at bends and corners, and where two parts are close to each other.

    Parameters
    ----------
    function : callable
    lower, upper : float64[dim]
        Corners of the box.
    """
    extent, dim = float((upper - lower).max()), len(lower)
    coarsest, finest = extent / _COARSEST[dim], extent / _FINEST[dim]

    def needs_refinement(centres: FloatArray, sizes: FloatArray) -> BoolArray:
        edge = float(sizes.max())
        if edge > coarsest:
            return np.ones(len(centres), np.bool_)
        if edge <= finest:
            return np.zeros(len(centres), np.bool_)
        return _is_bent(function, centres, 0.5 * sizes)

    deepest = math.ceil(math.log2(_FINEST[dim]))
    return Octree.build(lower, upper, needs_refinement, max_level=deepest)


def _is_bent(function: Implicit, centres: FloatArray, half: FloatArray) -> BoolArray:
    """Return in which cells the zero level may be, and the function is not nearly linear."""
    at_centre = function(centres)
    dim = centres.shape[1]
    rise, change = np.zeros(centres.shape), np.zeros(centres.shape)
    for axis in range(dim):
        step = np.zeros(centres.shape)
        step[:, axis] = half[:, axis]
        above, below = function(centres + step), function(centres - step)
        rise[:, axis] = 0.5 * (above - below)
        change[:, axis] = np.maximum(np.abs(above - at_centre), np.abs(below - at_centre))
    reach = change.sum(axis=1)
    off = np.zeros(len(centres))
    for corner in product((-1.0, 1.0), repeat=dim):
        linear = at_centre + rise @ np.array(corner)
        off = np.maximum(off, np.abs(function(centres + corner * half) - linear))
    possible = np.abs(at_centre) <= _MARGIN * reach
    return np.asarray(possible & (off > _STRAIGHT * reach))
