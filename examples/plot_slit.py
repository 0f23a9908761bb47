"""Sizes do not cross slits.

Measured inside the domain (a, c), the small sizes of the notch end at the slit. Straight
distances (b, d) refine the other side for nothing.

Figure 6 of Persson's paper (data/slit.vtu): small sizes are prescribed on a round notch in
the top, close to a narrow slit.  `limit_gradient` measures distances inside the domain: the
shortest path to the other side leads around the lower end of the slit, and the size there is
large.  Formula (11) of the paper has straight-line distances and is meant for convex domains.
Here it goes through the slit and refines the wrong side.  Below are meshes of both sizes,
up to 0.3, if Mmg is installed.

```python
import adaptsize as ads

mesh = ads.read("data/slit.vtu")  # with h0 at its nodes, inf where there is no bound
h = ads.limit_gradient(mesh, mesh.point_data["h0"], 0.15)
size = ads.SizeFunction(mesh, h).clip(hmax=0.3)
new = ads.remesh(mesh, size)
ads.plot.plot_size(new, size, path="slit.png")
```

    python examples/plot_slit.py [DIRECTORY]
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from _gallery import DATA, draw_mesh, drawing, has_mmg, node_at, run, save_drawing
from matplotlib.colors import LogNorm

import adaptsize as ads

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import TriMesh

G = 0.15
LARGEST = 0.3  # of the meshes and of the colours; the sizes alone grow to a third of the domain


def main(output_dir: Path, *, width: int = 800) -> dict[str, float]:
    mesh = ads.read(DATA / "slit.vtu")
    across = node_at(mesh, (2.02, 3.0))  # upper right edge of the slit
    h0 = mesh.point_data["h0"]
    sizes = {
        "inside the domain": ads.limit_gradient(mesh, h0, G),
        "straight through the slit": straight_sizes(mesh.points, h0),
    }
    figure, panels = drawing(2, 2 if has_mmg() else 1, width, shape=0.75)
    found = {}
    scale = LogNorm(float(h0.min()), LARGEST)
    for column, (name, h) in enumerate(sizes.items()):
        found[f"size across the slit, {name}"] = float(h[across])
        title = f"distances {name}\nh = {h[across]:.2f} at the top right edge of the slit"
        colours = draw(panels[column], mesh, h, title, scale)
        if has_mmg():
            size = ads.SizeFunction(mesh, h).clip(hmax=LARGEST)
            new = ads.remesh(mesh, size)
            found[f"triangles, {name}"] = new.n_cells
            title = f"its mesh, {new.n_cells} triangles"
            draw(panels[2 + column], new, size(new.points), title, scale)
    bar = figure.colorbar(colours, ax=panels, shrink=0.5, extend="max", label="mesh size h")
    bar.set_ticks([0.04, 0.05, 0.1, 0.2, 0.3], labels=["0.04", "0.05", "0.1", "0.2", "0.3"])
    bar.minorticks_off()
    save_drawing(output_dir / "slit.png", figure, panels[2 if has_mmg() else 0])
    return found


def draw(
    panel: Axes, mesh: ads.SimplexMesh, h: npt.NDArray[np.float64], title: str, scale: LogNorm
) -> TriMesh:
    """Draw nodal sizes and edges; return the colours."""
    colours = draw_mesh(panel, mesh, h, norm=scale)
    panel.set(title=title, aspect="equal", xlabel="x", ylabel="y")
    return colours


def straight_sizes(
    points: npt.NDArray[np.float64], h0: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the sizes of formula (11), whatever is in the way."""
    h = h0.copy()
    for node in np.flatnonzero(np.isfinite(h0)):
        h = np.minimum(h, h0[node] + G * np.linalg.norm(points - points[node], axis=1))
    return h


if __name__ == "__main__":
    run(main)
