"""Measure the errors and steps on grids given in docs/limiting.md; takes half a minute.

python docs/measurements/grids.py
"""

from functools import partial

import numpy as np

import adaptsize as ads
from adaptsize.limiting import FastMarching, HamiltonJacobi
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.limiting.problem import Problem

G = 0.3
LIMIT = partial(ads.limit_gradient, g=G)


def model(n_cells, dim):
    """Return a grid on (-50, 50)^dim, h0 of the two sources, the exact sizes."""
    grid = ads.CartesianGrid([-50.0] * dim, 100.0 / n_cells, (n_cells + 1,) * dim)
    h0 = np.full(grid.shape, np.inf)
    middle = (n_cells // 2,) * (dim - 1)
    h0[(2 * n_cells // 5, *middle)] = 1.0
    h0[(3 * n_cells // 5, *middle)] = 5.0
    return grid, h0, LIMIT(grid, h0, method="exact")


def errors():
    """Print errors of the schemes from bare sources, and from exact sizes within 10 of them."""
    print("dim, cells: edge-based; order 1; order 2; max / mean, bare and exact near")
    for dim, sides in ((2, (100, 200, 400, 800)), (3, (30, 60, 120))):
        for n_cells in sides:
            grid, h0, exact = model(n_cells, dim)
            near = np.zeros(grid.shape, bool)
            for x in (-10.0, 10.0):
                place = np.array([x] + [0.0] * (dim - 1))
                near |= grid.sample(lambda p, c=place: np.linalg.norm(p - c, axis=1)) <= 10.0
            bounds = {"bare": h0, "near": np.where(near, exact, np.inf)}
            found = []
            for method in ("edge-based", "fast-marching", FastMarching(order=2)):
                for bound in bounds.values():
                    error = np.abs(LIMIT(grid, bound, method=method) - exact)
                    found.append(f"{error.max():.4f} / {error.mean():.2g}")
            print(f"{dim} {n_cells}^{dim}: ", "; ".join(found))


def starts():
    """Print steps and errors of the Hamilton-Jacobi iteration from several starts."""
    grid, h0, exact = model(100, 2)
    values = np.array([G])
    for order in (1, 2):
        for name, start in (
            ("50", np.full(grid.shape, 50.0)),
            ("1", np.full(grid.shape, 1.0)),
            ("fast marching", LIMIT(grid, h0, method="fast-marching")),
        ):
            problem = Problem(grid, h0, Slope(values))
            solution = HamiltonJacobi(order, tol=1e-4).iterate(problem, start)
            error = np.abs(solution.h - exact)
            print(f"order {order} from {name}: {solution.iterations} steps, "
                  f"{error.max():.4f} / {error.mean():.4f}")  # fmt: skip


if __name__ == "__main__":
    errors()
    starts()
