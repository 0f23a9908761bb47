"""Which cells of an octree to refine: ready answers for `Octree.build`."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_number, as_slope, refuse_where
from adaptsize.typing import BoolArray, FloatArray

#: Takes the centres and the edge lengths of m cells, float64[m, dim] both; returns bool[m].
NeedsRefinement: TypeAlias = Callable[[FloatArray, FloatArray], BoolArray]
#: Takes points, float64[m, dim]; returns one number for each.
PointFunction: TypeAlias = Callable[[FloatArray], npt.ArrayLike]


def refine_at_boundary(
    signed_distance: PointFunction, spacing: float | None = None
) -> NeedsRefinement:
    """Return a criterion that wants small cells wherever the boundary may pass through.

    A cell is refined if its longest edge is longer than ``spacing`` and the boundary is no
    farther from its centre than its corners are, so that it may cut the cell.  The number
    of leaves then grows like the boundary, not like the volume, as ``spacing`` shrinks.

    Parameters
    ----------
    signed_distance : callable
        Takes points, float64[m, dim], and returns the signed distance of each to the
        boundary; the sign does not matter.
    spacing : float, optional
        Longest edge that is allowed for cells at the boundary, > 0.  Without it, cells are
        refined down to ``max_level``.

    Returns
    -------
    callable
        For `Octree.build`.

    Raises
    ------
    ValueError
        If ``spacing`` is not positive; when the criterion is asked, if the function does
        not return one number per point, or returns nan.

    Notes
    -----
    No cell that the boundary cuts is missed, provided that the function changes by no more
    than the distance between two points.  A signed distance does so, and so does any
    function whose gradient is at most 1, but such a function may refine more cells.

    Examples
    --------
    >>> import numpy as np
    >>> from adaptsize import Octree, refine_at_boundary
    >>> def circle(x):
    ...     return np.hypot(x[:, 0], x[:, 1]) - 0.7
    >>> tree = Octree.build([-1, -1], [1, 1], refine_at_boundary(circle, 0.1), max_level=9)
    >>> tree
    Octree(244 leaves of level 2 to 5, 2-D)
    """
    limit = 0.0 if spacing is None else as_number("spacing", spacing, lower=0.0, strict=True)

    def needs_refinement(centres: FloatArray, sizes: FloatArray) -> BoolArray:
        phi = _ask("signed_distance", signed_distance, centres)
        half_diagonal = 0.5 * np.linalg.norm(sizes, axis=1)
        result: BoolArray = (np.abs(phi) <= half_diagonal) & (sizes.max(axis=1) > limit)
        return result

    return needs_refinement


def refine_to_size(
    size: PointFunction, *, factor: float = 1.0, g: float | None = None
) -> NeedsRefinement:
    """Return a criterion that wants no cell larger than a multiple of the size in it.

    Parameters
    ----------
    size : callable
        Takes points, float64[m, dim], and returns positive sizes, inf where nothing is
        asked: a `SizeFunction`, for one.
    factor : float
        No leaf has an edge longer than ``factor`` times the smallest size in it (but for
        ``max_level``), > 0.
    g : float, optional
        Bound on the gradient of the size.  Then the size is asked for at the centre of each
        cell only, and ``size - g * diagonal / 2`` is a bound for the whole cell, so that no
        small size is overlooked, however far it lies between the samples.  Without it, the
        size is asked for at the centre and at the corners, and one that is small somewhere
        between them only is overlooked.

    Returns
    -------
    callable
        For `Octree.build`.

    Raises
    ------
    ValueError
        If ``factor`` is not positive or ``g`` is negative; when the criterion is asked, if
        ``size`` does not return one number per point, or returns one that is not positive.

    Notes
    -----
    With ``g`` leaves may come out smaller than need be, for the size is taken to fall from
    the centre to a corner as fast as it may: a cube is refined if its edge is longer than
    ``factor * size / (1 + factor * g * sqrt(dim) / 2)``, size at its centre.  The gradient
    of a `SizeFunction` may exceed the limit that its nodal values obey, in some cells.

    Examples
    --------
    >>> from adaptsize import Octree, refine_to_size
    >>> def size(x):
    ...     return 0.01 + 0.2 * abs(x - 0.3).max(axis=1)
    >>> tree = Octree.build([0, 0], [1, 1], refine_to_size(size, g=0.2), max_level=12)
    >>> tree
    Octree(874 leaves of level 4 to 7, 2-D)
    """
    factor = as_number("factor", factor, lower=0.0, strict=True)
    gradient = None if g is None else as_slope("g", g)

    def needs_refinement(centres: FloatArray, sizes: FloatArray) -> BoolArray:
        smallest = _ask("size", size, centres, positive=True)
        if gradient is None:
            for corner in np.ndindex(*[2] * centres.shape[1]):
                where = centres + (np.array(corner) - 0.5) * sizes
                smallest = np.minimum(smallest, _ask("size", size, where, positive=True))
        else:
            smallest = smallest - gradient * 0.5 * np.linalg.norm(sizes, axis=1)
        result: BoolArray = sizes.max(axis=1) > factor * smallest
        return result

    return needs_refinement


def _ask(
    name: str, function: PointFunction, points: FloatArray, *, positive: bool = False
) -> FloatArray:
    """Return the values of a function at points, after a look at them."""
    values = as_float_array(f"{name}(points)", function(points), (len(points),))
    bad, wanted = (~(values > 0.0), "positive") if positive else (np.isnan(values), "a number")
    refuse_where(f"{name}(points)", bad, values, f"must be {wanted}")
    return values
