"""The minimum of several upper bounds."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_limits, as_sizes
from adaptsize.typing import FloatArray

#: Least size over the diameter: a noisy spot, or a part that tapers to nothing, must not require
#: more than 10^6 elements along the part.
SMALLEST_SHARE = 1e-6


def minimum(*h0: npt.ArrayLike, hmin: float | None = None, hmax: float | None = None) -> FloatArray:
    """Return the minimum of several upper bounds at each node, clipped to two limits.

    Parameters
    ----------
    *h0 : array_like of float
        Upper bounds, one or more arrays of the same shape; positive, ``inf`` where
        there is no bound.
    hmin : float, optional
        Smallest size, positive.  Overrides ``h0``.
    hmax : float, optional
        Largest size, positive, at least ``hmin``.  Also the size at nodes without a
        bound.

    Returns
    -------
    ndarray of float64
        A new array; ``inf`` where no array has a bound and ``hmax`` is not given.

    Raises
    ------
    ValueError
        If no array is given, the shapes differ, a size is not positive or NaN, or
        ``hmin > hmax``.

    Notes
    -----
    Apply gradient limiting after this, not before: the minimum of a limited field and
    another bound is not limited any more.  ``hmin`` still holds afterwards, because
    limiting lowers no size below the smallest one.

    Examples
    --------
    >>> import numpy as np
    >>> minimum([0.1, 2.0, np.inf], [1.0, 1.0, np.inf], hmin=0.5)
    array([0.5, 1. , inf])
    >>> minimum([0.1, 2.0, np.inf], hmax=1.5)
    array([0.1, 1.5, 1.5])
    """
    if not h0:
        raise ValueError("minimum needs at least one array of sizes, got none")
    shape = np.shape(h0[0])
    smallest = as_sizes("h0[0]", h0[0], shape).copy()
    for number, bound in enumerate(h0[1:], start=1):
        np.minimum(smallest, as_sizes(f"h0[{number}]", bound, shape), out=smallest)
    return np.asarray(np.clip(smallest, *as_limits(hmin, hmax)))
