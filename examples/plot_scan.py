"""Tetrahedra of a scanned figurine.

Antlers and legs get small (dark) tetrahedra from their width and curvature, the trunk large ones;
the quality is uniform (c).

Figure 10 of Persson's paper, with a model of our own (data/deer.ply, triangles as of a
scanner, with some noise).  The signed distance is put on a Cartesian grid, whose medial
axis gives the feature size everywhere inside; curvature comes from the triangles, because
second differences on a grid finer than these see every edge between them.  The smaller
one is limited with g = 0.3.  Antlers are as thick as three to four spacings of the
grid.  Netgen and Mmg make the tetrahedra: 83 000, 91 % of their edges within sqrt 2 of the size,
no dihedral angle below 11 degrees, 0.26 % of the diagonal from the scan, in about five minutes of
one processor.  The noise makes the scan intersect itself: 23 triangles of the antlers cross others
by up to 0.024 mm, less than the tolerance of 0.3 mm.  `remesh` warns of them.

```python
import numpy as np

import adaptsize as ads

scan = ads.read("data/deer.ply")
grid = ads.CartesianGrid.around(scan.points, 0.45, margin=1.35)
feature = ads.feature_size(grid, ads.signed_distance(grid, scan))
curvature = ads.size_from_curvature(grid, scan, elements_per_radian=3, smoothing=2)
h0 = np.minimum(curvature, 2.0 * feature / 3.0).clip(0.45, 6.0)  # 3 elements across
size = ads.SizeFunction(grid, ads.limit_gradient(grid, h0, 0.3))
mesh = ads.remesh(scan, size, hmax=6.0, tolerance=2e-3)  # about five minutes
ads.plot.plot_size(mesh, size, path="scan.png")
```

    python examples/plot_scan.py [DIRECTORY]
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from _gallery import DATA, run, save_panels

import adaptsize as ads
from adaptsize.plot import plot_mesh, plot_size

ELEMENTS_PER_RADIAN = 3.0
#: Over the diagonal: more than the noise of the scan, which the mesh should not follow.
TOLERANCE = 2e-3
ELEMENTS_ACROSS = 3.0
#: Rounds of averaging, against the noise of the scan.
SMOOTHING = 2
G = 0.3
#: The head is what is above this share of the height.
HEAD = 0.63


def main(
    output_dir: Path,
    *,
    scan: ads.SimplexMesh | None = None,
    spacing: float = 0.45,
    hmax: float = 6.0,
    width: int = 420,
) -> dict[str, Any]:
    scan = scan or ads.read(DATA / "deer.ply")
    grid = ads.CartesianGrid.around(scan.points, spacing, margin=3.0 * spacing)
    phi = ads.signed_distance(grid, scan)
    feature = ads.feature_size(grid, phi)
    curvature = ads.size_from_curvature(
        grid, scan, elements_per_radian=ELEMENTS_PER_RADIAN, smoothing=SMOOTHING
    )
    h0 = np.minimum(curvature, 2.0 * feature / ELEMENTS_ACROSS).clip(spacing, hmax)
    h = ads.limit_gradient(grid, h0, G)
    size = ads.SizeFunction(grid, h)
    mesh = ads.remesh(scan, size, hmax=hmax, tolerance=TOLERANCE)
    draw(output_dir / "scan.png", mesh, size, width)
    conformity = ads.size_conformity(mesh, size, surface=scan)
    inside = phi < 0.0
    assert conformity.boundary_edges is not None
    return {
        "scanned triangles": scan.n_cells,
        "grid nodes": grid.n_points,
        "smallest size": float(h[inside].min()),
        "largest size": float(h[inside].max()),
        "tetrahedra": mesh.n_cells,
        "share of edges in band": conformity.share_in_band,
        "on the boundary": conformity.boundary_edges.share_in_band,
        "smallest dihedral angle": conformity.angle_min,
        "distance over diagonal": conformity.hausdorff_relative,
    }


def draw(path: Path, mesh: ads.SimplexMesh, size: ads.SizeFunction, width: int) -> None:
    """Draw the sizes, the tetrahedra behind a cut along the spine, and the head."""
    z = mesh.points[:, 2]
    above = z[mesh.cells].mean(axis=1) > z.min() + HEAD * np.ptp(z)
    nodes, cells = np.unique(mesh.cells[above], return_inverse=True)
    head = ads.SimplexMesh(mesh.points[nodes], cells.reshape(-1, 4))
    h = size(mesh.points)
    panels = [
        (f"mesh size h, g = {G}", plot_size(mesh, h, clip=None, width=width)),
        (f"{mesh.n_cells} tetrahedra, split view", plot_size(mesh, h, clip="y", width=width)),
        ("quality, head and antlers", plot_mesh(head, clip=None, width=width)),
    ]
    save_panels(path, panels, thumb=1)


if __name__ == "__main__":
    run(main)
