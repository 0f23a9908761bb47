"""Sizes on the sphere.

Sizes grow with the distance along great circles (a): across the date line and around the poles.
On the flat map (b) they do not.

Three places need elements of 20 km: Hilo, Longyearbyen at 78 degrees north, and McMurdo at 78
degrees south.  From there the sizes grow by 0.2 per length, up to 800 km.  Nodes are at every
degree of longitude and latitude.

Above, `limit_on_sphere` measures distances along great circles.  Sizes continue across the 180th
meridian, and around a pole the lines of equal size widen on the map, since its upper and lower
edges are single points.  Below, `limit_gradient` takes the map for a plane in which a degree is
111 km everywhere.  It overestimates distances near the poles and across the meridian: the size is
right on the meridian of each place, and too large elsewhere, by a factor of up to 10.

| nodes of a global grid | places | processor time |
|---:|---:|---:|
| 1 038 961 | 12 | 0.4 s |
| 1 038 961 | 10 199 | 0.5 s |
| 1 038 961 | all | 2.2 s |

```python
import numpy as np

import adaptsize as ads

grid = ads.CartesianGrid((-180.0, -90.0), 1.0, (361, 181))  # longitude, latitude
h0 = np.full(grid.shape, 800.0)  # km
h0[180 + 16, 90 + 78] = 20.0  # Longyearbyen
h = ads.limit_on_sphere(grid, h0, 0.2, radius=6371.0)
ads.plot.plot_size(grid, h, label="mesh size h, km", path="great_circles.png")
```

    python examples/plot_great_circles.py [DIRECTORY]
"""

from pathlib import Path

import numpy as np
import numpy.typing as npt
from _gallery import drawing, run, save_drawing, save_scenes

import adaptsize as ads
from adaptsize.limiting import Exact
from adaptsize.plot.scene import scene_of_mesh

FloatArray = npt.NDArray[np.float64]

PLACES = {"Hilo": (-155, 20), "Longyearbyen": (16, 78), "McMurdo": (167, -78)}
LEAST, MOST, G = 20.0, 800.0, 0.2  # km
RADIUS = 6371.0


def main(output_dir: Path, *, spacing: float = 1.0, width: int = 900) -> dict[str, float]:
    counts = (round(360 / spacing) + 1, round(180 / spacing) + 1)
    grid = ads.CartesianGrid((-180.0, -90.0), spacing, counts)
    h0 = np.full(grid.shape, MOST)
    for place in PLACES.values():
        nearest = np.rint((place - grid.origin) / grid.spacing).astype(int)
        h0[tuple(nearest)] = LEAST
    h = ads.limit_on_sphere(grid, h0, G, radius=RADIUS)
    degree = np.deg2rad(RADIUS)  # in km
    on_map = ads.limit_gradient(grid, h0, G * degree, method=Exact(face_sources=False))
    draw(output_dir / "great_circles.png", grid, h, on_map, width)
    every = max(1, round(3.0 / spacing))
    globe = on_globe(grid, every)
    scenes = {
        f"size h, km, along {way}": scene_of_mesh(
            globe,
            sizes[::every, ::every].ravel(),
            None,
            on_nodes=True,
            label="size h, km",
            color_range=(LEAST, MOST),
        )
        for way, sizes in (("great circles", h), ("straight lines on the map", on_map))
    }
    # Two of the places, the north pole and the 180th meridian are on this side.
    save_scenes(output_dir / "great_circles.scenes.json", scenes, seen_from=(-0.75, -0.2, 0.6))
    return {
        "largest ratio of sizes on the map and on the sphere": float((on_map / h).max()),
        "smallest ratio": float((on_map / h).min()),
    }


def on_globe(grid: ads.CartesianGrid, every: int) -> ads.SimplexMesh:
    """Return the triangles between every n-th node of the grid, on the sphere."""
    counts = [len(range(0, n, every)) for n in grid.shape]
    plane = ads.CartesianGrid(grid.origin, every * grid.spacing, counts).mesh
    longitude, latitude = np.deg2rad(plane.points.T)
    ring = np.cos(latitude)
    places = np.array([ring * np.cos(longitude), ring * np.sin(longitude), np.sin(latitude)])
    return ads.SimplexMesh(RADIUS * places.T, plane.cells)


def draw(
    path: Path, grid: ads.CartesianGrid, h: FloatArray, on_map: FloatArray, width: int
) -> None:
    """Draw both fields with one scale."""
    levels = [20, 50, 100, 200, 300, 400, 500, 600, 700, 800]
    x, y = (np.unique(grid.points[:, d]) for d in (0, 1))
    figure, axes = drawing(1, 2, width, shape=0.5)
    for ax, sizes, title in (
        (axes[0], h, "along great circles"),
        (axes[1], on_map, "along straight lines on the map"),
    ):
        filled = ax.contourf(x, y, sizes.T, levels)
        ax.contour(x, y, sizes.T, levels, colors="k", linewidths=0.4)
        for name, place in PLACES.items():
            left = place[0] > 100
            ax.plot(*place, ".", color="w", markersize=4)
            ax.annotate(
                name,
                place,
                xytext=(-5 if left else 5, 0),
                textcoords="offset points",
                ha="right" if left else "left",
                va="center",
                color="black",
                bbox={"facecolor": "w", "edgecolor": "none", "alpha": 0.8, "pad": 1.0},
            )
        ax.set_title(title)
        ax.set_ylabel("latitude, degrees")
        ax.set(aspect=1.0, xticks=range(-180, 181, 60), yticks=range(-90, 91, 30))
    axes[1].set_xlabel("longitude, degrees")
    figure.colorbar(filled, ax=axes, label="size h, km", shrink=0.7)
    save_drawing(path, figure, axes[0])


if __name__ == "__main__":
    run(main)
