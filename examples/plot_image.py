"""From a picture to triangles.

From the mask (a) to the distance (b), the sizes, small (dark) where objects are narrow or curved
(c), and the mesh, with one region per object (d).

After Figure 13 of Persson's paper.

A mask from the segmentation of a photo is smoothed.  The distance to its boundary gives the
curvature and the medial axis, and these give the sizes.  Distance and sizes give the mesh.

```python
import adaptsize as ads

image = ads.read_image("data/objects.png")
size = ads.size_function(image, elements_across=4)
mesh = ads.mesh_image(image, size=size)
print(size.report)
ads.plot.plot_size(mesh, label="mesh size h, pixels", path="image.png")
```
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from _gallery import CURVES, DATA, draw_mesh, drawing, run, save_drawing

import adaptsize as ads
from adaptsize.domain_size.of_image import ImageDomain
from adaptsize.options import checked
from adaptsize.options.sizes import ImageOptions
from adaptsize.quality import size_conformity

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def main(
    output_dir: Path, *, width: int = 560, every: int = 1, elements_across: float = 4.0
) -> dict[str, Any]:
    """Draw the four stages for data/objects.png; ``every`` takes each n-th pixel only."""
    picture = ads.read_image(DATA / "objects.png")
    image = ads.background.Image(picture.values[::every, ::every], spacing=float(every))
    domain = ImageDomain.of(image, checked(ImageOptions, {}))
    phi = domain.distance_to_outside()
    size = ads.size_function(image, elements_across=elements_across)
    report = size.report
    mesh = ads.mesh_image(image, elements_across=elements_across)

    figure, (top, right, left, last) = drawing(2, 2, width, shape=0.62)
    _draw_mask(top, image)
    _draw_distance(right, domain.mask.grid, phi)
    _draw_sizes(left, size, phi)
    _draw_mesh(last, mesh)
    for panel in (top, right, left, last):
        panel.set(xlim=(28, 472), ylim=(28, 330), aspect="equal", xticks=[], yticks=[])
    save_drawing(output_dir / "image.png", figure, left)

    pixels = every**2 * np.count_nonzero(image.values)
    kept = size_conformity(mesh, size)
    return {
        "objects": len(np.unique(mesh.cell_tags)),
        "triangles": mesh.n_cells,
        "area of the mesh over that of the pixels": float(mesh.measures.sum() / pixels),
        "smallest angle": float(mesh.minimum_angles().min()),
        "share of edges in band": kept.edges.share_in_band,
        **{f"share of {name}": share for name, share in report.domain_shares.items()},
    }


def _draw_mask(panel: Axes, image: ads.background.Image) -> None:
    step = image.spacing[0]
    far = step * (np.array(image.shape) - 0.5)
    extent = (-0.5 * step, far[0], -0.5 * step, far[1])
    panel.imshow(image.values.T, origin="lower", extent=extent, cmap="gray")
    panel.set_title("mask, one grey per object")


def _draw_distance(panel: Axes, grid: ads.CartesianGrid, phi: npt.NDArray[np.float64]) -> None:
    medial = ads.medial_axis(grid, phi)
    x, y = grid.axes
    filled = panel.contourf(x, y, phi.T, levels=np.arange(-40, 41, 5), cmap="RdBu_r", extend="both")
    panel.contour(x, y, phi.T, levels=[0.0], colors="black", linewidths=0.8)
    panel.plot(*medial.points.T, ".", color="black", markersize=0.8)
    panel.figure.colorbar(filled, ax=panel, shrink=0.7, label="pixels")
    panel.set_title("signed distance, edge and medial axis")


def _draw_sizes(panel: Axes, size: ads.SizeFunction, phi: npt.NDArray[np.float64]) -> None:
    from matplotlib.colors import LogNorm

    grid = size.background
    assert isinstance(grid, ads.CartesianGrid)
    inside = np.ma.masked_where(phi > 0.0, size.values)
    x, y = grid.axes
    drawn = panel.pcolormesh(x, y, inside.T, norm=LogNorm(), rasterized=True)
    ticks = [2, 4, 8, 16]
    bar = panel.figure.colorbar(drawn, ax=panel, shrink=0.7, ticks=ticks, format="%g")
    bar.minorticks_off()
    bar.set_label("pixels")
    panel.set_title("size h from curvature and width, limited")


def _draw_mesh(panel: Axes, mesh: ads.SimplexMesh) -> None:
    from matplotlib.colors import ListedColormap

    colours = ListedColormap(CURVES[: int(mesh.cell_tags.max())])
    draw_mesh(panel, mesh, mesh.cell_tags, cmap=colours, alpha=0.6)
    panel.set_title(f"mesh, {mesh.n_cells} triangles")


if __name__ == "__main__":
    run(main)
