"""Measure the figures of docs/anisotropic-meshes.md and decision 27; needs Mmg.

python docs/measurements/anisotropic.py space      (the picture of layers in space; seconds)
python docs/measurements/anisotropic.py gradation  (the price of gradient limiting; ten minutes)
python docs/measurements/anisotropic.py laws       (other laws of growth; ten minutes)
python docs/measurements/anisotropic.py counts     (cells per predicted cell; a minute)
python docs/measurements/anisotropic.py regular    (errors against regular triangles; seconds)
python docs/measurements/anisotropic.py plate      (aspect ratios up to 1000; seconds)
"""

import json
import sys
from pathlib import Path

import numpy as np

import adaptsize as ads
from adaptsize.metrics import metric_from_layers

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "support"))
sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import _edge_sweeps
import plot_anisotropic_layers as layers
from _fields import second_derivatives
from _gallery import CURVES, drawing, jittered_rectangle, save_drawing
from shapes import block

ROOT = Path(__file__).parents[2]
SQUARE = jittered_rectangle([0, 0], [1, 1], 30)


def measure_space():
    """Draw the errors of both loops in space, from the results of benchmarks/anisotropic.py."""
    loops = json.loads((ROOT / "benchmarks/results/anisotropic.json").read_text())["loops"]
    figure, panels = drawing(2, 1, 560, shape=0.8)
    for panel, name in zip(panels, ("sheet in space", "sphere in space"), strict=True):
        for kind, colour in zip(layers.KINDS, CURVES[1::-1], strict=True):
            rows = [row for row in loops if (row["field"], row["kind"]) == (name, kind)]
            n = np.array([row["elements"] for row in rows], float)
            panel.loglog(n, [row["error"] for row in rows], "o-", color=colour, label=kind)
            last = rows[-1]["error"] * (n[-1] / n[-3:]) ** (2.0 / 3.0)
            label = "order 2/3" if kind == "isotropic" else None
            panel.loglog(n[-3:], last, "--", color="black", linewidth=0.7, label=label)
        panel.set(xlabel="tetrahedra", title=f"{name}: error of interpolation, L2")
        panel.legend()
    save_drawing(ROOT / "docs/figures/anisotropic_space.png", figure)


def measure_gradation():
    """Print elements for an error of 1e-3 with different gradient limits, and the last meshes."""
    for name, field in (("S", layers.curved_layer), ("X", layers.crossing_layers)):
        for g in (None, 2.0, 1.0, 0.5, 0.25):
            mesh, steps = SQUARE, []
            for count in (750, 1500, 3000, 6000):
                for _ in range(3):
                    fields = {"u": field(mesh.points)}
                    result = ads.adapt(
                        mesh, anisotropic="u", fields=fields, elements=count, hmax=0.25,
                        g=g, enough=1.1,
                    )  # fmt: skip
                    mesh = result.mesh
                steps.append(layers.Step(mesh, layers.interpolation_error(mesh, field), None, 0.0))
            after = result.report.after
            print(
                f"| {name} | {g} | {layers.number_for(steps, 1e-3):.0f} | "
                f"{after.share_in_band:.2f} | {after.metric.quality_mean:.2f} |",
                flush=True,
            )


def measure_laws():
    """Print elements times error over 1e-3 with growth in physical and metric space, and mixed."""
    laws = {"physical": None, "metric": _edge_sweeps.METRIC, "mixed": _edge_sweeps.MIXED}

    def limited(mesh, metric, g, law):
        if law is None:
            return ads.limit_metric(mesh, metric, g)
        return _edge_sweeps.swept(mesh, metric, g, law)[0]

    for name, field in (("S", layers.curved_layer), ("X", layers.crossing_layers)):
        mesh = SQUARE
        for law, g in ((law, g) for law in laws for g in (1.0, 0.25)):
            for _ in range(3 if mesh is not SQUARE else 4):
                metric = ads.metric_from_hessian(
                    mesh, hessian=second_derivatives(field, mesh.points), elements=2000,
                    hmax=0.25,
                )  # fmt: skip
                for _ in range(3):
                    found = limited(mesh, metric, g, laws[law]).predicted_elements(mesh)
                    metric = metric.scaled(np.sqrt(found / 2000))
                mesh = ads.remesh(mesh, limited(mesh, metric, g, laws[law]))
            number = mesh.n_cells * layers.interpolation_error(mesh, field) / 1e-3
            print(f"| {name} | {law} | {g} | {mesh.n_cells} | {number:.0f} |", flush=True)


def measure_counts():
    """Print cells over predicted cells for constant metrics in random directions."""
    rng = np.random.default_rng(311)
    for mesh, sizes in (
        (SQUARE, [0.02, 0.02]), (SQUARE, [0.01, 0.05]), (SQUARE, [0.005, 0.1]),
        (block(6), [0.08, 0.08, 0.08]), (block(6), [0.04, 0.1, 0.1]),
        (block(6), [0.02, 0.2, 0.2]), (block(6), [0.02, 0.05, 0.2]),
    ):  # fmt: skip
        turn = np.linalg.qr(rng.standard_normal((mesh.dim, mesh.dim)))[0]

        def metric(points, sizes=sizes, turn=turn):
            n = len(points)
            return ads.Metric(np.tile(sizes, (n, 1)), np.tile(turn, (n, 1, 1)))

        new = ads.remesh(mesh, metric)
        found = ads.size_conformity(new, metric)
        share = new.n_cells / metric(mesh.points).predicted_elements(mesh)
        print(
            f"| {' x '.join(map(str, sizes))} | {new.n_cells} | {share:.2f} | "
            f"{found.share_in_band:.2f} | {found.metric.quality_mean:.2f} |",
            flush=True,
        )


def measure_regular():
    """Print the errors for x^T H x / 2 over those on triangles that are regular in the metric.

    The formula is that of benchmarks/anisotropic.py, with H of the eigenvalues 1 and a.
    """
    c, s = np.cos(0.6), np.sin(0.6)
    turn = np.array([[c, -s], [s, c]])
    for a, aspect in (
        (1.0, 1.0),
        (0.04, 10.0),
        (-1.0, 10.0),
        (-0.04, 10.0),
        (0.0, 10.0),
        (0.0, 1.0),
    ):
        hessian = turn @ np.diag([1.0, a]) @ turn.T
        metric = ads.metric_from_hessian(
            SQUARE, hessian=np.tile(hessian, (SQUARE.n_points, 1, 1)), elements=2000,
            max_aspect=aspect,
        )  # fmt: skip
        new = ads.remesh(SQUARE, metric)
        field = lambda x, h=hessian: 0.5 * np.einsum("...i,ij,...j->...", x, h, x)  # noqa: E731
        low = max(abs(a), 1.0 / aspect**2)
        of_h = 27.0 / 8.0 * (1.0 + (a / low) ** 2) + 21.0 / 4.0 * a / low
        regular = 4.0 / np.sqrt(3.0) * np.sqrt(low * of_h / 720.0) / new.n_cells
        share = layers.interpolation_error(new, field) / regular
        print(f"| {a} | {aspect:.0f} | {new.n_cells} | {share:.2f} |", flush=True)


def measure_plate():
    """Print conformity for layers over a flat plate, first height 1e-4, length 0.1."""

    def metric(points):
        height = points[:, 1]
        normals = np.tile([0.0, 1.0], (len(points), 1))
        along = np.minimum(0.1 + 0.2 * height, 0.2)
        return metric_from_layers(height, normals, first_height=1e-4, tangential=along)

    new = ads.remesh(jittered_rectangle([0, 0], [1, 1], 11), metric)
    print(ads.size_conformity(new, metric))


if __name__ == "__main__":
    globals()[f"measure_{sys.argv[1]}"]()
