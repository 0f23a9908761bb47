"""Measure the figures of docs/adaptation.md; takes about three minutes, needs Mmg.

python docs/measurements/adaptation.py
"""

import sys
import time
from pathlib import Path

import numpy as np

import adaptsize as ads
from adaptsize.sizes import recovered_gradient, recovered_hessian

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "support"))
sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
import fem_loop
from meshes import jittered_cube, jittered_square
from recovery import (
    MESHES,
    gradient_errors,
    means_of_cell_gradients,
    root_mean_square,
    solve_poisson,
    wave,
)

ROOT = Path(__file__).parents[2]
G = 0.3


def recovery(kind, n):
    """Print errors of the recovered derivatives of a smooth field, and of a solution."""
    mesh = MESHES[kind](n)
    u, gradient, hessian = wave(mesh.points)
    start = time.process_time()
    fitted = recovered_hessian(mesh, u)
    seconds = time.process_time() - start
    row = [root_mean_square(recovered_gradient(mesh, u) - gradient)]
    row += [root_mean_square(fitted - hessian)]
    first = means_of_cell_gradients(mesh, u)
    twice = np.stack([means_of_cell_gradients(mesh, part) for part in first.T], axis=1)
    row += [root_mean_square(first - gradient), root_mean_square(twice - hessian)]
    solution = solve_poisson(mesh, u, -np.trace(hessian, axis1=1, axis2=2))
    row += [root_mean_square(recovered_hessian(mesh, solution) - hessian)]
    true = np.linalg.norm(gradient_errors(mesh, solution, lambda x: wave(x)[1]))
    estimate = np.linalg.norm(ads.zz_indicator(mesh, solution)) / true
    print(kind, n, " ".join(f"{e:.4f}" for e in row), f"estimate / error {estimate:.4f}",
          f"{1e6 * seconds / mesh.n_points:.0f} us per node")  # fmt: skip


def lshape():
    """Print errors and numbers of elements of an adaptive loop on the L-shape."""
    mesh = ads.read(ROOT / "data" / "lshape.vtu")
    for wanted in (500, 1000, 2000, 4000, 8000, 16000, None):
        u = fem_loop.solve_laplace(mesh.points, mesh.cells, mesh.boundary().nodes)
        error = fem_loop.energy_error(mesh.points, mesh.cells, u)
        eta = ads.zz_indicator(mesh, u)
        print(f"{mesh.n_points} nodes, {mesh.n_cells} triangles, error {error:.5f}, "
              f"error * sqrt(nodes) {error * mesh.n_points**0.5:.3f}, "
              f"estimate / error {np.linalg.norm(eta) / error:.3f}; next {wanted}")  # fmt: skip
        if wanted is not None:
            h = ads.size_from_error(mesh, eta, order=1, elements=wanted, max_refine=8,
                                    g=G)  # fmt: skip
            mesh = ads.remesh(mesh, ads.SizeFunction(mesh, h), backend="mmg")


def shell(x):
    """Return a layer of thickness 0.1 around a circle or sphere."""
    return np.tanh((np.linalg.norm(x - 0.5, axis=1) - 0.5) / 0.05)


def interpolation_error(mesh):
    """Return the largest error of linear interpolation at the middles of edges and cells."""
    nodal = shell(mesh.points)
    i, j = mesh.edges.T
    edges = shell(0.5 * (mesh.points[i] + mesh.points[j])) - 0.5 * (nodal[i] + nodal[j])
    cells = shell(mesh.points[mesh.cells].mean(axis=1)) - nodal[mesh.cells].mean(axis=1)
    return max(np.abs(edges).max(), np.abs(cells).max())


def layers():
    """Print numbers of elements, and errors against tolerances, from second derivatives."""
    for start, counts in (
        (jittered_square(24, 5, half_width=1.0), (1000, 2000, 4000, 8000, 8000)),
        (jittered_cube(12, 5, half_width=1.0), (10_000, 20_000, 40_000, 40_000)),
    ):
        mesh = start
        for wanted in counts:
            h = ads.size_from_hessian(mesh, shell(mesh.points), elements=wanted,
                                      hmin=0.004, hmax=0.5, g=G)  # fmt: skip
            mesh = ads.remesh(mesh, ads.SizeFunction(mesh, h), backend="mmg")
            print(f"wanted {wanted}, got {mesh.n_cells}, {mesh.n_cells / wanted:.3f}")
    for tolerance in (0.04, 0.01, 0.0025):
        mesh = jittered_square(24, 5, half_width=1.0)
        for _ in range(5):
            h = ads.size_from_hessian(mesh, shell(mesh.points), tolerance=tolerance,
                                      hmin=0.002, hmax=0.5, g=G)  # fmt: skip
            mesh = ads.remesh(mesh, ads.SizeFunction(mesh, h), backend="mmg")
        print(f"tolerance {tolerance}: {mesh.n_cells} triangles, {interpolation_error(mesh):.5f}")


if __name__ == "__main__":
    for kind, counts in (("jittered", (21, 41, 81, 161)), ("cube", (9, 17, 25))):
        for n in counts:
            recovery(kind, n)
    lshape()
    layers()
