"""Distance to the zero level of a function that need not be a distance itself."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy.spatial import cKDTree

from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.geometry.distance.propagation import (
    AnyBackground,
    Features,
    Nodes,
    frame_of,
    places_of,
    propagate,
)
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

#: f(points[n, dim]) -> float64[n], checked.
Implicit: TypeAlias = Callable[[FloatArray], FloatArray]

# Nodes per batch of the projection; the function is evaluated at several points around each.
_NODES_AT_ONCE = 100_000
# Steps of the search for zeros on edges.
_CUTS = 4
# Steps of differences, in spacings: first derivatives and curvatures.
_STEP = 1e-3
_STEP_OF_CURVATURE = 3e-2
# Smooth functions need 3 to 5 iterations; at kinks the iteration does not converge.
_MOST_ITERATIONS = 15
# An iterate has converged when it moves by less, in spacings.
_ARRIVED = 1e-9
# Iterates farther from the zero level, in spacings and in steps along it, first return to it.
_OFF_LEVEL = 0.05
# Penalty on the distance of an iterate from the zero level, so that iterates on it are preferred.
_PENALTY = 2.0
# The parabola at a foot is used only for feet up to this distance from it, in spacings, ...
_WITHIN = 1.5
# ... and not near or beyond its focus.
_OFF_FOCUS = 0.25


class _Feet(NamedTuple):
    """Closest points of the zero level, and the surface around each."""

    points: FloatArray
    """float64[m, dim]"""
    normals: FloatArray
    """float64[m, dim], along the gradient"""
    tangents: FloatArray
    """float64[m, dim - 1, dim]"""
    curvatures: FloatArray
    """float64[m, dim - 1, dim - 1]: second fundamental form, positive where convex."""


def implicit_distance(
    background: AnyBackground,
    function: Implicit,
    values: FloatArray,
    band: float,
    report: ProgressCallback,
) -> FloatArray:
    """Return signed distances of the nodes to the zero level of a function.

    Parameters
    ----------
    background
    function : callable
    values : float64[nodal_shape]
        Values of the function at the nodes.
    band : float
        Nodes up to this number of spacings away are projected; inf: all.
    report : callable
    """
    crossings, layer, spacing = _crossings(background, function, values)
    place = places_of(background)
    start = cKDTree(crossings).query(place(layer))[1]
    feet = _project(function, place(layer), crossings[start], spacing, report)
    nearest, distance = _nearest_feet(background, layer, feet, report)
    distance[layer] = np.linalg.norm(place(layer) - feet, axis=1)
    known = np.zeros(background.n_points, np.bool_)
    known[layer] = True
    near = np.flatnonzero(~known & (distance <= (band + 0.5) * spacing))
    known[near] = True
    projected = _project(function, place(near), feet[nearest[near]], spacing, report)
    distance[near] = np.linalg.norm(place(near) - projected, axis=1)
    far = np.flatnonzero(~known)
    surface = _surface_at(function, feet, spacing)
    for first in range(0, len(far), _NODES_AT_ONCE):
        part = far[first : first + _NODES_AT_ONCE]
        closer = _distance_to_parabola(place(part), surface, nearest[part], spacing)
        distance[part] = np.minimum(distance[part], closer)
        report("distance beyond the band", min((first + _NODES_AT_ONCE) / len(far), 1.0))
    return np.copysign(distance, values.ravel()).reshape(background.nodal_shape)


def _crossings(
    background: AnyBackground, function: Implicit, values: FloatArray
) -> tuple[FloatArray, Nodes, float]:
    """Return points of the zero level on edges.

    Returns
    -------
    crossings : float64[m, dim]
    layer : int64[l]
        The nodes of the boxes that the zero level passes through, in meshes of the edges.
    spacing : float
        Length of the longest of the edges.
    """
    i, j = _edges_across(background, values)
    if len(i) == 0:
        raise ValueError(
            "boundary must change its sign between two neighbouring nodes of the background, got "
            f"values from {values.min():g} to {values.max():g} and no such nodes"
        )
    place, flat = places_of(background), values.ravel()
    a, b, f_a, f_b = place(i), place(j), flat[i], flat[j]
    # Illinois: regula falsi that halves the value at an end that stays.
    low, high, f_low, f_high = np.zeros(len(a)), np.ones(len(a)), f_a.copy(), f_b.copy()
    for _ in range(_CUTS):
        t = low + (high - low) * f_low / (f_low - f_high)
        f_t = function(a + t[:, None] * (b - a))
        on_low = (f_t > 0.0) == (f_a > 0.0)
        f_high = np.where(on_low, 0.5 * f_high, f_t)
        f_low = np.where(on_low, f_t, 0.5 * f_low)
        low, high = np.where(on_low, t, low), np.where(on_low, high, t)
        # A value of 0 counts as one below; two zeros would be no bracket.
        f_low = np.where(f_low == f_high, 1.0, f_low)
    t = low + (high - low) * f_low / (f_low - f_high)
    crossings = a + t[:, None] * (b - a)
    spacing = float(np.linalg.norm(a - b, axis=1).max())
    if isinstance(background, CartesianGrid):
        return crossings, _nodes_of_mixed_boxes(values > 0.0), spacing
    return crossings, np.unique(np.concatenate([i, j])), spacing


def _nodes_of_mixed_boxes(positive: BoolArray) -> Nodes:
    """Return the nodes of boxes that have corners of both kinds."""
    some = every = positive
    for axis in range(positive.ndim):
        n = positive.shape[axis] - 1
        some = some.take(range(n), axis) | some.take(range(1, n + 1), axis)
        every = every.take(range(n), axis) & every.take(range(1, n + 1), axis)
    at = np.pad(some & ~every, 1)
    for axis in range(positive.ndim):
        n = positive.shape[axis]
        at = at.take(range(n), axis) | at.take(range(1, n + 1), axis)
    return np.flatnonzero(at)


def _edges_across(background: AnyBackground, values: FloatArray) -> tuple[Nodes, Nodes]:
    """Return the ends of all edges with the function positive at one end only."""
    positive = values > 0.0
    if not isinstance(background, CartesianGrid):
        mesh = background if isinstance(background, SimplexMesh) else background.mesh
        i, j = mesh.edges[positive[mesh.edges[:, 0]] != positive[mesh.edges[:, 1]]].T
        return i.astype(np.int64), j.astype(np.int64)
    ends = []
    for axis in range(background.dim):
        at = list(np.nonzero(np.diff(positive, axis=axis)))
        low = np.ravel_multi_index(at, background.shape)
        at[axis] += 1
        ends.append((low, np.ravel_multi_index(at, background.shape)))
    return np.concatenate([low for low, _ in ends]), np.concatenate([high for _, high in ends])


def _nearest_feet(
    background: AnyBackground, layer: Nodes, feet: FloatArray, report: ProgressCallback
) -> tuple[Nodes, FloatArray]:
    """Return for each node the nearest of the feet of the nodes of a layer, and its distance."""
    if not isinstance(background, CartesianGrid):
        distance, nearest = cKDTree(feet).query(background.points)
        return nearest, distance
    number = np.full(background.n_points, -1, np.int32)
    number[layer] = np.arange(len(layer), dtype=np.int32)
    distance = np.full(background.n_points, np.inf)
    distance[layer] = np.linalg.norm(places_of(background)(layer) - feet, axis=1)
    in_space = np.zeros((len(feet), 3))
    in_space[:, : background.dim] = feet
    cells = np.arange(len(feet), dtype=np.int32)[:, None]
    features = Features(in_space, cells, cells, *_neighbours(background.shape, layer, number))
    nearest = number.copy()
    propagate(frame_of(background), features, distance, nearest, report)
    return nearest.astype(np.int64), distance


def _neighbours(
    shape: tuple[int, ...], layer: Nodes, number: IntArray
) -> tuple[IntArray, IntArray]:
    """Return the numbers of the nodes of a layer around each of its nodes, as compressed rows."""
    at = np.stack(np.unravel_index(layer, shape), axis=1)
    pairs = []
    for step in product((-1, 0, 1), repeat=len(shape)):
        there = at + step
        inside = ((there >= 0) & (there < shape)).all(axis=1) & any(step)
        other = np.full(len(layer), -1, np.int32)
        other[inside] = number[np.ravel_multi_index(tuple(there[inside].T), shape)]
        pairs.append(other)
    table = np.stack(pairs, axis=1)
    ring_ptr = np.zeros(len(layer) + 1, np.int32)
    np.cumsum((table >= 0).sum(axis=1), out=ring_ptr[1:])
    return ring_ptr, table[table >= 0]


def _project(
    function: Implicit,
    x: FloatArray,
    start: FloatArray,
    spacing: float,
    report: ProgressCallback,
) -> FloatArray:
    """Return the points of the zero level that are closest to x, float64[n, dim]."""
    feet = np.empty_like(x)
    for first in range(0, len(x), _NODES_AT_ONCE):
        part = slice(first, first + _NODES_AT_ONCE)
        feet[part] = _project_part(function, x[part], start[part], spacing)
        report("projection", min((first + _NODES_AT_ONCE) / len(x), 1.0))
    return feet


def _project_part(
    function: Implicit, x: FloatArray, start: FloatArray, spacing: float
) -> FloatArray:
    """Project points to the zero level, from start points near the closest points.

    Solves  f(y) = 0  and  x - y parallel to grad f(y)  by Newton's method in the direction of
    the normal and in the tangent plane, there with the curvature in the direction of x.  If this
    does not converge, at kinks of f, the best iterate is returned.
    """
    y = start.copy()
    best, feet = np.full(len(x), np.inf), start.copy()
    active = np.arange(len(x))
    for _ in range(_MOST_ITERATIONS):
        at, to = y[active], x[active]
        f, gradient = _gradient(function, at, _STEP * spacing)
        steep = np.linalg.norm(gradient, axis=1)
        regular = steep > 0.0
        per_steep = np.where(regular, 1.0 / np.where(regular, steep, 1.0), 0.0)
        off = f * per_steep
        merit = np.linalg.norm(to - at, axis=1) + _PENALTY * np.abs(off)
        better = (merit < best[active]) & regular
        best[active[better]], feet[active[better]] = merit[better], at[better]
        normal = gradient * per_steep[:, None]
        height = ((to - at) * normal).sum(axis=1)
        sideways = to - at - height[:, None] * normal
        bend = _curvature_along(function, at, f, sideways, spacing) * per_steep
        # Beyond the centre of curvature Newton's method would step in the wrong direction.
        step = sideways / np.maximum(1.0 + height * bend, _OFF_FOCUS)[:, None]
        length = np.linalg.norm(step, axis=1)
        step *= np.minimum(1.0, spacing / np.maximum(length, 1e-300))[:, None]
        # First back to the zero level: at a kink of f steps along it lead off it.
        back = (np.abs(off) > _OFF_LEVEL * spacing) & (np.abs(off) > _OFF_LEVEL * length)
        step[back] = 0.0
        step -= np.clip(off, -spacing, spacing)[:, None] * normal
        y[active] = at + step
        moving = (np.linalg.norm(step, axis=1) > _ARRIVED * spacing) & regular
        active = active[moving]
        if len(active) == 0:
            break
    return feet


def _gradient(function: Implicit, points: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Return the function and its gradient, by central differences."""
    n, dim = points.shape
    offsets = step * np.concatenate([np.zeros((1, dim)), np.eye(dim), -np.eye(dim)])
    f = function((points + offsets[:, None]).reshape(-1, dim)).reshape(-1, n)
    return f[0], (f[1 : dim + 1] - f[dim + 1 :]).T / (2.0 * step)


def _curvature_along(
    function: Implicit, points: FloatArray, f: FloatArray, along: FloatArray, spacing: float
) -> FloatArray:
    """Return the second derivative of the function along given directions."""
    step = _STEP_OF_CURVATURE * spacing
    length = np.linalg.norm(along, axis=1)
    unit = along * (step / np.maximum(length, 1e-300))[:, None]
    both = function(np.concatenate([points + unit, points - unit])).reshape(2, -1)
    return np.where(length > 0.0, (both[0] - 2.0 * f + both[1]) / step**2, 0.0)


def _surface_at(function: Implicit, feet: FloatArray, spacing: float) -> _Feet:
    """Return the normals, tangents and curvatures at points of the zero level."""
    f, gradient = _gradient(function, feet, _STEP * spacing)
    m, dim = feet.shape
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
        bends[:, k, k] = _curvature_along(function, feet, f, tangents[:, k], spacing)
    if dim == 3:
        diagonal = tangents.sum(axis=1)
        along = _curvature_along(function, feet, f, diagonal, spacing)
        bends[:, 0, 1] = bends[:, 1, 0] = along - 0.5 * (bends[:, 0, 0] + bends[:, 1, 1])
    return _Feet(feet, normal, tangents, bends / np.maximum(steep, 1e-300)[:, None, None])


def _distance_to_parabola(x: FloatArray, feet: _Feet, which: Nodes, spacing: float) -> FloatArray:
    """Return the distances of points to the paraboloids at given feet, inf where in doubt.

    With r the offset of x from the foot, rho its part along the normal, t that in the tangent
    plane and S the curvatures, one step of Newton's method leads to the offset u with
    (1 + rho S) u = t  of the closest point  y + u - u S u n / 2.
    """
    offset = x - feet.points[which]
    height = (offset * feet.normals[which]).sum(axis=1)
    sideways = np.einsum("mkd,md->mk", feet.tangents[which], offset)
    bend = feet.curvatures[which]
    matrix = height[:, None, None] * bend + np.eye(bend.shape[1])
    if bend.shape[1] == 0:
        return np.full(len(x), np.inf)
    reliable = _least_eigenvalue(matrix) > _OFF_FOCUS
    matrix[~reliable] = np.eye(bend.shape[1])
    to = np.linalg.solve(matrix, sideways[:, :, None])[:, :, 0]
    reliable &= np.linalg.norm(to, axis=1) <= _WITHIN * spacing
    drop = 0.5 * np.einsum("mk,mkl,ml->m", to, bend, to)
    along = np.linalg.norm(sideways - to, axis=1)
    return np.where(reliable, np.hypot(along, height + drop), np.inf)


def _least_eigenvalue(matrix: FloatArray) -> FloatArray:
    """Return the least eigenvalue of symmetric matrices of order 1 or 2."""
    if matrix.shape[1] == 1:
        return np.asarray(matrix[:, 0, 0])
    mean = 0.5 * (matrix[:, 0, 0] + matrix[:, 1, 1])
    half = 0.5 * (matrix[:, 0, 0] - matrix[:, 1, 1])
    return np.asarray(mean - np.hypot(half, matrix[:, 0, 1]))
