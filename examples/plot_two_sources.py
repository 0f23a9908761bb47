"""Errors of limiting along edges.

Distances along edges are too long, so the sizes are too large (red, a) in most directions.
Marching through the triangles is accurate (b).

Figure 11 and section 6.2 of Persson's paper, on jittered Delaunay triangles: the size is
1 at (-10, 0) and 5 at (10, 0) in the square (-50, 50)^2, and g = 0.3.  Shortest paths
along the edges of the mesh (what many mesh generators do) miss the true size where no
edges follow the straight path, at every mesh size.  Fast marching propagates through the triangles
and converges.

```python
import numpy as np
from scipy.spatial import Delaunay

import adaptsize as ads

points = np.random.default_rng(20050711).uniform(-50.0, 50.0, (20_000, 2))
mesh = ads.SimplexMesh(points, Delaunay(points).simplices)
h0 = np.full(mesh.n_points, np.inf)
for place, size in (((-10, 0), 1.0), ((10, 0), 5.0)):
    h0[np.argmin(np.linalg.norm(points - place, axis=1))] = size
exact = ads.limit_gradient(mesh, h0, 0.3)
for method in ("edge-based", "fast-marching"):
    print(method, np.abs(ads.limit_gradient(mesh, h0, 0.3, method=method) - exact).mean())
ads.plot.plot_size(mesh, exact, path="two_sources.png")
```

    python examples/plot_two_sources.py [DIRECTORY]
"""

from pathlib import Path

import numpy as np
from _gallery import jittered_rectangle, node_at, run, save_panels

import adaptsize as ads
from adaptsize.plot import plot_mesh, plot_size

G = 0.3


def main(output_dir: Path, *, n_side: int = 401, width: int = 420) -> dict[str, float]:
    mesh = jittered_rectangle((-50, -50), (50, 50), n_side)
    h0 = np.full(mesh.n_points, np.inf)
    h0[node_at(mesh, (-10, 0))] = 1.0
    h0[node_at(mesh, (10, 0))] = 5.0

    exact = ads.limit_gradient(mesh, h0, G, method="exact")
    panels = []
    found = {}
    errors = {
        method: ads.limit_gradient(mesh, h0, G, method=method) - exact
        for method in ("edge-based", "fast-marching")
    }
    scale = (
        min(float(error.min()) for error in errors.values()),
        max(float(error.max()) for error in errors.values()),
    )
    for method, error in errors.items():
        title = f"{method}\nerror {error.min():.2f} to {error.max():.2f}, mean {error.mean():.2f}"
        panels.append(
            (
                title,
                plot_mesh(
                    mesh.with_data(point_data={"error of h": error}),
                    color="error of h",
                    limits=scale,
                    width=width,
                ),
            )
        )
        found[f"max error {method}"] = float(np.abs(error).max())
        found[f"mean error {method}"] = float(np.abs(error).mean())
    title = f"exact, formula (11)\nh {exact.min():.2f} to {exact.max():.2f}"
    panels.append((title, plot_size(mesh, exact, width=width)))
    save_panels(output_dir / "two_sources.png", panels, thumb=0)
    return found


if __name__ == "__main__":
    run(main)
