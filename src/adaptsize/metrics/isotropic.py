"""Metrics with one size for all directions."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_sizes, as_whole_number
from adaptsize.metrics.metric import Metric


def isotropic_metric(h: npt.ArrayLike, dim: int) -> Metric:
    """Return the metric with the same size in all directions.

    Parameters
    ----------
    h : array_like of float, shape (n,)
        Sizes, positive; inf where there is no bound.
    dim : int
        1, 2 or 3.

    Returns
    -------
    Metric

    Examples
    --------
    >>> isotropic_metric([0.5, 2.0], 3)
    Metric(2 nodes in 3-D, sizes 0.5 to 2, aspect ratio up to 1)
    """
    size = as_float_array("h", h).ravel()
    size = as_sizes("h", size, size.shape)
    dim = as_whole_number("dim", dim, lower=1, upper=3)
    shape = (len(size), dim, dim)
    return Metric.of(np.repeat(size[:, None], dim, axis=1), np.broadcast_to(np.eye(dim), shape))
