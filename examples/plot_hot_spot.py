"""Refining where stresses are highest.

Triangles become small only at the edge of the hole, where the stress (red) is highest.

data/plate.vtk holds a plate with a hole and a stiff inlay, pulled at its ends, as a simulation left
it: "Material" in the cells, "von_mises" and "displacement" at the nodes.  Sizes come from the
stress: small where it is above 70 % of the highest, growing from there.  In each of three cycles
the sizes are halved, the hole is made round again, and the stress is recomputed (linear elements,
scikit-fem).
Measured:

| edges at the hot spot | triangles | highest stress in MPa |
|---:|---:|---:|
| 1.8 mm, the file | 1018 | 282 |
| 0.6 mm | 1573 | 345 |
| 0.3 mm | 2205 | 338 |
| 0.15 mm | 4028 | 341 |

Uniform meshes with edges of 0.15 mm have 595 000.  The smallest angle is 26 degrees.  The
materials keep their interface; their areas are those of before, but for the round hole (0.02 %).

The first cycle is also run on the command line, from a file with the bounds h0 as a nodal field:

    adaptsize remesh plate_sizes.vtu --field h0 -g 0.2 -o plate_fine.vtu

Without Python, regions are prescribed by hand: `--source ball:35,38,2=0.6`.

```python
import numpy as np

import adaptsize as ads

mesh = ads.read("data/plate.vtk")
stress = mesh.point_data["von_mises"]
h0 = np.where(stress > 0.7 * stress.max(), 0.6, np.inf)  # mm
new = ads.adapt(mesh, h0=h0, g=0.2).mesh
ads.plot.plot_mesh(new, color="region", path="hot_spot.png")
```

    python examples/plot_hot_spot.py [DIRECTORY]
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from _gallery import DATA, FIELDS, draw_mesh, drawing, run, save_drawing
from skfem import Basis, BilinearForm, ElementTriP1, ElementVector, FacetBasis, LinearForm, MeshTri
from skfem import condense as without
from skfem import solve as solved
from skfem.helpers import ddot, eye, sym_grad, trace
from skfem.models.elasticity import plane_stress

import adaptsize as ads
from adaptsize.sizes import predict

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import TriMesh

FloatArray = npt.NDArray[np.float64]
G = 0.2
HOLE, RADIUS = (35.0, 30.0), 8.0  # in millimetres
MATERIALS = {10: (70e3, 0.33), 20: (210e3, 0.3)}  # Young's modulus in MPa, Poisson's ratio
PULL = 100.0  # MPa


def main(
    output_dir: Path, *, width: int = 640, sizes: Sequence[float] = (0.6, 0.3, 0.15)
) -> dict[str, float]:
    """Refine to edges of each of ``sizes`` where the stress is highest."""
    mesh = ads.read(DATA / "plate.vtk")
    stress = mesh.point_data["von_mises"]
    by_command = remeshed_by_command(output_dir, mesh, bounds(stress, sizes[0]))
    states = [(mesh, stress)]
    for hot in sizes:
        old, stress = states[-1]
        result = ads.adapt(old, h0=bounds(stress, hot), g=G, project=onto_hole)
        states.append((result.mesh, von_mises(result.mesh)))
    draw(output_dir / "hot_spot.png", states, width)
    new = states[-1][0]
    found: dict[str, float] = {"triangles in the file": mesh.n_cells}
    found["highest stress in the file"] = float(states[0][1].max())
    for hot, (turned, stress) in zip(sizes, states[1:], strict=True):
        found[f"triangles, {hot:g} mm"] = turned.n_cells
        found[f"highest stress, {hot:g} mm"] = float(stress.max())
    found["triangles by the command"] = by_command.n_cells
    everywhere = np.full(mesh.n_points, sizes[-1])
    found["triangles, if uniform"] = predict(mesh, everywhere).cells
    found["smallest angle"] = float(new.minimum_angles().min())
    found["distance of the hole from the circle"] = off_the_hole(new)
    for material in MATERIALS:
        for name, other in (("", new), (" by the command", by_command)):
            share = area(other, material) / area(mesh, material)
            found[f"area of material {material}{name}, after over before"] = share
    return found


def bounds(stress: FloatArray, hot: float) -> FloatArray:
    """Return ``hot`` where the stress is above 70 % of the highest, 4 elsewhere."""
    return np.where(stress > 0.7 * stress.max(), hot, 4.0)


def remeshed_by_command(output_dir: Path, mesh: ads.SimplexMesh, h0: FloatArray) -> ads.SimplexMesh:
    """Return what the command in the docstring makes."""
    sizes, new = output_dir / "plate_sizes.vtu", output_dir / "plate_fine.vtu"
    ads.write(sizes, mesh, fields={"h0": h0})
    options = f"--field h0 -g {G}"
    command = [sys.executable, "-m", "adaptsize", "remesh", str(sizes), *options.split()]
    subprocess.run([*command, "-o", str(new)], check=True, capture_output=True)
    return ads.read(new)


def onto_hole(points: FloatArray) -> FloatArray:
    """Return points near the hole on its circle, others as they are."""
    out = points - HOLE
    r = np.linalg.norm(out, axis=1, keepdims=True)
    return np.where(np.abs(r - RADIUS) < 0.1 * RADIUS, HOLE + RADIUS * out / r, points)


def off_the_hole(mesh: ads.SimplexMesh) -> float:
    """Return how far nodes of the hole are from its circle."""
    nodes = mesh.points[mesh.boundary().nodes]
    away = np.abs(np.linalg.norm(nodes - HOLE, axis=1) - RADIUS)
    return float(away[away < 0.1 * RADIUS].max())


def area(mesh: ads.SimplexMesh, material: int) -> float:
    """Return the area of a material."""
    return float(mesh.measures[mesh.cell_tags == material].sum())


def von_mises(mesh: ads.SimplexMesh) -> FloatArray:
    """Return the equivalent stress at the nodes in MPa: means of the cells around, by area."""
    sxx, syy, sxy = stresses(mesh)[1]
    in_cells = np.sqrt(sxx**2 - sxx * syy + syy**2 + 3.0 * sxy**2)
    weights = np.repeat(mesh.measures, 3)
    around = mesh.cells.ravel()
    sums = np.bincount(around, weights * np.repeat(in_cells, 3), mesh.n_points)
    return np.asarray(sums / np.bincount(around, weights, mesh.n_points))


def stresses(mesh: ads.SimplexMesh) -> tuple[FloatArray, FloatArray]:
    """Return displacements at the nodes, (n, 2), and stresses xx, yy, xy in the cells, (3, m)."""
    m = MeshTri(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.cells.T))
    basis = Basis(m, ElementVector(ElementTriP1()), intorder=1)
    lame = np.array([plane_stress(*MATERIALS[int(tag)]) for tag in mesh.cell_tags]).T[:, :, None]
    matrix = elasticity.assemble(basis, lam=lame[0], mu=lame[1])
    ends = m.facets_satisfying(lambda x: np.isin(x[0], (m.p[0].min(), m.p[0].max())))
    load = pull.assemble(FacetBasis(m, basis.elem, facets=ends))
    # Held at two corners such that nothing but rigid motions is kept from happening.
    left, right = (np.abs(m.p.T - (x, m.p[1].min())).sum(axis=1).argmin()
                   for x in (m.p[0].min(), m.p[0].max()))  # fmt: skip
    held = np.array([*basis.nodal_dofs[:, left], basis.nodal_dofs[1, right]])
    u = solved(*without(matrix, load, D=held))
    strain = sym_grad(basis.interpolate(u))
    stress = 2.0 * lame[1] * strain + lame[0] * eye(trace(strain), 2)
    return u[basis.nodal_dofs].T, np.stack([stress[0, 0], stress[1, 1], stress[0, 1]])[:, :, 0]


@BilinearForm
def elasticity(u, v, w):
    strain = sym_grad(u)
    return ddot(2.0 * w["mu"] * strain + w["lam"] * eye(trace(strain), 2), sym_grad(v))


@LinearForm
def pull(v, w):
    return PULL * w.n[0] * v[0]


def draw(path: Path, states: list[tuple[ads.SimplexMesh, FloatArray]], width: int) -> None:
    """Draw stresses around the hole, in the file and on the last mesh."""
    figure, panels = drawing(2, 1, width, shape=0.8)
    top = float(states[-1][1].max())
    for panel, (mesh, values), name in (
        (panels[0], states[0], "the file"),
        (panels[1], states[-1], "after three cycles"),
    ):
        panel.set(aspect="equal", xlim=(HOLE[0] - 20, HOLE[0] + 20), xticks=[], yticks=[],
                  ylim=(HOLE[1] - 16, HOLE[1] + 16))  # fmt: skip
        image = draw_stress(panel, mesh, values, top, 0.6)
        panel.set_title(f"{name}: {mesh.n_cells} triangles,\nhighest stress {values.max():.0f} MPa")
    figure.colorbar(image, ax=panels, label="von Mises stress in MPa", shrink=0.8)
    save_drawing(path, figure, panels[1])


def draw_stress(
    panel: Axes, mesh: ads.SimplexMesh, values: FloatArray, top: float, line: float
) -> TriMesh:
    """Draw nodal values smoothly, under the triangles."""
    return draw_mesh(panel, mesh, values, cmap=FIELDS, vmin=0, vmax=top, width=line)


if __name__ == "__main__":
    run(main)
