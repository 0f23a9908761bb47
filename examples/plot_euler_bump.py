"""Transonic bump, isotropic triangles.

Where two shocks meet, the triangles have small angles without gradient limiting (a), and none with
it (b). The steady state is then reached in a third of the steps.

Figure 12 of Persson's paper (section 7.1).  Four times: the density of the flow at the nodes,
sizes that interpolate it equally well everywhere with 6000 triangles (`size_from_hessian`), a
mesh of these sizes, the flow taken to it (`transfer_fields`) and computed there.

In (a), the sizes are used as they are.  Away from the shocks they grow by up to 38 per length,
which no mesh can follow: fans of thin triangles arise.  In (b), they are limited to g = 0.25.
The picture shows the fish tail, where the oblique shock from the end of the bump meets the one
behind it, with the smallest angle of each triangle.  The last meshes:

| | without limiting | with limiting |
|---|---:|---:|
| steepest slope of the sizes | 38 | 0.25 |
| triangles | 5728 | 6012 |
| smallest angle | 5.3 | 33.1 |
| angle of the worst hundredth | 7.4 | 38.7 |
| triangles with an angle below 20 | 956 | 0 |
| worst radius ratio | 0.053 | 0.569 |
| mean radius ratio | 0.724 | 0.963 |
| steps of the solver | 294 | 103 |

Converged is a flow when the mass that flows into the triangles and not out, summed without
signs, is less than 1e-4 of the inflow.

The meshes come from `mesh_from_distance`, which like the generator of the paper takes sizes as they
are; boundary nodes lie on the arc, 10 % as high as long, whatever the mesh before was like.
Mmg by `remesh` is not left to grade limited sizes either, but grades those steeper than 3 per
length: it made twice as many triangles of them as asked for.

Above the bump and beyond both ends there is the free stream, and the flux between the two decides
what enters and what leaves.  With a wall above, the flow would choke: at Mach 0.95 a stream cannot
be narrowed by more than 0.2 %.  The solver is in `_euler.py`.  Takes under three minutes.

```python
import numpy as np

import adaptsize as ads

low, high = np.array([-1.0, 0.0]), np.array([2.0, 1.0])


def channel(x):  # negative inside
    return np.max([low - x, x - high], axis=(0, 2))


corners = [low, [2.0, 0.0], high, [-1.0, 1.0]]
grid = ads.CartesianGrid.around(corners, 0.5)
size = ads.SizeFunction(grid, np.full(grid.shape, 0.1))
mesh = ads.mesh_from_distance(channel, size, low, high, fixed_points=corners)
for target in (1500, 3000):
    x, y = mesh.points.T
    density = np.tanh(20.0 * (x - 1.0 - 0.2 * y))  # your solver's result instead
    h = ads.size_from_hessian(mesh, density, elements=target, hmin=0.004, g=0.25)
    size = ads.SizeFunction(mesh, h)
    new = ads.mesh_from_distance(channel, size, low, high, fixed_points=corners)
    start = ads.transfer_fields(mesh, new, fields={"density": density})  # for the solver
    mesh = new
ads.plot.plot_size(mesh, size, path="euler_bump.png")
```

    python examples/plot_euler_bump.py [DIRECTORY]
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import _euler as euler
import numpy as np
import numpy.typing as npt
from _gallery import CURVES, INK, QUALITY, draw_mesh, drawing, run, save_drawing

import adaptsize as ads
from adaptsize.errors import ConvergenceWarning, ResolutionWarning

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = npt.NDArray[np.float64]

MACH = 0.95
G = 0.25
#: Corners of the domain; the bump is an arc of a circle from (0, 0) to (1, 0).
LOW, HIGH = np.array([-3.0, 0.0]), np.array([5.0, 4.0])
THICKNESS = 0.1
RADIUS = (0.25 + THICKNESS**2) / (2.0 * THICKNESS)
CENTRE = np.array([0.5, THICKNESS - RADIUS])
CORNERS = np.array([LOW, [0, 0], [1, 0], [HIGH[0], LOW[1]], HIGH, [LOW[0], HIGH[1]]])
#: Sizes are held between these.
HMIN, HMAX = 0.004, 0.6
#: Imbalance of mass, summed over all triangles, over the inflow, that counts as converged.
TOLERANCE = 1e-4
#: Windows of the pictures: left, right, bottom, top.
AT_SHOCK = (0.95, 1.95, 0.0, 0.625)
NAMES = ("without", "with")


class Cycle(NamedTuple):
    """A mesh and the flow on it."""

    mesh: ads.SimplexMesh
    solution: euler.Solution
    slope: float = 0.0
    """Steepest slope, along edges, of the sizes that the mesh was made for."""


def main(
    output_dir: Path, *, n_triangles: int = 6000, n_cycles: int = 4, width: int = 560
) -> dict[str, float | str]:
    """Adapt in so many cycles, without and with gradient limiting, from the same first mesh."""
    first = solve(mesh_for(first_size(n_triangles)), tolerance=10.0 * TOLERANCE)
    found: dict[str, float | str] = {}
    results = {}
    for name in NAMES:
        result = first
        for cycle in range(n_cycles):
            wanted = n_triangles * min(1.0, 0.4 * 2.0**cycle)
            result = adapted(result, wanted, limited=name == "with")
        results[name] = result
        found |= {f"{key}, {name} limiting": value for key, value in summary(result).items()}
    draw_meshes(output_dir / "euler_bump.png", results, width)
    draw_comparison(output_dir / "euler_bump_comparison.png", results, width)
    return found


def channel(x: FloatArray) -> FloatArray:
    """Return a distance to the boundary, negative in the channel above the bump."""
    away = np.abs(x - 0.5 * (LOW + HIGH)) - 0.5 * (HIGH - LOW)
    box = np.linalg.norm(np.maximum(away, 0.0), axis=1) + np.minimum(away.max(axis=1), 0.0)
    return np.asarray(np.maximum(box, RADIUS - np.linalg.norm(x - CENTRE, axis=1)))


def is_wall(x: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which points of the boundary are on the lower wall."""
    inside = (x[:, 0] > LOW[0] + 1e-9) & (x[:, 0] < HIGH[0] - 1e-9)
    return np.asarray(inside & (x[:, 1] < THICKNESS + 1e-9))


def first_size(n_triangles: int) -> ads.SizeFunction:
    """Return sizes that are small around the bump, for a quarter of the triangles."""
    grid = ads.CartesianGrid.around(np.array([LOW, HIGH]), spacing=0.1, margin=0.2)
    away = np.maximum(np.abs(grid.points - [0.75, 0.5]) - [0.75, 0.5], 0.0)
    return ads.SizeFunction(
        grid, (5.5 / np.sqrt(n_triangles) + 0.15 * np.hypot(*away.T)).reshape(grid.shape)
    )


def mesh_for(size: ads.SizeFunction) -> ads.SimplexMesh:
    """Return a mesh of the channel; its boundary nodes lie on the true boundary."""
    with warnings.catch_warnings():
        # Sizes that are not limited cannot be met; how bad the triangles are is shown below.
        warnings.simplefilter("ignore", ConvergenceWarning)
        warnings.simplefilter("ignore", ResolutionWarning)
        return ads.mesh_from_distance(channel, size, LOW - 0.1, HIGH + 0.1, fixed_points=CORNERS)


def solve(
    mesh: ads.SimplexMesh, start: FloatArray | None = None, *, tolerance: float = TOLERANCE
) -> Cycle:
    """Return the flow on a mesh."""
    flow = euler.FlowMesh.of(mesh, is_wall)
    stream = euler.free_stream(MACH)
    return Cycle(mesh, euler.solve(flow, stream, start, tolerance=tolerance, max_steps=400))


def adapted(result: Cycle, n_triangles: float, *, limited: bool) -> Cycle:
    """Return the next mesh and the flow on it, from that on the present mesh."""
    mesh, solution = result.mesh, result.solution
    density = solution.at_nodes(solution.w)[:, 0]
    h = ads.size_from_hessian(
        mesh, density, elements=n_triangles, hmin=HMIN, hmax=HMAX, g=G if limited else None
    )
    new = mesh_for(ads.SizeFunction(mesh, h))
    fields = {"conserved": euler.conserved(solution.w)}
    start = ads.transfer_fields(mesh, new, cell_fields=fields).cell_fields["conserved"]
    i, j = mesh.edges.T
    slope = float((np.abs(h[i] - h[j]) / mesh.edge_lengths).max())
    return solve(new, euler.primitive(start))._replace(slope=slope)


def summary(result: Cycle) -> dict[str, float | str]:
    """Return the figures of a mesh and of the flow on it."""
    mesh, solution = result.mesh, result.solution
    angles, ratios = mesh.minimum_angles(), mesh.radius_ratios()
    boundary = mesh.points[mesh.boundary().nodes]
    wave = euler.mach_number(solution.w)
    return {
        "steepest slope of the sizes": result.slope,
        "triangles": mesh.n_cells,
        "smallest edge": float(mesh.edge_lengths.min()),
        "smallest angle": float(angles.min()),
        "angle of the worst hundredth": float(np.quantile(angles, 0.01)),
        "triangles with angles below 20": int((angles < 20.0).sum()),
        "worst radius ratio": float(ratios.min()),
        "mean radius ratio": float(ratios.mean()),
        "boundary nodes off the boundary": float(np.abs(channel(boundary)).max()),
        "steps": solution.steps,
        "converged": str(solution.converged),
        "imbalance": float(solution.history[-1]),
        "mass lost": solution.mass_lost,
        "largest Mach number": float(wave.max()),
    }


def draw_meshes(path: Path, results: dict[str, Cycle], width: int) -> None:
    """Draw the meshes at the shocks, without gradient limiting and with it."""
    figure, panels = drawing(2, 1, width, shape=0.75)
    for panel, name in zip(panels, NAMES, strict=True):
        mesh = results[name].mesh
        angles = mesh.minimum_angles()
        title = f"{name} limiting: {mesh.n_cells} triangles, worst {angles.min():.1f}°"
        window(panel, AT_SHOCK, title)
        colours = draw_mesh(panel, mesh, angles, vmin=0, vmax=60, cmap=QUALITY)
    figure.colorbar(colours, ax=panels, label="smallest angle, degrees", shrink=0.7)
    save_drawing(path, figure, panels[1])


def window(panel: Axes, box: tuple[float, float, float, float], title: str) -> None:
    """Show a part of the plane, the same scale along both axes."""
    panel.set(xlim=box[:2], ylim=box[2:], aspect="equal")
    panel.set_title(title, fontsize="medium")


def draw_comparison(path: Path, results: dict[str, Cycle], width: int) -> None:
    """Draw angles, convergence, and the density along a line, with and without limiting."""
    figure, (angle, steps, line) = drawing(3, 1, width, shape=0.75)
    along = np.column_stack([np.linspace(0.9, 2.4, 1500), np.full(1500, 0.3)])
    for name, colour in zip(NAMES, CURVES[1::-1], strict=True):
        mesh, solution = results[name].mesh, results[name].solution
        look = {"color": colour, "label": f"{name} limiting"}
        angle.hist(mesh.minimum_angles(), bins=np.arange(0, 61, 2), histtype="step", **look)
        steps.semilogy(np.arange(solution.steps), solution.history, **look)
        cells = mesh.locator.nearest(along)[0]
        line.plot(along[:, 0], solution.w[cells, 0], linewidth=1.0, **look)
    angle.set(title="smallest angles of the triangles", xlabel="degrees", ylabel="triangles")
    steps.axhline(TOLERANCE, color=INK, linewidth=0.6)
    steps.set(title="convergence on the last mesh", xlabel="steps", ylabel="imbalance / inflow")
    line.set(title="density at y = 0.3", xlabel="x")
    for panel in (angle, steps, line):
        panel.legend()
    save_drawing(path, figure)


if __name__ == "__main__":
    run(main)
