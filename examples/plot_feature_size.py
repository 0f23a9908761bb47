"""Local feature size from the boundary: the largest inscribed spheres.

The section of a part: a foot with a round hole, a fin, and a wall that tapers.  Left: circles
that touch the boundary and fit inside, at points along it, by their radius, which is half the
width there; their centres are points of the medial axis.  They are not driven to zero in
corners, where they may reach out of the part: the side beyond a corner does not bound them.
Middle: sizes for four elements across, 2 lfs / 4, limited, on a quadtree that is fine at the
boundary.  Right: across the fin and along the foot, with the feature size that the medial axis
of a grid gives.

```python
import numpy as np

import adaptsize as ads

corners = np.array([(0, 0), (10, 0), (10, 1.2), (2, 1.2), (1, 5), (0, 5)], dtype=float)
nodes = np.arange(len(corners))
boundary = ads.SimplexMesh(corners, np.column_stack([nodes, np.roll(nodes, -1)]))
near = ads.refine_at_boundary(lambda x: boundary.locator.nearest(x)[2], 0.1)
tree = ads.Octree.build([-0.5, -0.5], [10.5, 5.5], near, max_level=9)
h0 = ads.size_from_feature(tree, boundary, elements_across=4)
h = ads.limit_gradient(tree, h0, 0.25, method="fast-marching")
ads.plot.plot_size(tree, h, path="feature_size.png")
```

    python examples/plot_feature_size.py [DIRECTORY]
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from _gallery import drawing, run, save_drawing

import adaptsize as ads
from adaptsize.geometry import inscribed_spheres
from adaptsize.geometry.distance.api import signed_distance
from adaptsize.geometry.medial.feature_size import feature_size

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


def main(output_dir: Path, *, spacing: float = 0.04, width: int = 640) -> dict[str, float]:
    """Draw spheres, sizes and a comparison; ``spacing`` is that of the grid."""
    boundary = part()
    tree = ads.Octree.build(
        [-0.5, -0.5], [10.5, 5.5],
        ads.refine_at_boundary(lambda x: boundary.locator.nearest(x)[2], 2.0 * spacing),
        max_level=9,
    )  # fmt: skip
    h0 = ads.size_from_feature(tree, boundary, elements_across=ACROSS)
    h = ads.limit_gradient(tree, h0, G, method="fast-marching")
    size = ads.SizeFunction(tree, h)

    grid = ads.CartesianGrid.around(boundary.points, spacing, margin=0.2)
    by_axis = ads.SizeFunction(grid, feature_size(grid, signed_distance(grid, boundary)))
    x = np.linspace(0.02, 9.98, 400)
    foot = np.column_stack([x, np.full(400, 0.15)])
    by_spheres = inscribed_spheres(boundary, foot).smallest()

    figure, panels = drawing(3, 1, width, shape=0.7)
    n_drawn = draw_spheres(panels[0], boundary, 0.12)
    draw_sizes(panels[1], figure, tree, h, boundary)
    panels[2].plot(x, by_spheres, label="largest spheres")
    panels[2].plot(x, by_axis(foot), "--", label=f"medial axis, spacing {spacing:g}")
    panels[2].plot(x, 0.5 * ACROSS * size(foot), ":", label="limited size times 2")
    panels[2].set(xlabel="x", ylabel="feature size", ylim=(0, None))
    panels[2].legend(loc="upper right")
    panels[0].set_title("largest spheres, and their centres")
    panels[1].set_title(f"size for {ACROSS:g} elements across, g = {G}")
    panels[2].set_title("along the foot, y = 0.15")
    save_drawing(output_dir / "feature_size.png", figure)

    fin = np.column_stack([np.full(20, 6.25), np.linspace(1.6, 3.5, 20)])
    plain = (x > 2.5) & (x < 5.5)
    return {
        "spheres drawn": n_drawn,
        "smallest size": float(h.min()),
        "elements across the fin": float((0.3 / size(fin)).min()),
        "half the width of the foot, spheres": float(np.median(by_spheres[plain])),
        "half the width of the foot, medial axis": float(np.median(by_axis(foot)[plain])),
        "web above the hole": 2.0 * float(inscribed_spheres(boundary, [[8.4, 1.2]]).smallest()[0]),
    }


def draw_spheres(panel: Axes, boundary: ads.SimplexMesh, step: float) -> int:
    """Draw circles that touch the boundary every ``step``, and their centres."""
    from matplotlib.collections import EllipseCollection

    a, b = boundary.points[boundary.cells[:, 0]], boundary.points[boundary.cells[:, 1]]
    count = np.maximum(np.ceil(np.linalg.norm(b - a, axis=1) / step).astype(int), 1)
    segment = np.repeat(np.arange(len(a)), count)
    t = (np.arange(len(segment)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[
        segment
    ]
    points = (1 - t)[:, None] * a[segment] + t[:, None] * b[segment]
    spheres = inscribed_spheres(boundary, points)
    wide = 2.0 * spheres.radii
    circles = EllipseCollection(
        wide, wide, np.zeros(len(wide)), units="x", offsets=spheres.centres,
        offset_transform=panel.transData, facecolor="none", linewidth=0.3, cmap="viridis",
    )  # fmt: skip
    circles.set_array(spheres.radii)
    circles.set_facecolor("none")
    panel.add_collection(circles)
    panel.figure.colorbar(circles, ax=panel, label="radius", shrink=0.7, orientation="horizontal")
    panel.plot(*spheres.centres.T, ".", color="black", markersize=1.5)
    draw_boundary(panel, boundary)
    return len(wide)


def draw_sizes(
    panel: Axes, figure: object, tree: ads.Octree, h: npt.NDArray[np.float64],
    boundary: ads.SimplexMesh,
) -> None:  # fmt: skip
    """Draw the sizes inside."""
    from matplotlib.tri import Triangulation

    mesh = tree.mesh
    inside = signed_distance(tree, boundary)[mesh.cells].mean(axis=1) < 0.0
    triangles = Triangulation(*mesh.points.T, mesh.cells[inside])
    colours = panel.tripcolor(triangles, h, shading="gouraud", cmap="viridis")
    panel.figure.colorbar(
        colours, ax=panel, label="mesh size h", shrink=0.7, orientation="horizontal"
    )
    draw_boundary(panel, boundary)


def draw_boundary(panel: Axes, boundary: ads.SimplexMesh) -> None:
    """Draw the outline and the hole."""
    from matplotlib.collections import LineCollection

    lines = boundary.points[boundary.cells]
    panel.add_collection(LineCollection(list(lines), color="black", linewidth=0.8))
    panel.set(xlim=(-0.3, 10.3), ylim=(-0.3, 5.3), aspect="equal", xlabel="x", ylabel="y")


if __name__ == "__main__":
    run(main)
