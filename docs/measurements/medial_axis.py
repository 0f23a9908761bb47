"""Measure the figures of docs/width.md and decision 17; takes about a minute.

python docs/measurements/medial_axis.py
"""

import resource
import sys
import time
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import adaptsize as ads

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "support"))
import distance_shapes as shapes

# A point is false if it is farther than that from the true axis, in spacings, and a piece of
# the true axis missing if no point is closer.
FALSE, MISSING = 1.5, 2.0
SHIFTS = np.random.default_rng(20060112).random((5, 2))


def line(a, b, n=60_000):
    """Return points along a line."""
    return np.linspace(a, b, n)


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
    """Return the meet of three parabolas about the origin, their vertices ``reach`` away from it.

    Outside near the corners it is the largest of three distances, less than the true one.
    """

    def inside_one(x):
        above = x[:, 1] > -reach + 0.5 * curvature * x[:, 0] ** 2
        away = to_parabola(x, curvature, -reach)
        return np.where(above, -away, away)

    sides = [shapes.turned(inside_one, degrees) for degrees in (0.0, 120.0, 240.0)]
    return lambda x: np.max([side(x) for side in sides], axis=0)


def wavy_disc(radius, height, waves):
    """R = radius + height cos(waves angle); the closest point by Newton's method from samples."""

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


def plane_shapes():
    """Return name -> (distance, points of the true medial axis without branches into corners)."""
    turn = np.radians(20.0)
    end = 0.5 * np.array([np.cos(turn), np.sin(turn)])
    angle = line(0.0, 2.0 * np.pi, 200_000)
    along = line(-0.6, -0.2)
    bent = np.column_stack([along, -0.6 + (along + 0.2) ** 2 / 1.6])
    bent = bent[bent[:, 0] >= bent[:, 1]]
    straight = line((-0.2, -0.6), (0.6, -0.6))
    tips = [0.4 * np.array([np.sin(t), -np.cos(t)]) for t in np.radians([0.0, 120.0, 240.0])]
    return {
        "rectangle 2 : 1, by 20 degrees": (
            shapes.turned(shapes.box(2.0, 1.0), 20.0),
            line(-end, end),
        ),
        "annulus .4, 1": (
            shapes.annulus(0.4, 1.0),
            0.7 * np.column_stack([np.cos(angle), np.sin(angle)]),
        ),
        "ellipse 2 : 1": (shapes.Ellipse(1.0, 0.5), line((-0.75, 0.0), (0.75, 0.0))),
        "L": (
            shapes.letter_l(1.0, 0.8),
            np.concatenate([bent, bent[:, ::-1], straight, straight[:, ::-1]]),
        ),
        "three parabolas": (
            three_parabolas(2.5, 0.8),
            np.concatenate([line((0.0, 0.0), tip) for tip in tips]),
        ),
        "disc": (shapes.ball(0.9), np.zeros((1, 2))),
        "wavy disc": (wavy_disc(0.9, 0.005, 24), None),
    }


def compare(points, axis, step):
    """Return the number found, number of false ones, share missing, median and largest error."""
    if len(points) == 0:
        return 0, 0, 1.0, np.nan, np.nan
    off = cKDTree(axis).query(points)[0] / step
    missing = cKDTree(points).query(axis)[0] / step > MISSING
    true = off[off <= FALSE]
    return len(points), (off > FALSE).sum(), missing.mean(), np.median(true), off.max()


def row(distance, axis, step):
    """Return the means over the places of the grid, and the largest error."""
    results = []
    for shift in SHIFTS:
        grid, phi = shapes.sampled(distance, step, shift=shift, half=1.15)
        results.append(compare(ads.medial_axis(grid, phi).points, axis, step))
    mean, worst = np.mean(results, axis=0), np.max(results, axis=0)
    return (
        f"{mean[0]:8.1f} found {mean[1]:6.1f} false {100 * mean[2]:5.1f} % missing, "
        f"error median {mean[3]:8.1e} largest {worst[4]:6.2f} spacings"
    )


def resolutions():
    """Print what is found at five resolutions."""
    for name, (distance, axis) in plane_shapes().items():
        if axis is None:
            continue
        print(name)
        for n in (10, 20, 40, 80, 160):
            print(f"  1/{n:<4d}", row(distance, axis, 1.0 / n))


def near_the_boundary():
    """Print the smallest distance of a point from the boundary of disturbed shapes."""
    for n in (30, 60, 120):
        grid, phi = shapes.sampled(plane_shapes()["wavy disc"][0], 1.0 / n)
        found = ads.medial_axis(grid, phi)
        print(f"wavy disc 1/{n}: {len(found.points)} points, from {found.radii.min():.3f}")
    rng = np.random.default_rng(19731)
    step = 1.0 / 60.0
    for part in (0.01, 0.03, 0.1, 0.2, 0.3):
        for name in ("rectangle 2 : 1, by 20 degrees", "annulus .4, 1", "disc"):
            distance, axis = plane_shapes()[name]
            grid, phi = shapes.sampled(distance, step)
            noise = part * step * rng.uniform(-1.0, 1.0, phi.shape)
            found = ads.medial_axis(grid, phi + noise)
            _, false, missing, *_ = compare(found.points, axis, step)
            least = found.radii.min() if len(found.points) else np.nan
            print(
                f"noise {part} spacings, {name}: {len(found.points)} points, {false} false, "
                f"{100 * missing:.0f} % missing, radius from {least:.3f}"
            )


def in_space():
    """Print what is found in three solids, and the least feature size."""
    turn = shapes.turn_about((1.0, 2.0, 3.0), 40.0)
    angle = line(0.0, 2.0 * np.pi)
    sheet = np.stack(
        np.meshgrid(line(-0.25, 0.25, 600), line(-0.15, 0.15, 360), [0.0]), -1
    ).reshape(-1, 3)
    by_name = {
        "box 1 x .8 x .5": (shapes.box(1.0, 0.8, 0.5), sheet),
        "torus .55, .22": (
            shapes.torus(0.55, 0.22),
            0.55 * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle]),
        ),
        "cylinder .3, 1.4": (shapes.cylinder(0.3, 1.4), line((0.0, 0.0, -0.4), (0.0, 0.0, 0.4))),
    }
    for name, (distance, axis) in by_name.items():
        for n in (16, 32, 64):
            results, least = [], np.inf
            for k in range(3):
                shape = shapes.turned(distance, np.linalg.matrix_power(turn, k))
                grid, phi = shapes.sampled(shape, 1.0 / n, dim=3, half=0.95, shift=(0.3, 0.1, 0.6))
                found = ads.medial_axis(grid, phi)
                points = found.points @ np.linalg.matrix_power(turn, k)
                results.append(compare(points, axis, 1.0 / n))
                least = min(least, ads.feature_size(grid, phi, found).min())
            mean, worst = np.mean(results, axis=0), np.max(results, axis=0)
            print(
                f"{name} 1/{n}: {mean[0]:.0f} found, {mean[1]:.1f} false, "
                f"{100 * mean[2]:.1f} % missing, error median {mean[3]:.1e}, "
                f"largest {worst[4]:.2f} spacings; least feature size {least:.3f}"
            )


def speed(n=256):
    """Print seconds of this process, and the peak of memory so far."""

    def ribs(x):
        """Return the distance of a plate with a rib across it."""
        parts = []
        for centre, half in (
            ((0.0, 0.0, -0.3), (0.8, 0.6, 0.1)),
            ((0.1, 0.0, 0.1), (0.05, 0.5, 0.5)),
        ):
            away = np.abs(x - centre) - half
            parts.append(
                np.linalg.norm(np.maximum(away, 0.0), axis=1) + np.minimum(away.max(axis=1), 0.0)
            )
        return np.min(parts, axis=0)

    by_name = {"plate and rib": ribs, "torus": shapes.torus(0.6, 0.3), "ball": shapes.ball(0.9)}
    ads.feature_size(
        *shapes.sampled(by_name["torus"], 0.1, dim=3, half=1.0)
    )  # compiled before it is timed
    for name, distance in by_name.items():
        grid = ads.CartesianGrid([-0.95] * 3, 1.9 / (n - 1), (n, n, n))
        phi = grid.sample(distance)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
        start = time.process_time()
        found = ads.medial_axis(grid, phi)
        between = time.process_time()
        ads.feature_size(grid, phi, found)
        end = time.process_time()
        after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
        print(
            f"{n}^3, {name}: {100 * (phi < 0).mean():.0f} % inside, {len(found.points)} points; "
            f"medial axis {between - start:.1f} s, feature size {end - between:.1f} s, "
            f"memory at most {before:.2f} GB before, {after:.2f} GB after"
        )


if __name__ == "__main__":
    for measure in (resolutions, near_the_boundary, in_space, speed):
        print(f"\n{measure.__name__.replace('_', ' ').upper()}\n")
        measure()
