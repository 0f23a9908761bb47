"""Anisotropic adaptation beside isotropic: elements, errors of interpolation, and time.

    python benchmarks/anisotropic.py [--quick] [--output benchmarks/results]

The fields of examples/plot_anisotropic_layers.py, and tanh(30 (x - 1/2 - sin(2 pi y) / 10)) in the
unit cube.  Each row continues the loop of the row above with two or three cycles of `adapt`, to
about the number of elements.  *Error*: of linear interpolation, in the norm of L2.
*Scaled*: the error times N^(2/d) for N elements, constant at the optimal order.  *In band*: share
of the edges with lengths within sqrt 2 of the last request.  *Aspect*: largest aspect ratio of a
cell.  *s*: processor time with that of Mmg; kernels compiled beforehand.

The second table is for the plane.  *Elements for 0.001*: interpolated between the rows.
*Regular*: elements for the same error if all were exactly regular in the metric, by quadrature on
a grid of 301 x 301 nodes with the exact second derivatives.  For x^T H x / 2 on a triangle of area
A and edges e_k, the square of the error is A (sum d_k^2 + (sum d_k)^2) / 720 with d_k = e_k^T H
e_k, and A (27/8 (a^2 + b^2) + 21/4 a b) / 720 if it is equilateral with edges of length 1 and a, b
are the eigenvalues of H, here in the metric.  *Without g*: the same without gradient limiting.
Writes `anisotropic.md` and `anisotropic.json`.
"""

import sys
from pathlib import Path
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage

import numpy as np
from _fields import layer_in_space, second_derivatives
from _timing import arguments_of, machine, table, three, write

import adaptsize as ads
from adaptsize.metrics import implied_metric, predicted_simplices

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
import plot_anisotropic_layers as layers
from _gallery import jittered_rectangle
from shapes import block

GOAL = 1e-3
#: Gradient limits of the loops.
LIMITS = {"isotropic": 0.25, "anisotropic": 1.0}
NUMBERS = layers.NUMBERS
NUMBERS_IN_SPACE = {"isotropic": (12500, 25000), "anisotropic": (2500, 5000)}


FIELDS = {
    "S-shaped layer": layers.curved_layer,
    "crossing layers": layers.crossing_layers,
    "layer in space": layer_in_space,
}


def seconds():
    """Return the processor time of this process and of those it started."""
    used = [getrusage(who) for who in (RUSAGE_SELF, RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def rows_of(name, kind, numbers):
    """Return the steps of a loop, and a row for each."""
    field, in_space = FIELDS[name], name == "layer in space"
    mesh = block(8) if in_space else jittered_rectangle([0, 0], [1, 1], 30)
    steps, rows = [], []
    for number in numbers:
        start = seconds()
        step = layers.loop(mesh, field, kind, (number,))[0]
        took, mesh = seconds() - start, step.mesh
        steps.append(step)
        rows.append({
            "field": name, "kind": kind, "elements": mesh.n_cells, "error": step.error,
            "scaled": step.error * mesh.n_cells ** (2.0 / mesh.dim), "in band": step.in_band,
            "aspect": float(implied_metric(mesh).aspect_ratio.max()), "s": took,
        })  # fmt: skip
    return steps, rows


def regular_number(field, kind, g, number, n=301):
    """Return the elements for an error of `GOAL`, all regular in the optimal, limited metric."""
    grid = ads.CartesianGrid([0.0, 0.0], 1.0 / (n - 1), (n, n))
    mesh = grid.mesh
    hessian = second_derivatives(field, mesh.points)
    requested = hessian
    if kind == "isotropic":  # the largest second derivative in all directions
        requested = np.abs(np.linalg.eigvalsh(hessian)).max(axis=1)[:, None, None] * np.eye(2)
    metric = ads.metric_from_hessian(
        mesh, hessian=requested, target_elements=number, hmax=layers.HMAX
    )
    for _ in range(4):
        limited = metric if g is None else ads.limit_metric(grid, metric, g)
        metric = metric.scaled(np.sqrt(predicted_simplices(mesh, limited) / number))
    length = np.einsum("nij,nj,nkj->nik", limited.directions, limited.sizes, limited.directions)
    a, b = np.linalg.eigvalsh(length @ hessian @ length).T
    squares = (27.0 / 8.0 * (a * a + b * b) + 21.0 / 4.0 * a * b) / 720.0
    error = np.sqrt((squares[mesh.cells].mean(axis=1) * mesh.measures).sum())
    return float(predicted_simplices(mesh, limited) * error / GOAL)


def summary(steps):
    """Return rows of the elements for `GOAL`, those of regular triangles, and their ratios."""
    rows = []
    for name in ("S-shaped layer", "crossing layers"):
        found = {}
        for kind in layers.KINDS:
            made = layers.number_for(steps[name, kind], GOAL)
            regular = [regular_number(FIELDS[name], kind, g, made) for g in (LIMITS[kind], None)]
            found[kind] = np.array([made, *regular])
            rows.append([name, kind, *np.rint(found[kind]).astype(int).tolist()])
        ratios = found["isotropic"] / found["anisotropic"]
        rows.append([name, "ratio", *np.round(ratios, 1).tolist()])
    return rows


def main():
    options = arguments_of(__doc__)
    layers.loop(jittered_rectangle([0, 0], [1, 1], 12), layers.curved_layer, "isotropic", (300,))
    layers.loop(jittered_rectangle([0, 0], [1, 1], 12), layers.curved_layer, "anisotropic", (300,))
    steps, rows = {}, []
    for name in FIELDS:
        numbers = NUMBERS_IN_SPACE if name == "layer in space" else NUMBERS
        for kind in layers.KINDS:
            few = numbers[kind][:2] if options.quick else numbers[kind]
            if not options.quick or name != "layer in space":
                steps[name, kind], found = rows_of(name, kind, few)
                rows += found
    compared = summary(steps)
    formats = {"error": "{:.2e}", "scaled": "{:.2f}", "in band": "{:.2f}", "aspect": "{:.0f}"}
    cells = [[three(v) if k == "s" else formats.get(k, "{}").format(v) for k, v in row.items()]
             for row in rows]  # fmt: skip
    heads = ["field", "sizes", "elements for 0.001", "regular", "regular without g"]
    text = "\n\n".join([
        "# Anisotropic adaptation", machine(), table(list(rows[0]), cells),
        table(heads, compared),
    ])  # fmt: skip
    report = {"machine": machine(), "loops": rows, "elements": compared}
    write(options.output, "anisotropic", text + "\n", report)


if __name__ == "__main__":
    main()
