"""Distance to the zero level of a function that need not be a distance itself."""

from __future__ import annotations

from itertools import product

import numpy as np

from adaptsize._kernels.surface_distance import Features, Nearest
from adaptsize.background import AnyBackground, CartesianGrid, SimplexMesh
from adaptsize.geometry.distance.fast_marching import places_of, propagate
from adaptsize.geometry.distance.projection import project
from adaptsize.geometry.implicit_surface import Implicit, LevelFrame, frame_at
from adaptsize.typing import BoolArray, FloatArray, IntArray, LongArray, ProgressCallback

# Nodes per batch beyond the band.
_NODES_AT_ONCE = 100_000


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
    from scipy.spatial import cKDTree

    crossings, lengths = crossings_of(background, function, values)
    layer, spacing = _layer(background, values), float(lengths.max())
    place = places_of(background)
    start = cKDTree(crossings).query(place(layer))[1]
    feet = project(function, place(layer), crossings[start], spacing, report)
    nearest, distance = _nearest_feet(background, layer, feet, report)
    distance[layer] = np.linalg.norm(place(layer) - feet, axis=1)
    known = np.zeros(background.n_points, np.bool_)
    known[layer] = True
    near = np.flatnonzero(~known & (distance <= (band + 0.5) * spacing))
    known[near] = True
    projected = project(function, place(near), feet[nearest[near]], spacing, report)
    distance[near] = np.linalg.norm(place(near) - projected, axis=1)
    far = np.flatnonzero(~known)
    # Step of differences for curvatures, in spacings.
    surface = frame_at(function, feet, 3e-2 * spacing)
    for first in range(0, len(far), _NODES_AT_ONCE):
        part = far[first : first + _NODES_AT_ONCE]
        closer = _distance_to_parabola(place(part), feet, surface, nearest[part], spacing)
        distance[part] = np.minimum(distance[part], closer)
        report("distance beyond the band", min((first + _NODES_AT_ONCE) / len(far), 1.0))
    return np.copysign(distance, values.ravel()).reshape(background.nodal_shape)


def crossings_of(
    background: AnyBackground, function: Implicit, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return points of the zero level on edges, float64[m, dim], and the lengths of these edges.

    Raises
    ------
    ValueError
        If there are none.
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
    # Steps of the search for zeros on edges.
    for _ in range(4):
        t = low + (high - low) * f_low / (f_low - f_high)
        f_t = function(a + t[:, None] * (b - a))
        on_low = (f_t > 0.0) == (f_a > 0.0)
        f_high = np.where(on_low, 0.5 * f_high, f_t)
        f_low = np.where(on_low, f_t, 0.5 * f_low)
        low, high = np.where(on_low, t, low), np.where(on_low, high, t)
        # A value of 0 counts as one below; two zeros would be no bracket.
        f_low = np.where(f_low == f_high, 1.0, f_low)
    t = low + (high - low) * f_low / (f_low - f_high)
    return a + t[:, None] * (b - a), np.asarray(np.linalg.norm(a - b, axis=1))


def _layer(background: AnyBackground, values: FloatArray) -> LongArray:
    """Return the nodes of boxes that the zero level passes through, in meshes of such edges."""
    if isinstance(background, CartesianGrid):
        return _nodes_of_mixed_boxes(values > 0.0)
    return np.unique(np.concatenate(_edges_across(background, values)))


def _nodes_of_mixed_boxes(positive: BoolArray) -> LongArray:
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


def _edges_across(background: AnyBackground, values: FloatArray) -> tuple[LongArray, LongArray]:
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
    background: AnyBackground, layer: LongArray, feet: FloatArray, report: ProgressCallback
) -> tuple[LongArray, FloatArray]:
    """Return for each node the nearest of the feet of the nodes of a layer, and its distance."""
    from scipy.spatial import cKDTree

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
    propagate(background, features, Nearest(distance, nearest), report)
    return nearest.astype(np.int64), distance


def _neighbours(
    shape: tuple[int, ...], layer: LongArray, number: IntArray
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


def _distance_to_parabola(
    x: FloatArray, feet: FloatArray, surface: LevelFrame, which: LongArray, spacing: float
) -> FloatArray:
    """Return the distances of points to the paraboloids at given feet, inf where in doubt.

    With r the offset of x from the foot, rho its part along the normal, t that in the tangent
    plane and S the curvatures, one step of Newton's method leads to the offset u with
    (1 + rho S) u = t  of the closest point  y + u - u S u n / 2.
    """
    offset = x - feet[which]
    height = (offset * surface.normals[which]).sum(axis=1)
    sideways = np.einsum("mkd,md->mk", surface.tangents[which], offset)
    bend = surface.curvatures[which]
    matrix = height[:, None, None] * bend + np.eye(bend.shape[1])
    if bend.shape[1] == 0:
        return np.full(len(x), np.inf)
    # The parabola is not used near or beyond its focus, ...
    reliable = _least_eigenvalue(matrix) > 0.25
    matrix[~reliable] = np.eye(bend.shape[1])
    to = np.linalg.solve(matrix, sideways[:, :, None])[:, :, 0]
    # ... and only up to this distance from the foot where it touches, in spacings.
    reliable &= np.linalg.norm(to, axis=1) <= 1.5 * spacing
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
