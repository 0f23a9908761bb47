"""Effect of tuned values at half and at double: elements, trials of searches, errors of distances.

Run ``python benchmarks/tuning.py``, or with ``sizes``, ``search`` or ``geometry`` for a part of it.
The numbers are quoted in ``adaptsize/domain_size/tuning.py``, ``adaptsize/sizes/tuning.py`` and
``adaptsize/geometry/tuning.py``.
"""

import math
import sys

import numpy as np
from _shapes import ball, box, ring
from scipy.spatial import cKDTree

from adaptsize import CartesianGrid, SimplexMesh, signed_distance
from adaptsize.domain_size import budget, tuning
from adaptsize.domain_size.on_surface import SurfaceDomain
from adaptsize.domain_size.request import Request
from adaptsize.geometry import tuning as of_geometry
from adaptsize.geometry.implicit_surface import largest_curvature
from adaptsize.options import SizeFunctionOptions, checked
from adaptsize.sizes import search
from adaptsize.sizes import tuning as of_sizes

SIZES = (
    "PER_RADIAN",
    "ACROSS",
    "HMAX_SHARE",
    "HMIN_SHARE",
    "LEAST_ACROSS",
    "GRADIENT_OVER_DEFAULT",
    "FULLY",
)
DOMAINS = {"ball": ball(200), "ring": ring(40, 16), "plate": box(10.0, 8.0, 0.5)}


def numbers():
    """Return the predicted elements of each domain: by default, and fully relaxed."""
    request = Request.of(checked(SizeFunctionOptions, {}))
    rows = []
    for surface in DOMAINS.values():
        domain = SurfaceDomain.of(SimplexMesh(*surface), request.crease_angle)
        for size in (budget._relaxed(domain, request, 1.0), budget._fully_relaxed(domain, request)):
            rows.append(size.report.n_elements)
    return np.array(rows)


def falling(count=400):
    """Yield numbers that fall in eight steps, a fifth of them flat, and how far is to be gone."""
    rng = np.random.default_rng(7)
    for _ in range(count):
        at = np.cumsum(np.append(-8.0, rng.uniform(0.3, 4.0, 8)))
        order = rng.uniform(1.5, 3.0)
        fall = order * rng.uniform(0.3, 1.5, 8) * (rng.random(8) < 0.8)
        y = -np.cumsum(np.append(0.0, fall * np.diff(at)))
        y -= np.interp(0.0, at, y)
        yield at, y, order, rng.uniform(max(-3.0, y[-1]), min(3.0, y[0]))


def trials(patience=3):
    """Return the mean number of trials, and the share of searches that end without success."""
    used, missed = [], []
    for at, y, order, wanted in falling():
        one = search.Search(math.exp(wanted), order, 0.02, patience=patience, most=16)
        while (factor := one.factor) is not None:
            one.add(math.exp(np.interp(math.log(factor), at, y)), None)
        used.append(len(one.trials))
        missed.append(abs(one.miss) > 0.02)
    return np.mean(used), np.mean(missed)


def ellipse(x):
    """Return a function that is negative within an ellipse, or an ellipsoid of revolution."""
    return np.expm1(x[:, 0] ** 2 / 4.0 + (x[:, 1:] ** 2).sum(axis=1) - 1.0)


def errors():
    """Return the largest errors: of distances, in spacings, and the share of curvatures, by dim."""
    rows = []
    angle = np.linspace(0.0, np.pi, 100_001)
    tree = cKDTree(np.column_stack([2.0 * np.cos(angle), np.sin(angle)]))
    for dim, n in ((2, 60), (3, 16)):
        grid = CartesianGrid([-2.6] * dim, spacing=5.2 / (n - 1), shape=(n,) * dim)
        found = np.abs(signed_distance(grid, ellipse).ravel())
        x = grid.points
        meridian = np.column_stack([x[:, 0], np.linalg.norm(x[:, 1:], axis=1)])
        rows.append(np.abs(found - tree.query(meridian)[0]).max() / grid.spacing[0])
        at = np.linspace(0.05, np.pi - 0.05, 200)
        points = np.zeros((200, dim))
        points[:, 0], points[:, 1] = 2.0 * np.cos(at), np.sin(at)
        speed = np.hypot(2.0 * np.sin(at), np.cos(at))
        exact = 2.0 / speed**3
        if dim == 3:
            exact = np.maximum(exact, 2.0 / speed)
        kappa = largest_curvature(ellipse, points, np.full(200, 0.3), least_step=1e-4)
        rows.append(np.abs(kappa / exact - 1.0).max())
    return np.array(rows)


def halved_and_doubled(module, names, result, line):
    """Print what a function returns with half and double each of some values of a module."""
    for name in names:
        value = getattr(module, name)
        for factor in (0.5, 2.0):
            setattr(module, name, type(value)(factor * value))
            print(f"{name.strip('_'):18s} times {factor:g}: {line(result())}", flush=True)
        setattr(module, name, value)


def sizes():
    """Print how many elements are predicted."""
    base = numbers()
    names = [f"{name}, {kind}" for name in DOMAINS for kind in ("default", "relaxed")]
    print(", ".join(f"{name}: {number:.0f}" for name, number in zip(names, base, strict=True)))

    def line(found):
        return ", ".join(f"{ratio:.2f}" for ratio in found / base)

    halved_and_doubled(tuning, SIZES, numbers, line)
    halved_and_doubled(of_geometry, ("BESIDE_EDGE", "LONG_FACET"), numbers, line)


def searches():
    """Print how many trials searches need."""
    line = "{0[0]:.2f} trials, {0[1]:.1%} missed".format
    for patience in (1, 3, 6):
        print(f"patience {patience}: {line(trials(patience))}")
    names = ("FLAT_ORDER", "STALLED", "LEAST_ORDER", "LARGEST_ORDER", "INSIDE_BRACKET")
    halved_and_doubled(of_sizes, names, trials, line)


def geometry():
    """Print errors of distances and curvatures in the plane and in space."""

    def line(found):
        return ", ".join(f"{error:.2g}" for error in found)

    print(f"distance and curvature in the plane and in space: {line(errors())}")
    names = ("STEP_OF_GRADIENT", "STEP_OF_CURVATURE", "SHARE_OF_STEP", "TURN", "STEP_CHANGE",
             "MOST_CHANGES", "OFF_LEVEL", "REACH_OF_PARABOLA")  # fmt: skip
    halved_and_doubled(of_geometry, names, errors, line)


PARTS = {"sizes": sizes, "search": searches, "geometry": geometry}

if __name__ == "__main__":
    for part in sys.argv[1:] or PARTS:
        PARTS[part]()
