"""Small sizes do not reach across a slit.

Figure 6 of Persson's paper (data/slit.vtu): small sizes are asked for on a round notch in
the top, close to a narrow slit.  Limited on the mesh, they travel inside the domain: the
way to the other side leads around the lower end of the slit, and the size there is
large.  Straight-line distances (``method="exact"``, meant for convex domains) go through
the slit and refine the wrong side.  Meshes of both follow, if Mmg is installed.

    python examples/plot_slit.py [DIRECTORY]
"""

from pathlib import Path

from _gallery import DATA, has_mmg, node_at, run, save_panels

import adaptsize as ads
from adaptsize.plot import plot_size

G = 0.15
LARGEST = 0.3  # of the meshes; the sizes alone would grow to a third of the domain


def main(output_dir: Path, *, width: int = 700) -> dict[str, float]:
    mesh = ads.read(DATA / "slit.vtu")
    across = node_at(mesh, (2.02, 3.0))  # upper right edge of the slit
    names = {"fast-marching": "inside the domain", "exact": "straight through the slit"}
    panels, found = [], {}
    for method, name in names.items():
        h = ads.limit_gradient(mesh, mesh.point_data["h0"], G, method=method)
        found[f"size across the slit, {method}"] = float(h[across])
        title = f"distances {name}\nh = {h[across]:.2f} at the top right edge of the slit"
        panels.append((title, plot_size(mesh, h, width=width)))
        if has_mmg():
            size = ads.SizeFunction(mesh, h).clip(hmax=LARGEST)
            new = ads.remesh(mesh, size)
            found[f"triangles, {method}"] = new.n_cells
            title = f"its mesh (sizes up to {LARGEST})\n{new.n_cells} triangles"
            panels.append((title, plot_size(new, size, width=width)))
    save_panels(output_dir / "slit.png", panels, columns=2)
    return found


if __name__ == "__main__":
    run(main)
