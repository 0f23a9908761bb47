"""Adaptive loop with any solver.

The error of each cell on the L-shaped domain. At first it sits in the inner corner; after four
cycles every triangle has about the same error.

Section 7.1 of Persson's paper, on the L-shape (data/lshape.vtu).  The loop runs four times: solve,
estimate, `adaptsize.adapt`.  The solver is a few lines of numpy and scipy for the Laplace
equation with piecewise linear elements.  You can replace it by your own, because it exchanges only
the arrays ``points`` and ``cells``.  The solution r^(2/3) sin(2 t / 3) has infinite derivatives at
the reentrant corner.  Uniform meshes of n nodes have an energy error of about n^(-1/3).  Adapted
meshes reach n^(-1/2).

Needs Mmg.

```python
import adaptsize as ads

mesh = ads.read("data/lshape.vtu")
for target in (800, 1600, 3200, 6400):
    x, y = mesh.points.T
    u = (x**2 + y**2) ** (1 / 3)  # your solver's result at the nodes instead
    indicator = ads.zz_indicator(mesh, u)
    mesh = ads.adapt(mesh, indicator, elements=target, max_refine=8.0).mesh
ads.plot.plot_mesh(mesh, path="fem_loop.png")
```

    python examples/fem_loop.py [DIRECTORY]
"""

from pathlib import Path

import numpy as np
import numpy.typing as npt
from _gallery import DATA, run, save_panels
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

import adaptsize as ads
from adaptsize.plot import plot_mesh

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]


def main(output_dir: Path, *, n_cycles: int = 4, width: int = 560) -> dict[str, float | str]:
    mesh = ads.read(DATA / "lshape.vtu")
    counts, errors, panels = [], [], []
    for cycle in range(n_cycles + 1):
        points, cells = mesh.points, mesh.cells  # all that a solver needs
        u = solve_laplace(points, cells, mesh.boundary().nodes)
        counts.append(len(points))
        errors.append(energy_error(points, cells, u))
        title = f"cycle {cycle}: {counts[-1]} nodes\nenergy error {errors[-1]:.4f}"
        indicator = ads.zz_indicator(mesh, u)
        if cycle in (0, n_cycles):
            shown = mesh.with_data(cell_data={"error per cell": indicator})
            picture = plot_mesh(shown, color="error per cell", limits=(5e-5, 2e-2), width=width)
            panels.append((title, picture))
        if cycle == n_cycles:
            break
        mesh = ads.adapt(mesh, indicator, elements=800 * 2**cycle, max_refine=8.0).mesh
    save_panels(output_dir / "fem_loop.png", panels, thumb=0)
    # From the first adapted mesh on: the first step resolves what a uniform mesh does not.
    slope = np.log(errors[-1] / errors[1]) / np.log(counts[-1] / counts[1])
    return {
        "nodes, cycle by cycle": " ".join(map(str, counts)),
        "errors": " ".join(f"{e:.4f}" for e in errors),
        "nodes": counts[-1],
        "error at first": errors[0],
        "error at last": errors[-1],
        "order in the number of nodes": float(-slope),
        "smallest edge": float(mesh.edge_lengths.min()),
    }


def exact_solution(points: FloatArray) -> FloatArray:
    """Return r^(2/3) sin(2 t / 3), harmonic, zero on both edges of the inner corner."""
    x, y = points.T
    angle = np.arctan2(y, x) % (2.0 * np.pi)
    return np.hypot(x, y) ** (2.0 / 3.0) * np.sin(2.0 / 3.0 * angle)


def exact_gradient(points: FloatArray) -> FloatArray:
    """Return its gradient, (2/3) r^(-1/3) (-sin(t / 3), cos(t / 3))."""
    x, y = points[..., 0], points[..., 1]
    third = np.arctan2(y, x) % (2.0 * np.pi) / 3.0
    size = 2.0 / 3.0 * np.hypot(x, y) ** (-1.0 / 3.0)
    return size[..., None] * np.stack([-np.sin(third), np.cos(third)], axis=-1)


def hat_gradients(points: FloatArray, cells: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the gradients of the hat functions, (m, 3, 2), and the areas, (m,)."""
    a, b, c = np.moveaxis(points[cells], 1, 0)
    opposite = np.stack([c - b, a - c, b - a], axis=1)
    twice_area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    turned = np.stack([-opposite[..., 1], opposite[..., 0]], axis=-1)
    return turned / twice_area[:, None, None], 0.5 * np.abs(twice_area)


def solve_laplace(points: FloatArray, cells: IntArray, fixed: IntArray) -> FloatArray:
    """Return nodal values of the linear finite element solution, exact on ``fixed`` nodes."""
    gradients, areas = hat_gradients(points, cells)
    local = np.einsum("mid,mjd,m->mij", gradients, gradients, areas)
    rows, columns = np.repeat(cells, 3, axis=1), np.tile(cells, (1, 3))
    n = len(points)
    matrix = coo_array((local.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n)).tocsr()
    u = exact_solution(points)
    inner = np.setdiff1d(np.arange(n), fixed)
    load = -(matrix[inner][:, fixed] @ u[fixed])
    u[inner] = spsolve(matrix[inner][:, inner].tocsc(), load)
    return u


def energy_error(points: FloatArray, cells: IntArray, u: FloatArray) -> float:
    """Return the L2 norm of the error of the gradient (edge-midpoint-like rule per cell)."""
    gradients, areas = hat_gradients(points, cells)
    computed = np.einsum("mid,mi->md", gradients, u[cells])
    weights = np.full((3, 3), 1.0 / 6.0) + 0.5 * np.eye(3)  # exact for quadratics
    samples = np.einsum("qi,mid->mqd", weights, points[cells])
    square = ((exact_gradient(samples) - computed[:, None, :]) ** 2).sum(axis=-1)
    return float(np.sqrt((square.mean(axis=1) * areas).sum()))


if __name__ == "__main__":
    run(main)
