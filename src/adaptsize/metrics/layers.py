"""Metrics of boundary layers."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    FARTHEST,
    as_aspect,
    as_float_array,
    as_number,
    as_sizes,
    as_values,
    refuse_where,
)
from adaptsize.metrics.metric import Metric
from adaptsize.typing import FloatArray


def metric_from_layers(
    distance: npt.ArrayLike,
    normals: npt.ArrayLike,
    *,
    first_height: float,
    growth: float = 1.2,
    tangential: npt.ArrayLike = np.inf,
    max_aspect: float = 1000.0,
    last_over_tangential: float = 1.0,
) -> Metric:
    r"""Return the metric of layers along a wall, from the distance to it.

    Layers whose heights grow by a factor r, beginning with :math:`h_1` at the wall, have the
    height

    .. math:: h_n = h_1 + (r - 1)\, |d|

    at the distance d.  This is the size along the normal.  The sizes along the wall are
    ``tangential``, at most ``max_aspect`` times the size along the normal.  Where that exceeds
    ``tangential``, the metric is isotropic.

    Parameters
    ----------
    distance : array_like of float, shape (n,)
        Distance of the nodes to the wall, of either sign; inf where there are no layers.
    normals : array_like of float, shape (n, dim)
        Gradient of the distance, dim 2 or 3, of any length; zero where it is not known, there the
        metric is isotropic.
    first_height : float
        Height of the first layer.
    growth : float, default 1.2
        Factor r >= 1 between the heights of successive layers.
    tangential : float or array_like of float, shape (n,), default inf
        Size along the wall.
    max_aspect : float, default 1000
        Limit of the aspect ratio, at least 1.
    last_over_tangential : float, default 1
        Limit of the height of a layer over ``tangential``, above 0 and at most 1.  Below 1, layers
        of this height follow the last one that grows: set the distance to inf where they end.

    Returns
    -------
    Metric

    Raises
    ------
    ValueError
        If a shape is wrong, a value is NaN, or an option is out of range.

    Notes
    -----
    The result has the slope r - 1 along the normal.  Limit the metric with this g, at least, to
    keep the layers as requested.

    Examples
    --------
    Points 0 and 0.1 above a wall along x, and 2 above it:

    >>> metric = metric_from_layers(
    ...     [0.0, 0.1, 2.0], [[0, 1], [0, 1], [0, 1]], first_height=0.001, tangential=0.2
    ... )
    >>> metric.sizes.round(3)
    array([[0.001, 0.2  ],
           [0.021, 0.2  ],
           [0.2  , 0.2  ]])
    >>> metric.size_along([0.0, 1.0]).round(3)
    array([0.001, 0.021, 0.2  ])
    """
    d = np.abs(as_float_array("distance", distance))
    d = as_float_array("distance", d, d.shape[:1] if d.ndim else (1,))
    far = ~(np.abs(d) <= FARTHEST) & ~np.isinf(d)
    refuse_where("distance", far, d, f"must be inf or at most {FARTHEST:g} in size")
    n = as_values("normals", normals)
    if n.ndim != 2 or n.shape[1] not in (2, 3) or len(n) != len(d):
        raise ValueError(f"normals must have shape ({len(d)}, 2) or ({len(d)}, 3), got {n.shape}")
    first = as_number("first_height", first_height, lower=0.0, strict=True)
    slope = as_number("growth", growth, lower=1.0) - 1.0
    aspect = as_aspect("max_aspect", max_aspect)
    most = as_number(
        "last_over_tangential", last_over_tangential, lower=0.0, strict=True, upper=1.0
    )
    given = as_float_array("tangential", tangential)
    along = as_sizes("tangential", np.broadcast_to(given, d.shape) if given.ndim == 0 else given,
                     d.shape)  # fmt: skip
    across = first + slope * np.where(np.isfinite(d), d, 0.0)
    across = np.where(np.isfinite(d), np.minimum(across, most * along), along)
    known = np.linalg.norm(n, axis=1) > 0.0
    # The limit is written so that a size without a bound stays without one.
    sizes = np.repeat(np.where(np.isfinite(d), np.minimum(along, aspect * across), along)[:, None],
                      n.shape[1], axis=1)  # fmt: skip
    sizes[~known] = across[~known, None]
    sizes[:, 0] = across
    return Metric.of(sizes, frames(n))


def frames(normals: FloatArray) -> FloatArray:
    """Return orthonormal frames whose first column is along given vectors.

    Parameters
    ----------
    normals : float64[n, dim]
        Vectors of any length; a zero vector gets any frame.

    Returns
    -------
    float64[n, dim, dim]
    """
    count, dim = normals.shape
    length = np.linalg.norm(normals, axis=1)
    axis = np.zeros(dim)
    axis[0] = 1.0
    unit = np.where(length[:, None] > 0.0, normals, axis)
    unit = unit / np.linalg.norm(unit, axis=1)[:, None]
    # Householder's reflection that maps the first axis to -sign(u_1) u.
    sign = np.where(unit[:, 0] >= 0.0, 1.0, -1.0)
    v = unit.copy()
    v[:, 0] += sign
    scale = 2.0 / np.einsum("ni,ni->n", v, v)
    frame = np.eye(dim) - scale[:, None, None] * v[:, :, None] * v[:, None, :]
    frame[:, :, 0] *= -sign[:, None]
    return np.asarray(frame.reshape(count, dim, dim))
