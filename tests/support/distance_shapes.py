"""Shapes as functions of float64[n, dim], negative inside, and grids around them.

Values are exact signed distances inside; outside they are too unless a shape says otherwise.
"""

import numpy as np
import shapely
from scipy.spatial import cKDTree

from adaptsize import CartesianGrid


def sampled(shape, spacing, *, dim=2, half=1.2, shift=0.0):
    """Return a grid over [-half, half]^dim, shifted by parts of a spacing, and distances on it."""
    step = np.broadcast_to(np.asarray(spacing, dtype=float), dim)
    n = np.ceil(2.0 * half / step).astype(int) + 2
    grid = CartesianGrid(-half - step * np.asarray(shift), step, n.tolist())
    return grid, grid.sample(shape)


def turned(shape, turn):
    """Return a shape turned by a matrix, or in the plane by degrees counter-clockwise."""
    if np.ndim(turn) == 0:
        turn = turn_about((0.0, 0.0, 1.0), turn)[:2, :2]
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
    """About the origin; a rectangle if there are two edges."""
    return lambda x: _of_gaps(np.abs(x) - 0.5 * np.array(edges))


def cylinder(radius, height):
    """About the z axis."""
    return lambda x: _of_gaps(
        np.column_stack([np.hypot(x[:, 0], x[:, 1]) - radius, np.abs(x[:, 2]) - 0.5 * height])
    )


def torus(radius, tube):
    """About the z axis."""
    return lambda x: np.hypot(np.hypot(x[:, 0], x[:, 1]) - radius, x[:, 2]) - tube


def annulus(inner, outer):
    return lambda x: (
        np.abs(np.linalg.norm(x, axis=1) - 0.5 * (inner + outer)) - 0.5 * (outer - inner)
    )


def polygon(corners):
    shape = shapely.Polygon(corners)

    def distance(x):
        points = shapely.points(x)
        away = shapely.distance(shape.exterior, points)
        return np.where(shapely.contains(shape, points), -away, away)

    return distance


def regular_polygon(n, radius):
    angle = 2.0 * np.pi * np.arange(n) / n
    return polygon(radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def letter_l(size, width):
    """An L in [-size, size]^2 with arms of one width."""
    s, w = size, width - size
    return polygon([(-s, -s), (s, -s), (s, w), (w, w), (w, s), (-s, s)])


class Ellipse:
    """The ellipse of half axes a and b, its distance by Newton's method."""

    def __init__(self, a, b):
        self.a, self.b = a, b

    def at(self, t):
        return np.column_stack([self.a * np.cos(t), self.b * np.sin(t)])

    def curvature_at(self, t):
        return self.a * self.b / ((self.a * np.sin(t)) ** 2 + (self.b * np.cos(t)) ** 2) ** 1.5

    def closest(self, x):
        """Return the parameter of the closest point, from the closest of 4000 samples."""
        start = np.linspace(0.0, 2.0 * np.pi, 4000, endpoint=False)
        t = start[cKDTree(self.at(start)).query(x)[1]]
        for _ in range(4):
            tangent = np.column_stack([-self.a * np.sin(t), self.b * np.cos(t)])
            gap = self.at(t) - x
            curving = (tangent**2).sum(axis=1) - (gap * self.at(t)).sum(axis=1)
            step = (gap * tangent).sum(axis=1) / np.where(curving > 1e-6, curving, np.inf)
            t = t - np.clip(step, -1e-3, 1e-3)
        return t

    def __call__(self, x):
        away = np.linalg.norm(x - self.at(self.closest(x)), axis=1)
        return np.where(((x / [self.a, self.b]) ** 2).sum(axis=1) < 1.0, -away, away)


def grid_across(n, dim=2, *, stretch=1.0):
    """A grid of n boxes across [-1.05, 1.05]^dim, off centre; the first spacing is stretched."""
    spacing = np.full(dim, 2.1 / n)
    spacing[0] *= stretch
    shape = np.ceil(2.1 / spacing).astype(int) + 1
    return CartesianGrid(np.array([-1.03, -1.01, -1.02])[:dim], spacing, shape.tolist())
