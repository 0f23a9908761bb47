"""From STL to graded tetrahedra.

The part is cut open: dark, small tetrahedra in the thin rib and in the bores, light, large ones
where nothing requires small ones.

The way of Figures 9 and 10 of Persson's paper, from curvature and width: data/bracket.stl,
an L-bracket in millimetres with bores, a fillet and a thin rib.  Sizes are put on its
surface, limited, extended inwards, and given to fTetWild, followed by Mmg if that is
installed.  Takes about half a minute.

```python
import adaptsize as ads

surface = ads.read("data/bracket.stl")
size = ads.size_function(surface, elements_per_radian=2.0, g=0.25, hmin=1.0, hmax=5.0)
new = ads.remesh(surface, size)
print(ads.size_conformity(new, size, surface=surface))
ads.plot.plot_size(new, size, label="mesh size h, mm", path="bracket.png")
```

    python examples/plot_bracket.py [DIRECTORY]
"""

from pathlib import Path

from _gallery import DATA, run, save_image_thumbnail, save_scenes

import adaptsize as ads
from adaptsize.plot import plot_size
from adaptsize.reporting.page.scenes import scenes_of_mesh


def main(
    output_dir: Path,
    *,
    part: Path = DATA / "bracket.stl",
    elements_per_radian: float = 2.0,
    hmin: float = 1.0,
    hmax: float = 5.0,
    width: int = 1600,
) -> dict[str, float | str]:
    surface = ads.read(part)
    size = ads.size_function(
        surface, elements_per_radian=elements_per_radian, g=0.25, hmin=hmin, hmax=hmax
    )
    new = ads.remesh(surface, size)
    h = size(new.points)
    conformity = ads.size_conformity(new, h, surface=surface)
    path = output_dir / "bracket.png"
    save_image_thumbnail(path, plot_size(new, h, path=path, label="mesh size h, mm", width=width))
    shown = ("size h, cut open", "size h")
    scenes = scenes_of_mesh(new, size)
    save_scenes(output_dir / "bracket.scenes.json", {name: scenes[name] for name in shown})
    ads.write(output_dir / "bracket.vtu", new, fields={"h": h})
    return {
        "tetrahedra": new.n_cells,
        "share of edges in band": conformity.share_in_band,
        "smallest dihedral angle": conformity.angle_min,
        "distance over diagonal": conformity.hausdorff_relative,
        "inverted": conformity.n_inverted,
        "conformity": f"\n{conformity}",
    }


if __name__ == "__main__":
    run(main)
