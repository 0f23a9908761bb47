"""Gradient limiting of metrics.

Two stretched ellipses are requested (a). Limited metrics (b) turn gradually into circles away
from them.

A metric is drawn as its ellipse: an edge from the centre to the outline has the requested length.
Two points request flat ellipses in different directions.  `limit_metric` lets all of
their sizes grow by g = 0.25 per length, so that the ellipses become larger and rounder with the
distance, and intersects them where both are active.

```python
import numpy as np

import adaptsize as ads

mesh = ads.read("data/slit.vtu")
sizes = np.full((mesh.n_points, 2), np.inf)
directions = np.tile(np.eye(2), (mesh.n_points, 1, 1))
node = np.argmin(np.linalg.norm(mesh.points - [1.0, 1.5], axis=1))
sizes[node], directions[node] = (0.02, 0.5), [[0.6, 0.8], [-0.8, 0.6]]  # small along (0.6, 0.8)
metric = ads.limit_metric(mesh, ads.Metric(sizes, directions), 0.25)
ads.plot.plot_metric(mesh, metric, path="metric_gradation.png")
```

    python examples/plot_metric_gradation.py [DIRECTORY]
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from _gallery import FIELDS, INK, drawing, jittered_rectangle, node_at, run, save_drawing

import adaptsize as ads
from adaptsize.metrics import Metric

if TYPE_CHECKING:
    from matplotlib.axes import Axes

G = 0.25
POINTS = ((0.6, 0.5), (2.4, 0.9))
ANGLES = (70.0, -20.0)
SIZES = ((0.02, 0.5), (0.03, 0.3))
#: Ellipses are drawn at this share of the requested lengths, so that they do not overlap.
SCALE = 0.3


def main(output_dir: Path, *, n_side: int = 121, width: int = 1040) -> dict[str, float]:
    mesh = jittered_rectangle((0.0, 0.0), (3.0, 1.4), n_side)
    bound = requested(mesh)
    limited, info = ads.limit_metric.with_info(mesh, bound, G)

    path = output_dir / "metric_gradation.png"
    draw(path, mesh, bound, limited, info.n_active, width)
    return {
        "smallest size": float(limited.sizes.min()),
        "largest aspect ratio": float(limited.aspect_ratio.max()),
        "nodes with both": int((info.n_active == 2).sum()),
        "elements": limited.predicted_elements(mesh),
    }


def requested(mesh: ads.SimplexMesh) -> Metric:
    """Return the metric of the two points; there is no bound elsewhere."""
    sizes = np.full((mesh.n_points, 2), np.inf)
    directions = np.tile(np.eye(2), (mesh.n_points, 1, 1))
    for place, angle, size in zip(POINTS, np.deg2rad(ANGLES), SIZES, strict=True):
        node = node_at(mesh, place)
        c, s = np.cos(angle), np.sin(angle)
        sizes[node], directions[node] = size, [[s, c], [-c, s]]  # the short size is across
    return Metric(sizes, directions)


def draw(
    path: Path,
    mesh: ads.SimplexMesh,
    bound: Metric,
    limited: Metric,
    active: npt.NDArray[np.int32],
    width: int,
) -> None:
    """Draw the requested ellipses, and the limited ones over the map of the aspect ratio."""
    from matplotlib.colors import LogNorm

    figure, (before, after) = drawing(1, 2, width, shape=0.5)
    before.set_title(f"requested at two points, drawn at {SCALE:g} of the size")
    some = np.array([node_at(mesh, place) for place in POINTS])
    ellipses(before, mesh.points[some], bound[some], 2.0)
    before.plot(*mesh.points[some].T, ".", color=INK, markersize=3)

    after.set_title(f"limited, g = {G:g}; dashed: both points to its left")
    filled = after.tripcolor(
        *mesh.points.T, mesh.cells, limited.aspect_ratio, shading="gouraud", cmap=FIELDS,
        norm=LogNorm(1.0, limited.aspect_ratio.max()),
    )  # fmt: skip
    figure.colorbar(filled, ax=after, label="aspect ratio", format="%g", ticks=[1, 2, 5, 10, 20])
    x, y = np.meshgrid(np.linspace(0.15, 2.85, 10), np.linspace(0.12, 1.28, 5))
    chosen = {node_at(mesh, place) for place in zip(x.ravel(), y.ravel(), strict=True)}
    grid = np.array(sorted(chosen))
    ellipses(after, mesh.points[grid], limited[grid], 0.8)
    ellipses(after, mesh.points[some], limited[some], 2.0)
    after.tricontour(
        *mesh.points.T, mesh.cells, (active == 2).astype(float), [0.5], colors="k",
        linestyles="--", linewidths=0.8,
    )  # fmt: skip
    for axes in (before, after):
        axes.set(aspect="equal", xlim=(0.0, 3.0), ylim=(0.0, 1.4), xlabel="x", ylabel="y")
    save_drawing(path, figure, after)


def ellipses(axes: Axes, centres: npt.NDArray[np.float64], metric: Metric, width: float) -> None:
    """Draw the ellipse of the metric of each point."""
    from matplotlib.patches import Ellipse

    for centre, size, directions in zip(centres, metric.sizes, metric.directions, strict=True):
        angle = np.rad2deg(np.arctan2(directions[1, 0], directions[0, 0]))
        axes.add_patch(
            Ellipse(centre, *(2.0 * SCALE * size), angle=angle, fill=False, color=INK, lw=width)
        )


if __name__ == "__main__":
    run(main)
