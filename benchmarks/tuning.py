"""Effect of tuned values at half and at double: predicted elements, and trials of searches.

Run ``python benchmarks/tuning.py``.  The numbers are quoted in ``adaptsize/domain_size/tuning.py``
and ``adaptsize/sizes/search.py``.
"""

import math

import numpy as np
from _shapes import ball, box, ring

from adaptsize import SimplexMesh
from adaptsize.domain_size import budget, tuning
from adaptsize.domain_size.on_surface import SurfaceDomain
from adaptsize.domain_size.request import Request
from adaptsize.options import SizeFunctionOptions, checked
from adaptsize.sizes import search

SIZES = ("PER_RADIAN", "ACROSS", "HMAX_SHARE", "HMIN_SHARE", "LEAST_ACROSS", "STEEPEST", "FULLY")
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


def main():
    """Print a table."""
    base = numbers()
    names = [f"{name}, {kind}" for name in DOMAINS for kind in ("default", "relaxed")]
    print(", ".join(f"{name}: {number:.0f}" for name, number in zip(names, base, strict=True)))
    for name in SIZES:
        value = getattr(tuning, name)
        for factor in (0.5, 2.0):
            setattr(tuning, name, factor * value)
            ratios = ", ".join(f"{ratio:.2f}" for ratio in numbers() / base)
            print(f"{name:12s} times {factor:g}: {ratios}")
        setattr(tuning, name, value)
    for patience in (1, 3, 6):
        print("patience {}: {:.2f} trials, {:.1%} missed".format(patience, *trials(patience)))
    for name in ("FLAT", "STALLED", "LEAST_ORDER", "LARGEST_ORDER", "INSIDE"):
        value = getattr(search, f"_{name}")
        for factor in (0.5, 2.0):
            setattr(search, f"_{name}", type(value)(factor * value))
            print("{:13s} times {:g}: {:.2f} trials, {:.1%} missed".format(name, factor, *trials()))
        setattr(search, f"_{name}", value)


if __name__ == "__main__":
    main()
