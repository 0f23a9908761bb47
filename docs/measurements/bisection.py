"""Compare `adapt` with bisection at the Fichera corner; needs Mmg and scikit-fem (a minute).

python docs/measurements/bisection.py
"""

import resource
import sys
from pathlib import Path

import numpy as np
from skfem import Basis, ElementTetP1, Functional, MeshTet
from skfem.helpers import dot

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


def adapted(cycle, number, factor):
    """Return the next mesh of ``adapt``, for a number of cells that grows by a factor."""
    elements = 4000 * factor**number
    options = {"order": 1, "elements": elements, "g": G, "max_refine": 8.0}
    return ads.adapt(cycle.mesh, cycle.indicator, **options).mesh


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


if __name__ == "__main__":
    adapted(solve(fichera(2)), 0, 1)  # compile
    for name, refined, factor in (
        ("adapt, times 2", adapted, 2), ("adapt, times 4", adapted, 4), ("bisection", bisected, 1),
    ):  # fmt: skip
        cycle, error, number, of_meshes, in_all = loop(refined, factor)
        print(
            f"| {name} | {number} | {cycle.unknowns} | {error:.4f} | {of_meshes:.1f} | "
            f"{in_all:.1f} |",
            flush=True,
        )
