"""Planar shapes with their exact signed distances, negative inside, as functions of float64[n, 2].

Distances are exact inside; outside they are too unless a shape says otherwise.
"""

import numpy as np

from adaptsize import CartesianGrid


def sampled(shape, spacing, *, half=1.2, shift=(0.0, 0.0)):
    """Return a grid over [-half, half]^2, shifted by parts of a spacing, and distances on it."""
    step = np.broadcast_to(np.asarray(spacing, dtype=float), 2)
    n = np.ceil(2.0 * half / step).astype(int) + 2
    grid = CartesianGrid(-half - step * np.asarray(shift), step, n.tolist())
    return grid, grid.sample(shape)


def turned(shape, degrees):
    """Return a shape turned counter-clockwise about the origin."""
    angle = np.radians(degrees)
    back = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return lambda x: shape(x @ back)


def to_segment(x, a, b):
    """Return the distance of points from the segment ab."""
    along = np.subtract(b, a)
    t = np.clip((x - a) @ along / (along @ along), 0.0, 1.0)
    return np.linalg.norm(x - a - t[:, None] * along, axis=1)


def disc(radius):
    return lambda x: np.linalg.norm(x, axis=1) - radius


def annulus(inner, outer):
    return lambda x: (
        np.abs(np.linalg.norm(x, axis=1) - 0.5 * (inner + outer)) - 0.5 * (outer - inner)
    )


def polygon(corners):
    """A simple polygon; distance to its sides, sign by the even-odd rule."""
    corners = np.asarray(corners, dtype=float)

    def distance(x):
        nearest, inside = np.full(len(x), np.inf), np.zeros(len(x), bool)
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            nearest = np.minimum(nearest, to_segment(x, a, b))
            if a[1] != b[1]:
                at = a[0] + (x[:, 1] - a[1]) * (b[0] - a[0]) / (b[1] - a[1])
                inside ^= ((a[1] > x[:, 1]) != (b[1] > x[:, 1])) & (x[:, 0] < at)
        return np.where(inside, -nearest, nearest)

    return distance


def rectangle(width, height):
    w, h = 0.5 * width, 0.5 * height
    return polygon([(-w, -h), (w, -h), (w, h), (-w, h)])


def regular_polygon(n, radius):
    angle = 2.0 * np.pi * np.arange(n) / n
    return polygon(radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def letter_l(size, width):
    """An L in [-size, size]^2 with arms of one width."""
    s, w = size, width - size
    return polygon([(-s, -s), (s, -s), (s, w), (w, w), (w, s), (-s, s)])


def ellipse(a, b):
    """Half axes a >= b; the closest point by bisection, after the known secular equation."""

    def distance(x):
        # (a u / (t + a^2))^2 + (b v / (t + b^2))^2 = 1 has its largest root between these.
        u, v = np.abs(x).T
        low, high = np.maximum(b * v - b * b, -b * b), np.hypot(a * u, b * v) - b * b
        high = np.maximum(high, low)
        for _ in range(80):
            t = 0.5 * (low + high)
            with np.errstate(divide="ignore", invalid="ignore"):
                second = np.where(v > 0.0, b * v / (t + b * b), 0.0)
                outside = (a * u / (t + a * a)) ** 2 + second**2 > 1.0
            low, high = np.where(outside, t, low), np.where(outside, high, t)
        t = 0.5 * (low + high)
        p = np.minimum(a * a * u / (t + a * a), a)
        q = b * np.sqrt(np.maximum(1.0 - (p / a) ** 2, 0.0))
        away = np.hypot(u - p, v - q)
        return np.where((u / a) ** 2 + (v / b) ** 2 < 1.0, -away, away)

    return distance
