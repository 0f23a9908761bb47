"""From a volume to tetrahedra.

Two organs that touch become two regions (c) with a common interface; the small one gets small
tetrahedra (b).

The input are labels on voxels, as from a CT scan.  Their boundary is smoothed, sizes come from its
curvature and from the width of the organs, and the tetrahedra keep the labels.  Also writes
organs.vtu.

```python
import adaptsize as ads

image = ads.read_image("data/organs.nii.gz")
mesh = ads.mesh_image(image, elements_per_radian=3, elements_across=3)
ads.write("organs.vtu", mesh)
ads.plot.plot_mesh(mesh, color="region", clip=None, path="volume.png")
```
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from _gallery import DATA, run, save_panels, save_scenes

import adaptsize as ads
from adaptsize.errors import ResolutionWarning
from adaptsize.plot import plot_causes, plot_mesh, plot_size
from adaptsize.reporting.page.scenes import scenes_of_mesh


def main(
    output_dir: Path, *, width: int = 560, every: int = 2, elements_per_radian: float = 3.0
) -> dict[str, Any]:
    """Mesh data/organs.nii.gz, of which each n-th voxel is taken along each axis."""
    volume = ads.read_image(DATA / "organs.nii.gz")
    image = ads.background.Image(
        volume.values[(slice(None, None, every),) * 3], every * volume.spacing
    )
    options: dict[str, Any] = {"elements_per_radian": elements_per_radian, "elements_across": 3.0}
    size = ads.size_function(image, **options)
    report = size.report
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResolutionWarning)  # a few slivers, counted below
        mesh = ads.mesh_image(image, **options)
    ads.write(output_dir / "organs.vtu", mesh)

    panels = [
        ("which cause controls the size,\nin a section", plot_causes(report, width=width)),
        ("size", plot_size(mesh, label="size h, mm", width=width)),
        ("regions", plot_mesh(mesh, color="region", clip=None, width=width)),
        ("quality of the tetrahedra", plot_mesh(mesh, color="quality", width=width)),
    ]
    save_panels(output_dir / "volume.png", panels, columns=2, thumb=2)
    scenes = scenes_of_mesh(mesh, ads.SizeFunction(mesh, mesh.point_data["h"]))
    save_scenes(output_dir / "volume.scenes.json", scenes)
    voxel = float(np.prod(image.spacing))
    volumes = {
        f"volume of region {k} over that of its voxels": float(
            mesh.measures[mesh.cell_tags == k].sum() / (voxel * np.count_nonzero(image.values == k))
        )
        for k in (1, 2)
    }
    angles = mesh.minimum_angles()
    return {
        "tetrahedra": mesh.n_cells,
        "smallest size in mm": float(size.values.min()),
        **volumes,
        "share below 10 degrees": float((angles < 10.0).mean()),
        **{f"share of {name}": share for name, share in report.domain_shares.items()},
    }


if __name__ == "__main__":
    run(main)
