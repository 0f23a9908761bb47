"""Gradient limit by place.

The same size at two points: on the left, where g is twice as large, elements grow twice as fast.

Figure 14 of Persson's paper: g = 0.4 in the left half and 0.2 in the right, given per
cell because it is discontinuous.  From the same small size at two points, the size grows twice as
fast on the left.  The mesh on the right is finer, and its triangles vary less in size.

```python
import numpy as np

import adaptsize as ads

mesh = ads.read("data/slit.vtu")
left = mesh.points[mesh.cells].mean(axis=1)[:, 0] < 2.0
g = np.where(left, 0.4, 0.2)  # one number for each cell
h = ads.limit_gradient(mesh, mesh.point_data["h0"], g)
ads.plot.plot_size(mesh, h, path="space_dependent_g.png")
```

    python examples/plot_space_dependent_g.py [DIRECTORY]
"""

from pathlib import Path

import numpy as np
from _gallery import has_mmg, jittered_rectangle, node_at, run, save_panels

import adaptsize as ads
from adaptsize.plot import plot_mesh, plot_size

SMALLEST = 0.02


def main(output_dir: Path, *, n_side: int = 401, width: int = 420) -> dict[str, float]:
    mesh = jittered_rectangle((-2, 0), (2, 2), n_side)
    g = np.where(mesh.points[mesh.cells].mean(axis=1)[:, 0] < 0.0, 0.4, 0.2)
    h0 = np.full(mesh.n_points, np.inf)
    sources = [node_at(mesh, (-1, 1)), node_at(mesh, (1, 1))]
    h0[sources] = SMALLEST
    h, info = ads.limit_gradient.with_info(mesh, h0, g)

    left, right = node_at(mesh, (-1, 0)), node_at(mesh, (1, 0))
    grown = [h[left] - SMALLEST, h[right] - SMALLEST]
    paths = np.linalg.norm(mesh.points[[left, right]] - mesh.points[sources], axis=1)
    found = {
        "mean slope on the left": float(grown[0] / paths[0]),
        "mean slope on the right": float(grown[1] / paths[1]),
        "largest slope over g": info.largest_edge_slope,
    }
    scale = SMALLEST, float(h.max())
    halves = mesh.with_data(cell_data={"g": g})
    panels = [
        (
            "gradient limit\n0.4 left, 0.2 right",
            plot_mesh(halves, color="g", width=width),
        ),
        (f"size\nh {h.min():.2f} to {h.max():.2f}", plot_size(mesh, h, limits=scale, width=width)),
    ]
    if has_mmg():
        sizes = ads.SizeFunction(mesh, h)
        new = ads.remesh(mesh, sizes)
        middle = new.points[new.cells].mean(axis=1)[:, 0]
        found["triangles on the left"] = int((middle < 0.0).sum())
        found["triangles on the right"] = int((middle >= 0.0).sum())
        panels.append(
            (f"mesh\n{new.n_cells} triangles", plot_size(new, sizes, limits=scale, width=width))
        )
    save_panels(output_dir / "space_dependent_g.png", panels)
    return found


if __name__ == "__main__":
    run(main)
