"""Choosing g, the elements per radian and the elements across.

Rows change one parameter from coarse to fine; the middle column has the defaults.  With a larger
gradient limit g, elements grow faster away from small ones; more elements per radian make curved
boundaries smoother; more elements across resolve narrow places.

The numbers of triangles are those that Mmg made.  Halving g costs more elements in the
interior, doubling the other two costs elements along the boundary.

```python
import numpy as np
import adaptsize as ads

angle = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
circle = np.column_stack([np.cos(angle), np.sin(angle)])
plate = ads.polygons([(0, 0), (3, 0), (3, 2), (0, 2)], holes=[[1.1, 0.72] + 0.55 * circle])
size = ads.size_function(plate, g=0.5, elements_per_radian=4, elements_across=2)
ads.plot.plot_size(ads.remesh(plate, size), size, path="choices.png")
```

    python examples/plot_choices.py [DIRECTORY]
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from _gallery import draw_mesh, drawing, run, save_drawing
from matplotlib.colors import LogNorm

import adaptsize as ads

#: What each row changes: the name, how the title calls it, and three values.
ROWS = (
    ("g", "g", (0.5, 0.25, 0.125)),
    ("elements_per_radian", "elements per radian", (2.0, 4.0, 8.0)),
    ("elements_across", "elements across", (1.0, 2.0, 4.0)),
)


def plate(n: int = 200) -> ads.SimplexMesh:
    """Return a plate with a large hole close to its lower side, and a small one."""
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    holes = [[1.1, 0.72] + 0.55 * circle, [2.4, 1.4] + 0.12 * circle]
    return ads.polygons([(0, 0), (3, 0), (3, 2), (0, 2)], holes=holes)


def main(output_dir: Path, *, width: int = 500, n: int = 200) -> dict[str, int]:
    domain = plate(n)
    figure, panels = drawing(3, 3, width, shape=0.78)
    scale = LogNorm(0.01, 0.3)
    found = {}
    for row, (option, name, values) in enumerate(ROWS):
        for column, value in enumerate(values):
            chosen: dict[str, Any] = {option: value}
            size = ads.size_function(domain, hmax=0.3, tolerance=np.inf, **chosen)
            mesh = ads.remesh(domain, size)
            found[f"triangles, {name} {value:g}"] = mesh.n_cells
            panel = panels[3 * row + column]
            colours = draw_mesh(panel, mesh, size(mesh.points), norm=scale, width=0.4)
            equals = f"g = {value:g}" if option == "g" else f"{value:g} {name}"
            equals = equals.replace("1 elements", "1 element")
            default = ", as by default" if column == 1 else ""
            panel.set_title(f"{equals}{default}\n{mesh.n_cells} triangles", fontsize=8)
            panel.set(aspect="equal", xticks=[], yticks=[], frame_on=False)
    bar = figure.colorbar(colours, ax=panels, location="bottom", shrink=0.5, aspect=40)
    bar.set_label("size h")
    bar.set_ticks(
        [0.01, 0.02, 0.05, 0.1, 0.2, 0.3], labels=list(map(str, (0.01, 0.02, 0.05, 0.1, 0.2, 0.3)))
    )
    bar.minorticks_off()
    save_drawing(output_dir / "choices.png", figure, panels[4])
    return found


if __name__ == "__main__":
    run(main)
