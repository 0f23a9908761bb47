"""Limiting schemes on grids.

The contours should be circles around the two sources, as in (a) and (e). Along the edges of the
grid (b) they become squares.

Figure 11 of Persson's paper: two point sources, 1 at (-10, 0) and 5 at (10, 0), in the
square (-50, 50)^2 of 100 x 100 squares, g = 0.3.  With edge-based limiting, circles become
diamonds at every spacing.  Sizes by first-order fast marching are slightly too large, and the
error at second order is a quarter of that.  The default method, in the fifth panel, is exact to
rounding.  The paper does not have it.

```python
import numpy as np

import adaptsize as ads

grid = ads.CartesianGrid([-50.0, -50.0], 1.0, (101, 101))
h0 = np.full(grid.shape, np.inf)
h0[40, 50], h0[60, 50] = 1.0, 5.0
exact = ads.limit_gradient(grid, h0, 0.3)
for method in ("edge-based", ads.limiting.FastMarching(order=2)):
    print(method, np.abs(ads.limit_gradient(grid, h0, 0.3, method=method) - exact).max())
ads.plot.plot_size(grid, exact, path="grid_schemes.png")
```

    python examples/plot_grid_schemes.py [DIRECTORY]
"""

from pathlib import Path

import numpy as np
from _gallery import drawing, run, save_drawing

import adaptsize as ads

G = 0.3
SCHEMES: dict[str, str | ads.limiting.FastMarching] = {
    "edge-based": "edge-based",
    "first order": "fast-marching",
    "second order": ads.limiting.FastMarching(order=2),
    "exact": "exact",
}


def main(output_dir: Path, *, n_cells: int = 100, width: int = 480) -> dict[str, float]:
    grid = ads.CartesianGrid([-50.0, -50.0], 100.0 / n_cells, (n_cells + 1, n_cells + 1))
    h0 = np.full(grid.shape, np.inf)
    h0[2 * n_cells // 5, n_cells // 2] = 1.0
    h0[3 * n_cells // 5, n_cells // 2] = 5.0
    away = [np.linalg.norm(grid.points - [x, 0.0], axis=1) for x in (-10.0, 10.0)]
    true = np.minimum(1.0 + G * away[0], 5.0 + G * away[1]).reshape(grid.shape)
    titles, fields, found = ["true solution, formula (11)"], [true], {}
    for name, method in SCHEMES.items():
        h = ads.limit_gradient(grid, h0, G, method=method)
        found[f"max error {name}"] = float(np.abs(h - true).max())
        titles.append(f"{name}, largest error {np.abs(h - true).max():.3g}")
        fields.append(h)

    figure, panels = drawing(-(-len(fields) // 2), 2, width, shape=1.0)
    levels = np.arange(0.0, true.max() + 3.0, 2.0)
    for panel in panels[len(fields) :]:
        panel.set_axis_off()
    for title, h, panel in zip(titles, fields, panels, strict=False):
        filled = panel.contourf(*grid.axes, h.T, levels, extend="max")
        panel.contour(*grid.axes, h.T, levels, colors="black", linewidths=0.5)
        panel.plot([-10, 10], [0, 0], "w.", markersize=4)
        panel.set(title=title, xlabel="x", ylabel="y", aspect="equal")
    figure.colorbar(filled, ax=panels, label="mesh size h", shrink=0.6)
    save_drawing(output_dir / "grid_schemes.png", figure, panels[1])
    return found


if __name__ == "__main__":
    run(main)
