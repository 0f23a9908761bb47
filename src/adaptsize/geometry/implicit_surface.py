"""The zero level of a function: normals and curvatures by differences, and closest points."""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from adaptsize._checks import as_float_array, refuse_where
from adaptsize.geometry import tuning
from adaptsize.typing import BoolArray, FloatArray, IndexArray, ProgressCallback

#: f(points[n, dim]) -> float64[n], checked.
Implicit: TypeAlias = Callable[[FloatArray], FloatArray]

# Points per batch; the function is evaluated at several points around each.
_POINTS_AT_ONCE = 100_000


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
    f, gradient = gradient_of(function, points, tuning.SHARE_OF_STEP * np.asarray(step))[:2]
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
    for _ in range(tuning.MOST_CHANGES):
        turns = np.flatnonzero(
            (kappa * steps > tuning.TOO_FAR * tuning.TURN) & (steps > least_step)
        )
        if len(turns) == 0:
            break
        shorter = np.maximum(tuning.TURN / kappa[turns], tuning.STEP_CHANGE * steps[turns])
        steps[turns] = np.maximum(shorter, least_step)
        kappa[turns] = _modulus(frame_at(function, points[turns], steps[turns]))
    least = kappa
    for share in tuning.SHARES_OF_STEP_AT_KINK:
        fine = _modulus(frame_at(function, points, share * steps))
        least = np.minimum(least, fine)
    return np.where(fine > tuning.GROWTH_AT_KINK * kappa, 0.0, least)


def _modulus(frame: LevelFrame) -> FloatArray:
    """Return the largest modulus of the eigenvalues of the second fundamental form."""
    return np.asarray(np.abs(eigenvalues_of(frame.curvatures)).max(axis=0))


def eigenvalues_of(matrices: FloatArray) -> FloatArray:
    """Return the least and the largest eigenvalue of symmetric matrices of order 1 or 2."""
    first, last = matrices[:, 0, 0], matrices[:, -1, -1]
    mean = 0.5 * (first + last)
    half = np.hypot(0.5 * (first - last), matrices[:, 0, 1]) if matrices.shape[1] == 2 else 0.0
    return np.stack([mean - half, mean + half])


def project(
    function: Implicit,
    x: FloatArray,
    start: FloatArray,
    spacing: float | FloatArray,
    report: ProgressCallback,
) -> FloatArray:
    """Return the points of the zero level that are closest to given points, float64[n, dim].

    Parameters
    ----------
    function : callable
    x : float64[n, dim]
    start : float64[n, dim]
        Points near the closest points.
    spacing : float or float64[n]
        Scale of the details of the zero level around the closest points.
    report : callable
    """
    spacings = np.broadcast_to(spacing, len(x))
    closest = np.empty_like(x)
    for first in range(0, len(x), _POINTS_AT_ONCE):
        part = slice(first, first + _POINTS_AT_ONCE)
        closest[part] = _project_part(function, x[part], start[part], spacings[part])
        report("projection", min((first + _POINTS_AT_ONCE) / len(x), 1.0))
    return closest


def _project_part(
    function: Implicit, x: FloatArray, start: FloatArray, spacings: FloatArray
) -> FloatArray:
    """Project points to the zero level, from start points near the closest points.

    Newton's method, see `_step_to`.  If it does not converge, the closest point may be at a kink of
    f, see `_at_kinks`.
    """
    y = start.copy()
    best, closest = np.full(len(x), np.inf), start.copy()
    active, kinked = np.arange(len(x)), np.zeros(len(x), np.bool_)
    for _ in range(tuning.MOST_ITERATIONS):
        at, spacing = y[active], spacings[active]
        found = _step_to(function, x[active], at, spacing)
        better = (found.merit < best[active]) & found.is_regular
        best[active[better]], closest[active[better]] = found.merit[better], at[better]
        y[active] = at + found.step
        kinked[active] = found.is_kinked
        # An iterate has converged when it moves by less, in spacings.
        far = np.linalg.norm(found.step, axis=1) > 1e-9 * spacing
        active = active[far & found.is_regular]
        if len(active) == 0:
            break
    kinked[active] = True
    rest = np.flatnonzero(kinked)
    for share in tuning.BESIDE_KINK if len(rest) else ():
        closest[rest] = _at_kinks(function, x[rest], closest[rest], share * spacings[rest])
    return closest


class _Step(NamedTuple):
    """A step of Newton's method from each of several points."""

    step: FloatArray
    merit: FloatArray
    """Of the points: their distance, and a penalty if they are off the zero level."""
    is_regular: BoolArray
    """Whether the function has a gradient there."""
    is_kinked: BoolArray
    """Whether its derivatives jump there."""


def _step_to(function: Implicit, x: FloatArray, at: FloatArray, spacing: FloatArray) -> _Step:
    """Return steps from points ``at`` to the points y of the zero level that are closest to x.

    They solve  f(y) = 0  and  x - y parallel to grad f(y)  by Newton's method in the direction of
    the normal and in the tangent plane, there with the curvature in the direction of x.
    """
    f, gradient, jump = gradient_of(function, at, tuning.STEP_OF_GRADIENT * spacing)
    steep = np.linalg.norm(gradient, axis=1)
    regular = steep > 0.0
    per_steep = np.where(regular, 1.0 / np.where(regular, steep, 1.0), 0.0)
    off = f * per_steep
    merit = np.linalg.norm(x - at, axis=1) + tuning.PENALTY * np.abs(off)
    normal = gradient * per_steep[:, None]
    height = ((x - at) * normal).sum(axis=1)
    sideways = x - at - height[:, None] * normal
    bend = second_derivative(function, at, f, sideways, tuning.STEP_OF_CURVATURE * spacing)
    bend *= per_steep
    # Beyond the centre of curvature Newton's method would step in the wrong direction.
    step = sideways / np.maximum(1.0 + height * bend, tuning.LEAST_CURVATURE_FACTOR)[:, None]
    length = np.linalg.norm(step, axis=1)
    step *= np.minimum(1.0, spacing / np.maximum(length, 1e-300))[:, None]
    # First back to the zero level: at a kink of f steps along it lead off it.
    back = (np.abs(off) > tuning.OFF_LEVEL * spacing) & (np.abs(off) > tuning.OFF_LEVEL * length)
    step[back] = 0.0
    step -= np.clip(off, -spacing, spacing)[:, None] * normal
    return _Step(step, merit, regular, jump > tuning.JUMP_AT_KINK * steep)


def _at_kinks(function: Implicit, x: FloatArray, y0: FloatArray, reach: FloatArray) -> FloatArray:
    """Return the closest points where smooth pieces of the zero level meet, or beside.

    The pieces are replaced by their tangent planes at points that far from the given ones.  The
    closest point of a plane, or of the intersection of two or three, replaces the given one if it
    is closer to x, or to the zero level.
    """
    n, dim = x.shape
    around = np.concatenate([np.eye(dim), -np.eye(dim)])
    at = y0[:, None] + reach[:, None, None] * around
    f, gradient = gradient_of(
        function, at.reshape(-1, dim), tuning.STEP_OF_GRADIENT * np.repeat(reach, 2 * dim)
    )[:2]
    steep = np.maximum(np.linalg.norm(gradient, axis=1), 1e-300)
    normals = (gradient / steep[:, None]).reshape(n, 2 * dim, dim)
    heights = (normals * at).sum(axis=2) - (f / steep).reshape(n, 2 * dim)
    slope = steep.reshape(n, 2 * dim).max(axis=1)

    def merit_of(y: FloatArray) -> FloatArray:
        off = np.abs(function(y)) / slope
        return np.asarray(np.linalg.norm(x - y, axis=1) + tuning.PENALTY * off)

    result, best = y0.copy(), merit_of(y0)
    for planes in _distinct(normals):
        rows = np.take_along_axis(normals, planes[:, :, None], axis=1)
        matrix = rows @ rows.transpose(0, 2, 1)
        gap = np.take_along_axis(heights, planes, axis=1) - np.einsum("nkd,nd->nk", rows, x)
        meet = np.linalg.det(matrix) > tuning.LEAST_ANGLE**2
        matrix[~meet] = np.eye(planes.shape[1])
        offset = np.einsum("nkd,nk->nd", rows, np.linalg.solve(matrix, gap[:, :, None])[:, :, 0])
        merit = np.where(meet, merit_of(np.where(meet[:, None], x + offset, y0)), np.inf)
        better = merit < best
        result[better], best[better] = (x + offset)[better], merit[better]
    return result


def _distinct(normals: FloatArray) -> list[IndexArray]:
    """Return numbers of the two (and, in space, three) most different of several normals.

    First each of two alone, int[n, 1], then several together.
    """
    n, m, dim = normals.shape
    cosine = np.einsum("nid,njd->nij", normals, normals).reshape(n, m * m)
    two = np.stack(np.unravel_index(cosine.argmin(axis=1), (m, m)), axis=1)
    planes = [two[:, :1], two[:, 1:], two]
    if dim == 2:
        return planes
    first, second = (np.take_along_axis(normals, two[:, k, None, None], axis=1) for k in (0, 1))
    across = np.cross(first, second)
    third = np.abs((normals * across).sum(axis=2)).argmax(axis=1)
    return [*planes, np.column_stack([two, third])]
