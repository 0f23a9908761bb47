"""Sizes as a few points.

A size function on the plate with a slit (data/slit.vtu), and the points that it grows from.  They
are at the source, at the end of the slit, on the notch, whose curvature bounds the size, and where
the size grows from an edge of the notch rather than from its nodes.  On the right are the sizes
that grow straight from these points, over those in the domain: equal at the nodes where the way is
straight, smaller behind the slit.

```python
import adaptsize as ads

mesh = ads.read("data/slit.vtu")
size = ads.size_function(mesh, sources=ads.PointSource([3.0, 1.0], 0.02), hmax=0.6)
sparse = size.sparse()
sparse.write("sizes.csv")
print(sparse)
```

    python examples/plot_sparse_sizes.py [DIRECTORY]
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from _gallery import DATA, drawing, run, save_drawing

import adaptsize as ads


def main(output_dir: Path, *, width: int = 700) -> dict[str, float]:
    mesh = ads.read(DATA / "slit.vtu")
    size = ads.size_function(mesh, sources=ads.PointSource([3.0, 1.0], 0.02), hmax=0.6)
    sparse = size.sparse()
    share = sparse(mesh.points) / size.values
    figure, panels = drawing(2, 1, width)
    title = f"size at {mesh.n_points} nodes, and {len(sparse.sizes)} points"
    for panel, values, name in (
        (panels[0], size.values, title),
        (panels[1], share, "size from the points over the size"),
    ):
        colours = panel.tripcolor(*mesh.points.T, mesh.cells, values, shading="gouraud")
        figure.colorbar(colours, ax=panel, shrink=0.8)
        panel.set(title=name, aspect="equal", xlabel="x", ylabel="y")
    panels[0].plot(*sparse.points.T, ".", color="#d55e00", markersize=5)
    save_drawing(output_dir / "sparse_sizes.png", figure, panels[0])
    return {
        "points": len(sparse.sizes),
        "nodes": mesh.n_points,
        "largest share": float(share.max()),
        "smallest share": float(share.min()),
        "nodes with equal sizes": int(np.count_nonzero(share > 1.0 - 1e-11)),
    }


if __name__ == "__main__":
    run(main)
