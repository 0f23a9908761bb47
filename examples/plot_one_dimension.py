"""Gradient limiting in one dimension.

The limited size (blue) is the largest function below the bound (dashed) whose slope is at most g:
the smaller g, the more nodes are lowered.

Figure 4 of Persson's paper: where h0 (dashed) is steeper than g it is lowered by as much
as is needed and no more, and elsewhere h (solid) is h0; smoothing would change all of it.
The sizes at the nodes of a grid are those of formula (11), to rounding.

```python
import numpy as np

import adaptsize as ads

grid = ads.CartesianGrid([0.0], 1.0 / 400, (401,))
x = grid.axes[0]
h0 = 0.5 + 0.4 * np.sin(20.0 * x)
h = ads.limit_gradient(grid, h0, 2.0)
exact = (h0 + 2.0 * np.abs(x[:, None] - x)).min(axis=1)  # formula (11)
print(np.abs(h - exact).max())
```

    python examples/plot_one_dimension.py [DIRECTORY]
"""

from pathlib import Path

import numpy as np
import numpy.typing as npt
from _gallery import INK, drawing, run, save_drawing

import adaptsize as ads

LIMITS = (4.0, 2.0, 1.0, 0.5)


def upper_bound(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return a function with slopes up to 8: a wave, a step, a dip."""
    wave = 0.6 + 0.1 * np.cos(4.0 * np.pi * x)
    step = 0.25 * np.tanh(20.0 * (x - 0.4))
    dip = 0.6 * np.exp(-(((x - 0.75) / 0.07) ** 2))
    return wave + step - dip


def main(output_dir: Path, *, n_nodes: int = 401, width: int = 480) -> dict[str, float]:
    grid = ads.CartesianGrid([0.0], 1.0 / (n_nodes - 1), (n_nodes,))
    x = grid.axes[0]
    h0 = upper_bound(x)
    found = {"steepest slope of h0": float(np.abs(np.diff(h0)).max() * (n_nodes - 1))}
    figure, panels = drawing(2, 2, width, shape=0.7)
    for g, panel in zip(LIMITS, panels, strict=True):
        h, info = ads.limit_gradient.with_info(grid, h0, g)
        exact = (h0 + g * np.abs(x[:, None] - x)).min(axis=1)
        found[f"share lowered, g = {g:g}"] = info.n_changed / n_nodes
        found[f"steepest slope over g, g = {g:g}"] = info.largest_edge_slope
        found[f"difference from formula (11), g = {g:g}"] = float(np.abs(h - exact).max())
        panel.plot(x, h0, "--", color=INK, label="$h_0$")
        panel.plot(x, h, label="$h$, limited")
        panel.set(title=f"g = {g:g}: {info.n_changed / n_nodes:.0%} of the nodes lowered")
        panel.set(xlabel="x", ylabel="mesh size", xlim=(0, 1), ylim=(0, 1.1))
    panels[0].legend(loc="upper left")
    save_drawing(output_dir / "one_dimension.png", figure, panels[2])
    return found


if __name__ == "__main__":
    run(main)
