"""Signed distances from four inputs.

Blue is inside, red outside, and the lines are equidistant: the distance is found from a function,
from an outline with gaps, from pixels and from the triangles of a part.

Lines are a fixed distance apart, the zero level is bold; blue is inside.  (a) The distance to the
zero level of a function whose slope varies by a factor of twenty.  (b) An outline with gaps; the
sign changes across the gaps as if they were closed, and the distance jumps there.  (c) A disc as
pixels, and the boundary found between them.  (d) A slice through data/bracket.stl.

```python
import numpy as np

import adaptsize as ads


def ellipse(x):  # zero on an ellipse, but no distance
    return ((x[:, 0] / 1.5) ** 2 + x[:, 1] ** 2 - 1.0) * np.exp(x[:, 0])


grid = ads.CartesianGrid.around([[-2.2, -1.6], [2.2, 1.6]], 0.03)
phi = ads.signed_distance(grid, ellipse)  # also of a boundary mesh, or of pixels
ads.plot.plot_size(grid, phi, label="signed distance", path="distance.png")
```

    python examples/plot_distance.py [DIRECTORY]
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from _gallery import CURVES, DATA, INK, drawing, run, save_drawing
from scipy.spatial import cKDTree

import adaptsize as ads

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = npt.NDArray[np.float64]
RADIUS = 7.3


def ellipse(x: Floats) -> Floats:
    """Return a function that is zero on an ellipse, and steeper to the right."""
    return ((x[:, 0] / 1.5) ** 2 + x[:, 1] ** 2 - 1.0) * np.exp(x[:, 0])


def gear(n_teeth: int = 7) -> ads.SimplexMesh:
    """Return the outline of a gear, every ninth segment left out."""
    t = np.linspace(0.0, 2.0 * np.pi, 181)[:-1]
    radius = 1.0 + 0.25 * np.tanh(4.0 * np.sin(n_teeth * t))
    points = radius[:, None] * np.column_stack([np.cos(t), np.sin(t)])
    cells = np.stack([np.arange(180), (np.arange(180) + 1) % 180], axis=1)
    return ads.SimplexMesh(points, cells[np.arange(180) % 9 > 0])


def main(output_dir: Path, *, n: int = 160, width: int = 520) -> dict[str, float]:
    """Draw the distances on grids with ``n`` boxes along an axis."""
    figure, panels = drawing(2, 2, width, shape=0.75)
    plane = ads.CartesianGrid.around([[-2.2, -1.6], [2.2, 1.6]], 4.4 / n)
    phi = ads.signed_distance(plane, ellipse)
    draw(panels[0], plane, phi, 0.2, 1.2, "the zero level of a function")
    found = {
        "largest error, spacings": error_in_spacings(plane, phi),
        **with_gaps(panels[1], n),
        **of_pixels(panels[2]),
        **of_a_part(panels[3], n),
    }
    save_drawing(output_dir / "distance.png", figure, panels[1])
    return found


def error_in_spacings(plane: ads.CartesianGrid, phi: Floats) -> float:
    """Return the largest error of the distance to the ellipse, against its distance to points."""
    t = np.linspace(0.0, 2.0 * np.pi, 100_001)
    exact = cKDTree(np.column_stack([1.5 * np.cos(t), np.sin(t)])).query(plane.points)[0]
    return float(np.abs(np.abs(phi.ravel()) - exact).max() / plane.spacing[0])


def with_gaps(panel: Axes, n: int) -> dict[str, float]:
    """Draw the distance from an outline with gaps."""
    outline = gear()
    plane = ads.CartesianGrid.around([[-1.7, -1.5], [1.7, 1.5]], 3.4 / n)
    phi = ads.signed_distance(plane, outline)
    draw(panel, plane, phi, 0.1, 0.8, "an outline with 20 gaps", bold=False)
    a, b = outline.points[outline.cells].transpose(1, 2, 0)
    panel.plot(np.stack([a[0], b[0]]), np.stack([a[1], b[1]]), color=INK, linewidth=1.6)
    angle = np.arctan2(*plane.points.T[::-1])
    inside = np.linalg.norm(plane.points, axis=1) < 1.0 + 0.25 * np.tanh(4.0 * np.sin(7.0 * angle))
    agree = (inside == (phi < 0.0).ravel())[np.abs(phi).ravel() > 0.05]
    return {"share of right signs beside the gaps": float(agree.mean())}


def of_pixels(panel: Axes) -> dict[str, float]:
    """Draw the boundary of a disc, found from its pixels."""
    grid = ads.CartesianGrid([-10.61, -9.24], 1.0, (22, 19))
    exact = (np.linalg.norm(grid.points, axis=1) - RADIUS).reshape(grid.shape)
    phi = ads.signed_distance(grid, exact < 0.0)
    x, y = grid.axes
    panel.pcolormesh(x, y, (exact > 0.0).T, cmap="Greys_r", vmin=-2.0, vmax=1.3, shading="nearest")
    panel.contour(x, y, phi.T, levels=[0.0], colors=CURVES[0], linewidths=2.0)
    panel.plot([], [], color=CURVES[0], linewidth=2.0, label="found")
    t = np.linspace(0.0, 2.0 * np.pi, 200)
    panel.plot(RADIUS * np.cos(t), RADIUS * np.sin(t), color=CURVES[1], linewidth=1.2, label="true")
    panel.set(title="a disc as pixels, its boundary", aspect="equal", xlabel="x", ylabel="y")
    panel.legend(loc="center")
    near = np.abs(exact) < 1.0
    return {"mean error, pixels": float(np.abs(phi - exact)[near].mean())}


def of_a_part(panel: Axes, n: int) -> dict[str, float]:
    """Draw a slice of the distance from a triangulated part."""
    surface = ads.read(DATA / "bracket.stl")
    box = np.ptp(surface.points, axis=0)
    spacing = float(box.max()) / (0.6 * n)
    grid = ads.CartesianGrid.around(surface.points, spacing, margin=8.0 * spacing)
    phi = ads.signed_distance(grid, surface)
    thin = int(np.argmin(box))
    others = [d for d in range(3) if d != thin]
    place = surface.points[:, thin].min() + 0.75 * box[thin]
    index = int(np.argmin(np.abs(grid.axes[thin] - place)))
    cut = ads.CartesianGrid(
        grid.origin[others], grid.spacing[others], [grid.shape[d] for d in others]
    )
    name = f"bracket at {'xyz'[thin]} = {grid.axes[thin][index]:.3g}"
    draw(panel, cut, np.moveaxis(phi, thin, 0)[index], 2.0, 12.0, name)
    # Boxes around nodes count by the share that lies inside, were the surface flat in them.
    volume = float(np.clip(0.5 - phi / spacing, 0.0, 1.0).sum() * spacing**3)
    a, b, c = surface.points[surface.cells].transpose(1, 0, 2)
    exact = float((a * np.cross(b, c)).sum() / 6.0)
    return {"volume inside over that of the part": volume / exact}


def draw(
    panel: Axes,
    grid: ads.CartesianGrid,
    values: Floats,
    apart: float,
    most: float,
    title: str,
    *,
    bold: bool = True,
    label: str = "signed distance",
) -> None:
    """Draw lines ``apart`` from each other over colours, both up to ``most``."""
    x, y = grid.axes
    picture = panel.pcolormesh(
        x, y, values.T, cmap="RdBu_r", vmin=-most, vmax=most, shading="gouraud"
    )
    panel.figure.colorbar(picture, ax=panel, shrink=0.8, extend="both", label=label)
    last = round(most / apart)
    levels = apart * np.delete(np.arange(-last, last + 1), last)
    panel.contour(x, y, values.T, levels=levels, colors="black", linewidths=0.4,
                  linestyles="solid")  # fmt: skip
    if bold:
        panel.contour(x, y, values.T, levels=[0.0], colors="black", linewidths=2.0)
    panel.set(title=title, aspect="equal", xlabel="x", ylabel="y")


if __name__ == "__main__":
    run(main)
