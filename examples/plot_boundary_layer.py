"""Boundary layer of an airfoil.

Triangles at the wall are flat (b, a window 200 times smaller than a). Their heights follow the
request, the line, over four decades (c).

Around a NACA 0012 airfoil (chord 1, closed trailing edge), `metric_from_layers` requests
triangles that are 1e-4 high at the wall, with heights that grow by 1.2 from layer to layer.  Their
length along the wall is limited by its curvature: with the radius r, an edge of length l leaves the
wall by l^2 / 8 r.  The lengths are at most sqrt(first height r), which keeps this below an eighth
of the first height.  From the leading and the trailing edge they grow with the slope 0.2.

Mmg gets the metric as a function of points, so it is exact wherever there are nodes.  Heights
are measured as the size along the normal of the metric that is implied by each triangle.

The picture shows the mesh around the airfoil and in a window on its upper side, and the heights of
triangles over their distance d from the wall.

| first height | 1e-4 | 1e-5 |
|---|---:|---:|
| triangles | 12 384 | 34 739 |
| height on the wall over the requested: 5 %, median, 95 % | 0.65, 1.03, 1.29 | 0.56, 1.20, 1.67 |
| growth of the heights by a linear fit | 1.205 | 1.208 |
| height at the wall by this fit | 0.87e-4 | 1.22e-5 |
| largest aspect ratio requested | 268 | 847 |

Needs Mmg.  Takes a few seconds.

```python
import numpy as np

import adaptsize as ads


def ring(x):  # around a cylinder of radius 0.2, negative inside
    r = np.linalg.norm(x, axis=1)
    return np.maximum(0.2 - r, r - 1.0)


def metric(x):
    r = np.linalg.norm(x, axis=1)
    return ads.metric_from_layers(
        r - 0.2, x / r[:, None], first_height=0.002, growth=1.2, tangential=0.05
    )


mesh = ads.mesh_from_distance(ring, lambda x: np.full(len(x), 0.05), [-1, -1], [1, 1])
new = ads.remesh(mesh, metric)
ads.plot.plot_mesh(new, path="boundary_layer.png")
```

    python examples/plot_boundary_layer.py [DIRECTORY]
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from _gallery import FIELDS, INK, draw_mesh, drawing, run, save_drawing

import adaptsize as ads
from adaptsize.errors import BoundaryWarning
from adaptsize.metrics import metric_from_layers

FloatArray = npt.NDArray[np.float64]

FIRST, GROWTH = 1e-4, 1.2
#: Half the side of the square domain, and the largest size.
FAR, HMAX = 6.0, 1.0
MIDDLE = np.array([0.5, 0.0])
#: Where heights are measured: away from both ends of the airfoil, up to this distance.
ALONG, AWAY = (0.1, 0.95), 0.2


class Wall(NamedTuple):
    """The airfoil as a fine polyline."""

    line: ads.SimplexMesh
    lengths: FloatArray
    """Requested length of edges along the wall at its nodes."""

    def foot(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the distance from the wall, its gradient, and the length along the wall."""
        cells, weights, distance = self.line.locator.nearest(points)
        ends = self.line.points[self.line.cells[cells]]
        along = ends[:, 1] - ends[:, 0]
        normals = np.column_stack([along[:, 1], -along[:, 0]])
        off = points - np.einsum("nk,nkd->nd", weights, ends)
        normals = np.where((distance > 1e-8)[:, None], off, normals)
        return distance, normals, (weights * self.lengths[self.line.cells[cells]]).sum(axis=1)


def main(output_dir: Path, *, first: float = FIRST, width: int = 520) -> dict[str, float | str]:
    """Make the mesh, measure the layers, draw both."""
    wall = airfoil(20001, first)

    def metric(points: FloatArray) -> ads.Metric:
        distance, normals, length = wall.foot(points)
        slope = GROWTH - 1.0
        length = np.minimum(np.maximum(length, first) + slope * distance, HMAX)
        return metric_from_layers(
            distance, normals, first_height=first, growth=GROWTH, tangential=length
        )

    with warnings.catch_warnings():
        # Mmg does not keep so small a tolerance; `summary` measures how far nodes are off the wall.
        warnings.simplefilter("ignore", BoundaryWarning)
        mesh = ads.remesh(first_mesh(), metric, tolerance=1e-3 * first)
    draw(output_dir / "boundary_layer.png", mesh, wall, first, width)
    return summary(mesh, wall, metric(mesh.points), first)


def naca(n: int) -> FloatArray:
    """Return points of the airfoil in order, from the trailing edge over the upper side."""
    x = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, n)))
    thickness = 0.2969 * np.sqrt(x) - x * (0.126 + x * (0.3516 - x * (0.2843 - 0.1036 * x)))
    upper = np.column_stack([x, 0.6 * thickness])
    upper[[0, -1], 1] = 0.0
    return np.concatenate([upper[::-1], upper[1:-1] * [1.0, -1.0]])


def airfoil(n: int, first: float) -> Wall:
    """Return the wall, with lengths by its curvature that grow from its sharp end."""
    points = naca(n)
    before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
    step, bend = 0.5 * (after - before), after - 2.0 * points + before
    curvature = np.abs(step[:, 0] * bend[:, 1] - step[:, 1] * bend[:, 0])
    curvature /= np.linalg.norm(step, axis=1) ** 3
    curvature[0] = 1.0 / first  # the trailing edge
    lengths = np.sqrt(first / np.maximum(curvature, 1e-3))
    nodes = np.arange(len(points))
    line = ads.SimplexMesh(points, np.column_stack([nodes, np.roll(nodes, -1)]))
    return Wall(line, ads.limit_gradient(line, lengths, GROWTH - 1.0))


def first_mesh(n: int = 400, n_rings: int = 14) -> ads.SimplexMesh:
    """Return triangles between the airfoil and a square, in rings."""
    inner = naca(n + 1)
    count = len(inner)
    angle = 2.0 * np.pi * np.arange(count) / count
    outer = np.column_stack([np.cos(angle), np.sin(angle)])
    outer *= FAR / np.abs(outer).max(axis=1, keepdims=True)  # all four corners are among these
    share = (np.geomspace(1.0, 200.0, n_rings + 1) - 1.0)[:, None, None] / 199.0
    points = (inner * (1.0 - share) + (outer + MIDDLE) * share).reshape(-1, 2)
    ring, along = (a.ravel() for a in np.indices((n_rings, count)))
    here, beside = ring * count + along, ring * count + (along + 1) % count
    above, diagonal = here + count, beside + count
    cells = [np.column_stack([here, above, beside]), np.column_stack([beside, above, diagonal])]
    return ads.SimplexMesh(points, np.concatenate(cells))


def heights(mesh: ads.SimplexMesh, wall: Wall) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return distance, height and aspect ratio of the triangles beside the middle of the wall."""
    middle = mesh.points[mesh.cells].mean(axis=1)
    distance, normals, _ = wall.foot(middle)
    beside = (middle[:, 0] > ALONG[0]) & (middle[:, 0] < ALONG[1]) & (distance < AWAY)
    implied = mesh.implied_metric()[beside]
    return distance[beside], implied.size_along(normals[beside]), implied.aspect_ratio


def first_heights(mesh: ads.SimplexMesh) -> FloatArray:
    """Return the heights of the triangles on the wall, away from its ends."""
    skin = mesh.boundary()
    ends = skin.mesh.points[skin.mesh.cells]
    middle = ends.mean(axis=1)
    chosen = (np.abs(middle[:, 1]) < 0.5) & (middle[:, 0] > ALONG[0]) & (middle[:, 0] < ALONG[1])
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return np.asarray(2.0 * mesh.measures[skin.cells[chosen]] / length[chosen])


def summary(
    mesh: ads.SimplexMesh, wall: Wall, metric: ads.Metric, first: float
) -> dict[str, float | str]:
    """Return the figures of the mesh."""
    distance, height, aspect = heights(mesh, wall)
    requested = first + (GROWTH - 1.0) * distance
    on_wall = first_heights(mesh) / first
    slope, start = np.polyfit(distance, height, 1, w=1.0 / requested)
    conformity = ads.size_conformity(mesh, metric)
    skin = mesh.points[mesh.boundary().nodes]
    near = np.abs(skin - MIDDLE).max(axis=1) < 1.0
    jumps = height_jumps(mesh, wall)
    return {
        "triangles": mesh.n_cells,
        "nodes on the wall": int(near.sum()),
        "first height over the requested, median": float(np.median(on_wall)),
        "first height over the requested, 5 %": float(np.quantile(on_wall, 0.05)),
        "first height over the requested, 95 %": float(np.quantile(on_wall, 0.95)),
        "growth of the heights": float(1.0 + slope),
        "height at the wall by the fit": float(start),
        "largest aspect ratio requested": float(metric.aspect_ratio.max()),
        "aspect ratio, 99 %": float(np.quantile(aspect, 0.99)),
        "share of edges in band": conformity.share_in_band,
        "jump of the height between neighbours, median": float(np.median(jumps)),
        "jump of the height between neighbours, 99 %": float(np.quantile(jumps, 0.99)),
        "wall nodes off the wall": float(wall.foot(skin[near])[0].max()),
    }


def height_jumps(mesh: ads.SimplexMesh, wall: Wall) -> FloatArray:
    """Return ratios of heights of triangles with a common edge, at least 1, around the wall."""
    middle = mesh.points[mesh.cells].mean(axis=1)
    distance, normals, _ = wall.foot(middle)
    height = mesh.implied_metric().size_along(normals)
    order = np.argsort(mesh.cell_facets.ravel(), kind="stable")
    facet = mesh.cell_facets.ravel()[order]
    twice = np.flatnonzero(facet[1:] == facet[:-1])
    one, other = order[twice] // 3, order[twice + 1] // 3
    near = (distance[one] < AWAY) & (distance[other] < AWAY)
    ratio = height[one[near]] / height[other[near]]
    return np.maximum(ratio, 1.0 / ratio)


def draw(path: Path, mesh: ads.SimplexMesh, wall: Wall, first: float, width: int) -> None:
    """Draw the mesh in two windows, and the heights."""
    figure, panels = drawing(3, 1, width, shape=0.85)
    upper = wall.line.points[: len(wall.lengths) // 2]
    place = upper[np.argmin(np.abs(upper[:, 0] - 0.3))]
    for panel, half in zip(panels[:2], (0.8, 0.004), strict=True):
        centre = MIDDLE if half == 0.8 else place + np.array([0.0, 0.7 * half])
        around = np.array([-half, half])
        panel.set(xlim=centre[0] + around, ylim=centre[1] + around, aspect="equal")
        draw_mesh(panel, mesh)
        panel.set_title(f"window of {2 * half:g}", fontsize="medium")
        panel.tick_params(labelsize="small")
        panel.locator_params(nbins=4)
    distance, height, aspect = heights(mesh, wall)
    plot = panels[2]
    colours = plot.scatter(distance + first, height, c=aspect, s=3, cmap=FIELDS, norm="log")
    figure.colorbar(colours, ax=plot, label="aspect ratio")
    at = np.geomspace(first, AWAY, 200)
    plot.loglog(at, first + (GROWTH - 1.0) * (at - first), color=INK, linewidth=1.0,
                label=f"{first:g} + {GROWTH - 1.0:.1f} d")  # fmt: skip
    plot.set(xlabel="d, plus the first height", title="height of triangles")
    plot.legend()
    save_drawing(path, figure, panels[0])


if __name__ == "__main__":
    run(main)
