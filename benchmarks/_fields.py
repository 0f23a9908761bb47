"""Fields with layers in space, and exact second derivatives."""

import numpy as np


def layer_in_space(points):
    """Return values that change across an S-shaped sheet, the same for all z."""
    x, y = points[..., 0], points[..., 1]
    return np.tanh(30.0 * (x - 0.5 - 0.1 * np.sin(2.0 * np.pi * y)))


def spherical_layer(points):
    """Return values that change across an eighth of a sphere, bent in both directions."""
    return np.tanh(30.0 * (np.linalg.norm(points, axis=-1) - 0.7))


def second_derivatives(field, points, step=1e-4):
    """Return central differences, float64[n, dim, dim]."""
    dim = points.shape[1]
    axes, middle = np.eye(dim) * step, field(points)
    found = np.empty((len(points), dim, dim))
    for i, a in enumerate(axes):
        found[:, i, i] = field(points + a) - 2.0 * middle + field(points - a)
        for j, b in enumerate(axes[:i]):
            along = field(points + a + b) + field(points - a - b)
            across = field(points + a - b) + field(points - a + b)
            found[:, i, j] = found[:, j, i] = 0.25 * (along - across)
    return found / step**2
