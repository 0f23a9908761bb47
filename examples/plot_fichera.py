"""Fichera corner with tetrahedra.

The tetrahedra are small (dark) along the three inner edges and smallest in the corner where these
meet, and the error falls faster than on uniform meshes (a).

A solution with the singularities of the Fichera corner, known everywhere: the sum of r^(2/3) for
the distances r from the three inner edges.  Linear elements by scikit-fem, the error estimated by
`adaptsize.zz_indicator`, and `adaptsize.adapt` to a number of tetrahedra that doubles from 4000.
Measured, with the power of the number of unknowns over the last three:

| | tetrahedra | unknowns | energy error | power | smallest angle | iterations |
|---|---:|---:|---:|---:|---:|---:|
| uniform | 172 032 | 25 695 | 0.363 | -0.25 | 45 | 104 |
| Mmg | 60 818 | 8885 | 0.322 | -0.29 | 19.5 | 76 |
| fTetWild | 18 089 | 2624 | 0.455 | -0.33 | 25.5 | 54 |

In theory uniform meshes reach -2/9 and the best of isotropic elements -1/3, after a long
way: the share of the error that is next to the edges falls slowly.  The angle is the smallest
dihedral one of all meshes of the loop; iterations are those of conjugate gradients,
preconditioned by the diagonal, to 1e-8.  The pictures colour by the length of edges.

```python
import adaptsize as ads

mesh = ads.read("data/block.vtu")
x, y, z = mesh.points.T
r = (x - x.min()) ** 2 + (y - y.min()) ** 2  # from one edge of the block, squared
u = r ** (1 / 3)  # your solver's result at the nodes instead
indicator = ads.zz_indicator(mesh, u)
new = ads.adapt(mesh, indicator, elements=20_000, g=0.3, max_refine=8.0).mesh
ads.plot.plot_mesh(new, path="fichera.png")
```

    python examples/plot_fichera.py [DIRECTORY]
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from _gallery import CURVES, INK, drawing, run, save_drawing, save_scenes
from scipy.sparse import diags_array
from scipy.sparse.linalg import cg
from skfem import Basis, BilinearForm, ElementTetP1, Functional, LinearForm, MeshTet, condense
from skfem.helpers import dot, grad

import adaptsize as ads
from adaptsize.plot import plot_size
from adaptsize.plot.scene import scene_of_mesh

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = npt.NDArray[np.float64]
G = 0.3
OCTANT = (1.0, -1.0, 1.0)  # the one that is missing: pictures are taken from there


class Cycle(NamedTuple):
    """A mesh and what was found on it."""

    mesh: ads.SimplexMesh
    unknowns: int
    error: float
    indicator: FloatArray
    iterations: int


def main(
    output_dir: Path,
    *,
    width: int = 560,
    targets: Sequence[int] = (4000, 8000, 16000, 32000, 64000),
    tetwild_targets: Sequence[int] = (4000, 8000, 16000),
    finest: int = 16,
) -> dict[str, float | str]:
    """Adapt for each number of ``targets``; cut the cube into up to 2 * ``finest`` cells."""
    start = solve(fichera(4))
    n = [4 * 2**k for k in range(10) if 4 * 2**k <= finest]
    loops = {
        "uniform": [start, *(solve(fichera(k)) for k in n[1:])],
        "Mmg": adapted(start, "mmg", targets),
        "fTetWild": adapted(start, "tetwild", tetwild_targets),
    }
    draw(output_dir / "fichera.png", loops, width)
    mesh = loops["Mmg"][min(3, len(targets))].mesh
    scenes = {
        f"edge length, {name}": scene_of_mesh(
            mesh, edges_at_nodes(mesh), clip, on_nodes=True, label="edge length"
        )
        for name, clip in (("from outside", None), ("behind x = 0", "x"))
    }
    save_scenes(output_dir / "fichera.scenes.json", scenes)
    return {
        key: value for name, cycles in loops.items() for key, value in summary(name, cycles).items()
    }


def adapted(start: Cycle, backend: str, targets: Sequence[int]) -> list[Cycle]:
    """Return the cycles of a loop."""
    cycles = [start]
    for target in targets:
        result = ads.adapt(
            cycles[-1].mesh, cycles[-1].indicator, order=1, elements=target, g=G,
            max_refine=8.0, backend=backend,
        )  # fmt: skip
        cycles.append(solve(result.mesh))
    return cycles


def fichera(n: int) -> ads.SimplexMesh:
    """Return (-1, 1)^3 without an octant, each unit in n cubes of six tetrahedra."""
    x = np.linspace(-1.0, 1.0, 2 * n + 1)
    m = MeshTet.init_tensor(x, x, x)
    outwards = m.p[:, m.t].mean(axis=1) * np.reshape(OCTANT, (3, 1))
    m = m.restrict(np.flatnonzero(~(outwards > 0.0).all(axis=0)))
    return ads.SimplexMesh(m.p.T, m.t.T)


def solve(mesh: ads.SimplexMesh) -> Cycle:
    """Return error, indicators and iterations (conjugate gradients, diagonal preconditioner)."""
    m = MeshTet(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.cells.T))
    basis = Basis(m, ElementTetP1(), intorder=4)
    u = exact_solution(m.p)  # to stay on the boundary
    matrix, load, _, free = condense(
        laplace.assemble(basis), weak_load.assemble(basis), x=u, D=basis.get_dofs()
    )
    steps: list[FloatArray] = []
    diagonal = diags_array(1.0 / matrix.diagonal())
    u[free], _ = cg(matrix, load, rtol=1e-8, M=diagonal, callback=steps.append)
    square = energy_error.assemble(basis, u=basis.interpolate(u))
    eta = ads.zz_indicator(mesh, u)
    return Cycle(mesh, len(free), float(square) ** 0.5, eta, len(steps))


@BilinearForm
def laplace(u, v, w):
    return dot(grad(u), grad(v))


@LinearForm
def weak_load(v, w):
    return dot(exact_gradient(w.x), grad(v))


@Functional
def energy_error(w):
    return ((w["u"].grad - exact_gradient(w.x)) ** 2).sum(axis=0)


def exact_solution(x: FloatArray) -> FloatArray:
    """Return the sum of r^(2/3) over the three inner edges."""
    return sum((away**2).sum(axis=0) ** (1.0 / 3.0) for away in from_edges(x))


def exact_gradient(x: FloatArray) -> FloatArray:
    """Return its gradient, (2/3) r^(-1/3) in the direction away from each edge."""
    return sum(2.0 / 3.0 * away * (away**2).sum(axis=0) ** (-2.0 / 3.0) for away in from_edges(x))


def from_edges(x: FloatArray) -> list[FloatArray]:
    """Return the vectors from the closest points of the three inner edges."""
    vectors = []
    for axis, sign in enumerate(OCTANT):
        away = np.array(x)
        away[axis] = np.where(sign * away[axis] > 0.0, 0.0, away[axis])
        vectors.append(away)
    return vectors


def summary(name: str, cycles: list[Cycle]) -> dict[str, float | str]:
    """Return what is to be said of a loop."""
    last = cycles[-1]
    adapted_meshes = [t.mesh for t in cycles[1:]]
    return {
        f"{name}: tetrahedra": last.mesh.n_cells,
        f"{name}: unknowns": last.unknowns,
        f"{name}: error": last.error,
        f"{name}: rate": rate(cycles[-3:]),
        f"{name}: estimate over error": float(np.linalg.norm(last.indicator)) / last.error,
        f"{name}: iterations": last.iterations,
        f"{name}: smallest angle": min(float(m.minimum_angles().min()) for m in adapted_meshes),
        f"{name}: worst radius ratio": min(float(m.radius_ratios().min()) for m in adapted_meshes),
        f"{name}: smallest edge": float(last.mesh.edge_lengths.min()),
    }


def rate(cycles: list[Cycle]) -> float:
    """Return the power of the number of unknowns with which the error goes, by least squares."""
    unknowns, errors = (np.log([getattr(t, k) for t in cycles]) for k in ("unknowns", "error"))
    return float(np.polyfit(unknowns, errors, 1)[0])


def draw(path: Path, loops: dict[str, list[Cycle]], width: int) -> None:
    """Draw errors, a mesh from outside, and meshes behind a cut through the corner."""
    figure, panels = drawing(2, 2, width, shape=0.85)
    draw_errors(panels[0], loops)
    shown = {name: cycles[min(3, len(cycles) - 1)].mesh for name, cycles in loops.items()}
    sizes = {name: edges_at_nodes(mesh) for name, mesh in shown.items()}
    scale = min(h.min() for h in sizes.values()), max(h.max() for h in sizes.values())
    clips: tuple[Literal["x"] | None, ...] = (None, "x", "x")
    for panel, name, clip in zip(panels[1:], ("Mmg", "Mmg", "fTetWild"), clips, strict=True):
        image = plot_size(shown[name], sizes[name], clip=clip, limits=scale, width=width)
        panel.imshow(image)
        where = "from outside" if clip is None else "behind x = 0"
        panel.set_title(f"{name}, {shown[name].n_cells} tetrahedra, {where}")
        panel.axis("off")
    save_drawing(path, figure, panels[2])


def edges_at_nodes(mesh: ads.SimplexMesh) -> FloatArray:
    """Return the mean length of the edges at each node."""
    total = np.bincount(mesh.edges.ravel(), np.repeat(mesh.edge_lengths, 2))
    return total / np.bincount(mesh.edges.ravel())


def draw_errors(panel: Axes, loops: dict[str, list[Cycle]]) -> None:
    """Draw the error over the unknowns, and the slopes of theory."""
    styles = {"uniform": ("s--", INK), "Mmg": ("o-", CURVES[0]), "fTetWild": ("^-", CURVES[1])}
    for name, cycles in loops.items():
        style, colour = styles[name]
        x, y = [t.unknowns for t in cycles], [t.error for t in cycles]
        panel.loglog(x, y, style, color=colour, markersize=5, label=name)
    for name, power, label in (("uniform", -2 / 9, "$N^{-2/9}$"), ("Mmg", -1 / 3, "$N^{-1/3}$")):
        last = loops[name][-1]
        x = np.array([loops[name][len(loops[name]) // 2].unknowns, last.unknowns])
        y = 1.15 * last.error * (x / last.unknowns) ** power
        panel.loglog(x, y, "0.5", linewidth=1)
        panel.annotate(label, (x[1], y[1]), (4, 0), textcoords="offset points")
    panel.set(xlabel="number of unknowns N", ylabel="energy error", title="error over unknowns")
    panel.legend()
    panel.grid(alpha=0.3)
    panel.tick_params(axis="x", which="minor", labelbottom=False)


if __name__ == "__main__":
    run(main)
