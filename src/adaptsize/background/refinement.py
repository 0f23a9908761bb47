"""Refinement criteria for `Octree.build`."""

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
    """Return a criterion that refines cells that the boundary may intersect.

    A cell is refined if its longest edge is longer than ``spacing`` and the boundary is no
    farther from its centre than its corners are, so that the boundary may intersect the cell.
    As ``spacing`` decreases, the number of leaves grows like the number of boundary cells, not
    like the number of cells in the volume.

    Parameters
    ----------
    signed_distance : callable
        Takes points, float64[m, dim], and returns the signed distance of each to the
        boundary; the sign is ignored.
    spacing : float, optional
        Longest edge allowed for cells at the boundary, > 0.  If it is omitted, cells are
        refined down to ``max_level``.

    Returns
    -------
    callable
        For `Octree.build`.

    Raises
    ------
    ValueError
        If ``spacing`` is not positive.  The criterion raises a ValueError if the function does
        not return one number per point, or returns nan.

    Notes
    -----
    No cell that the boundary intersects is missed, provided that the function changes by no
    more than the distance between two points.  This holds for a signed distance and for any
    function whose gradient is at most 1; such a function may refine more cells.

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
    """Return a criterion that refines cells larger than a multiple of the size in them.

    Parameters
    ----------
    size : callable
        Takes points, float64[m, dim], and returns positive sizes, inf where there is no
        request; for example a `SizeFunction`.
    factor : float
        Factor > 0: no leaf has an edge longer than ``factor`` times the smallest size in it,
        unless ``max_level`` is reached.
    g : float, optional
        Bound on the gradient of the size.  If it is given, the size is evaluated at the centre
        of each cell only, and ``size - g * diagonal / 2`` is a lower bound in the whole cell;
        no small size is missed.  If it is omitted, the size is evaluated at the centre and at
        the corners, and a small size between these points is missed.

    Returns
    -------
    callable
        For `Octree.build`.

    Raises
    ------
    ValueError
        If ``factor`` is not positive or ``g`` is negative.  The criterion raises a ValueError
        if ``size`` does not return one number per point, or returns one that is not positive.

    Notes
    -----
    With ``g``, leaves may be smaller than necessary, because the criterion assumes the steepest
    decrease from the centre to a corner.  A cube is refined if its edge is longer than
    ``factor * size / (1 + factor * g * sqrt(dim) / 2)``, with the size at its centre.  In some
    cells, the gradient of a `SizeFunction` may exceed the limit that its nodal values satisfy.

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
    """Return the checked values of a function at points."""
    values = as_float_array(f"{name}(points)", function(points), (len(points),))
    bad, wanted = (~(values > 0.0), "positive") if positive else (np.isnan(values), "a number")
    refuse_where(f"{name}(points)", bad, values, f"must be {wanted}")
    return values
