"""Compare new meshes with bisection, at the Fichera corner and on an L; a minute.

python docs/measurements/bisection.py

Needs Mmg and scikit-fem.
"""

import resource
import sys
from pathlib import Path

import numpy as np
from skfem import Basis, ElementTetP1, ElementTriP1, Functional, MeshTet, MeshTri, condense
from skfem import solve as solve_linear
from skfem.helpers import dot
from skfem.models.poisson import laplace

import adaptsize as ads

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
from plot_fichera import G, exact_gradient, fichera, solve

ERROR = 0.061
"""Relative error in the energy norm at which the loops stop."""


@Functional
def energy(w):
    """Return the square of the exact gradient."""
    return dot(exact_gradient(w.x), exact_gradient(w.x))


def of_scikit_fem(mesh):
    """Return the same tetrahedra as a mesh of scikit-fem."""
    return MeshTet(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.cells.T))


def seconds():
    """Return the processor time of this process and of those that it has run."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(own.ru_utime + own.ru_stime for own in used)


def adapted(cycle, number, factor, backend="mmg"):
    """Return the next mesh of ``adapt``, for a number of cells that grows by a factor."""
    elements = 4000 * factor**number
    options = {"order": 1, "elements": elements, "g": G, "max_refine": 8.0}
    return ads.adapt(cycle.mesh, cycle.indicator, backend=backend, **options).mesh


def divided(cycle, number, factor):
    """Return the next mesh of ``adapt`` by bisection."""
    return adapted(cycle, number, factor, "bisection")


def bisected(cycle, number, factor):
    """Return the mesh with the cells bisected that have half of the squared error."""
    square = cycle.indicator**2
    worst = np.argsort(-square)
    n = np.searchsorted(np.cumsum(square[worst]), 0.5 * square.sum()) + 1
    mesh = of_scikit_fem(cycle.mesh).refined(worst[:n])
    return ads.SimplexMesh(mesh.p.T, mesh.t.T)


def loop(refined, factor):
    """Return the last cycle, their number, and the seconds for meshes and in all."""
    start, of_meshes, number = seconds(), 0.0, 0
    cycle = solve(fichera(4))
    norm = energy.assemble(Basis(of_scikit_fem(fichera(8)), ElementTetP1(), intorder=6)) ** 0.5
    while cycle.error > ERROR * norm:
        before = seconds()
        mesh = refined(cycle, number, factor)
        of_meshes += seconds() - before
        cycle, number = solve(mesh), number + 1
    return cycle, cycle.error / norm, number, of_meshes, seconds() - start


def exact_on_l(x):
    """Return r^(2/3) sin(2 t / 3), and its gradient, at points, float64[2, ...]."""
    r, t = np.hypot(*x), np.mod(np.arctan2(x[1], x[0]), 2.0 * np.pi)
    r = np.maximum(r, 1e-300)
    radial, angular = (2.0 / 3.0 * r ** (-1.0 / 3.0) * f(2.0 * t / 3.0) for f in (np.sin, np.cos))
    gradient = np.array(
        [radial * np.cos(t) - angular * np.sin(t), radial * np.sin(t) + angular * np.cos(t)]
    )
    return r ** (2.0 / 3.0) * np.sin(2.0 * t / 3.0), gradient


@Functional
def square_on_l(w):
    """Return the squared error of the gradient."""
    return ((w["u"].grad - exact_on_l(w.x)[1]) ** 2).sum(axis=0)


def errors_on_l(mesh):
    """Return the error of linear elements in each cell, in the energy norm."""
    own = MeshTri(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.cells.T))
    basis = Basis(own, ElementTriP1(), intorder=6)
    fixed, u = own.boundary_nodes(), exact_on_l(own.p)[0]
    u = solve_linear(*condense(laplace.assemble(basis), x=u, D=fixed))
    return np.sqrt(square_on_l.elemental(basis, u=basis.interpolate(u)))


def loop_on_l(backend, tolerance):
    """Return the last mesh and error, the cycles, and the seconds for meshes and in all."""
    start, of_meshes = seconds(), 0.0
    mesh = ads.SimplexMesh(
        [[-1, -1], [0, -1], [-1, 0], [0, 0], [1, 0], [-1, 1], [0, 1], [1, 1]],
        [[0, 1, 2], [1, 3, 2], [2, 3, 5], [3, 6, 5], [3, 4, 6], [4, 7, 6]],
    )
    for cycle in range(40):
        eta = errors_on_l(mesh)
        before = seconds()
        result = ads.adapt(mesh, eta, tolerance=tolerance, backend=backend)
        of_meshes += seconds() - before
        if not result.remeshed:
            return mesh, np.linalg.norm(eta), cycle, of_meshes, seconds() - start
        mesh = result.mesh
    raise SystemExit(f"{backend}: no end")


def at_the_corner():
    """Print the table of the Fichera corner."""
    for backend in ("mmg", "bisection"):
        adapted(solve(fichera(2)), 0, 1, backend)  # compile
    for name, refined, factor in (
        ("`adapt`, times 2", adapted, 2), ("`adapt`, times 4", adapted, 4),
        ("`adapt` with bisection, times 2", divided, 2), ("scikit-fem", bisected, 1),
    ):  # fmt: skip
        cycle, error, number, of_meshes, in_all = loop(refined, factor)
        print(
            f"| {name} | {number} | {cycle.unknowns} | {error:.4f} | {of_meshes:.1f} | "
            f"{in_all:.1f} |",
            flush=True,
        )


def on_an_l():
    """Print the table of the L."""
    for backend in ("mmg", "bisection"):
        loop_on_l(backend, 0.1)  # compile
    for tolerance in (0.02, 0.01, 0.004):
        for backend in ("mmg", "bisection"):
            mesh, error, number, of_meshes, in_all = loop_on_l(backend, tolerance)
            print(
                f"| {tolerance:g} | {backend} | {number} | {mesh.n_points} | {error:.5f} | "
                f"{error * mesh.n_points**0.5:.2f} | {of_meshes:.2f} | {in_all:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    at_the_corner()
    on_an_l()
