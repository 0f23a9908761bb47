"""Functions that are negative inside domains, and sizes for them."""

import numpy as np


def disc(x):
    return np.linalg.norm(x, axis=1) - 1.0


def ring(x):
    """A disc of radius 1 less one of radius 0.3, not concentric."""
    return np.maximum(disc(x), 0.3 - np.linalg.norm(x - [0.2, 0.2], axis=1))


def ring_size(x):
    return 0.03 + 0.25 * np.abs(np.linalg.norm(x - [0.2, 0.2], axis=1) - 0.3)


def box(x, half):
    away = np.abs(x) - half
    return np.linalg.norm(np.maximum(away, 0.0), axis=1) + np.minimum(away.max(axis=1), 0.0)


def corner(x):
    """An L: the square of edge 2 less its upper right quarter."""
    return np.maximum(box(x, 1.0), -box(x - 1.0, 1.0))


def ellipse(x):
    """No distance: its slope at the boundary is 1 to 2."""
    return (x[:, 0] / 2.0) ** 2 + x[:, 1] ** 2 - 1.0


def dumbbell(x):
    """Two discs of radius 0.6 and a neck of width 0.04."""
    discs = [np.linalg.norm(x - [c, 0.0], axis=1) - 0.6 for c in (-1.0, 1.0)]
    return np.min([*discs, box(x, np.array([1.0, 0.02]))], axis=0)


def neck_size(x):
    away = np.maximum(np.abs(x) - [0.4, 0.02], 0.0)
    return 0.02 + 0.2 * np.linalg.norm(away, axis=1)
