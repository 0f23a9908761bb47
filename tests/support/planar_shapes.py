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


def to_parabola(x, curvature, lowest):
    """Return the distance of points from y = lowest + curvature / 2 x^2, by Cardano's formula."""
    k = 0.5 * curvature
    u, v = x[:, 0], x[:, 1] - lowest
    p, q = (1.0 - 2.0 * k * v) / (2.0 * k * k), -u / (2.0 * k * k)  # t^3 + p t + q = 0
    discriminant = (q / 2.0) ** 2 + (p / 3.0) ** 3
    root = np.sqrt(np.maximum(discriminant, 0.0))
    single = np.cbrt(-q / 2.0 + root) + np.cbrt(-q / 2.0 - root)
    scale = np.sqrt(np.maximum(-p / 3.0, 1e-30))
    angle = np.arccos(np.clip(-q / (2.0 * scale**3), -1.0, 1.0)) / 3.0
    nearest = np.full(len(x), np.inf)
    for turn in range(3):
        t = np.where(
            discriminant >= 0.0, single, 2.0 * scale * np.cos(angle - 2.0 * np.pi * turn / 3.0)
        )
        nearest = np.minimum(nearest, np.hypot(u - t, v - k * t * t))
    return nearest


def three_parabolas(curvature, reach):
    """The meet of three parabolas about the origin, their vertices ``reach`` away from it.

    Outside near the corners it is the largest of three distances, less than the true one.
    """

    def inside_one(x):
        above = x[:, 1] > -reach + 0.5 * curvature * x[:, 0] ** 2
        away = to_parabola(x, curvature, -reach)
        return np.where(above, -away, away)

    sides = [turned(inside_one, degrees) for degrees in (0.0, 120.0, 240.0)]
    return lambda x: np.max([side(x) for side in sides], axis=0)


def wavy_disc(radius, height, waves):
    """r = radius + height cos(waves angle); the closest point by Newton's method from samples."""
    from scipy.spatial import cKDTree

    def curve(t, derivative):
        r = np.array(
            [
                radius + height * np.cos(waves * t),
                -height * waves * np.sin(waves * t),
                -height * waves**2 * np.cos(waves * t),
            ]
        )
        c, s = np.cos(t), np.sin(t)
        if derivative == 0:
            return np.column_stack([r[0] * c, r[0] * s])
        if derivative == 1:
            return np.column_stack([r[1] * c - r[0] * s, r[1] * s + r[0] * c])
        along, across = r[2] - r[0], 2.0 * r[1]
        return np.column_stack([along * c - across * s, along * s + across * c])

    samples = np.linspace(0.0, 2.0 * np.pi, 400 * waves, endpoint=False)
    tree = cKDTree(curve(samples, 0))

    def distance(x):
        t = samples[tree.query(x)[1]]
        for _ in range(3):
            gap, tangent = curve(t, 0) - x, curve(t, 1)
            slope = (tangent**2).sum(axis=1) + (gap * curve(t, 2)).sum(axis=1)
            step = (gap * tangent).sum(axis=1) / np.where(np.abs(slope) > 1e-6, slope, np.inf)
            t = t - np.clip(step, -0.01 / waves, 0.01 / waves)
        away = np.linalg.norm(curve(t, 0) - x, axis=1)
        angle = np.arctan2(x[:, 1], x[:, 0])
        inside = np.linalg.norm(x, axis=1) < radius + height * np.cos(waves * angle)
        return np.where(inside, -away, away)

    return distance
