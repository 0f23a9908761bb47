"""Three backgrounds, one problem.

The same size function on a grid, a quadtree and triangles: the fields agree, and only the cells
that carry them differ.

Figure 1 of Persson's paper names the three; `limit_gradient` takes each of them.  Asked for
are a size of 0.01 at two points and 0.05 on a segment; the limited sizes are compared with the
true ones, the least of size + g distance.

```python
import adaptsize as ads

sources = [
    ads.PointSource([0.25, 0.25], 0.01),
    ads.CurveSource([[1.0, 0.25], [1.75, 0.25]], 0.05),
]
near = ads.refine_at_boundary(lambda x: abs(x[:, 0] - 1.0), 0.02)
for background in (
    ads.CartesianGrid([0, 0], 1 / 32, (65, 33)),
    ads.Octree.build([0, 0], [2, 1], near, max_level=6),
    ads.read("data/slit.vtu"),
):
    h = ads.limit_gradient(background, ads.size_from_sources(background, sources, g=0.25), 0.25)
    print(background, h.min(), h.max())
```

    python examples/plot_backgrounds.py [DIRECTORY]
"""

from pathlib import Path

import numpy as np
import numpy.typing as npt
from _gallery import jittered_rectangle, run, save_panels

import adaptsize as ads
from adaptsize.plot import plot_size

G = 0.25
SOURCES = (
    ads.PointSource([0.25, 0.25], 0.01),
    ads.PointSource([1.5, 0.75], 0.01),
    ads.CurveSource([[1.0, 0.25], [1.75, 0.25]], 0.05),
)


def true_size(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the limited size, in the whole plane."""
    on_segment = np.column_stack([np.clip(x[:, 0], 1.0, 1.75), np.full(len(x), 0.25)])
    return np.min(
        [
            0.01 + G * np.linalg.norm(x - [0.25, 0.25], axis=1),
            0.01 + G * np.linalg.norm(x - [1.5, 0.75], axis=1),
            0.05 + G * np.linalg.norm(x - on_segment, axis=1),
        ],
        axis=0,
    )


def main(output_dir: Path, *, n_cells: int = 64, width: int = 420) -> dict[str, float]:
    """Draw the three; ``n_cells`` is that of the grid along x."""
    backgrounds: dict[str, ads.background.AnyBackground] = {
        "grid": ads.CartesianGrid([0, 0], 2.0 / n_cells, (n_cells + 1, n_cells // 2 + 1)),
        "quadtree": ads.Octree.build(
            [0, 0], [2, 1], ads.refine_to_size(true_size, factor=50.0 / n_cells, g=G), max_level=12
        ),
        "triangles": jittered_rectangle((0, 0), (2, 1), n_cells + 1),
    }
    panels = []
    found: dict[str, float] = {}
    exact = true_size(backgrounds["triangles"].points)
    scale = float(exact.min()), float(exact.max())
    for name, background in backgrounds.items():
        h0 = ads.size_from_sources(background, SOURCES, g=G)
        h = ads.limit_gradient(background, h0, G, method="fast-marching")
        error = np.abs(h.ravel() - true_size(background.points))
        found[f"nodes, {name}"] = background.n_points
        found[f"max error, {name}"] = float(error.max())
        title = f"{name}, {background.n_points} nodes\nlargest error {error.max():.4f}"
        panels.append((title, plot_size(background, h, limits=scale, width=width)))
    save_panels(output_dir / "backgrounds.png", panels)
    return found


if __name__ == "__main__":
    run(main)
