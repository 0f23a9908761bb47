"""Local maxima of the depth inside a boundary."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt

from adaptsize.geometry.distance.closest_points import Boundary
from adaptsize.typing import BoolArray, FloatArray

# Largest number of steps, and smallest step as a share of the first.
_STEPS = 100
_SMALLEST = 1e-5
# A point is surrounded by the boundary if a mean of the directions around it is shorter than this.
_SURROUNDED = 0.1
# Weight of the constraint on the sum of the weights of a mean, relative to its length.
_WEIGHT = 1e3


def climb(
    boundary: Boundary, points: FloatArray, reach: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return the centres of balls that the boundary touches on all sides.

    Each step leads away from the boundary, against the shortest mean of the directions to the
    boundary around a point.  This is the steepest ascent where several fronts meet [1]_.  If the
    mean vanishes, or the depth does not increase, the step is halved.

    Parameters
    ----------
    boundary : Boundary
    points : float64[n, dim]
        Start points inside.
    reach : float64[n]
        Length of the first steps.

    Returns
    -------
    centres : float64[m, dim]
    reached : bool[n]
        Whether a centre was found from each point.

    References
    ----------
    .. [1] J. V. Burke, A. S. Lewis, M. L. Overton, "A robust gradient sampling algorithm for
       nonsmooth, nonconvex optimization", SIAM J. Optim. 15 (2005) 751-779.
    """
    dim = points.shape[1]
    around = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=dim)))
    around /= np.maximum(np.linalg.norm(around, axis=1), 1.0)[:, None]
    best, step = points.copy(), 0.5 * reach
    depth = boundary.seen_from(best).depth
    surrounded = np.zeros(len(best), np.bool_)
    going = np.arange(len(best))
    for _ in range(_STEPS):
        probes = best[going, None, :] + step[going, None, None] * around
        outward = boundary.seen_from(probes.reshape(-1, dim)).outward.reshape(probes.shape)
        mean = np.array([_shortest_mean(directions) for directions in outward]).reshape(-1, dim)
        length = np.linalg.norm(mean, axis=1)
        surrounded[going] = length < _SURROUNDED
        way = mean * (step[going] / np.maximum(length, _SURROUNDED))[:, None]
        seen = boundary.seen_from(best[going] - way)
        better = (seen.depth > depth[going]) & ~surrounded[going]
        best[going[better]] -= way[better]
        depth[going[better]] = seen.depth[better]
        step[going[~better]] *= 0.5
        going = going[step[going] > _SMALLEST * reach[going]]
        if len(going) == 0:
            break
    reached = surrounded.copy()
    reached[going] = False
    return best[reached], reached


def _shortest_mean(directions: FloatArray) -> FloatArray:
    """Return the shortest of all weighted means, float64[dim], of vectors, float64[n, dim]."""
    from scipy.optimize import nnls

    rows = np.vstack([directions.T, np.full(len(directions), _WEIGHT)])
    wanted = np.zeros(len(rows))
    wanted[-1] = _WEIGHT
    weights: npt.NDArray[np.float64] = nnls(rows, wanted)[0]
    return np.asarray(weights @ directions / weights.sum())
