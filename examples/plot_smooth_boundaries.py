"""Meshes from distance functions.

The ring is narrow, so its feature size (a), its size (b) and its triangles (c) are small.

Figures 8 and 9 of Persson's paper.  The plane object is the region where a sum of poles is large,
minus a hole.  This function is far from a distance, so its signed distance is computed on a
Cartesian grid.  The medial axis gives the feature size, the corrected curvature the size at
the boundary, and their minimum is limited.  `mesh_from_distance` needs only the two functions,
distance and size.  The solid is a cylinder with an eccentric spherical hole, sampled on a grid from
closed forms: the size in a section, and the tetrahedra behind it.

```python
import numpy as np

import adaptsize as ads


def blob(x):  # any function that is negative inside
    centres = [-0.5, 0.0], [0.5, 0.2]
    return 1.0 - sum(0.3 / ((x - c) ** 2).sum(axis=1).clip(1e-3) for c in centres)


lower, upper = [-1.8, -1.5], [1.8, 1.5]
grid = ads.CartesianGrid.around([lower, upper], 0.03)
phi = ads.signed_distance(grid, blob)
curvature = ads.size_from_curvature(grid, phi, elements_per_radian=3, g=0.3)
h0 = np.minimum(curvature, 2.0 * ads.feature_size(grid, phi) / 5.0).clip(0.06)
size = ads.SizeFunction(grid, ads.limit_gradient(grid, h0, 0.3))
mesh = ads.mesh_from_distance(lambda x: ads.interpolate(grid, phi, x), size, lower, upper)
ads.plot.plot_size(mesh, size, path="smooth_boundaries.png")
```

    python examples/plot_smooth_boundaries.py [DIRECTORY]
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt
from _gallery import INK, draw_mesh, drawing, run, save_drawing, save_panels

import adaptsize as ads

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = npt.NDArray[np.float64]

#: Poles of the object, centre and radius, and its hole.
POLES = (((-1.0, -0.3), 0.5), ((0.2, 0.5), 0.6), ((1.2, -0.35), 0.42), ((0.15, -0.5), 0.2))
HOLE = ((0.25, 0.5), 0.28)
ELEMENTS_ACROSS = 5.0
ELEMENTS_PER_RADIAN = 3.0
G = 0.3
#: The hole in the cylinder of radius 1 and height 2, along the z axis.
BALL = ((0.25, 0.0, 0.3), 0.45)
G_SOLID = 0.2


class Problem(NamedTuple):
    """A domain on a grid, and what the sizes in it come from."""

    grid: ads.CartesianGrid
    phi: Array
    medial: Any
    feature: Array
    size: ads.SizeFunction

    def distance(self, x: Array) -> Array:
        """Return the signed distance between the nodes."""
        return np.asarray(self.grid.locator.interpolate(self.phi, x)[0])


def blob(x: Array) -> Array:
    """Return a function that is negative in the object; its slope varies from 1 to 10."""
    poles = [radius**2 / (((x - centre) ** 2).sum(axis=1) + 1e-3) for centre, radius in POLES]
    hole = HOLE[1] - np.linalg.norm(x - np.array(HOLE[0]), axis=1)
    return np.maximum(1.0 - np.sum(poles, axis=0), hole)


def solid(x: Array) -> Array:
    """Return the larger of the distances to a cylinder and to the outside of a ball."""
    away = np.column_stack([np.hypot(x[:, 0], x[:, 1]) - 1.0, np.abs(x[:, 2]) - 1.0])
    outside = np.linalg.norm(np.maximum(away, 0.0), axis=1)
    cylinder = outside + np.minimum(away.max(axis=1), 0.0)
    return np.maximum(cylinder, BALL[1] - np.linalg.norm(x - np.array(BALL[0]), axis=1))


def problem(
    function: Callable[[Array], Array], lower: list[float], upper: list[float], n: int, g: float
) -> Problem:
    """Return the limited size of a domain, on a grid of ``n`` boxes along the first axis."""
    spacing = (upper[0] - lower[0]) / n
    shape = tuple(round((b - a) / spacing) + 1 for a, b in zip(lower, upper, strict=True))
    grid = ads.CartesianGrid(lower, spacing, shape)
    phi = ads.signed_distance(grid, function)
    medial = ads.medial_axis(grid, phi)
    feature = ads.feature_size(grid, phi, medial)
    curvature = ads.size_from_curvature(grid, phi, elements_per_radian=ELEMENTS_PER_RADIAN, g=g)
    h0 = np.minimum(curvature, 2.0 * feature / ELEMENTS_ACROSS).clip(min=2.0 * spacing)
    return Problem(
        grid, phi, medial, feature, ads.SizeFunction(grid, ads.limit_gradient(grid, h0, g))
    )


def main(output_dir: Path, *, n: int = 240, n_solid: int = 52, width: int = 560) -> dict[str, Any]:
    """Draw both; ``n`` and ``n_solid`` are boxes of the grids along x."""
    lower, upper = [-1.95, -1.35], [1.95, 1.65]
    plane = problem(blob, lower, upper, n, G)
    mesh, report = ads.mesh_from_distance.with_info(plane.distance, plane.size, lower, upper)
    draw_plane(output_dir / "smooth_boundaries.png", plane, mesh, width)

    low, high = [-1.2] * 3, [1.2] * 3
    space = problem(solid, low, high, n_solid, G_SOLID)
    body, found = ads.mesh_from_distance.with_info(solid, space.size, low, high)
    draw_solid(output_dir / "solid.png", space, body, width)
    ring = np.abs(np.linalg.norm(mesh.points - np.array(HOLE[0]), axis=1) - HOLE[1])
    return {
        "triangles": mesh.n_cells,
        "share of edges in band": report.conformity.share_in_band,
        "smallest angle": report.conformity.angle_min,
        "nodes on the hole": int(np.count_nonzero(ring < 0.01)),
        "mesh over domain, area": report.measure / report.domain_measure,
        "tetrahedra": body.n_cells,
        "share of edges in band, solid": found.conformity.share_in_band,
        "smallest dihedral angle": found.conformity.angle_min,
        "slivers": found.n_slivers,
        "mesh over domain, volume": found.measure / found.domain_measure,
    }


def draw_plane(path: Path, plane: Problem, mesh: ads.SimplexMesh, width: int) -> None:
    """Draw medial axis and feature size, size, and mesh."""
    figure, panels = drawing(3, 1, width, shape=0.8)
    shade(panels[0], plane, plane.feature, "local feature size")
    panels[0].plot(
        *plane.medial.points.T,
        ".",
        color="black",
        markersize=3.5,
        markeredgecolor="white",
        markeredgewidth=0.4,
    )
    panels[0].set_title("medial axis, feature size")
    shade(panels[1], plane, plane.size.values, "mesh size h")
    panels[1].set_title(f"mesh size h, g = {G}")
    draw_mesh(panels[2], mesh)
    panels[2].set_title(f"mesh, {mesh.n_cells} triangles")
    for panel in panels:
        panel.set(xlim=(-1.8, 1.8), ylim=(-1.2, 1.5), aspect="equal", xlabel="x", ylabel="y")
    save_drawing(path, figure, panels[1])


def shade(panel: Axes, plane: Problem, values: Array, label: str) -> None:
    """Draw nodal values inside the domain, and its boundary."""
    x, y = (plane.grid.points[:, d].reshape(plane.grid.shape) for d in range(2))
    inside = np.where((plane.phi < 0.0) & np.isfinite(values), values, np.nan)
    from matplotlib.ticker import MaxNLocator

    image = panel.pcolormesh(x, y, inside, shading="nearest")
    panel.figure.colorbar(image, ax=panel, label=label, shrink=0.8, ticks=MaxNLocator(5))
    panel.contour(x, y, plane.phi, [0.0], colors=INK, linewidths=0.8)


def draw_solid(path: Path, space: Problem, body: ads.SimplexMesh, width: int) -> None:
    """Draw the size on the cells behind a cut, and the cells with their quality."""
    from adaptsize.plot import plot_mesh, plot_size

    save_panels(
        path,
        [
            (
                f"mesh size h, g = {G_SOLID}",
                plot_size(body, space.size(body.points), clip="y", width=width),
            ),
            (f"{body.n_cells} tetrahedra", plot_mesh(body, clip="y", width=width)),
        ],
    )


if __name__ == "__main__":
    run(main)
