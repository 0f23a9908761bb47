"""Width and separation.

Rays to the opposite wall measure the width (a); circles, the distance to the nearest feature (b).
Narrow places (dark) get small sizes (c, d).

The section of a part: a foot with a round hole, a fin, a wall that tapers, a step, a slot, and two
windows that nearly touch.  Left: rays from the boundary along the inward normal to the opposite
wall, coloured by their length, the width W.  Rays without an opposite wall that counts, as beside
a corner, are not drawn.  Right: from each corner, a segment to the nearest corner or side that it
does not meet, and the circle around the corner with this radius, the separation F.  F detects what
no normal passes through: the gap between the corners of the two windows, the step, the end of the
slot, the chamfer.  It does not detect the web below the hole, which has no corners.  Below: the
sizes that W and F allow, limited with g = 0.25.  The complete size function takes both.

```python
import numpy as np

import adaptsize as ads

corners = np.array(
    [(0, 0), (10, 0), (10, 1.2), (9, 1.2), (9, 1.0), (2, 1.0), (1, 5), (0, 5)], dtype=float
)
nodes = np.arange(len(corners))
boundary = ads.SimplexMesh(corners, np.column_stack([nodes, np.roll(nodes, -1)]))
print(ads.geometry.boundary_width(boundary).round(2))
print(ads.geometry.boundary_separation(boundary).distances.round(2))
size = ads.size_function(boundary, elements_across=2, elements_between=1)
ads.plot.plot_size(size, path="width.png")
```

    python examples/plot_width.py [DIRECTORY]
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from _gallery import INK, drawing, run, save_drawing

import adaptsize as ads
from adaptsize.geometry import boundary_separation, boundary_width

if TYPE_CHECKING:
    from matplotlib.axes import Axes

G = 0.25
ACROSS = 2.0
HMAX = 1.0
OUTLINE = [
    (0, 0), (4.3, 0), (4.3, 0.8), (4.45, 0.8), (4.45, 0), (10, 0), (10, 1.5), (8.9, 1.5),
    (8.9, 1.35), (6.9, 1.35), (6.9, 3.4), (6.6, 3.4), (6.6, 1.35), (5.2, 1.35), (5.2, 3.2),
    (2.1, 3.2), (1.1, 5.0), (0.12, 5.0), (0, 4.88),
]  # fmt: skip
WINDOWS = [(2.3, 1.25), (3.28, 2.23)]
HALF_WINDOW = 0.41
HOLE = ((8.2, 0.6), 0.35)
Array = npt.NDArray[np.float64]


def part(n_hole: int = 90) -> ads.SimplexMesh:
    """Return the boundary, with nodes at the corners and on the hole; the part is on the left."""
    angle = -2.0 * np.pi * np.arange(n_hole) / n_hole
    square = HALF_WINDOW * np.array([(-1, -1), (-1, 1), (1, 1), (1, -1)])
    hole = np.array(HOLE[0]) + HOLE[1] * np.column_stack([np.cos(angle), np.sin(angle)])
    loops = [np.array(OUTLINE), *(centre + square for centre in np.array(WINDOWS)), hole]
    cells, first = [], 0
    for loop in loops:
        nodes = np.arange(len(loop))
        cells.append(first + np.column_stack([nodes, np.roll(nodes, -1)]))
        first += len(loop)
    return ads.SimplexMesh(np.concatenate(loops), np.concatenate(cells))


def main(output_dir: Path, *, step: float = 0.15, width: int = 640) -> dict[str, float]:
    """Draw W, F and the sizes from them; ``step`` is the distance of the rays."""
    from matplotlib.colors import LogNorm

    boundary = part()
    rays, widths = rays_of(divided(boundary, step))
    separation = boundary_separation(boundary)
    links = links_of(boundary, separation)
    options: dict[str, Any] = {
        "elements_per_radian": 0, "tolerance": np.inf, "hmin": 0.01, "hmax": HMAX, "g": G,
    }  # fmt: skip
    by_width = ads.size_function(boundary, elements_across=ACROSS, elements_between=0, **options)
    by_separation = ads.size_function(boundary, elements_across=0, elements_between=1, **options)

    figure, panels = drawing(2, 2, width, shape=0.56)
    draw_boundary(panels[0], boundary)
    draw_boundary(panels[1], boundary)
    lengths = LogNorm(0.12, 5.0)
    thin = 0.8 / np.sqrt(np.sort(widths)[::-1])  # as drawn: long ones first
    drawn = draw_lines(panels[0], rays, widths, norm=lengths, linewidth=thin, zorder=1)
    draw_lines(panels[1], links, separation.distances, norm=lengths, linewidth=2.0, zorder=3)
    draw_circles(panels[1], boundary, separation, lengths)
    panels[1].plot(*separation.points.T, "o", color=INK, markersize=2.8, zorder=4)
    bar = figure.colorbar(drawn, ax=panels[:2], label="W, F", pad=0.01, aspect=15)
    bar.set_ticks([0.2, 0.5, 1, 2, 5], labels=["0.2", "0.5", "1", "2", "5"])
    bar.minorticks_off()
    for panel, size in ((panels[2], by_width), (panels[3], by_separation)):
        colours = draw_size(panel, boundary, size)
        draw_boundary(panel, boundary)
    bar = figure.colorbar(colours, ax=panels[2:], label="mesh size h", pad=0.01, aspect=15)
    bar.set_ticks([0.1, 0.2, 0.5, 1], labels=["0.1", "0.2", "0.5", "1"])
    bar.minorticks_off()
    panels[0].set_title("width W: rays to the opposite wall")
    panels[1].set_title("separation F: nearest feature of each corner")
    panels[2].set_title(f"size from the width, W / {ACROSS:g}")
    panels[3].set_title("size from the separation, F / 1")
    save_drawing(output_dir / "width.png", figure, panels[2])

    corner = np.array(WINDOWS) + HALF_WINDOW * np.array([(1, 1), (-1, -1)])
    gap = float(np.linalg.norm(corner[1] - corner[0]))
    nearest = np.argmin(np.linalg.norm(separation.points - corner[0], axis=1))
    middle = corner.mean(axis=0)[None]
    fin = np.column_stack([np.full(20, 6.75), np.linspace(1.8, 3.1, 20)])
    return {
        "rays drawn": len(rays),
        "smallest width": float(widths.min()),
        "corners": len(separation.points),
        "smallest separation": float(separation.distances.min()),
        "gap of the windows": gap,
        "separation there": float(separation.distances[nearest]),
        "size from the width there": float(by_width(middle)[0]),
        "size from the separation there": float(by_separation(middle)[0]),
        "elements across the fin": float((0.3 / by_width(fin)).min()),
    }


def divided(boundary: ads.SimplexMesh, step: float) -> ads.SimplexMesh:
    """Return the same boundary with segments of at most ``step``."""
    points, cells, n_points = [boundary.points], [], boundary.n_points
    for a, b in boundary.cells:
        start, end = boundary.points[[a, b]]
        n = max(1, int(np.ceil(np.linalg.norm(end - start) / step)))
        t = np.arange(1, n)[:, None] / n
        points.append((1.0 - t) * start + t * end)
        nodes = np.concatenate([[a], n_points + np.arange(n - 1), [b]])
        cells.append(np.column_stack([nodes[:-1], nodes[1:]]))
        n_points += n - 1
    return ads.SimplexMesh(np.concatenate(points), np.concatenate(cells))


def rays_of(boundary: ads.SimplexMesh) -> tuple[Array, Array]:
    """Return the rays from the middles of the segments whose wall counts, and their lengths."""
    widths = boundary_width(boundary)
    ends = boundary.points[boundary.cells]
    along = ends[:, 1] - ends[:, 0]
    inward = np.column_stack([-along[:, 1], along[:, 0]])
    inward /= np.linalg.norm(inward, axis=1)[:, None]
    counted = np.isfinite(widths)
    start = ends.mean(axis=1)[counted]
    stop = start + widths[counted, None] * inward[counted]
    return np.stack([start, stop], axis=1), widths[counted]


def links_of(boundary: ads.SimplexMesh, separation: Any) -> Array:
    """Return a segment from each corner to a point of the boundary as far away as the feature."""
    a, b = boundary.points[boundary.cells].transpose(1, 0, 2)
    links = []
    for place, distance in zip(separation.points, separation.distances, strict=True):
        along = b - a
        t = np.einsum("ij,ij->i", place - a, along) / np.einsum("ij,ij->i", along, along)
        closest = a + np.clip(t, 0.0, 1.0)[:, None] * along
        off = np.abs(np.linalg.norm(closest - place, axis=1) - distance)
        links.append((place, closest[np.argmin(off)]))
    return np.array(links)


def draw_lines(panel: Axes, lines: Array, values: Array, **style: Any) -> Any:
    """Draw lines by their values, long ones first."""
    from matplotlib.collections import LineCollection

    order = np.argsort(-values)
    drawn = LineCollection(list(lines[order]), **style)
    drawn.set_array(values[order])
    panel.add_collection(drawn)
    return drawn


def draw_circles(panel: Axes, boundary: ads.SimplexMesh, found: Any, norm: Any) -> None:
    """Draw circles of the radius F around the corners, as far as they are in the part."""
    from matplotlib import colormaps
    from matplotlib.patches import Circle, PathPatch
    from matplotlib.path import Path as Outline

    loops = np.split(boundary.points, np.flatnonzero(np.diff(boundary.cells, axis=1) < 0) + 1)
    outlines = [Outline(np.append(loop, loop[:1], axis=0), closed=True) for loop in loops[:-1]]
    inside = PathPatch(
        Outline.make_compound_path(*outlines), facecolor="none", edgecolor="none",
        transform=panel.transData,
    )  # fmt: skip
    panel.add_patch(inside)
    for place, radius in zip(found.points, found.distances, strict=True):
        colour = colormaps["adaptsize"](norm(radius))
        circle = Circle(place, radius, facecolor=(*colour[:3], 0.08), edgecolor=colour)
        circle.set_linewidth(0.8)
        panel.add_patch(circle)
        circle.set_clip_path(inside)


def draw_size(panel: Axes, boundary: ads.SimplexMesh, size: ads.SizeFunction) -> Any:
    """Draw the sizes at the nodes of a grid, cut off at the boundary."""
    from matplotlib.colors import LogNorm

    grid = size.background
    assert isinstance(grid, ads.CartesianGrid)
    inside = ads.signed_distance(grid, boundary) <= 0.0
    x, y = grid.points.reshape(*grid.shape, 2).transpose(2, 0, 1)
    sizes = np.ma.array(size.values, mask=~inside)
    return panel.pcolormesh(x, y, sizes, shading="nearest", norm=LogNorm(0.1, 1.0))


def draw_boundary(panel: Axes, boundary: ads.SimplexMesh) -> None:
    """Draw the outline, the windows and the hole."""
    from matplotlib.collections import LineCollection

    lines = boundary.points[boundary.cells]
    panel.add_collection(LineCollection(list(lines), color=INK, linewidth=0.9))
    panel.set(xlim=(-0.2, 10.2), ylim=(-0.2, 5.2), aspect="equal")
    panel.set_axis_off()


if __name__ == "__main__":
    run(main)
