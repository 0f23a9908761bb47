"""Shapes with known signed distance and curvature, and grids around them."""

import numpy as np
import solid_shapes
from scipy.spatial import cKDTree

from adaptsize import CartesianGrid

RADIUS, TUBE = 0.6, 0.25
ball, torus = solid_shapes.ball(RADIUS), solid_shapes.torus(RADIUS, TUBE)


def box(n, dim=2, *, stretch=1.0):
    """A grid of n boxes across [-1.05, 1.05]^dim, off centre; the first spacing is stretched."""
    spacing = np.full(dim, 2.1 / n)
    spacing[0] *= stretch
    shape = np.ceil(2.1 / spacing).astype(int) + 1
    return CartesianGrid(np.array([-1.03, -1.01, -1.02])[:dim], spacing, shape.tolist())


def cylinder(x):
    """Of radius 0.6 about the line through 0 along (1, 2, 2) / 3."""
    axis = np.array([1.0, 2.0, 2.0]) / 3.0
    return np.linalg.norm(x - np.outer(x @ axis, axis), axis=1) - RADIUS


def torus_curvature(x):
    """Of the closest point of the tube: 1 / r, and cos(t) / (R + r cos(t)) around the axis."""
    away = np.hypot(x[:, 0], x[:, 1]) - RADIUS
    cosine = away / np.hypot(away, x[:, 2])
    return np.column_stack([np.full(len(x), 1.0 / TUBE), cosine / (RADIUS + TUBE * cosine)])


def slope(x):
    """Distance to a plane, or a line, that no axis is normal to."""
    normal = np.array([3.0, 4.0, 12.0])[: x.shape[1]]
    return x @ (normal / np.linalg.norm(normal)) - 0.1


class Ellipse:
    """The ellipse of half axes 0.8 and 0.4, its distance by Newton's method."""

    a, b = 0.8, 0.4

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
            t = t - (gap * tangent).sum(axis=1) / curving
        return t

    def __call__(self, x):
        away = np.linalg.norm(x - self.at(self.closest(x)), axis=1)
        return np.where(((x / [self.a, self.b]) ** 2).sum(axis=1) < 1.0, -away, away)
