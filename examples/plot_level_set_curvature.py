"""Curvature from a signed distance.

Off the boundary, the curvature of the level set is not that of the boundary. The corrected values
(blue) converge with second order (a).

Section 3 of Persson's paper on an ellipse.  The curvature at a node at the distance phi is that of
the level set through the node, not that of the boundary.  Left: largest relative errors near the
boundary against the spacing, without correction, with the paper's correction with the printed
sign, and with the sign for phi < 0 inside.

Right: errors of the sizes after limiting, along a quarter of the boundary (lines) and 4
spacings inside it (dashes).  Formula (4), with its first sign corrected, lets sizes fall by g
per distance to the outside.  Where they also change along the boundary, this is too steep,
and limiting makes them too small.  Without - g phi they are too small inside.

```python
import numpy as np

import adaptsize as ads

grid = ads.CartesianGrid.around([[-1.1, -0.6], [1.1, 0.6]], 0.02)
phi = ads.signed_distance(grid, lambda x: np.hypot(x[:, 0], x[:, 1] / 0.5) - 1.0)
h0 = ads.size_from_curvature(grid, phi, elements_per_radian=3, g=0.25)
h = ads.limit_gradient(grid, h0, 0.25)
ads.plot.plot_size(grid, h, path="level_set_curvature.png")
```

    python examples/plot_level_set_curvature.py [DIRECTORY]
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from _gallery import CURVES, INK, drawing, run, save_drawing

import adaptsize as ads
from adaptsize.geometry import level_set_curvature, signed_distance

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = npt.NDArray[np.float64]
G, K = 0.25, 4.0
A, B = 0.8, 0.4  # half axes
WAYS = {"at the nodes": 0.0, "plus sign": -1.0, "corrected": 1.0}
COLOURS = {"at the nodes": CURVES[1], "plus sign": CURVES[3], "corrected": CURVES[0]}


def main(
    output_dir: Path, *, cells: Sequence[int] = (40, 80, 160, 320), width: int = 480
) -> dict[str, float]:
    """Draw the figure; ``cells`` are the boxes along the longer axis of the ellipse."""
    errors: dict[str, list[float]] = {name: [] for name in WAYS}
    figure, (left, right) = drawing(2, 1, width, shape=0.85)
    for n in cells:
        grid, phi, t = problem(n)
        level = level_set_curvature(grid, phi, at_boundary=False, band=2.0)[..., 0]
        exact = curvature(t)
        for name, sign in WAYS.items():
            ratio = level / (1.0 - sign * level * phi) / exact
            errors[name].append(float(np.nanmax(np.abs(ratio - 1.0))))
    draw_orders(left, cells, errors)
    found = draw_sizes(right, cells[1])
    save_drawing(output_dir / "level_set_curvature.png", figure, left)
    steps = np.log(cells[-1] / cells[-2])
    return {
        **{f"largest error, {name}": error[-1] for name, error in errors.items()},
        **{f"order, {name}": float(np.log(e[-2] / e[-1]) / steps) for name, e in errors.items()},
        **found,
    }


def ellipse(t: FloatArray) -> FloatArray:
    return np.stack([A * np.cos(t), B * np.sin(t)], axis=-1)


def curvature(t: FloatArray) -> FloatArray:
    return np.asarray(A * B / ((A * np.sin(t)) ** 2 + (B * np.cos(t)) ** 2) ** 1.5)


def problem(n: int) -> tuple[ads.CartesianGrid, FloatArray, FloatArray]:
    """Return a grid, the distance at its nodes, and the parameter of the closest points."""
    # Chords so short that they are nearer to the ellipse than the differences notice.
    start = np.linspace(0.0, 2.0 * np.pi, 300 * n, endpoint=False)
    after = (np.arange(len(start)) + 1) % len(start)
    line = ads.SimplexMesh(ellipse(start), np.column_stack([np.arange(len(start)), after]))
    spacing = 2.0 * A / n
    grid = ads.CartesianGrid.around(line.points, spacing, margin=4.3 * spacing)
    phi = signed_distance(grid, line, band=np.inf)
    cell, weights, _ = line.locator.nearest(grid.points)
    t = start[cell] + weights[:, 1] * (start[1] - start[0])
    return grid, phi, t.reshape(grid.shape)


def exact_sizes(x: FloatArray) -> FloatArray:
    """Return the smallest of 1 / (K kappa) + g distance over the ellipse."""
    t = np.linspace(0.0, 2.0 * np.pi, 2000)
    away = np.linalg.norm(x[:, None] - ellipse(t), axis=2)
    return np.asarray((1.0 / (K * curvature(t)) + G * away).min(axis=1))


def draw_orders(panel: Axes, cells: Sequence[int], errors: dict[str, list[float]]) -> None:
    spacing = 2.0 * A / np.array(cells)
    for name, error in errors.items():
        panel.loglog(spacing, error, "o-", color=COLOURS[name], label=name)
    panel.loglog(spacing, errors["corrected"][-1] * 0.6 * (spacing / spacing[-1]) ** 2, ":",
                 color=INK, label="second order")  # fmt: skip
    panel.set(title="largest relative error of the curvature,\nup to 2 spacings from the boundary",
              xlabel="spacing", ylabel="relative error")  # fmt: skip
    panel.set_xticks(spacing, [f"{s:g}" for s in spacing])
    panel.minorticks_off()
    panel.legend(loc="lower right")


def draw_sizes(panel: Axes, n: int) -> dict[str, float]:
    """Draw relative errors of limited sizes; return the largest on the boundary and inside."""
    grid, phi, _ = problem(n)
    level = level_set_curvature(grid, phi, band=2.0)[..., 0]
    formula = np.where(np.isfinite(level), 1.0 / (K * np.abs(level)) - G * phi, np.inf)
    t = np.linspace(0.0, 0.5 * np.pi, 361)
    normal = np.stack([B * np.cos(t), A * np.sin(t)], axis=-1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    found = {}
    for name, h0, colour in (
        ("formula (4)", formula, CURVES[3]),
        ("without - g phi", ads.size_from_curvature(grid, phi, g=0.0), CURVES[1]),
        ("size_from_curvature", ads.size_from_curvature(grid, phi, g=G), CURVES[0]),
    ):
        size = ads.SizeFunction(grid, ads.limit_gradient(grid, h0, G))
        for place, depth, style in (("on the boundary", 0.0, "-"), ("inside", 4.0, "--")):
            x = ellipse(t) - depth * grid.spacing[0] * normal
            error = size(x) / exact_sizes(x) - 1.0
            found[f"{name}, largest error {place}"] = float(np.abs(error).max())
            panel.plot(np.degrees(t), 100.0 * error, style, color=colour, linewidth=1.0,
                       label=name if depth == 0.0 else None)  # fmt: skip
    panel.axhline(0.0, color=INK, linewidth=0.8)
    panel.set(title=f"error of the limited size\n{n} boxes along the ellipse",
              xlabel="parameter in degrees, 0: sharp end",
              ylabel="per cent; dashed: 4 spacings inside")  # fmt: skip
    panel.legend()
    return found


if __name__ == "__main__":
    run(main)
