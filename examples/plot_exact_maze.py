"""Exact limiting in a maze.

Each colour is the region that one bound controls; distances lead around the walls.

Six bounds are given in a maze, with g = 0.2.  Two of them are undercut: another bound allows less
there.  The other four survive.  The bound of 0.8 survives only because a wall hides it.  Along a
straight line, the bound of 0.05 would allow 0.73 there.

A shortest path bends at reflex corners of the walls only.  A corner serves the points in its wedge,
between the direction in which the path arrives and the wall behind which it turns.  The size at a
point is the least that is allowed by the survivors and corners that the point sees.  One line of
sight per point is enough, however many bends the path has.  The dotted purple lines lead from one
point to the survivors that it does not see.

The colours show which survivor controls which part.  The white lines are lines of equal size.

```python
import numpy as np

import adaptsize as ads

mesh = ads.read("data/slit.vtu")
h0 = np.full(mesh.n_points, np.inf)
h0[np.argmin(np.linalg.norm(mesh.points - [1.0, 2.0], axis=1))] = 0.05
h, info = ads.limit_gradient.with_info(mesh, h0, 0.2)
before = info.sources.nodes[:, 0]  # the last node on the shortest path to each node
path = [np.argmin(np.linalg.norm(mesh.points - [3.0, 2.0], axis=1))]
while before[path[-1]] != path[-1]:
    path.append(before[path[-1]])
print(mesh.points[path])  # around the lower end of the slit
```

    python examples/plot_exact_maze.py [DIRECTORY]
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from _gallery import drawing, node_at, run, save_drawing

import adaptsize as ads

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = npt.NDArray[np.float64]
G = 0.2
EXTENT = (12.0, 7.0)
# Lower left and upper right corner of each block of wall.
WALLS = np.array([
    [2.0, 0.0, 2.2, 4.6],
    [2.2, 4.4, 4.4, 4.6],
    [4.2, 1.6, 4.4, 4.4],
    [6.2, 0.0, 6.4, 3.0],
    [6.2, 4.4, 6.4, 7.0],
    [6.4, 4.4, 8.4, 4.6],
    [8.4, 1.6, 8.6, 4.6],
    [8.6, 1.6, 10.4, 1.8],
    [10.2, 3.4, 12.0, 3.6],
])  # fmt: skip
BOUNDS = {
    (1.0, 1.0): 0.05, (1.4, 2.6): 0.6, (3.2, 3.6): 0.8, (3.0, 5.6): 1.6, (9.4, 3.0): 0.1,
    (11.0, 5.8): 0.3,
}  # fmt: skip
COLOURS = ("#a6cee3", "#fdd49e", "#b2df8a", "#f4b6c2")
WEDGE = 0.8  # radius of the wedges in the picture
PLACES = ((5.6, 6.4), (7.4, 6.2), (7.2, 3.6), (11.4, 0.8), (9.2, 6.4), (5.4, 0.5))
YELLOW, DARK = "#ffef8a", "#542788"


def main(output_dir: Path, *, spacing: float = 0.05, width: int = 1440) -> dict[str, float]:
    mesh = maze(spacing)
    h0 = np.full(mesh.n_points, np.inf)
    for place, size in BOUNDS.items():
        h0[node_at(mesh, place)] = size
    h, info = ads.limit_gradient.with_info(mesh, h0, G)
    before = info.sources.nodes[:, 0]  # the last node on the shortest path to each node
    corners = np.setdiff1d(before, np.flatnonzero(h == h0))
    paths = [path_to(node_at(mesh, place), before) for place in PLACES]

    figure, (panel,) = drawing(1, 1, width, shape=0.68)
    draw_regions(panel, mesh, h, info.sources.roots())
    for corner in corners:
        draw_wedge(panel, mesh, corner, before[corner])
    draw_hidden(panel, PLACES[-1], mesh.points[h == h0])
    for path in paths:
        panel.plot(*mesh.points[path].T, color="black", linewidth=0.9)
        panel.plot(*mesh.points[path[0]], "o", color="black", markersize=2.2)
    draw_bounds(panel, mesh.points, h0, h)
    add_legend(panel)
    save_drawing(output_dir / "exact_maze.png", figure, panel)
    ends = [path[0] for path in paths]
    steps = [np.linalg.norm(np.diff(mesh.points[path], axis=0), axis=1) for path in paths]
    along = [h0[path[-1]] + G * lengths.sum() for path, lengths in zip(paths, steps, strict=True)]
    return {
        "bounds": len(BOUNDS),
        "survivors": int(np.count_nonzero(h == h0)),
        "corners that serve": len(corners),
        "most bends of a path": max(len(path) for path in paths) - 2,
        "share of nodes proved exact": info.n_proved / mesh.n_points,
        "largest difference of sizes and paths": float(np.abs(h[ends] - along).max()),
    }


def path_to(node: int, before: npt.NDArray[np.int32]) -> list[int]:
    """Return the nodes of the shortest path from a node back to its survivor."""
    path = [node]
    while before[path[-1]] != path[-1]:
        path.append(int(before[path[-1]]))
    return path


def draw_regions(
    panel: Axes, mesh: ads.SimplexMesh, h: FloatArray, roots: npt.NDArray[np.int32]
) -> None:
    """Colour the cells by the survivor that controls them, and draw lines of equal size."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Rectangle

    survivors = np.unique(roots)
    cause = np.searchsorted(survivors, roots)[mesh.cells]
    panel.tripcolor(
        *mesh.points.T, mesh.cells, np.median(cause, axis=1), cmap=ListedColormap(COLOURS),
        vmin=0, vmax=len(COLOURS) - 1, rasterized=True,
    )  # fmt: skip
    levels = np.arange(0.2, h.max(), 0.2)
    panel.tricontour(*mesh.points.T, mesh.cells, h, levels, colors="white", linewidths=0.6)
    for x0, y0, x1, y1 in WALLS:
        panel.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, color="0.35"))
    panel.set(xlim=(0.0, EXTENT[0]), ylim=(0.0, EXTENT[1]), aspect="equal", xticks=[], yticks=[])


def draw_wedge(panel: Axes, mesh: ads.SimplexMesh, corner: int, before: int) -> None:
    """Draw the wedge of a corner: from straight ahead to the wall behind which the path turns."""
    from matplotlib.patches import Polygon

    facets = mesh.boundary().nodes[mesh.boundary().mesh.cells]
    beside = facets[(facets == corner).any(axis=1)].sum(axis=1) - corner
    walls = np.arctan2(*(mesh.points[beside] - mesh.points[corner]).T[::-1])
    ahead = np.arctan2(*(mesh.points[corner] - mesh.points[before])[::-1])
    turns = np.angle(np.exp(1j * (walls - ahead)))  # between -pi and pi
    turn = turns[np.argmin(np.abs(turns))]
    angle = ahead + np.linspace(0.0, turn, 60)
    arc = mesh.points[corner] + WEDGE * np.column_stack([np.cos(angle), np.sin(angle)])
    fan = np.vstack([mesh.points[corner], arc])
    panel.add_patch(Polygon(fan, facecolor=YELLOW, edgecolor=DARK, linewidth=0.6))


def draw_hidden(panel: Axes, place: tuple[float, float], others: FloatArray) -> None:
    """Draw lines of sight from a place that end at a wall before they reach a source."""
    for other in others:
        shares = [hit(np.array(place), other, wall) for wall in WALLS]
        if min(shares) < 1.0:
            end = place + min(shares) * (other - place)
            panel.plot(*np.transpose([place, end]), color=DARK, linestyle=":", linewidth=0.8)
            panel.plot(*end, "x", color=DARK, markersize=3.5, markeredgewidth=0.9)


def hit(a: FloatArray, b: FloatArray, wall: FloatArray) -> float:
    """Return at which share of the line ab it enters a wall, inf if it does not."""
    with np.errstate(divide="ignore"):
        shares = (wall.reshape(2, 2) - a) / (b - a)
    first, last = shares.min(axis=0).max(), shares.max(axis=0).min()
    return float(first) if max(first, 0.0) < last - 1e-6 else np.inf


def draw_bounds(panel: Axes, points: FloatArray, h0: FloatArray, h: FloatArray) -> None:
    """Draw the nodes with bounds: full circles where these are kept."""
    for node in np.flatnonzero(np.isfinite(h0)):
        kept = h[node] == h0[node]
        panel.plot(
            *points[node], "o", markersize=5, markeredgecolor="black", markeredgewidth=0.8,
            color="#1f3b73" if kept else "white",
        )  # fmt: skip
        panel.annotate(
            f"{h0[node]:g}", points[node], (-4, -7), textcoords="offset points", fontsize=6.5,
            ha="right", fontweight="bold" if kept else "normal",
        )  # fmt: skip


def add_legend(panel: Axes) -> None:
    """Say what is what, below the picture."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    circle = {"marker": "o", "linestyle": "", "markeredgecolor": "black"}
    handles = [
        Line2D([], [], color="#1f3b73", label="survivor, with its bound", **circle),
        Line2D([], [], color="white", label="bound that another undercuts", **circle),
        Patch(facecolor=YELLOW, edgecolor=DARK, label="corner that serves its wedge"),
        Line2D([], [], color="black", linewidth=0.9, marker=".", label="shortest path to a point"),
        Line2D(
            [], [], color=DARK, linestyle=":", marker="x", markersize=4, label="survivor not seen"
        ),
        Patch(color="0.35", label="wall"),
    ]
    panel.figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=6.2)


def maze(spacing: float) -> ads.SimplexMesh:
    """Return triangles of the passages: halved squares, with nodes off the walls moved."""
    nx, ny = (round(length / spacing) for length in EXTENT)
    x, y = np.meshgrid(spacing * np.arange(nx + 1), spacing * np.arange(ny + 1), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])
    node = np.arange(len(points)).reshape(x.shape)
    a, b, c, d = (n.ravel() for n in (node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]))
    centres = (points[a] + 0.5 * spacing)[:, None]
    is_in = np.all((centres > WALLS[:, :2]) & (centres < WALLS[:, 2:]), axis=2)
    free = ~np.any(is_in, axis=1)
    cells = np.concatenate([np.column_stack([a, b, c])[free], np.column_stack([a, c, d])[free]])
    used, local = np.unique(cells, return_inverse=True)
    points, cells = points[used], local.reshape(-1, 3)
    inner = np.setdiff1d(np.arange(len(points)), ads.SimplexMesh(points, cells).boundary().nodes)
    rng = np.random.default_rng(20261201)
    points[inner] += spacing * rng.uniform(-0.2, 0.2, (len(inner), 2))
    return ads.SimplexMesh(points, cells)


if __name__ == "__main__":
    run(main)
