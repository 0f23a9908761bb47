"""Measure the figures of docs/limiting.md and decisions 3 and 4: ten minutes, --quick one.

python docs/measurements/limiting.py [--quick]
"""

import sys
import time
import warnings
from pathlib import Path

import numpy as np
from scipy.spatial import Delaunay

import adaptsize as ads
from adaptsize.limiting import PositiveCoefficient

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "support"))
from meshes import jittered_cube, jittered_square, random_sphere, random_square

SEED = 20050711
G = 0.3


def two_sources(mesh):
    """Return h0: 1 near (-10, 0), 5 near (10, 0), inf elsewhere."""
    h0 = np.full(mesh.n_points, np.inf)
    for x, size in ((-10.0, 1.0), (10.0, 5.0)):
        place = np.zeros(mesh.dim)
        place[0] = x
        h0[np.argmin(np.linalg.norm(mesh.points - place, axis=1))] = size
    return h0


def accuracy(name, mesh):
    """Print errors of fast marching, the same with exact data near the sources, edge-based."""
    h0 = two_sources(mesh)
    exact = ads.limit_gradient(mesh, h0, G, method="exact")
    h, info = ads.limit_gradient.with_info(mesh, h0, G, method="fast-marching")
    sources = mesh.points[np.isfinite(h0)]
    near = (np.linalg.norm(mesh.points[:, None] - sources, axis=2) <= 10.0).any(axis=1)
    no_tip = ads.limit_gradient(mesh, np.where(near, exact, np.inf), G, method="fast-marching")
    edge = ads.limit_gradient(mesh, h0, G, method="edge-based")
    errors = [np.abs(found - exact) for found in (h, no_tip, edge)]
    columns = " ".join(f"{e.max():.3f}/{e.mean():.3f}" for e in errors)
    print(f"{name} {mesh.n_points}: {columns} accepted/n {info.iterations / mesh.n_points:.4f}")


def positive_coefficient(mesh):
    """Print error, steps and bounds of the scheme of Barth and Sethian, floored and raw."""
    h0 = two_sources(mesh)
    exact = ads.limit_gradient(mesh, h0, G, method="exact")
    from_50 = np.full(mesh.n_points, 50.0)
    for floor in ("hopf-lax", None):
        for name, initial in (("fast marching", None), ("50", from_50)):
            start = time.perf_counter()
            h, info = ads.limit_gradient.with_info(
                mesh, h0, G, method=PositiveCoefficient(floor=floor), initial=initial,
            )  # fmt: skip
            seconds = time.perf_counter() - start
            error = h - exact
            print(
                f"{mesh.n_points} floor {floor} from {name}: {error.min():.3f} to "
                f"{error.max():.3f}, mean {np.abs(error).mean():.3f}, {info.iterations} steps, "
                f"{seconds:.1f} s, largest gradient {info.cell_gradient_quantiles[1.0]:.3f}"
            )


def slivers(n, stretch):
    """Print accepted nodes and policies on stretched Delaunay triangles of random points."""
    points = np.random.default_rng(SEED).uniform(0.0, 1.0, (n, 2))
    mesh = ads.SimplexMesh(points * (stretch, 1.0), Delaunay(points).simplices)
    h0 = np.full(n, np.inf)
    h0[0] = 0.01
    texts = []
    start = time.perf_counter()
    _, info = ads.limit_gradient.with_info(
        mesh, h0, G, method="fast-marching",
        progress=lambda text, share: texts.append(text),
    )  # fmt: skip
    print(
        f"slivers {n}, stretched {stretch}:1: accepted/n {info.iterations / n:.2f}, "
        f"{texts.count('policy iteration')} policies, residual {info.residual:.0e}, "
        f"{time.perf_counter() - start:.2f} s"
    )


def sphere(n):
    """Print the error of the geodesic distance from a point of the unit sphere."""
    mesh = random_sphere(n, SEED)
    h0 = np.full(n, np.inf)
    h0[0] = 0.01
    h = ads.limit_gradient(mesh, h0, 1.0, method="fast-marching")
    error = h - 0.01 - np.arccos(np.clip(mesh.points @ mesh.points[0], -1.0, 1.0))
    print(f"sphere {n}: {error.min():.4f} to {error.max():.4f}, mean {np.abs(error).mean():.4f}")


def exact_gradients(mesh):
    """Print the gradients in the cells of the exact nodal values, over g."""
    _, info = ads.limit_gradient.with_info(mesh, two_sources(mesh), G, method="exact")
    print(f"exact nodal values, gradients over g: {info.cell_gradient_quantiles}")


def main(quick):
    """Measure all, or the smallest mesh of each kind."""
    warnings.simplefilter("ignore")
    sizes = 1 if quick else 3
    for mesh in (random_square(100, SEED), jittered_cube(5, SEED), random_sphere(100, SEED)):
        ads.limit_gradient.with_info(mesh, mesh.points[:, 0] + 60.0, G)  # compile
    for n in (100, 200, 400)[:sizes]:
        accuracy("jittered", jittered_square(n, SEED))
        accuracy("random", random_square(n * n, SEED, half_width=50.0))
    for n in (21, 41, 61)[:sizes]:
        accuracy("tetrahedra", jittered_cube(n, SEED))
    for n in (2500, 10_000, 40_000)[:sizes]:
        sphere(n)
    exact_gradients(jittered_square(100, SEED))
    for n in (5000, 20_000, 80_000)[:sizes]:
        for stretch in (1, 3, 10, 100):
            slivers(n, stretch)
    for n in (51, 101, 201)[:sizes]:
        positive_coefficient(jittered_square(n, SEED))


if __name__ == "__main__":
    main("--quick" in sys.argv)
