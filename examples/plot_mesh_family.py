"""Meshes for a convergence study.

The first three panels show meshes of one family (data/curved.vtu).  From one mesh to the next, the
size is divided by the square root of 2 everywhere, because the bounds and the gradient limit are.
The last panel has the errors of the gradient of linear elements for a smooth solution.  On the
family, they fall with the first power of the size.  On meshes that were refined by halving hmax,
they do not: the sizes at the arcs and around them stay as they are.

Needs Mmg and scikit-fem.

```python
import adaptsize as ads

mesh = ads.read("data/curved.vtu")
family = ads.mesh_family(mesh, hmax=0.5)
h = family.mean_sizes
print(family, family.convergence(1.0 + h**2))  # your results instead
```

    python examples/plot_mesh_family.py [DIRECTORY]
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
from _gallery import CURVES, DATA, draw_mesh, drawing, run, save_drawing

import adaptsize as ads


def main(output_dir: Path, *, width: int = 600) -> dict[str, float]:
    mesh = ads.read(DATA / "curved.vtu")
    largest = mesh.diameter / 15
    family = ads.mesh_family(mesh, hmax=largest)
    hmax = largest / 2.0 ** np.arange(4)
    halved = [ads.remesh(mesh, ads.size_function(mesh, hmax=float(h))) for h in hmax]
    figure, panels = drawing(2, 2, width)
    for panel, level in zip(panels, (0, 1, 3), strict=False):
        new = family.meshes[level]
        draw_mesh(panel, new)
        h = family.mean_sizes[level]
        title = f"mesh {level + 1}: {new.n_cells} triangles, mean size {h:.3f}"
        panel.set(title=title, aspect="equal", xlabel="x", ylabel="y")
    errors = measurements().errors
    found = {}
    plot = panels[3]
    for name, sizes, meshes, colour, mark in (
        ("family, over the mean size", family.mean_sizes, family.meshes, CURVES[0], "o-"),
        ("halved hmax, over hmax", hmax, halved, CURVES[1], "s--"),
    ):
        error = [errors(one)[0] for one in meshes]
        order = float(np.polyfit(np.log(sizes), np.log(error), 1)[0])
        found[f"order, {name}"] = order
        plot.loglog(sizes, error, mark, color=colour, label=f"{name}: order {order:.2f}")
    plot.set(title="error of the gradient", xlabel="size")
    plot.set_xticks([0.1, 0.2, 0.4, 0.8], labels=["0.1", "0.2", "0.4", "0.8"])
    plot.set_yticks([5, 10, 20, 40], labels=["5", "10", "20", "40"])
    plot.minorticks_off()
    plot.legend()
    save_drawing(output_dir / "mesh_family.png", figure, panels[1])
    return found


def measurements():
    """Return docs/measurements/mesh_families.py, which solves the problem."""
    path = DATA.parent / "docs" / "measurements" / "mesh_families.py"
    spec = importlib.util.spec_from_file_location("mesh_families", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


if __name__ == "__main__":
    run(main)
