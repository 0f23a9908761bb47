"""The medial axis on a quadtree refined by the feature size.

The section of a part: a foot with a round hole, a fin, and a wall that tapers.  Left: a quadtree
that is fine only at the boundary.  For each point, the closest point of the boundary is computed.
Edges on which it jumps contain the medial axis exactly, for any size of the leaves.
Middle: the quadtree after three rounds of feature size, limited size, and refinement to that size.
It is fine only where the part is narrow.  Right: the feature size along the foot on both trees, and
on a grid with the finest spacing everywhere.  The grid mistakes the walls beside the hole for
corners where they are less than three spacings away.

```python
import numpy as np

import adaptsize as ads

corners = np.array([(0, 0), (10, 0), (10, 1.2), (2, 1.2), (1, 5), (0, 5)], dtype=float)
nodes = np.arange(len(corners))
boundary = ads.SimplexMesh(corners, np.column_stack([nodes, np.roll(nodes, -1)]))
box = [-0.53, -0.57], [10.61, 5.59]
near = ads.refine_at_boundary(lambda x: boundary.locator.nearest(x)[2], 0.25)
tree = ads.Octree.build(*box, near, max_level=10)
for _ in range(3):  # each time with leaves of the size found before
    h0 = ads.size_from_feature(tree, boundary, method="medial-axis", elements_across=4)
    h = ads.limit_gradient(tree, h0, 0.25, method="fast-marching")
    size = ads.SizeFunction(tree, h)
    tree = ads.Octree.build(*box, ads.refine_to_size(size, g=0.25), max_level=10)
print(tree, ads.feature_size(tree, boundary).min())
```

    python examples/plot_octree_feature_size.py [DIRECTORY]
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from _gallery import drawing, run, save_drawing
from plot_width import draw_boundary

import adaptsize as ads

if TYPE_CHECKING:
    from matplotlib.axes import Axes

G = 0.25
ACROSS = 4.0
OUTLINE = [
    (0, 0), (10, 0), (10, 1.2), (6.4, 1.2), (6.4, 3.6), (6.1, 3.6), (6.1, 1.2), (2.0, 1.2),
    (1.0, 5), (0, 5),
]  # fmt: skip
HOLE = ((8.4, 0.6), 0.35)


def part(n_hole: int = 90) -> ads.SimplexMesh:
    """Return the boundary: nodes at the corners only, and on the hole."""
    angle = -2.0 * np.pi * np.arange(n_hole) / n_hole
    hole = np.array(HOLE[0]) + HOLE[1] * np.column_stack([np.cos(angle), np.sin(angle)])
    cells = [
        first + np.column_stack([np.arange(n), np.roll(np.arange(n), -1)])
        for first, n in ((0, len(OUTLINE)), (len(OUTLINE), n_hole))
    ]
    return ads.SimplexMesh(np.concatenate([OUTLINE, hole]), np.concatenate(cells))


def main(
    output_dir: Path, *, spacing: float = 0.25, rounds: int = 3, width: int = 640
) -> dict[str, float]:
    """Draw quadtrees and feature sizes; ``spacing``: of the first one at the boundary."""
    boundary = part()
    near = ads.refine_at_boundary(lambda x: boundary.locator.nearest(x)[2], spacing)
    tree = first = ads.Octree.build([-0.53, -0.57], [10.61, 5.59], near, max_level=10)
    for _ in range(rounds):
        tree = refined(tree, boundary)

    trees = (first, tree)
    axes = [ads.medial_axis(t, boundary) for t in trees]
    sizes = [ads.feature_size(t, boundary) for t in trees]
    figure, panels = drawing(3, 1, width, shape=0.72)
    titles = (f"fine at the boundary: {first.n_leaves} leaves", f"refined: {tree.n_leaves} leaves")
    for panel, t, medial, title in zip(panels, trees, axes, titles, strict=False):
        draw_tree(panel, t, medial, boundary)
        panel.set_title(title)

    x = np.linspace(0.05, 9.95, 400)
    foot = np.column_stack([x, np.full(400, 0.15)])
    finest = float(tree.leaf_sizes.min())
    grid = ads.CartesianGrid.around(boundary.points, finest, margin=4.0 * finest)
    phi = ads.signed_distance(grid, boundary)
    curves = [
        ("first quadtree", ":", at(first, sizes[0], foot)),
        ("refined quadtree", "-", at(tree, sizes[1], foot)),
        ("grid as fine", "--", at(grid, ads.feature_size(grid, phi), foot)),
    ]
    for label, style, values in curves:
        panels[2].plot(x, values, style, label=label)
    panels[2].set(xlabel="x", ylabel="feature size", ylim=(0, None))
    panels[2].set_title("along the foot, y = 0.15")
    panels[2].legend(loc="upper center")
    save_drawing(output_dir / "octree_feature_size.png", figure)

    fin = np.column_stack([np.full(20, 6.25), np.linspace(1.8, 3.3, 20)])
    plain = (x > 2.5) & (x < 5.5)
    web = np.array([[8.4, 1.08]])
    return {
        "leaves at first": first.n_leaves,
        "leaves": tree.n_leaves,
        "leaves of the finest size in the box": float(
            np.prod((tree.upper - tree.lower) / tree.leaf_sizes.min(axis=0))
        ),
        "half the width of the fin": float(np.median(at(tree, sizes[1], fin))),
        "half the width of the fin, first quadtree": float(np.median(at(first, sizes[0], fin))),
        "half the width of the foot": float(np.median(curves[1][2][plain])),
        "half the width of the foot, grid": float(np.median(curves[2][2][plain])),
        "half the width of the web above the hole": float(at(tree, sizes[1], web)[0]),
    }


def refined(tree: ads.Octree, boundary: ads.SimplexMesh) -> ads.Octree:
    """Return a quadtree with leaves of the size that the last one asks for."""
    h0 = ads.size_from_feature(tree, boundary, method="medial-axis", elements_across=ACROSS)
    size = ads.SizeFunction(tree, ads.limit_gradient(tree, h0, G, method="fast-marching"))
    return ads.Octree.build(tree.lower, tree.upper, ads.refine_to_size(size, g=G), max_level=10)


def at(
    background: ads.Octree | ads.CartesianGrid, lfs: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """Return the feature size at points; it is inf at nodes outside, which count as far away."""
    largest = float(lfs[np.isfinite(lfs)].max())
    return ads.SizeFunction(background, np.minimum(lfs, largest))(points)


def draw_tree(
    panel: Axes, tree: ads.Octree, medial: ads.geometry.MedialAxis, boundary: ads.SimplexMesh
) -> None:
    """Draw the leaves, and the points of the medial axis by their distance from the boundary."""
    from matplotlib.collections import LineCollection

    low, high = tree.leaf_lower, tree.leaf_lower + tree.leaf_sizes
    x, y = np.stack([low, high], axis=1).transpose(2, 0, 1)
    boxes = np.stack([x[:, [0, 1, 1, 0, 0]], y[:, [0, 0, 1, 1, 0]]], axis=-1)
    panel.add_collection(LineCollection(list(boxes), color="0.75", linewidth=0.3))
    dots = panel.scatter(
        *medial.points.T, c=medial.radii, s=6, cmap="viridis", vmin=0.0, vmax=0.7, zorder=3
    )
    panel.figure.colorbar(
        dots, ax=panel, label="distance from the boundary", shrink=0.7, orientation="horizontal"
    )
    draw_boundary(panel, boundary)
    panel.set_axis_on()
    panel.set(xlabel="x", ylabel="y")


if __name__ == "__main__":
    run(main)
