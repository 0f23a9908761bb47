"""Anisotropic meshes of two layers.

With about as many triangles, stretched ones (b) have a 40 times smaller error than equilateral ones
(a). They are up to 100 times longer than wide along the layers. For a given error, 6 to 14 times
fewer triangles are needed (c).

Linear elements interpolate u = tanh(60 (x - 1/2 - sin(2 pi y) / 10)) and
u = tanh(60 (x - 1/2)) + tanh(60 (y - 1/2)) on the unit square.  Each cycle of `adapt` takes the
second derivatives from the nodal values on the present mesh; nothing else is known of u.  With
``anisotropic=True`` triangles become long along the layers.  With `size_from_hessian` they stay
regular.

Elements for an error of 1e-3 in the norm of L2, interpolated between the meshes:

| | isotropic | anisotropic | ratio |
|---|---:|---:|---:|
| S-shaped layer | 11 150 | 1 930 | 5.8 |
| crossing layers | 22 360 | 1 600 | 13.9 |

How much there is to gain depends on the field.  Two straight layers need a bounded number of
triangles along them, so that the ratio grows as the error falls.  The S-shaped layer has a
radius of curvature of 1/4 against a thickness of 1/60; for it, the optimal numbers of
regular triangles differ by a factor of 4.7 (docs/anisotropic-meshes.md).

The pictures: meshes with about the same number of triangles, the errors, and the metric as
ellipses.  Needs Mmg.  Takes about a minute.

```python
import numpy as np

import adaptsize as ads

mesh = ads.read("data/lshape.vtu")
for target in (1000, 2000, 3000):
    x, y = mesh.points.T
    u = np.tanh(30.0 * (x + 0.5 - 0.1 * np.sin(np.pi * y)))  # your solver's result instead
    result = ads.adapt(mesh, anisotropic="u", fields={"u": u}, elements=target, hmax=0.2)
    mesh = result.mesh
ads.plot.plot_metric(result.metric, path="anisotropic_layers.png")
```

    python examples/plot_anisotropic_layers.py [DIRECTORY]
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from _gallery import (
    CURVES,
    draw_mesh,
    drawing,
    jittered_rectangle,
    run,
    save_drawing,
    save_panels,
)

import adaptsize as ads
from adaptsize.plot import plot_metric

FloatArray = npt.NDArray[np.float64]
Field = Callable[[FloatArray], FloatArray]

KINDS = ("isotropic", "anisotropic")
#: Numbers of elements of the loops; the first one for three cycles, the others for two.
NUMBERS = {"isotropic": (3000, 6000, 12000, 24000), "anisotropic": (750, 1500, 3000, 6000)}
#: Largest size, and the error to reach.
HMAX, GOAL = 0.25, 1e-3


class Step(NamedTuple):
    """A mesh of a loop, and the error of interpolation on it."""

    mesh: ads.SimplexMesh
    error: float
    metric: ads.MetricFunction | None
    in_band: float
    """Share of the edges with lengths within sqrt 2 of the request."""


def main(
    output_dir: Path, *, numbers: dict[str, Sequence[int]] | None = None, width: int = 520
) -> dict[str, float | str]:
    """Run both loops for both fields, and draw them."""
    start = jittered_rectangle([0, 0], [1, 1], 30)
    found: dict[str, float | str] = {}
    loops = {}
    for name, field in (("S-shaped", curved_layer), ("crossing", crossing_layers)):
        for kind in KINDS:
            steps = loop(start, field, kind, (numbers or NUMBERS)[kind])
            loops[name, kind] = steps
            found[f"{name}, {kind}: triangles"] = " ".join(str(s.mesh.n_cells) for s in steps)
            found[f"{name}, {kind}: errors"] = " ".join(f"{s.error:.2e}" for s in steps)
            found[f"{name}, {kind}: for an error of {GOAL:g}"] = number_for(steps, GOAL)
            found[f"{name}, {kind}: order in 1 / N"] = order(steps)
        last = loops[name, "anisotropic"][-1].mesh.implied_metric()
        found[f"{name}: largest aspect ratio"] = float(last.aspect_ratio.max())
    draw(output_dir / "anisotropic_layers.png", loops, width)
    metrics = {name: loops[name, "anisotropic"][1].metric for name in ("S-shaped", "crossing")}
    scale = min(float(m.metric.sizes.min()) for m in metrics.values() if m), HMAX
    ellipses = [
        (f"metric of the {name} layer{'s' * (name == 'crossing')}",
         plot_metric(metric, n_glyphs=500, limits=scale, width=width))
        for name, metric in metrics.items()
        if metric is not None
    ]  # fmt: skip
    save_panels(output_dir / "anisotropic_layers_metric.png", ellipses)
    return found


def curved_layer(points: FloatArray) -> FloatArray:
    """Return values that change across an S-shaped curve."""
    x, y = points[..., 0], points[..., 1]
    return np.asarray(np.tanh(60.0 * (x - 0.5 - 0.1 * np.sin(2.0 * np.pi * y))))


def crossing_layers(points: FloatArray) -> FloatArray:
    """Return values that change across two lines."""
    return np.asarray(np.tanh(60.0 * (points[..., :2] - 0.5)).sum(axis=-1))


def loop(
    mesh: ads.SimplexMesh, field: Field, kind: str, numbers: Sequence[int], *, hmax: float = HMAX
) -> list[Step]:
    """Adapt to a field with increasing numbers of elements; return the last mesh of each."""
    steps = []
    for place, number in enumerate(numbers):
        for _ in range(3 if place == 0 else 2):
            fields = {"u": field(mesh.points)}
            if kind == "anisotropic":
                result = ads.adapt(
                    mesh, anisotropic="u", fields=fields, elements=number, hmax=hmax,
                    enough=1.1,
                )  # fmt: skip
            else:
                h = ads.size_from_hessian(
                    mesh, fields["u"], elements=number, norm=2.0, hmax=hmax, g=0.25,
                    backend="mmg",
                )  # fmt: skip
                result = ads.adapt(mesh, h0=h, g=None, enough=1.1)
            mesh = result.mesh
        in_band = result.report.after.share_in_band
        steps.append(Step(mesh, interpolation_error(mesh, field), result.metric, in_band))
    return steps


def interpolation_error(
    mesh: ads.SimplexMesh, field: Field, n: int = 60, *, norm: float = 2.0
) -> float:
    """Return the norm of L2 (or inf) of the error of linear interpolation.

    It is evaluated at n random points per cell.
    """
    rng = np.random.default_rng(20261122)
    corners, nodal = mesh.points[mesh.cells], field(mesh.points)[mesh.cells]
    total = largest = 0.0
    for _ in range(n):
        weights = rng.dirichlet(np.ones(mesh.cell_dim + 1), len(nodal))
        there = np.einsum("nk,nkd->nd", weights, corners)
        error = (weights * nodal).sum(axis=1) - field(there)
        total += float((error**2 * mesh.measures).sum()) / n
        largest = max(largest, float(np.abs(error).max()))
    return largest if norm == np.inf else float(np.sqrt(total))


def number_for(steps: Sequence[Step], error: float) -> float:
    """Return the number of elements for an error, interpolated between meshes."""
    logs = np.log([[step.error, step.mesh.n_cells] for step in steps])[::-1]
    return float(np.exp(np.interp(np.log(error), *logs.T)))


def order(steps: Sequence[Step]) -> float:
    """Return p of errors proportional to N^-p, from the last two meshes."""
    one, two = steps[-2:]
    return float(np.log(one.error / two.error) / np.log(two.mesh.n_cells / one.mesh.n_cells))


def draw(path: Path, loops: dict[tuple[str, str], list[Step]], width: int) -> None:
    """Draw meshes of the crossing layers of about the same size, and errors for both fields."""
    figure, panels = drawing(3, 1, width, shape=0.95)
    for panel, kind, place, line in zip(panels, KINDS, (0, -2), (0.4, 0.15), strict=False):
        step = loops["crossing", kind][place]
        draw_mesh(panel, step.mesh, width=line)
        panel.set_title(f"{kind}: {step.mesh.n_cells} triangles\nerror {step.error:.1e}")
        panel.set(aspect="equal", xlim=(0, 1), ylim=(0, 1), xticks=[], yticks=[])
    for (name, kind), steps in loops.items():
        panels[2].loglog(
            [step.mesh.n_cells for step in steps], [step.error for step in steps],
            "o-" if name == "crossing" else "o:", color=CURVES[1 - KINDS.index(kind)],
            label=f"{kind}, {name}",
        )  # fmt: skip
    panels[2].set(xlabel="triangles", title="error of interpolation\nin the norm of L2")
    panels[2].set_ylim(bottom=1e-7)  # room for the legend
    panels[2].legend(loc="lower left", fontsize="small")
    save_drawing(path, figure, panels[1])


if __name__ == "__main__":
    run(main)
