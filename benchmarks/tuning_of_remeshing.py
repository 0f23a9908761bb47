"""Effect of tuned values of remeshing at half and at double.

Run ``python benchmarks/tuning_of_remeshing.py``, in 10 minutes or so.  The figures are quoted in
``adaptsize/remeshing/tuning.py``: cells, the share of edges in the band, and the distance from the
boundary in tolerances, of a disc whose sizes grow off a point, of a ring, and of a
ball whose sizes grow along it.
"""

import time
import warnings
from collections.abc import Mapping

import numpy as np
from _shapes import ball, ring

from adaptsize import SimplexMesh, remesh, size_conformity
from adaptsize.domain_size import size_function
from adaptsize.remeshing import tuning

TOLERANCE = 1e-3
VALUES = (
    "RIDGE_ANGLE", "HAUSD", "HAUSD_OF_ADAPTED", "HAUSD_ON_SURFACE", "FACTOR_OF_ADAPTED", "TURNS",
    "GOOD_SHARE", "CORRECTION", "CORRECTION_ON_SURFACE", "LEAST_GRADIENT", "BULGE",
    "EDGE_OVER_SIZE_FOR_GENERATORS",
)  # fmt: skip


def disc():
    """Return a disc of 200 arcs, and sizes that grow off a point."""
    angle = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    spokes = np.column_stack([np.full(200, 200), np.arange(200), (np.arange(200) + 1) % 200])
    mesh = SimplexMesh(np.vstack([rim, [[0.0, 0.0]]]), spokes)
    return mesh, lambda x: 0.01 + 0.2 * np.linalg.norm(x - [0.3, 0.2], axis=1)


def part():
    """Return a ring, and its size function."""
    mesh = SimplexMesh(*ring(20, 8))
    return mesh, size_function(mesh, tolerance=TOLERANCE)


def solid():
    """Return the tetrahedra in a ball, and sizes that grow along it."""
    mesh = remesh(SimplexMesh(*ball(300)), 0.2)
    return mesh, lambda x: 0.05 + 0.2 * (x[:, 0] + 0.5)


CASES = {"disc": disc(), "ring": part(), "ball": solid()}


def figures():
    """Return the cells, the share in the band and the distance for each mesh."""
    rows = []
    for mesh, size in CASES.values():
        new = remesh(mesh, size, tolerance=TOLERANCE, backend="mmg")
        skin = mesh if mesh.cell_dim < mesh.dim else mesh.boundary().mesh
        found = size_conformity(new, size, surface=skin)
        distance = found.hausdorff / (TOLERANCE * mesh.diagonal)
        rows.append((new.n_cells, found.share_in_band, distance))
    return np.array(rows)


def times(value, factor):
    """Return a value, or each of several, times a factor."""
    if isinstance(value, Mapping):
        return {key: times(one, factor) for key, one in value.items()}
    if isinstance(value, tuple):
        return tuple(times(one, factor) for one in value)
    return max(1, round(factor * value)) if isinstance(value, int) else factor * value


def main():
    """Print a table."""
    warnings.simplefilter("ignore")
    base = figures()
    for name, (cells, band, distance) in zip(CASES, base, strict=True):
        print(f"{name}: {cells:.0f} cells, {band:.1%} in the band, {distance:.2f} tolerances")
    for name in VALUES:
        value = getattr(tuning, name)
        for factor in (0.5, 2.0):
            setattr(tuning, name, times(value, factor))
            began = time.process_time()
            try:
                found = figures()
                text = "; ".join(
                    f"{cells / was:.2f} x, {band:.3f}, {distance:.2f}"
                    for (cells, band, distance), (was, *_) in zip(found, base, strict=True)
                )
            except Exception as error:
                text = f"{type(error).__name__}: {error}"
            print(f"{name:22s} times {factor:g}: {text} ({time.process_time() - began:.0f} s)")
            setattr(tuning, name, value)


if __name__ == "__main__":
    main()
