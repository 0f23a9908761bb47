"""Solids with their exact signed distances, negative inside, as functions of float64[n, 3]."""

import numpy as np

from adaptsize import CartesianGrid


def sampled(shape, spacing, *, half=1.0, shift=(0.0, 0.0, 0.0)):
    """Return a grid over [-half, half]^3, shifted by parts of a spacing, and distances on it."""
    step = np.broadcast_to(np.asarray(spacing, dtype=float), 3)
    n = np.ceil(2.0 * half / step).astype(int) + 2
    grid = CartesianGrid(-half - step * np.asarray(shift), step, n.tolist())
    return grid, grid.sample(shape)


def turned(shape, turn):
    """Return a shape turned by a matrix: ``x`` is in it if ``turn.T x`` is in the shape."""
    return lambda x: shape(x @ turn)


def turn_about(axis, degrees):
    """Return the matrix of a turn about an axis through the origin (Rodrigues)."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def ball(radius):
    return lambda x: np.linalg.norm(x, axis=1) - radius


def _of_gaps(gaps):
    """Return the distance from the meet of walls at right angles, from that to each, [n, m]."""
    outside = np.linalg.norm(np.maximum(gaps, 0.0), axis=1)
    return outside + np.minimum(gaps.max(axis=1), 0.0)


def box(*edges):
    return lambda x: _of_gaps(np.abs(x) - 0.5 * np.array(edges))


def cylinder(radius, height):
    """About the z axis."""
    return lambda x: _of_gaps(
        np.column_stack([np.hypot(x[:, 0], x[:, 1]) - radius, np.abs(x[:, 2]) - 0.5 * height])
    )


def torus(radius, tube):
    """About the z axis."""
    return lambda x: np.hypot(np.hypot(x[:, 0], x[:, 1]) - radius, x[:, 2]) - tube
