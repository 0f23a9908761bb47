"""The smallest ball that encloses points."""

import itertools
import math

import numpy as np

from adaptsize.typing import FloatArray

# Points outside by this share of the radius are on the ball.
_SLACK = 1e-12


def enclosing_diameter(points: FloatArray) -> float:
    """Return the diameter of the smallest ball that encloses points.

    The ball through a few of the points grows until it encloses all of them: the farthest point
    outside replaces one that is no longer needed [1]_.

    Parameters
    ----------
    points : float64[n, dim]
        dim 1, 2 or 3; n >= 1.

    Returns
    -------
    float
        Bit for bit the same in any order of the points; under rotations the same to rounding.

    Notes
    -----
    O(n) time for each of some ten steps.

    References
    ----------
    .. [1] B. Gaertner, "Fast and robust smallest enclosing balls", ESA 1999, LNCS 1643, 325-338.

    Examples
    --------
    >>> enclosing_diameter(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 4.0], [1.0, 1.0]]))
    5.0
    """
    lower = points.min(axis=0)
    largest = float((points - lower).max())
    if largest == 0.0:
        return 0.0
    scale = math.ldexp(1.0, -math.frexp(largest)[1])
    local = (points - lower) * scale
    support = _farthest(local, 0.5 * local.max(axis=0))[None, :]
    centre, radius = support[0], 0.0
    while True:
        far = _farthest(local, centre)
        if np.linalg.norm(far - centre) <= radius * (1.0 + _SLACK):
            return 2.0 * radius / scale
        support, centre, grown = _ball_around(np.vstack([support, far]))
        if grown <= radius:  # rounding
            return 2.0 * radius / scale
        radius = grown


def _farthest(points: FloatArray, centre: FloatArray) -> FloatArray:
    """Return the point that is farthest from another; of several, the first by coordinates."""
    square = np.zeros(len(points))
    for axis in range(points.shape[1]):
        square += (points[:, axis] - centre[axis]) ** 2
    ties = points[square == square.max()]
    return np.asarray(ties[np.lexsort(ties.T[::-1])[0]])


def _ball_around(points: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return the points on the smallest ball around at most dim + 2 points, centre and radius."""
    points = points[np.lexsort(points.T[::-1])]
    balls: list[tuple[FloatArray, FloatArray, float]] = []
    for count in range(2, points.shape[1] + 2):
        for chosen in itertools.combinations(range(len(points)), count):
            some = points[list(chosen)]
            centre = _circumcentre(some)
            if centre is None:
                continue
            radius = float(np.linalg.norm(some - centre, axis=1).max())
            outside = np.linalg.norm(points - centre, axis=1).max() > radius * (1.0 + _SLACK)
            if not outside:
                balls.append((some, centre, radius))
    return min(balls, key=lambda ball: ball[2])


def _circumcentre(points: FloatArray) -> FloatArray | None:
    """Return the point at equal distance from others in their plane; None if there is none."""
    edges = points[1:] - points[0]
    gram = edges @ edges.T
    weights = np.linalg.lstsq(2.0 * gram, np.diag(gram), rcond=None)[0]
    centre = points[0] + weights @ edges
    distances = np.linalg.norm(points - centre, axis=1)
    if np.ptp(distances) > 1e-9 * distances.max():
        return None
    return np.asarray(centre)
