"""Which source controls the size.

Colours show the controlling source, lines the size. Between the nodes, interpolation adds little
(b).

A plate with three arcs (data/curved.vtu) and a point with a prescribed size.
The exact method returns the source of the size at every node.  Left: the parts controlled by
the arcs and by the point, with contours of the size.  Right: the interpolation error of the
sizes along the broken line.  Around the point, where the true size is a cone, it is up to
7 %.  Evaluated from the sources, the size is exact at every point.

```python
import adaptsize as ads

mesh = ads.read("data/curved.vtu")
h0 = ads.size_from_curvature(mesh, elements_per_radian=4)
h, info = ads.limit_gradient.with_info(mesh, h0, 0.3)
roots = info.sources.roots()  # for each node the node whose bound controls it
exact = ads.SizeFunction(mesh, h, sources=info.sources)  # not interpolated
print(exact([[5.5, 2.5]]), ads.SizeFunction(mesh, h)([[5.5, 2.5]]))
```

    python examples/plot_sources.py [DIRECTORY]
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from _gallery import DATA, INK, drawing, node_at, run, save_drawing

import adaptsize as ads

if TYPE_CHECKING:
    from matplotlib.axes import Axes

G = 0.3
PLACE, SIZE = (5.5, 2.5), 0.05
CAUSES = ("arc of radius 1.5", "arc of radius 0.5", "arc of radius 4", f"h = {SIZE} at one node")
COLOURS = ("#88ccee", "#ddcc77", "#99cc99", "#c994c7")


def main(output_dir: Path, *, width: int = 640) -> dict[str, float]:
    mesh = ads.read(DATA / "curved.vtu")
    node = node_at(mesh, PLACE)
    h0 = ads.size_from_curvature(mesh, elements_per_radian=4)
    h0[node] = SIZE
    h, info = ads.limit_gradient.with_info(mesh, h0, G)
    roots = info.sources.roots()
    causes = causes_of(mesh)
    interpolated = ads.SizeFunction(mesh, h)
    exact = ads.SizeFunction(mesh, h, sources=info.sources)

    place = mesh.points[node]
    line = np.full((2000, 2), place)
    line[:, 1] = np.linspace(0.05, 5.9, len(line))
    away = np.linalg.norm(line - place, axis=1)
    near = away < 0.5
    cone = SIZE + G * away[near]

    figure, panels = drawing(2, 1, width, shape=0.85)
    draw_regions(panels[0], mesh, (h0, h), roots, causes)
    panels[0].plot(*line.T, "k--", linewidth=1)
    draw_difference(panels[1], line[:, 1], interpolated(line) - exact(line), place[1])
    save_drawing(output_dir / "sources.png", figure, panels[0])
    shares = {f"share of nodes, {CAUSES[i]}": (causes[roots] == i).mean() for i in range(4)}
    return {
        **{name: float(share) for name, share in shares.items()},
        "largest error at the place, interpolated": float((interpolated(line)[near] - cone).max()),
        "largest error at the place, exact": float(np.abs(exact(line)[near] - cone).max()),
    }


def causes_of(mesh: ads.SimplexMesh) -> npt.NDArray[np.intp]:
    """Return for each node with a bound of its own the number of its cause."""
    causes = np.full(mesh.n_points, len(CAUSES) - 1)
    for tag in (1, 2, 3):  # of the arcs
        causes[mesh.tagged_facets[mesh.facet_tags == tag]] = tag - 1
    return causes


def draw_regions(
    panel: Axes,
    mesh: ads.SimplexMesh,
    sizes: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]],
    roots: npt.NDArray[np.int32],
    causes: npt.NDArray[np.intp],
) -> None:
    """Colour points by the cause of the least size that the nodes around them know of."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    h0, h = sizes
    x, y = np.meshgrid(np.linspace(0.0, 10.0, 501), np.linspace(0.0, 6.0, 301))
    pixels = np.column_stack([x.ravel(), y.ravel()])
    around, weights, distances = mesh.locator.weights(pixels)
    source = roots[around]
    length = np.linalg.norm(mesh.points[source] - pixels[:, None], axis=2)
    best = np.where(weights > 0.0, h0[source] + G * length, np.inf).argmin(axis=1)
    cause = causes[np.take_along_axis(source, best[:, None], axis=1)].reshape(x.shape)
    shown = np.ma.masked_where(distances.reshape(x.shape) > 0.0, cause)
    panel.pcolormesh(x, y, shown, cmap=ListedColormap(COLOURS), vmin=0, vmax=3, rasterized=True)
    levels = np.arange(0.1, 2.0, 0.1)
    lines = panel.tricontour(*mesh.points.T, mesh.cells, h, levels, colors="0.25", linewidths=0.6)
    panel.clabel(lines, lines.levels[1::2], fontsize=7)
    patches = [Patch(color=c, label=name) for c, name in zip(COLOURS, CAUSES, strict=True)]
    panel.figure.legend(
        handles=patches, title="size comes from", loc="outside lower center", ncols=4
    )
    panel.set(xlabel="x", ylabel="y", aspect="equal", title="what controls the size")


def draw_difference(
    panel: Axes,
    y: npt.NDArray[np.float64],
    difference: npt.NDArray[np.float64],
    place: float,
) -> None:
    """Draw what interpolation adds along the line."""
    panel.axhline(0.0, color="0.7", linewidth=0.8)
    panel.axvline(place, color=COLOURS[-1], linewidth=0.8, label="the node with h = 0.05")
    panel.plot(y, difference, color=INK, linewidth=1)
    panel.legend(fontsize="small")
    title = "interpolated size less size from the sources"
    panel.set(xlabel="y along the dashed line of (a)", title=title)


if __name__ == "__main__":
    run(main)
