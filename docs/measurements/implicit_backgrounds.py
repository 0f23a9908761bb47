"""Measure sizes between the nodes of the background of implicit domains; takes some minutes.

python docs/measurements/implicit_backgrounds.py [name ...]

For each domain: nodes of the background, largest and 99.9 % quantile of the relative error of the
size at random points inside, and processor time, on the octree that `size_function` chooses and on
a uniform grid of 250 boxes along the longest side (100 in space).
"""

import sys
import time

import numpy as np
from scipy.spatial import cKDTree

import adaptsize as ads

G = 0.25
K = 4.0
FREE = {"g": G, "hmax": 100.0, "max_elements": np.inf}
CURVATURE = {**FREE, "elements_per_radian": K, "elements_across": 0.0}
WIDTH = {**FREE, "elements_per_radian": 0.0, "elements_across": 2.0}
BOXES = {2: 250, 3: 100}
RNG = np.random.default_rng(20061)


# --- domains and exact sizes -------------------------------------------------------


def disc(x):
    """Return the signed distance to the unit circle."""
    return np.linalg.norm(x, axis=1) - 1.0


def ellipse(x):
    """Return a function, no distance, whose zero level is an ellipse with axes 4 : 1."""
    return x[:, 0] ** 2 + (4.0 * x[:, 1]) ** 2 - 1.0


def ellipse_size(x):
    """Return the least of 1 / (K kappa) at a point of the boundary, plus g times the distance."""
    t = np.linspace(0.0, 2.0 * np.pi, 4_001)
    points = np.column_stack([np.cos(t), 0.25 * np.sin(t)])
    radius = (np.sin(t) ** 2 + (0.25 * np.cos(t)) ** 2) ** 1.5 / 0.25
    return least(x, points, radius / K)


def least(x, points, sizes):
    """Return the least of size + g times distance over all given points."""
    result = np.full(len(x), np.inf)
    for i in range(0, len(x), 500):
        part = slice(i, i + 500)
        away = np.linalg.norm(x[part, None] - points, axis=2)
        result[part] = (sizes + G * away).min(axis=1)
    return result


def gap(x, half=0.004, radius=0.3):
    """Return the signed distance of a disc with two holes that leave a thin wall between them."""
    holes = [radius - np.hypot(x[:, 0] - side * (radius + half), x[:, 1]) for side in (-1.0, 1.0)]
    return np.maximum(np.linalg.norm(x, axis=1) - 1.0, np.maximum(*holes))


def plate(x, half=0.01):
    """Return a square with a slot that is 1/100 of it wide: two kinds of narrow places."""
    square = np.abs(x).max(axis=1) - 1.0
    slot = np.maximum(np.abs(x[:, 0] - 0.93 + half), np.abs(x[:, 1]) - 0.5 + half) - half
    return np.maximum(square, -slot)


def smooth_union(x):
    """Return three metaballs, no distance, joined by a neck."""
    centres = np.array([[-0.5, 0.0], [0.5, 0.1], [0.1, 0.62]])
    return 1.0 - sum(0.09 / ((x - c) ** 2).sum(axis=1) for c in centres)


def torus(x):
    """Return the signed distance to a torus of radii 1 and 0.3."""
    return np.hypot(np.hypot(x[:, 0], x[:, 1]) - 1.0, x[:, 2]) - 0.3


def rounded_box(x, radius=0.1):
    """Return the signed distance to a box of 2 x 1 x 0.6 with rounded edges."""
    q = np.abs(x) - np.array([1.0, 0.5, 0.3]) + radius
    outside = np.linalg.norm(np.maximum(q, 0.0), axis=1)
    return outside + np.minimum(q.max(axis=1), 0.0) - radius


def rounded_box_size(x, radius=0.1):
    """Return the size from the rounded edges, whose cylinders are sampled densely."""
    half = np.array([1.0, 0.5, 0.3]) - radius
    points = []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        along, angle = np.meshgrid(
            np.linspace(0.0, half[axis], 200), np.linspace(0.0, np.pi / 2, 40), indexing="ij"
        )
        edge = np.empty((along.size, 3))
        edge[:, axis] = along.ravel()
        edge[:, others[0]] = half[others[0]] + radius * np.cos(angle).ravel()
        edge[:, others[1]] = half[others[1]] + radius * np.sin(angle).ravel()
        points.append(edge)
    one, other = np.meshgrid(*[np.linspace(0.0, np.pi / 2, 60)] * 2, indexing="ij")
    ball = np.stack([np.cos(one) * np.cos(other), np.sin(one) * np.cos(other), np.sin(other)])
    points.append(half + radius * ball.reshape(3, -1).T)
    away = cKDTree(np.concatenate(points)).query(np.abs(x))[0]
    return radius / K + G * away


def two_balls(x):
    """Return two balls joined by a thin rod, a union of distances."""
    ball = np.minimum(*(np.linalg.norm(x - [s, 0.0, 0.0], axis=1) - 0.5 for s in (-1.0, 1.0)))
    rod = np.maximum(np.hypot(x[:, 1], x[:, 2]) - 0.03, np.abs(x[:, 0]) - 1.0)
    return np.minimum(ball, rod)


# name: function, box, options, exact size or None for a reference on a finer background
CASES = {
    "disc, curvature": (disc, 2, 1.3, CURVATURE, lambda x: 1 / K - G * disc(x)),
    "disc, width": (disc, 2, 1.3, WIDTH, lambda x: np.ones(len(x))),
    "ellipse 4:1, curvature": (ellipse, 2, [1.2, 0.4], CURVATURE, ellipse_size),
    "disc with a thin wall": (gap, 2, 1.1, {**FREE, "hmax": 0.1}, None),
    "square with a slot": (plate, 2, 1.1, {**FREE, "hmax": 0.2}, None),
    "metaballs": (smooth_union, 2, 1.2, {**FREE, "hmax": 0.3}, None),
    "torus, curvature": (torus, 3, [1.4, 1.4, 0.4], CURVATURE, lambda x: 0.3 / K - G * torus(x)),
    "torus, width": (torus, 3, [1.4, 1.4, 0.4], WIDTH, lambda x: np.full(len(x), 0.3)),
    "rounded box": (rounded_box, 3, [1.1, 0.6, 0.4], CURVATURE, rounded_box_size),
    "balls and rod": (two_balls, 3, [1.6, 0.6, 0.6], {**FREE, "hmax": 0.15}, None),
}


def samples(function, half, dim, n=20_000):
    """Return random points inside, a half of them near the boundary of the domain."""
    half = np.broadcast_to(half, dim)
    x = RNG.uniform(-half, half, (40 * n, dim))
    values = function(x)
    inside = np.flatnonzero(values < 0.0)
    near = inside[np.argsort(-values[inside])[: len(inside) // 10]]
    return np.concatenate([x[inside[: n // 2]], RNG.choice(x[near], n // 2)])


def measure(name):
    """Print the figures of one domain."""
    function, dim, half, options, exact = CASES[name]
    half = np.broadcast_to(half, dim).astype(float)
    box = (-half, half)
    x = samples(function, half, dim)
    corners = np.array(box)
    grid = ads.CartesianGrid.around(corners, 2.0 * float(half.max()) / BOXES[dim])
    wanted = None if exact is None else exact(x)
    for kind, more in (("octree", {"box": box}), ("grid", {"background": grid})):
        start = time.process_time()
        size = ads.size_function(function, **options, **more)
        spent = time.process_time() - start
        if wanted is None:
            wanted = reference(function, half, dim, options, size)(x)
        off = size(x) / wanted - 1.0
        low, high = off.min(), off.max()
        q = np.quantile(np.abs(off), 0.999)
        print(
            f"{name:24} {kind:7} {size.background.n_points:8d} nodes, error {low:+7.1%} to "
            f"{high:+7.1%}, 99.9 % {q:6.1%}, {spent:6.2f} s",
            flush=True,
        )


def reference(function, half, dim, options, size):
    """Return the size function on a background that is twice finer than the given one."""
    tree = ads.Octree(
        size.background.lower,
        size.background.upper,
        size.background.root_shape,
        np.repeat(size.background.levels + 1, 2**dim),
    )
    return ads.size_function(function, background=tree, **options)


if __name__ == "__main__":
    chosen = sys.argv[1:] or CASES
    for name in chosen:
        measure(name)
