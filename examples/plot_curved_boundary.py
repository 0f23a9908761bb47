"""Sizes from boundary curvature.

(a) Bounds on the curved parts of the boundary only. (b) Gradient limiting propagates them
inwards. (c) The mesh follows, with well-shaped triangles.

Figure 5 of Persson's paper, on a rectangle with three arcs of radius 1.5, 0.5 and 4
(data/curved.vtu).  From left to right: the bound h0 = 1 / (K kappa) on the arcs, with K = 6
elements per radian, and no bound elsewhere (grey); the largest size below h0 with a gradient of
at most 0.2; and the mesh, if Mmg is installed.

```python
import adaptsize as ads

mesh = ads.read("data/curved.vtu")
h0 = ads.size_from_curvature(mesh, elements_per_radian=6)
h = ads.limit_gradient(mesh, h0, 0.2)
new = ads.remesh(mesh, ads.SizeFunction(mesh, h))
ads.plot.plot_mesh(new, path="curved_boundary.png")
```

    python examples/plot_curved_boundary.py [DIRECTORY]
"""

from pathlib import Path

from _gallery import DATA, has_mmg, run, save_panels

import adaptsize as ads
from adaptsize.plot import plot_mesh, plot_size

G = 0.2
PER_RADIAN = 6.0


def main(output_dir: Path, *, width: int = 420) -> dict[str, float]:
    mesh = ads.read(DATA / "curved.vtu")
    h0 = ads.size_from_curvature(mesh, elements_per_radian=PER_RADIAN)
    h, info = ads.limit_gradient.with_info(mesh, h0, G)
    scale = float(h.min()), float(h.max())
    panels = [
        (
            f"from curvature, {PER_RADIAN:g} elements per radian\ngrey: no bound",
            plot_size(mesh, h0, limits=scale, width=width),
        ),
        (
            f"limited, g = {G}\nh {h.min():.3f} to {h.max():.3f}",
            plot_size(mesh, h, limits=scale, width=width),
        ),
    ]
    found = {
        "smallest size": float(h.min()),
        "largest size": float(h.max()),
        "largest slope over g": info.largest_edge_slope,
    }
    if has_mmg():
        size = ads.SizeFunction(mesh, h)
        new = ads.remesh(mesh, size)
        conformity = ads.size_conformity(new, size)
        found["share of edges in band"] = conformity.share_in_band
        found["smallest angle"] = conformity.angle_min
        title = (
            f"mesh, {new.n_cells} triangles\n"
            f"{conformity.share_in_band:.0%} of the edges within sqrt 2 of h"
        )
        panels.append((title, plot_mesh(new, width=width)))
    save_panels(output_dir / "curved_boundary.png", panels, thumb=1)
    return found


if __name__ == "__main__":
    run(main)
