"""Quadtrees refined to the size.

Leaves refined at the boundary alone (a) carry the sizes poorly (b). Refined to the sizes, fewer
leaves carry them well (c).

The octree of Figure 1 of Persson's paper.  Left: refined at the boundary of a plate
with two holes, by its signed distance.  The number of leaves is proportional to the length of the
boundary, not to the area.  Middle: a size of a quarter of the radius is prescribed at the
holes (thick lines) and limited on that tree, whose leaves need not be balanced.  Right: a tree
refined to these sizes, in which no leaf is larger than the size in it.

```python
import numpy as np

import adaptsize as ads

near = ads.refine_at_boundary(lambda x: np.hypot(x[:, 0] - 0.7, x[:, 1] - 0.5) - 0.2)
tree = ads.Octree.build([0.0, 0.0], [2.0, 1.0], near, max_level=6)
h0 = ads.size_from_sources(tree, ads.PointSource([0.5, 0.5], 0.02), g=0.3)
size = ads.SizeFunction(tree, ads.limit_gradient(tree, h0, 0.3, method="fast-marching"))
fine = ads.Octree.build([0.0, 0.0], [2.0, 1.0], ads.refine_to_size(size, g=0.3), max_level=12)
ads.plot.plot_size(fine, size, path="octree.png")
```

    python examples/plot_octree.py [DIRECTORY]
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from _gallery import INK, drawing, run, save_drawing

import adaptsize as ads

if TYPE_CHECKING:
    from matplotlib.axes import Axes

G = 0.3
HOLES = (((0.7, 0.5), 0.2), ((1.5, 0.6), 0.05))


def plate(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the signed distance to the boundary of the plate, negative inside."""
    away = np.abs(x - [1.0, 0.5]) - [0.95, 0.45]
    square = np.hypot(*np.maximum(away, 0.0).T) + np.minimum(away.max(axis=1), 0.0)
    holes = [radius - np.linalg.norm(x - np.array(centre), axis=1) for centre, radius in HOLES]
    return np.max([square, *holes], axis=0)


def true_size(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the size around each hole, the way around the other one not counted."""
    return np.min(
        [
            radius / 4.0 + G * np.abs(np.linalg.norm(x - np.array(centre), axis=1) - radius)
            for centre, radius in HOLES
        ],
        axis=0,
    )


def main(output_dir: Path, *, level: int = 6, width: int = 640) -> dict[str, float]:
    """Draw the trees; ``level`` is that of the leaves at the boundary."""
    box = ([0.0, 0.0], [2.0, 1.0])
    at_boundary = ads.refine_at_boundary(plate)
    tree = ads.Octree.build(*box, at_boundary, max_level=level)
    finer = ads.Octree.build(*box, at_boundary, max_level=level + 3)
    h0 = ads.size_from_sources(tree, circles(), g=G)
    h = ads.limit_gradient(tree, h0, G, method="fast-marching")
    size = ads.SizeFunction(tree, h)
    fine = ads.Octree.build(*box, ads.refine_to_size(size, g=G), max_level=12)
    fine_h0 = ads.size_from_sources(fine, circles(), g=G)
    fine_h = ads.limit_gradient(fine, fine_h0, G, method="fast-marching")

    figure, panels = drawing(3, 1, width, shape=0.6)
    for panel, background, values in zip(
        panels, (tree, tree, fine), (None, h, fine_h), strict=True
    ):
        draw(panel, background, values)
    panels[0].set_title(f"refined at the boundary\n{tree.n_leaves} leaves")
    panels[1].set_title(f"sizes limited on it, g = {G}\nh {h.min():.4f} to {h.max():.3f}")
    panels[2].set_title(f"refined to these sizes\n{fine.n_leaves} leaves")
    save_drawing(output_dir / "octree.png", figure, panels[2])
    return {
        "leaves at the boundary": tree.n_leaves,
        "times as many leaves, 8 times finer": finer.n_leaves / tree.n_leaves,
        "largest error": float(np.abs(h - true_size(tree.points)).max()),
        "leaves to the size": fine.n_leaves,
        "largest leaf over the size at its centre": largest_leaf(fine, size),
    }


def draw(panel: Axes, tree: ads.Octree, h: npt.NDArray[np.float64] | None) -> None:
    """Draw the leaves of a quadtree, coloured by the mean size at their corners if given."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import LogNorm

    squares = tree.points[tree.leaf_corners[:, [0, 2, 3, 1]]]
    leaves = PolyCollection(squares, edgecolor="#0f172966", facecolor="#eff2eb", linewidth=0.3)
    if h is not None:
        leaves.set(array=h[tree.leaf_corners].mean(axis=1), norm=LogNorm(0.01, 0.3))
        panel.figure.colorbar(leaves, ax=panel, label="mesh size h", shrink=0.8,
                              ticks=[0.01, 0.03, 0.1, 0.3], format="%g")  # fmt: skip
    panel.add_collection(leaves)
    for centre, radius in HOLES:
        t = np.linspace(0.0, 2.0 * np.pi, 181)
        circle = np.array(centre)[:, None] + radius * np.stack([np.cos(t), np.sin(t)])
        panel.plot(*circle, color=INK, linewidth=1.6)
    panel.set(xlim=(0, 2), ylim=(0, 1), aspect="equal", xlabel="x", ylabel="y")


def circles() -> list[ads.CurveSource]:
    """Return the boundaries of the holes as sources of a quarter of their radius."""
    t = np.linspace(0.0, 2.0 * np.pi, 721)
    unit = np.column_stack([np.cos(t), np.sin(t)])
    return [
        ads.CurveSource(np.array(centre) + radius * unit, np.full(len(t), radius / 4.0))
        for centre, radius in HOLES
    ]


def largest_leaf(tree: ads.Octree, size: ads.SizeFunction) -> float:
    """Return the largest of the edges of leaves, as multiples of the size at their centres."""
    return float((tree.leaf_sizes.max(axis=1) / size(tree.leaf_centres)).max())


if __name__ == "__main__":
    run(main)
