"""Refining for one number that is wanted.

Where only the mean over the ringed spot is wanted, triangles become small (dark) around it, and not
at the three other spots, where the solution is just as steep.

The energy error of a solution is large at all four spots.  A mesh for the number J(u), a weighted
mean of u, needs little of that: what an error in a cell does to J is measured by the solution z of
the adjoint problem, which has the weight of the mean as its load.  The error of J is at most the
sum over the cells of the products of the energy errors of u and z [1].  The root of this product is
the indicator, so that the sum of its squares is the bound:

    indicator = sqrt(energy error of u * energy error of z)

Both are estimated by `adaptsize.zz_indicator`.  Linear elements by scikit-fem for
-D div grad u + u = f, whose solution is known.  Measured, with the error relative to J:

| | triangles | error of J | bound |
|---|---:|---:|---:|
| for the goal | 15 779 | 9.8e-5 | 3.6e-4 |
| for the energy | 16 050 | 3.1e-4 | |
| uniform | 15 842 | 6.0e-3 | |

The error for the goal falls with the power -1 of the number of triangles.

[1] R. Becker, R. Rannacher, "An optimal control approach to a posteriori error estimation in finite
element methods", Acta Numerica 10 (2001) 1-102.

```python
import numpy as np

import adaptsize as ads

mesh = ads.read("data/lshape.vtu")
u, z = np.exp(-9.0 * mesh.points.T**2)  # your solver's results for f, and for the weight of J
indicator = np.sqrt(ads.zz_indicator(mesh, u) * ads.zz_indicator(mesh, z))
new = ads.adapt(mesh, indicator, order=1, elements=2000).mesh
ads.plot.plot_mesh(new, path="goal.png")
```

    python examples/plot_goal.py [DIRECTORY]
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from _gallery import CURVES, draw_mesh, drawing, run, save_drawing
from matplotlib.patches import Circle
from skfem import Basis, BilinearForm, ElementTriP1, LinearForm, MeshTri, condense
from skfem import solve as solved
from skfem.helpers import dot

import adaptsize as ads

FloatArray = npt.NDArray[np.float64]
D = 2.5e-3
SPOTS, WIDTH = np.array([(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)]), 0.04
WANTED, BREADTH = np.array([0.29, 0.72]), 0.06  # centre and width of the weight of the mean


class Cycle(NamedTuple):
    """A mesh, the error of J, and indicators of the energy errors of u and z."""

    mesh: ads.SimplexMesh
    error: float
    of_u: FloatArray
    of_z: FloatArray

    @property
    def product(self) -> FloatArray:
        """What a cell contributes to the bound of the error of J."""
        return self.of_u * self.of_z


def main(
    output_dir: Path,
    *,
    width: int = 640,
    targets: Sequence[int] = (1000, 2000, 4000, 8000, 16000),
) -> dict[str, float]:
    """Adapt for each number of ``targets``."""
    start = solve(square(16))
    loops = {"for the goal": [start], "for the energy": [start]}
    for name, cycles in loops.items():
        for target in targets:
            last = cycles[-1]
            indicator = np.sqrt(last.product) if name == "for the goal" else last.of_u
            mesh = ads.adapt(last.mesh, indicator, order=1, elements=target, enough=2.0).mesh
            cycles.append(solve(mesh))
    loops["uniform"] = [start, *(solve(square(round((n / 2) ** 0.5))) for n in targets)]
    draw(output_dir / "goal.png", loops, width)
    found: dict[str, float] = {}
    for name, cycles in loops.items():
        found[f"triangles, {name}"] = cycles[-1].mesh.n_cells
        found[f"error, {name}"] = cycles[-1].error
    found["bound, for the goal"] = float(loops["for the goal"][-1].product.sum()) / exact_mean()
    found["order of the error for the goal"] = order_of(loops["for the goal"][2:])
    return found


def square(n: int) -> ads.SimplexMesh:
    """Return the unit square, each side in n parts."""
    x = np.linspace(0.0, 1.0, n + 1)
    m = MeshTri.init_tensor(x, x)
    return ads.SimplexMesh(m.p.T, m.t.T)


def bump(x: FloatArray, centre: FloatArray, width: float) -> FloatArray:
    """Return a function that is 1 at the centre and 1 / e at the distance ``width``."""
    away = x - centre.reshape(2, *[1] * (x.ndim - 1))
    return np.exp(-(away**2).sum(axis=0) / width**2)


def exact_mean() -> float:
    """Return J: the integral of the product of the solution and the weight."""
    square_sum = WIDTH**2 + BREADTH**2
    away = ((SPOTS - WANTED) ** 2).sum(axis=1)
    return float(np.pi * (WIDTH * BREADTH) ** 2 / square_sum * np.exp(-away / square_sum).sum())


@BilinearForm
def energy(u, v, _):
    return D * dot(u.grad, v.grad) + u * v


@LinearForm
def load(v, w):
    total = 0.0
    for centre in SPOTS:
        r2 = ((w.x - centre.reshape(2, 1, 1)) ** 2).sum(axis=0)
        spot = bump(w.x, centre, WIDTH)
        total = total + spot * (1.0 - D * (4.0 * r2 / WIDTH**2 - 4.0) / WIDTH**2)
    return total * v


@LinearForm
def weight(v, w):
    return bump(w.x, WANTED, BREADTH) * v


def solve(mesh: ads.SimplexMesh) -> Cycle:
    """Return the error of J, and estimates of the energy errors, with linear elements."""
    m = MeshTri(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.cells.T))
    basis = Basis(m, ElementTriP1(), intorder=8)
    matrix, mean = energy.assemble(basis), weight.assemble(basis)
    edge = m.boundary_nodes()
    u = solved(*condense(matrix, load.assemble(basis), D=edge))
    z = solved(*condense(matrix, mean, D=edge))
    error = abs(float(mean @ u) / exact_mean() - 1.0)
    of_u, of_z = (D**0.5 * ads.zz_indicator(mesh, values) for values in (u, z))
    return Cycle(mesh, error, of_u, of_z)


def order_of(cycles: Sequence[Cycle]) -> float:
    """Return the power of the number of triangles with which the error falls."""
    first, last = cycles[0], cycles[-1]
    return float(np.log(last.error / first.error) / np.log(last.mesh.n_cells / first.mesh.n_cells))


def draw(path: Path, loops: dict[str, list[Cycle]], width: int) -> None:
    """Draw the meshes for the goal and for the energy, and the errors."""
    figure, panels = drawing(3, 1, width, shape=1.1)
    k = min(2, len(loops["uniform"]) - 1)
    for panel, name in zip(panels, ("for the goal", "for the energy"), strict=False):
        mesh = loops[name][k].mesh
        draw_mesh(panel, mesh, mesh.sizes())
        panel.add_patch(
            Circle(tuple(WANTED), 1.5 * BREADTH, fill=False, color="white", linewidth=2.0)
        )
        panel.set(aspect="equal")
        panel.set_axis_off()
        panel.set_title(f"{name}:\n{mesh.n_cells} triangles")
    for (name, cycles), color in zip(loops.items(), CURVES, strict=False):
        panels[2].loglog(
            [cycle.mesh.n_cells for cycle in cycles], [cycle.error for cycle in cycles],
            "o-", color=color, label=name,
        )  # fmt: skip
    panels[2].set(xlabel="triangles", ylabel="relative error of J")
    panels[2].legend()
    save_drawing(path, figure, panels[0])


if __name__ == "__main__":
    run(main)
