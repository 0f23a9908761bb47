"""Quadtree background of implicit domains.

The wall between the two holes is a 200th of the disc. Leaves are small (dark) only there (b).

Between two holes of a disc there is a wall that is 1/250 of the disc wide.  `size_function` chooses
the quadtree.  It is refined until sizes between its nodes are right within 5 %: along the wall, at
the holes, and where sizes from different parts of the boundary meet.  The uniform grid of the same
resolution would have 2000 x 2000 nodes.

```python
import numpy as np

import adaptsize as ads


def disc_with_holes(x):  # with a thin wall between the holes, negative inside
    left, right = (0.3 - np.hypot(x[:, 0] - c, x[:, 1]) for c in (-0.304, 0.304))
    return np.max([np.hypot(*x.T) - 1.0, left, right], axis=0)


size = ads.size_function(disc_with_holes, box=([-1.1, -1.1], [1.1, 1.1]), g=0.25)
print(size.background, size([[0.0, 0.0]]))
ads.plot.plot_size(size, path="implicit_background.png")
```

    python examples/plot_implicit_background.py [DIRECTORY]
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from _gallery import INK, drawing, run, save_drawing

import adaptsize as ads

G, RADIUS, HALF = 0.25, 0.3, 0.004
BOX = ([-1.1, -1.1], [1.1, 1.1])


def disc_with_holes(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the signed distance to the boundary of the disc with two holes, negative inside."""
    left, right = (
        RADIUS - np.hypot(x[:, 0] - side * (RADIUS + HALF), x[:, 1]) for side in (-1.0, 1.0)
    )
    return np.max([np.hypot(*x.T) - 1.0, left, right], axis=0)


def main(output_dir: Path, *, width: int = 640) -> dict[str, float]:
    """Draw the leaves, coloured by the size, in the disc and around the wall."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import LogNorm

    size = ads.size_function(disc_with_holes, box=BOX, g=G)
    tree = size.background
    assert isinstance(tree, ads.Octree)
    squares = tree.points[tree.leaf_corners[:, [0, 2, 3, 1]]]
    inside = (disc_with_holes(tree.points) < 0.0)[tree.leaf_corners].any(axis=1)
    colours = np.ma.masked_array(size.values[tree.leaf_corners].mean(axis=1), ~inside)
    figure, panels = drawing(2, 1, width, shape=0.9)
    t = np.linspace(0.0, 2.0 * np.pi, 721)
    for panel, reach in zip(panels, (1.1, 0.05), strict=True):
        leaves = PolyCollection(squares, edgecolor="#0f172966", linewidth=0.25)
        leaves.set(array=colours, norm=LogNorm(0.004, 0.1))
        panel.add_collection(leaves)
        for centre, radius in ((0.0, 1.0), (-RADIUS - HALF, RADIUS), (RADIUS + HALF, RADIUS)):
            panel.plot(centre + radius * np.cos(t), radius * np.sin(t), color=INK, linewidth=1.6)
        panel.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="x")
        panel.figure.colorbar(leaves, ax=panel, label="mesh size h", shrink=0.8,
                              ticks=[0.004, 0.01, 0.03, 0.1], format="%g")  # fmt: skip
    panels[0].set_ylabel("y")
    panels[0].set_title(f"{tree.n_leaves} leaves, {tree.n_points} nodes")
    panels[1].set_title("around the wall between the holes")
    save_drawing(output_dir / "implicit_background.png", figure, panels[1])
    return {
        "nodes": tree.n_points,
        "smallest leaf": float(tree.leaf_sizes.min()),
        "size in the wall": float(size([[0.0, 0.0]])[0]),
    }


if __name__ == "__main__":
    run(main)
