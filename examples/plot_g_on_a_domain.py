"""Varying gradient limits, smooth boundary.

Sizes grow more slowly where the gradient limit is small: in the right half (a), and where elements
are large (c). The meshes follow (b, d).

Figures 14 and 15 of Persson's paper.  The prescribed sizes are 1 / (K kappa) on the boundary of
a three-lobed domain with a hole, with known curvature kappa and K = 6 elements per radian.  They
are limited on a Cartesian grid.  Only its nodes in the domain are active, so sizes do not
propagate through the hole.  Upper row: g = 0.4 on the left and 0.2 on the right.  Lower row: g(h)
falls from 0.6 for small to 0.2 for large elements, so the contours of h are closest at small
elements.  With Mmg installed, a mesh is made for each.

```python
import numpy as np

import adaptsize as ads

grid = ads.CartesianGrid([-1.0, -1.0], 0.01, (201, 201))
x, y = (grid.points[:, d].reshape(grid.shape) for d in range(2))
grid = grid.with_active((np.hypot(x, y) < 1.0) & (np.hypot(x - 0.3, y) > 0.2))
h0 = ads.size_from_sources(grid, ads.PointSource([0.3, 0.2], 0.01), g=0.2)
h = ads.limit_gradient(grid, np.minimum(h0, 0.3), np.where(x < 0.0, 0.4, 0.2))
ads.plot.plot_size(grid, h, path="g_on_a_domain.png")
```

    python examples/plot_g_on_a_domain.py [DIRECTORY]
"""

from pathlib import Path

import numpy as np
import numpy.typing as npt
from _gallery import draw_mesh, drawing, has_mmg, run, save_drawing
from scipy.spatial import Delaunay, cKDTree

import adaptsize as ads
from adaptsize.typing import GradientLimit

PER_RADIAN = 6.0
HMAX = 0.32
HOLE, HOLE_RADIUS = (0.55, 0.1), 0.2
SMALL, LARGE = 0.03, 0.25


def g_of_h(h: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return 0.6 up to h = SMALL, 0.2 from h = LARGE on, a half cosine in between."""
    share = np.clip((h - SMALL) / (LARGE - SMALL), 0.0, 1.0)
    return 0.4 + 0.2 * np.cos(np.pi * share)


def boundary(n: int) -> list[tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]]:
    """Return n points of the outer and of the inner boundary, and 1 / (K kappa) there."""
    t = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    r, dr, ddr = 1.5 + 0.45 * np.cos(3 * t), -1.35 * np.sin(3 * t), -4.05 * np.cos(3 * t)
    kappa = np.abs(r**2 + 2.0 * dr**2 - r * ddr) / (r**2 + dr**2) ** 1.5
    outer = np.column_stack([r * np.cos(t), r * np.sin(t)])
    asked = np.minimum(1.0 / (PER_RADIAN * np.maximum(kappa, 1e-9)), HMAX)
    inner = HOLE + HOLE_RADIUS * np.column_stack([np.cos(t), np.sin(t)])
    return [(outer, asked), (inner, np.full(n, HOLE_RADIUS / PER_RADIAN))]


def inside(x: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Return which points are in the domain."""
    r, t = np.hypot(x[:, 0], x[:, 1]), np.arctan2(x[:, 1], x[:, 0])
    return (r < 1.5 + 0.45 * np.cos(3 * t)) & (np.hypot(*(x - HOLE).T) > HOLE_RADIUS)


def starting_mesh(spacing: float) -> ads.SimplexMesh:
    """Return triangles of the domain: points of its boundary and of a lattice."""
    edge = np.concatenate([boundary(int(12.0 / spacing))[0][0], boundary(int(3.0 / spacing))[1][0]])
    lattice = ads.CartesianGrid.around(edge, spacing).points
    lattice[:, 0] += 0.5 * spacing * (np.rint(lattice[:, 1] / spacing) % 2)
    far = cKDTree(edge).query(lattice)[0] > 0.7 * spacing
    points = np.concatenate([edge, lattice[inside(lattice) & far]])
    cells = Delaunay(points).simplices
    return ads.SimplexMesh(points, cells[inside(points[cells].mean(axis=1))])


def main(output_dir: Path, *, n_nodes: int = 401, width: int = 480) -> dict[str, float]:
    outer = boundary(2000)[0][0]
    spacing = 4.0 / (n_nodes - 1)
    grid = ads.CartesianGrid.around(outer, spacing, margin=2.0 * spacing)
    active = inside(grid.points).reshape(grid.shape)
    grid = grid.with_active(active)
    x = grid.points[:, 0].reshape(grid.shape)

    found: dict[str, float] = {"active nodes": int(active.sum())}
    figure, panels = drawing(2 if has_mmg() else 1, 2, width, shape=0.9)
    per_row = len(panels) // 2
    limits: tuple[GradientLimit, ...] = (np.where(x < 0.0, 0.4, 0.2), g_of_h)
    for row, g in enumerate(limits):
        # The sources are of slope 0.2 up to the nodes around them, which no g here is below.
        h0 = ads.size_from_sources(grid, curves(), g=0.2)
        h, info = ads.limit_gradient.with_info(grid, np.minimum(h0, HMAX), g)
        name = "g(x)" if row == 0 else "g(h)"
        found[f"largest slope over g, {name}"] = info.largest_edge_slope
        found[f"mean size on the left, {name}"] = float(h[active & (x < 0.0)].mean())
        found[f"mean size on the right, {name}"] = float(h[active & (x > 0.0)].mean())
        shown = np.where(active, h, np.nan)
        of_h, *of_mesh = panels[row * per_row : (row + 1) * per_row]
        draw_field(of_h, grid, shown, f"size h, limited with {name}", "h", (0.0, HMAX))
        levels = np.linspace(0.0, HMAX, 17)[1:]
        of_h.contour(*grid.axes, shown.T, levels, colors="white", linewidths=0.6)
        if of_mesh:
            new = ads.remesh(starting_mesh(0.04), ads.SizeFunction(grid, h))
            found[f"triangles, {name}"] = new.n_cells
            draw_triangles(of_mesh[0], new)
            of_mesh[0].set(xlim=of_h.get_xlim(), ylim=of_h.get_ylim())
    save_drawing(output_dir / "g_on_a_domain.png", figure, panels[0])
    return found


def curves() -> list[ads.CurveSource]:
    """Return the boundary as sources, each curve closed."""
    return [
        ads.CurveSource(np.vstack([points, points[:1]]), np.append(sizes, sizes[0]))
        for points, sizes in boundary(2000)
    ]


def draw_field(panel, grid, values, title, label, limits):
    """Draw nodal values of a grid in colours."""
    low, high = limits
    image = panel.pcolormesh(*grid.axes, values.T, vmin=low, vmax=high, shading="nearest")
    panel.figure.colorbar(image, ax=panel, label=label, shrink=0.7)
    panel.set(title=title, aspect="equal", xlabel="x", ylabel="y")


def draw_triangles(panel, mesh):
    """Draw a plane mesh."""
    draw_mesh(panel, mesh)
    panel.set(title=f"mesh, {mesh.n_cells} triangles", aspect="equal", xlabel="x", ylabel="y")


if __name__ == "__main__":
    run(main)
