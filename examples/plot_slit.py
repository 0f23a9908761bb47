"""Small sizes do not reach across a slit.

Figure 6 of Persson's paper (data/slit.vtu): small sizes are prescribed on a round notch in
the top, close to a narrow slit.  `limit_gradient` measures distances inside the domain: the
shortest path to the other side leads around the lower end of the slit, and the size there is
large.  Formula (11) of the paper has straight-line distances and is meant for convex domains.
Here it goes through the slit and refines the wrong side.  Meshes of both follow, if Mmg is
installed.

    python examples/plot_slit.py [DIRECTORY]
"""

from pathlib import Path

import numpy as np
import numpy.typing as npt
from _gallery import DATA, has_mmg, node_at, run, save_panels

import adaptsize as ads
from adaptsize.plot import plot_size

G = 0.15
LARGEST = 0.3  # of the meshes; the sizes alone would grow to a third of the domain


def main(output_dir: Path, *, width: int = 700) -> dict[str, float]:
    mesh = ads.read(DATA / "slit.vtu")
    across = node_at(mesh, (2.02, 3.0))  # upper right edge of the slit
    h0 = mesh.point_data["h0"]
    sizes = {
        "inside the domain": ads.limit_gradient(mesh, h0, G),
        "straight through the slit": straight_sizes(mesh.points, h0),
    }
    panels, found = [], {}
    scale = {
        name: (float(h0[h0 < np.inf].min()), top)
        for name, top in (("sizes", max(float(h.max()) for h in sizes.values())), ("mesh", LARGEST))
    }
    for name, h in sizes.items():
        found[f"size across the slit, {name}"] = float(h[across])
        title = f"distances {name}\nh = {h[across]:.2f} at the top right edge of the slit"
        panels.append((title, plot_size(mesh, h, limits=scale["sizes"], width=width)))
        if has_mmg():
            size = ads.SizeFunction(mesh, h).clip(hmax=LARGEST)
            new = ads.remesh(mesh, size)
            found[f"triangles, {name}"] = new.n_cells
            title = f"its mesh (sizes up to {LARGEST})\n{new.n_cells} triangles"
            panels.append((title, plot_size(new, size, limits=scale["mesh"], width=width)))
    save_panels(output_dir / "slit.png", panels, columns=2)
    return found


def straight_sizes(
    points: npt.NDArray[np.float64], h0: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the sizes of formula (11), whatever is in the way."""
    h = h0.copy()
    for node in np.flatnonzero(np.isfinite(h0)):
        h = np.minimum(h, h0[node] + G * np.linalg.norm(points - points[node], axis=1))
    return h


if __name__ == "__main__":
    run(main)
