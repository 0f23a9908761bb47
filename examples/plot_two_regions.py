"""Two materials, one mesh.

The ball has small tetrahedra, the block around it large ones, and the interface between the two
is preserved.

data/block.vtu is a block of tetrahedra (region 1) with a ball in it (region 2), and tagged
facets at the ends, the sides and the interface.  A size is prescribed in the ball, and another
one at a point of one end.  The sizes are limited and the block is remeshed.  Regions and
facet tags are preserved, as the volumes and areas by tag show.

```python
import numpy as np

import adaptsize as ads

mesh = ads.read("data/block.vtu")  # a block, region 1, with a ball in it, region 2
sources = [ads.RegionSource(2, 1.0), ads.PointSource((40.0, 10.0, 10.0), 0.3)]
h0 = np.minimum(ads.size_from_sources(mesh, sources, g=0.3), 5.0)
size = ads.SizeFunction(mesh, ads.limit_gradient(mesh, h0, 0.3))
new = ads.remesh(mesh.without_data(), size)
print(np.unique(new.cell_tags), np.unique(new.facet_tags))
ads.plot.plot_mesh(new, color="region", path="two_regions.png")
```

    python examples/plot_two_regions.py [DIRECTORY]
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from _gallery import DATA, run, save_panels, save_scenes

import adaptsize as ads
from adaptsize.plot import plot_mesh, plot_size
from adaptsize.reporting.page.scenes import scenes_of_mesh

G = 0.3


def main(
    output_dir: Path, *, in_ball: float = 1.0, at_point: float = 0.3, width: int = 560
) -> dict[str, float]:
    mesh = replace(ads.read(DATA / "block.vtu"), tag_names={(3, 1): "block", (3, 2): "ball"})
    sources = [ads.RegionSource(2, in_ball), ads.PointSource((40.0, 10.0, 10.0), at_point)]
    h0 = np.minimum(ads.size_from_sources(mesh, sources, g=G), 5.0)
    size = ads.SizeFunction(mesh, ads.limit_gradient(mesh, h0, G))
    new = ads.remesh(mesh.without_data(), size)

    found: dict[str, float] = {"tetrahedra": new.n_cells}
    for name, old_by_tag, new_by_tag in (
        ("volume of region", _volumes(mesh), _volumes(new)),
        ("area of facets", _areas(mesh), _areas(new)),
    ):
        for tag, before in old_by_tag.items():
            found[f"{name} {tag}, after over before"] = new_by_tag[tag] / before
    found["share of edges in band"] = ads.size_conformity(new, size).share_in_band
    save_panels(
        output_dir / "two_regions.png",
        [
            ("regions kept\ncut through the middle", plot_mesh(new, color="region", width=width)),
            (f"sizes\n{new.n_cells} tetrahedra", plot_size(new, size, width=width)),
        ],
    )
    save_scenes(output_dir / "two_regions.scenes.json", scenes_of_mesh(new, size))
    return found


def _volumes(mesh: ads.SimplexMesh) -> dict[int, float]:
    tags = mesh.cell_tags
    return {int(t): float(mesh.measures[tags == t].sum()) for t in np.unique(tags)}


def _areas(mesh: ads.SimplexMesh) -> dict[int, float]:
    facets = ads.SimplexMesh(mesh.points, mesh.tagged_facets)
    tags = mesh.facet_tags
    return {int(t): float(facets.measures[tags == t].sum()) for t in np.unique(tags)}


if __name__ == "__main__":
    run(main)
