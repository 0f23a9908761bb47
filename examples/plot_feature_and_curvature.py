"""Sizes from width and curvature.

Narrow bridges between the holes get small (dark) sizes from the width (a); round corners from the
curvature (b). Gradient limiting makes the transitions smooth (c).

This is Figure 7 of Persson's paper.

A plate between arcs, with holes close to each other and to its edge.  The feature size drops
where walls come together, faster than elements may shrink from one to the next, and curvature asks
at the boundary only: limiting corrects both.

```python
import numpy as np

import adaptsize as ads


def plate(x):  # a rectangle with a hole, negative inside
    outer = np.max(np.abs(x) - [1.0, 0.55], axis=1)
    return np.maximum(outer, 0.28 - np.linalg.norm(x - [-0.45, 0.12], axis=1))


lower, upper = np.array([-1.0, -0.55]), np.array([1.0, 0.55])
grid = ads.CartesianGrid.around([lower, upper], 0.01)
domain = grid, ads.signed_distance(grid, plate)
size = ads.size_function(domain, elements_per_radian=6, elements_across=4, g=0.3)
print(size.report)
mesh = ads.mesh_from_distance(plate, size, lower, upper)
ads.plot.plot_size(mesh, size, path="feature_and_curvature.png")
```
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from _gallery import draw_mesh, drawing, run, save_drawing

import adaptsize as ads
from adaptsize.remeshing.distmesh.from_distance import mesh_from_distance

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = npt.NDArray[np.float64]

LOWER, UPPER = np.array([-1.0, -0.55]), np.array([1.0, 0.55])
HOLES = (((-0.45, 0.12), 0.28), ((0.05, -0.1), 0.17), ((0.12, 0.28), 0.13), ((0.62, 0.0), 0.2))
G = 0.3


def plate(points: FloatArray) -> FloatArray:
    """Return a function that is negative in the plate: a distance but near concave corners."""
    x, y = points.T
    outside = np.maximum(np.abs(x) - 0.75, np.abs(y) - 0.3)
    corner = np.hypot(np.maximum(np.abs(x) - 0.75, 0.0), np.maximum(np.abs(y) - 0.3, 0.0))
    phi = np.where(outside > 0.0, corner, outside) - 0.18  # a box with round corners
    for centre, radius in HOLES:
        phi = np.maximum(phi, radius - np.linalg.norm(points - centre, axis=1))
    bite = 0.22 - np.linalg.norm(points - (0.35, -0.55), axis=1)
    return np.maximum(phi, bite)


def main(output_dir: Path, *, width: int = 560, spacing: float = 0.005) -> dict[str, Any]:
    """Draw width, bounds, sizes and mesh; return how steep the sizes are."""
    grid = ads.CartesianGrid.around([LOWER, UPPER], spacing)
    phi = ads.signed_distance(grid, plate)
    size = ads.size_function((grid, phi), elements_per_radian=6.0, elements_across=4.0, g=G)
    report = size.report
    inside = phi < 0.0
    lfs = ads.feature_size(grid, phi)
    bound = np.minimum.reduce([*report.bounds.values(), np.full(grid.shape, size.values.max())])
    mesh = mesh_from_distance(plate, size, LOWER, UPPER)

    limits = float(size.values[inside].min()), float(bound[inside].max())
    figure, panels = drawing(2, 2, width, shape=0.56)
    fields = (
        (lfs, "local feature size, half the width", None),
        (bound, "bounds h0: not limited", limits),
        (size.values, f"sizes h, g = {G:g}", limits),
    )
    for panel, (values, title, span) in zip(panels, fields, strict=False):
        _draw_field(panel, grid, np.where(inside, values, np.nan), title, span)
    draw_mesh(panels[3], mesh)
    panels[3].set_title(f"mesh, {mesh.n_cells} triangles")
    for panel in panels:
        panel.set(xlim=(LOWER[0], UPPER[0]), ylim=(LOWER[1], UPPER[1]), aspect="equal")
        panel.set(xticks=[], yticks=[])
    save_drawing(output_dir / "feature_and_curvature.png", figure, panels[2])
    return {
        "steepest bound over g": _steepest(bound, inside, spacing) / G,
        "steepest size over g": _steepest(size.values, inside, spacing) / G,
        "triangles": mesh.n_cells,
        "smallest angle": float(mesh.minimum_angles().min()),
        **{f"share of {name}": share for name, share in report.domain_shares.items()},
    }


def _draw_field(
    panel: Axes,
    grid: ads.CartesianGrid,
    values: FloatArray,
    title: str,
    limits: tuple[float, float] | None = None,
) -> None:
    from matplotlib.colors import LogNorm

    x, y = grid.axes
    low, high = limits or (float(np.nanmin(values)), float(np.nanmax(values)))
    drawn = panel.pcolormesh(x, y, values.T, norm=LogNorm(low, high), rasterized=True)
    ticks = [t for t in (0.01, 0.02, 0.03, 0.05, 0.1, 0.2) if low <= t <= high]
    panel.figure.colorbar(drawn, ax=panel, shrink=0.75, ticks=ticks, format="%g").minorticks_off()
    panel.set_title(title)


def _steepest(values: FloatArray, inside: npt.NDArray[np.bool_], spacing: float) -> float:
    """Return the largest difference of neighbours in the domain over their distance."""
    steepest = 0.0
    for axis in (0, 1):
        both = np.minimum(*(np.take(inside, part, axis) for part in _ends(inside.shape[axis])))
        steepest = max(steepest, float(np.abs(np.diff(values, axis=axis))[both].max()))
    return steepest / spacing


def _ends(n: int) -> tuple[range, range]:
    return range(n - 1), range(1, n)


if __name__ == "__main__":
    run(main)
