"""Medial axis of planar shapes.

Dark is narrow. The grey points of the medial axis lie in the middle between opposite walls.

After Figure 3 of Persson's paper.  Colours show the local feature size, the sum of the distances
from the boundary and from the medial axis (dots).  It is half the width between parallel walls.
The picture has an ellipse, three parabolas, an L, whose corners are not narrow, and a part.  The
script computes five more shapes, among them a wedge, which is narrow at its tip, and a disc with
waves of half a per cent, which are ignored.

```python
import numpy as np

import adaptsize as ads

grid = ads.CartesianGrid([-1.1, -1.1], 0.02, (111, 111))
phi = grid.sample(lambda x: np.abs(np.linalg.norm(x, axis=1) - 0.7) - 0.3)  # a ring
medial = ads.medial_axis(grid, phi)
feature = ads.feature_size(grid, phi, medial)
print(medial.points, feature[phi < 0.0])
```

    python examples/plot_medial_axis.py [DIRECTORY]
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt
from _gallery import INK, drawing, run, save_drawing

import adaptsize as ads

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array: TypeAlias = npt.NDArray[np.float64]
Shape: TypeAlias = Callable[[Array], Array] | ads.SimplexMesh


def main(output_dir: Path, *, n: int = 180, width: int = 400) -> dict[str, float]:
    """Compute the shapes on grids of n nodes across, and draw four of them."""
    figure, panels = drawing(2, 2, width, shape=0.8)
    drawn = dict(zip(("ellipse", "three parabolas", "L", "part"), panels, strict=True))
    found: dict[str, float] = {}
    for name, shape in shapes().items():
        grid = ads.CartesianGrid([-1.13, -1.13], 2.26 / (n - 1), (n, n))
        if isinstance(shape, ads.SimplexMesh):
            phi = ads.signed_distance(grid, shape, band=np.inf)
        else:
            phi = grid.sample(shape)
        medial = ads.medial_axis(grid, phi)
        size = ads.feature_size(grid, phi, medial)
        if panel := drawn.get(name):
            draw(panel, grid, phi, size, medial)
            panel.set_title(name)
        inside = np.isfinite(size)
        found[f"smallest, {name}"] = float(size[inside].min())
        found[f"largest, {name}"] = float(size[inside].max())
    save_drawing(output_dir / "medial_axis.png", figure, panels[3])
    return found


def shapes() -> dict[str, Shape]:
    """Return signed distances of curved shapes, and the boundaries of others as polylines."""
    t = np.linspace(0.0, 2.0 * np.pi, 2881)[:-1]
    circle = np.column_stack([np.cos(t), np.sin(t)])
    angle = np.radians(20.0)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    box = np.array([(-1.0, -0.35), (1.0, -0.35), (1.0, 0.35), (-1.0, 0.35)])
    wavy = (0.95 + 0.005 * np.cos(24.0 * t))[:, None] * circle
    hole = -0.12 * circle[::-16]  # clockwise
    return {
        "ellipse": loops(circle * [1.0, 0.5]),
        "ring": lambda x: np.abs(np.linalg.norm(x, axis=1) - 0.7) - 0.3,
        "three parabolas": three_parabolas,
        "rectangle, turned": loops(box @ turn),
        "L": loops([(-1, -1), (1, -1), (1, -0.2), (-0.2, -0.2), (-0.2, 1), (-1, 1)]),
        "corner cut off": loops([(-1, -1), (1, -1), (1, 0.5), (0.5, 1), (-1, 1)]),
        "wedge of 20 degrees": loops([(-1.0, 0.0), (1.0, -0.3527), (1.0, 0.3527)]),
        "wavy disc": loops(wavy),
        "part": loops(
            [
                (-1, -0.8), (1, -0.8), (1, -0.4), (0.2, -0.4), (0.2, 0.1), (1, 0.1), (1, 0.8),
                (0.45, 0.8), (0.45, 0.4), (0.35, 0.4), (0.35, 0.8), (-1, 0.8),
            ],
            hole + np.array([-0.55, 0.35]),
            hole + np.array([-0.3, -0.45]),
        ),
    }  # fmt: skip


def loops(*curves: npt.ArrayLike) -> ads.SimplexMesh:
    """Return closed curves through points as one mesh of segments."""
    points, cells, start = [], [], 0
    for curve in map(np.asarray, curves):
        number = start + np.arange(len(curve))
        points.append(curve)
        cells.append(np.column_stack([number, np.roll(number, -1)]))
        start += len(curve)
    return ads.SimplexMesh(np.concatenate(points), np.concatenate(cells))


def three_parabolas(x: Array, *, bend: float = 1.4, reach: float = 0.85) -> Array:
    """Return the distance of the points inside y > bend x^2 - reach and its two turned copies."""
    sides = []
    for angle in np.radians([0.0, 120.0, 240.0]):
        along = x @ [np.cos(angle), np.sin(angle)]
        above = x @ [-np.sin(angle), np.cos(angle)] + reach
        # The closest point (t, bend t^2) by Newton's method, from the side of x.
        t = np.sign(along) * np.sqrt(np.maximum(above / bend - 0.5 / bend**2, along**2))
        for _ in range(40):
            gap = bend * t * t - above
            t = t - (t - along + 2.0 * bend * t * gap) / (
                1.0 + 2.0 * bend * gap + (2 * bend * t) ** 2
            )
        away = np.hypot(along - t, above - bend * t * t)
        sides.append(np.where(above > bend * along**2, -away, away))
    return np.asarray(np.max(sides, axis=0))


def draw(panel: Axes, grid: ads.CartesianGrid, phi: Array, size: Array, medial: Any) -> None:
    """Draw the feature size inside, the boundary and the points of the medial axis."""
    shown = np.ma.masked_invalid(size)
    mesh = panel.pcolormesh(*grid.axes, shown.T, vmin=0.0, shading="nearest")
    panel.figure.colorbar(mesh, ax=panel, label="local feature size", shrink=0.85)
    panel.contour(*grid.axes, phi.T, [0.0], colors=INK, linewidths=1.0)
    panel.plot(
        *medial.points.T,
        ".",
        color="black",
        markersize=4,
        markeredgecolor="white",
        markeredgewidth=0.4,
    )
    panel.set(aspect="equal", xlim=(-1.13, 1.13), ylim=(-1.13, 1.13), xticks=[-1, 0, 1],
              yticks=[-1, 0, 1])  # fmt: skip


if __name__ == "__main__":
    run(main)
