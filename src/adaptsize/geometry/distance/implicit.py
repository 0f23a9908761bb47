"""Distance to the zero level of a function that need not be a distance itself."""

from itertools import product

import numpy as np

from adaptsize._kernels.surface_distance import Features, Nearest
from adaptsize.background import AnyBackground, CartesianGrid, SimplexMesh
from adaptsize.background.grid import whole_boxes
from adaptsize.background.interpolation import places_of
from adaptsize.background.location import in_space
from adaptsize.geometry import tuning
from adaptsize.geometry.distance.surface import propagate
from adaptsize.geometry.implicit_surface import (
    Implicit,
    LevelFrame,
    eigenvalues_of,
    frame_at,
    project,
)
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
    spacing = float(lengths.max())
    if isinstance(background, CartesianGrid):
        # Nodes at edges only would miss closest points at corners.
        layer = _nodes_of_mixed_boxes(values > 0.0)
    else:
        layer = np.unique(np.concatenate(_edges_across(background, values)))
    place = places_of(background)
    start = cKDTree(crossings).query(place(layer))[1]
    closest = project(function, place(layer), crossings[start], spacing, report)
    nearest, distance = _nearest_of_layer(background, layer, closest, report)
    distance[layer] = np.linalg.norm(place(layer) - closest, axis=1)
    known = np.zeros(background.n_points, np.bool_)
    known[layer] = True
    near = np.flatnonzero(~known & (distance <= (band + 0.5) * spacing))
    known[near] = True
    projected = project(function, place(near), closest[nearest[near]], spacing, report)
    distance[near] = np.linalg.norm(place(near) - projected, axis=1)
    far = np.flatnonzero(~known)
    surface = frame_at(function, closest, tuning.STEP_OF_CURVATURE * spacing)
    for first in range(0, len(far), _NODES_AT_ONCE):
        part = far[first : first + _NODES_AT_ONCE]
        closer = _distance_to_parabola(place(part), closest, surface, nearest[part], spacing)
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


def _nodes_of_mixed_boxes(positive: BoolArray) -> LongArray:
    """Return the nodes of boxes that have corners of both kinds."""
    mixed = ~(whole_boxes(positive) | whole_boxes(~positive))
    at = np.zeros(positive.shape, np.bool_)
    for corner in product((slice(None, -1), slice(1, None)), repeat=positive.ndim):
        at[corner] |= mixed
    return np.flatnonzero(at)


def _edges_across(background: AnyBackground, values: FloatArray) -> tuple[LongArray, LongArray]:
    """Return the ends of all edges with the function positive at one end only."""
    positive = values > 0.0
    if not isinstance(background, CartesianGrid):
        mesh = background if isinstance(background, SimplexMesh) else background.mesh
        i, j = mesh.edges[positive[mesh.edges[:, 0]] != positive[mesh.edges[:, 1]]].T
        return i.astype(np.int64), j.astype(np.int64)
    low, high = [], []
    for axis in range(background.dim):
        at = list(np.nonzero(np.diff(positive, axis=axis)))
        low.append(np.ravel_multi_index(at, background.shape))
        at[axis] += 1
        high.append(np.ravel_multi_index(at, background.shape))
    return np.concatenate(low), np.concatenate(high)


def _nearest_of_layer(
    background: AnyBackground, layer: LongArray, closest: FloatArray, report: ProgressCallback
) -> tuple[LongArray, FloatArray]:
    """Return for each node the nearest of the points closest to a layer, and its distance."""
    from scipy.spatial import cKDTree

    if not isinstance(background, CartesianGrid):
        distance, nearest = cKDTree(closest).query(background.points)
        return nearest, distance
    number = np.full(background.n_points, -1, np.int32)
    cells = np.arange(len(closest), dtype=np.int32)[:, None]
    number[layer] = cells[:, 0]
    distance = np.full(background.n_points, np.inf)
    distance[layer] = np.linalg.norm(places_of(background)(layer) - closest, axis=1)
    rings = _neighbours(background.shape, layer, number)
    features = Features(in_space(closest), cells, cells, *rings)
    nearest = number.copy()
    propagate(background, features, Nearest(distance, nearest), report)
    return nearest.astype(np.int64), distance


def _neighbours(
    shape: tuple[int, ...], layer: LongArray, number: IntArray
) -> tuple[IntArray, IntArray]:
    """Return the numbers of the nodes of a layer around each of its nodes, as compressed rows."""
    around = np.pad(number.reshape(shape), 1, constant_values=-1)
    at = np.stack(np.unravel_index(layer, shape), axis=1) + 1
    steps = [step for step in product((-1, 0, 1), repeat=len(shape)) if any(step)]
    table = np.stack([around[tuple((at + step).T)] for step in steps], axis=1)
    ring_ptr = np.zeros(len(layer) + 1, np.int32)
    np.cumsum((table >= 0).sum(axis=1), out=ring_ptr[1:])
    return ring_ptr, table[table >= 0]


def _distance_to_parabola(
    x: FloatArray, closest: FloatArray, surface: LevelFrame, which: LongArray, spacing: float
) -> FloatArray:
    """Return the distances of points to the paraboloids at given points, inf where in doubt.

    With r the offset of x from the point, rho its part along the normal, t that in the tangent
    plane and S the curvatures, one step of Newton's method leads to the offset u with
    (1 + rho S) u = t  of the closest point  y + u - u S u n / 2.
    """
    offset = x - closest[which]
    height = (offset * surface.normals[which]).sum(axis=1)
    sideways = np.einsum("mkd,md->mk", surface.tangents[which], offset)
    bend = surface.curvatures[which]
    matrix = height[:, None, None] * bend + np.eye(bend.shape[1])
    if bend.shape[1] == 0:
        return np.full(len(x), np.inf)
    # The parabola is not used near or beyond its focus, ...
    reliable = eigenvalues_of(matrix)[0] > 0.25
    matrix[~reliable] = np.eye(bend.shape[1])
    to = np.linalg.solve(matrix, sideways[:, :, None])[:, :, 0]
    # ... and not far from where it touches.
    reliable &= np.linalg.norm(to, axis=1) <= tuning.REACH_OF_PARABOLA * spacing
    drop = 0.5 * np.einsum("mk,mkl,ml->m", to, bend, to)
    along = np.linalg.norm(sideways - to, axis=1)
    return np.where(reliable, np.hypot(along, height + drop), np.inf)
