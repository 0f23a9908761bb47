"""Small size at a point.

Three centres of small (dark) sizes: the prescribed point, the notch by its curvature, and the end
of the slit by the separation of its corners.

The script of the README, with a picture: data/slit.vtu is a plate with a notch and a narrow slit.
The size is prescribed at one point to the right of the slit.  The notch and the narrow regions also
require small elements.  All sizes grow with the gradient g = 0.25, up to hmax = 0.3, and do
not cross the slit.  The mesh on the right follows them, if Mmg is installed.

```python
import adaptsize as ads

mesh = ads.read("data/slit.vtu")
size = ads.size_function(mesh, sources=ads.PointSource([3.0, 1.0], 0.02), g=0.25, hmax=0.3)
new = ads.remesh(mesh, size)
ads.plot.plot_size(new, size, path="point_source.png")
```

    python examples/plot_point_source.py [DIRECTORY]
"""

from pathlib import Path

from _gallery import DATA, has_mmg, run, save_panels

import adaptsize as ads
from adaptsize.plot import plot_size


def main(output_dir: Path, *, at_point: float = 0.02, width: int = 560) -> dict[str, float]:
    mesh = ads.read(DATA / "slit.vtu")
    size = ads.size_function(mesh, sources=ads.PointSource([3.0, 1.0], at_point), g=0.25, hmax=0.3)
    found = {"size at the point": float(size([[3.0, 1.0]])[0])}
    scale = float(size.values.min()), 0.3
    panels = [("size function", plot_size(mesh, size, limits=scale, width=width))]
    if has_mmg():
        new = ads.remesh(mesh, size)
        found["triangles"] = new.n_cells
        found["share of edges in band"] = ads.size_conformity(new, size).share_in_band
        panels.append(
            (f"mesh of {new.n_cells} triangles", plot_size(new, size, limits=scale, width=width))
        )
    save_panels(output_dir / "point_source.png", panels)
    return found


if __name__ == "__main__":
    run(main)
