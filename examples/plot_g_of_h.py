"""Gradient limit by size.

Small elements grow faster than large ones: g(h) is large (red) only close to the three sources.

Figure 15 of Persson's paper: g(h) falls smoothly from 0.6 for small elements to 0.2 for
large ones, so that small elements grow fast and large ones slowly.  The paper leaves open
whether such a problem has one solution; with the change of variable Phi(h) =
integral of dh / g(h) it has, for any positive g, and here it is compared with the
solution of the differential equation dh/ds = g(h) along straight lines from each source.

```python
import numpy as np

import adaptsize as ads


def g_of_h(h):
    return 0.4 + 0.2 * np.cos(np.pi * np.clip(h / 0.1, 0.0, 1.0))


mesh = ads.read("data/slit.vtu")
h = ads.limit_gradient(mesh, mesh.point_data["h0"], g_of_h)
ads.plot.plot_size(mesh, h, path="g_of_h.png")
```

    python examples/plot_g_of_h.py [DIRECTORY]
"""

from pathlib import Path

import numpy as np
import numpy.typing as npt
from _gallery import has_mmg, jittered_rectangle, node_at, run, save_panels
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import adaptsize as ads
from adaptsize.plot import plot_mesh, plot_size

SOURCES = {(0.2, 0.3): 0.002, (0.75, 0.65): 0.002, (0.25, 0.8): 0.02}
SMALLEST, LARGE = 0.002, 0.1


def g_of_h(h: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return 0.6 for h = 0, 0.2 from h = 0.1 on, a half cosine in between."""
    return 0.4 + 0.2 * np.cos(np.pi * np.clip(h / LARGE, 0.0, 1.0))


def main(output_dir: Path, *, n_side: int = 401, width: int = 420) -> dict[str, float]:
    mesh = jittered_rectangle((0, 0), (1.0, 1.0), n_side)
    h0 = np.full(mesh.n_points, np.inf)
    for place, size_there in SOURCES.items():
        h0[node_at(mesh, place)] = size_there
    h = ads.limit_gradient(mesh, h0, g_of_h)

    error = h - exact_sizes(mesh.points, np.flatnonzero(np.isfinite(h0)), h0)
    found = {
        "largest size": float(h.max()),
        "max error": float(np.abs(error).max()),
        "largest with g = 0.2": float(ads.limit_gradient(mesh, h0, 0.2).max()),
        "largest with g = 0.6": float(ads.limit_gradient(mesh, h0, 0.6).max()),
    }
    panels = [
        ("gradient limit g(h(x))\n0.6 for small, 0.2 for large elements",
         plot_mesh(mesh.with_data(point_data={"g(h)": g_of_h(h)}), color="g(h)", width=width)),
        (f"size, {SMALLEST} to {h.max():.2f}\nlargest error {np.abs(error).max():.0e}",
         plot_size(mesh, h, limits=(SMALLEST, h.max()), width=width)),
    ]  # fmt: skip
    if has_mmg():
        size = ads.SizeFunction(mesh, h)
        new = ads.remesh(mesh, size)
        found["triangles"] = new.n_cells
        picture = plot_size(new, size, limits=(SMALLEST, h.max()), width=width)
        panels.append((f"mesh\n{new.n_cells} triangles", picture))
    save_panels(output_dir / "g_of_h.png", panels)
    return found


def exact_sizes(
    points: npt.NDArray[np.float64],
    sources: npt.NDArray[np.intp],
    h0: npt.NDArray[np.float64],
) -> npt.NDArray[np.float64]:
    """Return the least of the sizes that grow by dh/ds = g(h) from each source."""
    grown = solve_ivp(
        lambda s, h: g_of_h(h), (0.0, 3.0), [SMALLEST], rtol=1e-10, atol=1e-12, dense_output=True
    ).sol
    exact = np.full(len(points), np.inf)
    for source in sources:
        start = brentq(lambda s, size=h0[source]: grown(s)[0] - size, 0.0, 1.0, xtol=1e-14)
        way = np.linalg.norm(points - points[source], axis=1)
        exact = np.minimum(exact, grown(start + way)[0])
    return exact


if __name__ == "__main__":
    run(main)
