"""Normals and curvatures of the zero level of a function, by differences at steps of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from adaptsize._checks import as_float_array, refuse_where
from adaptsize.typing import FloatArray

#: f(points[n, dim]) -> float64[n], checked.
Implicit: TypeAlias = Callable[[FloatArray], FloatArray]

# Steps are adapted until the normal turns by about this angle on each of them; ...
_TURN = 0.1
# ... by up to this factor at a time, ...
_STEP_CHANGE = 1.0 / 8.0
# ... at most so often.
_MOST_CHANGES = 8
# The curvature is evaluated again with these shares of the step.  At a kink it grows, by more than
# this factor.  Beside a kink it falls.
_SHORTER = (0.25, 0.0625)


def checked(function: Callable[[FloatArray], object]) -> Implicit:
    """Return a function of points that refuses values of a wrong shape, nan and inf."""

    def values_at(points: FloatArray) -> FloatArray:
        values = as_float_array("boundary(points)", function(points), (len(points),))  # type: ignore[arg-type]
        refuse_where("boundary(points)", ~np.isfinite(values), values, "must be finite")
        return values

    return values_at


class LevelFrame(NamedTuple):
    """The zero level around some of its points.

    Parameters
    ----------
    normals : float64[m, dim]
        Along the gradient.
    tangents : float64[m, dim - 1, dim]
    curvatures : float64[m, dim - 1, dim - 1]
        Second fundamental form, positive where convex.
    """

    normals: FloatArray
    tangents: FloatArray
    curvatures: FloatArray


def gradient_of(
    function: Implicit, points: FloatArray, step: float | FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the function, its gradient, and the largest jump of a derivative along an axis.

    Parameters
    ----------
    function : callable
    points : float64[n, dim]
    step : float or float64[n]
        Of central differences.
    """
    n, dim = points.shape
    steps = np.broadcast_to(step, n)
    around = np.concatenate([np.zeros((1, dim)), np.eye(dim), -np.eye(dim)])
    offsets = around[:, None] * steps[:, None]
    f = function((points + offsets).reshape(-1, dim)).reshape(2 * dim + 1, n)
    ahead, behind = f[1 : dim + 1], f[dim + 1 :]
    jump = np.abs(ahead - 2.0 * f[0] + behind).max(axis=0) / steps
    return f[0], (ahead - behind).T / (2.0 * steps)[:, None], jump


def second_derivative(
    function: Implicit,
    points: FloatArray,
    f: FloatArray,
    along: FloatArray,
    step: float | FloatArray,
) -> FloatArray:
    """Return the second derivative of the function along given directions, 0 for zero vectors.

    Parameters
    ----------
    function : callable
    points : float64[n, dim]
    f : float64[n]
        Values of the function.
    along : float64[n, dim]
        Of any length.
    step : float or float64[n]
    """
    steps = np.broadcast_to(step, len(points))
    length = np.linalg.norm(along, axis=1)
    unit = along * (steps / np.maximum(length, 1e-300))[:, None]
    both = function(np.concatenate([points + unit, points - unit])).reshape(2, len(points))
    return np.where(length > 0.0, (both[0] - 2.0 * f + both[1]) / steps**2, 0.0)


def frame_at(function: Implicit, points: FloatArray, step: float | FloatArray) -> LevelFrame:
    """Return the normals, tangents and curvatures at points of the zero level.

    Parameters
    ----------
    function : callable
    points : float64[n, dim]
    step : float or float64[n]
        Of second differences; those of first ones are shorter.
    """
    # Steps of first differences, relative to the steps given for second ones.
    f, gradient = gradient_of(function, points, (1.0 / 30.0) * np.asarray(step))[:2]
    m, dim = points.shape
    steep = np.linalg.norm(gradient, axis=1)
    normal = gradient / np.maximum(steep, 1e-300)[:, None]
    # Columns of the reflection that takes the normal to the axis it is nearest to.
    axis = np.abs(normal).argmax(axis=1)
    mirror = normal.copy()
    mirror[np.arange(m), axis] += np.copysign(1.0, normal[np.arange(m), axis])
    mirror /= np.linalg.norm(mirror, axis=1)[:, None]
    tangents = np.empty((m, dim - 1, dim))
    for k in range(dim - 1):
        other = (axis + 1 + k) % dim
        tangents[:, k] = -2.0 * mirror * mirror[np.arange(m), other][:, None]
        tangents[np.arange(m), k, other] += 1.0
    bends = np.empty((m, dim - 1, dim - 1))
    for k in range(dim - 1):
        bends[:, k, k] = second_derivative(function, points, f, tangents[:, k], step)
    if dim == 3:
        # Of the unit vector halfway between the tangents.
        along = second_derivative(function, points, f, tangents.sum(axis=1), step)
        bends[:, 0, 1] = bends[:, 1, 0] = along - 0.5 * (bends[:, 0, 0] + bends[:, 1, 1])
    return LevelFrame(normal, tangents, bends / np.maximum(steep, 1e-300)[:, None, None])


def largest_curvature(
    function: Implicit, points: FloatArray, step: FloatArray, *, least_step: float
) -> FloatArray:
    """Return the principal curvature of larger modulus at points of the zero level.

    The step of the differences follows from the radius: it is shortened until the normal turns by
    about a tenth of a radian on it.  At kinks of the boundary, where the curvature grows as the
    step is shortened further, the result is 0.

    Parameters
    ----------
    function : callable
        Function with a gradient at its zero level; it need not be a distance.
    points : float64[n, dim]
        On the zero level.
    step : float64[n]
        Longest step.  The zero level must extend that far on both sides.
    least_step : float
        Shortest step, > 0.

    Returns
    -------
    float64[n]
        Moduli, 1 / length.
    """
    steps = np.maximum(step, least_step)
    kappa = _modulus(frame_at(function, points, steps))
    for _ in range(_MOST_CHANGES):
        turns = np.flatnonzero((kappa * steps > 1.5 * _TURN) & (steps > least_step))
        if len(turns) == 0:
            break
        shorter = np.maximum(_TURN / kappa[turns], _STEP_CHANGE * steps[turns])
        steps[turns] = np.maximum(shorter, least_step)
        kappa[turns] = _modulus(frame_at(function, points[turns], steps[turns]))
    least = kappa
    for share in _SHORTER:
        fine = _modulus(frame_at(function, points, share * steps))
        least = np.minimum(least, fine)
    return np.where(fine > 2.0 * kappa, 0.0, least)


def _modulus(frame: LevelFrame) -> FloatArray:
    """Return the largest modulus of the eigenvalues of the second fundamental form."""
    bends = frame.curvatures
    if bends.shape[1] == 1:
        return np.asarray(np.abs(bends[:, 0, 0]))
    mean = 0.5 * (bends[:, 0, 0] + bends[:, 1, 1])
    half = np.hypot(0.5 * (bends[:, 0, 0] - bends[:, 1, 1]), bends[:, 0, 1])
    return np.asarray(np.abs(mean) + half)
