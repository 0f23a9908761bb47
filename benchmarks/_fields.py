"""A field with a layer in space, and exact second derivatives of fields in the plane."""

import numpy as np


def layer_in_space(points):
    """Return values that change across an S-shaped sheet, the same for all z."""
    x, y = points[..., 0], points[..., 1]
    return np.tanh(30.0 * (x - 0.5 - 0.1 * np.sin(2.0 * np.pi * y)))


def second_derivatives(field, points, step=1e-4):
    """Return central differences, float64[n, 2, 2]."""
    x, y = np.eye(2) * step
    middle = field(points)
    xx = field(points + x) - 2.0 * middle + field(points - x)
    yy = field(points + y) - 2.0 * middle + field(points - y)
    along = field(points + x + y) + field(points - x - y)
    xy = 0.25 * (along - field(points + x - y) - field(points - x + y))
    return np.stack([xx, xy, xy, yy], axis=-1).reshape(-1, 2, 2) / step**2
