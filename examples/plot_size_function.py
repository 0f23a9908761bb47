"""What a size function is.

Each bound on the sizes acts where it arises (a): on curved boundaries, in narrow places, at a point
that the user chose.  From there sizes grow by at most g per length (b).  At each place one bound
controls the size (c), and a mesh generator makes edges of this length (d).

The part has a hole close to its lower side, a rounded notch in the upper one, and a point with a
prescribed size.  Of the bounds, (a) shows the smallest at each node of the background mesh; where
there is none, only the largest size counts.  `size.report.cause` tells which bound controls a node.

```python
import numpy as np
import adaptsize as ads

angle = np.linspace(0.0, 2.0 * np.pi, 80, endpoint=False)
hole = np.column_stack([1.2 + 0.5 * np.cos(angle), 0.65 + 0.5 * np.sin(angle)])
part = ads.polygons([(0, 0), (4, 0), (4, 2), (0, 2)], holes=[hole])
size = ads.size_function(part, sources=ads.PointSource([3.2, 0.6], 0.02), hmax=0.3)
new = ads.remesh(part, size)
ads.plot.plot_size(new, size, path="size_function.png")
```

    python examples/plot_size_function.py [DIRECTORY]
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from _gallery import CURVES, INK, draw_mesh, drawing, has_mmg, run, save_drawing
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.patches import Patch

import adaptsize as ads

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from adaptsize._size_report import SizeReport

POINT, LARGEST = (3.2, 0.6), 0.3


def plate(n: int = 80) -> ads.SimplexMesh:
    """Return a plate of 4 by 2 with a round hole near its lower side and a rounded notch."""
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    hole = np.column_stack([1.2 + 0.5 * np.cos(angle), 0.65 + 0.5 * np.sin(angle)])
    turn = np.linspace(np.pi, 2.0 * np.pi, n // 2)
    notch = np.column_stack([2.3 + 0.12 * np.cos(turn), 1.4 + 0.12 * np.sin(turn)])
    outer = [(0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (2.42, 2.0), *notch[::-1], (2.18, 2.0), (0.0, 2.0)]
    return ads.polygons(outer, holes=[hole])


def main(output_dir: Path, *, width: int = 800, spacing: float = 0.05) -> dict[str, float]:
    part = ads.remesh(plate(), spacing)
    size = ads.size_function(part, sources=ads.PointSource(POINT, 0.02), hmax=LARGEST)
    report, mesh = size.report, size.background
    assert report is not None
    assert isinstance(mesh, ads.SimplexMesh)
    bounds = np.min([bound for name, bound in report.bounds.items() if name != "hmax"], axis=0)
    figure, panels = drawing(2, 2, width, shape=0.66)
    scale = LogNorm(0.02, LARGEST)
    draw_outline(panels[0], mesh)
    arise = np.flatnonzero(bounds < LARGEST)
    arise = arise[np.argsort(-bounds[arise])]
    panels[0].scatter(*mesh.points[arise].T, c=bounds[arise], s=7, norm=scale)
    panels[0].set_title("bounds, where they arise")
    draw_outline(panels[1], mesh)
    colours = panels[1].tripcolor(
        *mesh.points.T, mesh.cells, size.values, norm=scale, shading="gouraud", rasterized=True
    )
    panels[1].set_title(f"the size function, grown by g = {report.g:g}")
    draw_causes(panels[2], mesh, report)
    found = {"nodes with a bound": len(arise) / mesh.n_points}
    if has_mmg():
        new = ads.remesh(part, size)
        draw_mesh(panels[3], new, size(new.points), norm=scale)
        panels[3].set_title(f"a mesh with these sizes, {new.n_cells} triangles")
        found["triangles over predicted"] = new.n_cells / report.n_elements
    for panel in panels:
        panel.set(aspect="equal", xticks=[], yticks=[], frame_on=False)
    place = panels[3].inset_axes((0.1, -0.14, 0.8, 0.05))
    bar = figure.colorbar(colours, cax=place, orientation="horizontal", label="size h")
    bar.set_ticks([0.02, 0.05, 0.1, 0.2, 0.3], labels=["0.02", "0.05", "0.1", "0.2", "0.3"])
    bar.minorticks_off()
    save_drawing(output_dir / "size_function.png", figure, panels[1])
    return found


def draw_outline(panel: Axes, mesh: ads.SimplexMesh) -> None:
    """Draw the boundary."""
    skin = mesh.boundary().mesh
    panel.add_collection(LineCollection(list(skin.points[skin.cells]), colors=INK, linewidths=0.9))
    panel.autoscale()


def draw_causes(panel: Axes, mesh: ads.SimplexMesh, report: SizeReport) -> None:
    """Draw which bound controls each place, with a legend."""
    shares = {name: share for name, share in report.domain_shares.items() if share > 0.005}
    names = list(shares)
    number = np.array([names.index(name) if name in names else -1 for name in report.causes])
    of_cells = number[report.cause[mesh.cells]].max(axis=1)
    colours = ListedColormap(CURVES[: len(names)])
    panel.tripcolor(
        *mesh.points.T, mesh.cells, of_cells, cmap=colours, vmin=-0.5, vmax=len(names) - 0.5,
        rasterized=True,
    )  # fmt: skip
    draw_outline(panel, mesh)
    labels = [f"{name} {share:.0%}" for name, share in shares.items()]
    handles = [Patch(color=colour) for colour in CURVES[: len(names)]]
    panel.legend(
        handles, labels, loc="upper center", bbox_to_anchor=(0.5, 0.02), ncols=2, frameon=False,
        handlelength=1.0,
    )  # fmt: skip
    panel.set_title("which bound controls the size")


if __name__ == "__main__":
    run(main)
