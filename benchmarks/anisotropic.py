"""Anisotropic adaptation beside isotropic: elements, errors of interpolation, and time.

    python benchmarks/anisotropic.py [--quick] [--output benchmarks/results]

The fields of examples/plot_anisotropic_layers.py, and in the unit cube
tanh(30 (x - 1/2 - sin(2 pi y) / 10)) and tanh(30 (|x| - 0.7)).  Each row continues the loop of the
row above with two or three cycles of `adapt`, to about the number of elements.  *Error*: of linear
interpolation, in the norm of L2; *largest*: at 60 random points in each cell.
*Scaled*: the error times N^(2/d) for N elements, constant at the optimal order.  *Order*: p of
errors proportional to N^-p, from the row above.  *In band*: share of the edges with lengths within
sqrt 2 of the last request.  *Aspect*: largest aspect ratio of a cell.  *s*: processor time with
that of Mmg; kernels compiled beforehand.

The second table compares elements for the same error, interpolated between the rows (never
extrapolated).  *Regular*: elements for the same error if all were exactly regular in the metric, by
quadrature on a grid with the exact second derivatives.  *Without g*: the same without gradient
limiting.  Regular tetrahedra do not fill space, so that no mesh has so few.

On a regular simplex of volume V, with H the second derivatives in coordinates in which its edges
have length 1, the square of the error for x^T H x / 2 is V (21/8 tr(H)^2 + 3/4 tr(H^2)) / 720 in
the plane, and V (4 tr(H)^2 + tr(H^2)) / 1680 in space, where it is the mean over all orientations.
Both are integrals of the error -1/2 sum l_i l_j e_ij^T H e_ij, summed over the edges e_ij, with
barycentric coordinates l.  This assumes that the layers are resolved.
Writes `anisotropic.md` and `anisotropic.json`.
"""

import sys
from pathlib import Path
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
from typing import NamedTuple

import numpy as np
from _fields import layer_in_space, second_derivatives, spherical_layer
from _timing import arguments_of, machine, table, three, write

import adaptsize as ads

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
import plot_anisotropic_layers as layers
from _gallery import jittered_rectangle
from shapes import block

#: Gradient limits of the loops.
LIMITS = {"isotropic": 0.25, "anisotropic": 1.0}
NUMBERS = layers.NUMBERS
NUMBERS_IN_SPACE = {
    "isotropic": (12500, 25000, 50000, 100000, 200000),
    "anisotropic": (2500, 5000, 10000, 20000, 40000),
}


class Case(NamedTuple):
    """A field, and the grid of the quadrature."""

    field: layers.Field
    nodes: tuple[int, ...]
    goals: tuple[float, ...]
    """Errors at which elements are compared."""


CASES = {
    "S-shaped layer": Case(layers.curved_layer, (301, 301), (1e-3,)),
    "crossing layers": Case(layers.crossing_layers, (301, 301), (1e-3,)),
    "sheet in space": Case(layer_in_space, (121, 121, 2), (1.2e-2, 6.5e-3)),
    "sphere in space": Case(spherical_layer, (49, 49, 49), (1e-2, 5e-3)),
}


def seconds():
    """Return the processor time of this process and of those it started."""
    used = [getrusage(who) for who in (RUSAGE_SELF, RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def rows_of(name, kind, numbers):
    """Return the steps of a loop, and a row for each."""
    field, nodes, _ = CASES[name]
    mesh = block(8) if len(nodes) == 3 else jittered_rectangle([0, 0], [1, 1], 30)
    steps, rows = [], []
    for number in numbers:
        start = seconds()
        step = layers.loop(mesh, field, kind, (number,))[0]
        took, mesh = seconds() - start, step.mesh
        steps.append(step)
        rows.append({
            "field": name, "kind": kind, "elements": mesh.n_cells, "error": step.error,
            "largest": layers.interpolation_error(mesh, field, norm=np.inf),
            "scaled": step.error * mesh.n_cells ** (2.0 / mesh.dim),
            "order": layers.order(steps) if len(steps) > 1 else None, "in band": step.in_band,
            "aspect": float(mesh.implied_metric().aspect_ratio.max()), "s": took,
        })  # fmt: skip
    return steps, rows


def regular_number(case, kind, g, goal, number):
    """Return the elements for an error, all regular in the optimal, limited metric."""
    shape = np.array(case.nodes)
    dim = len(shape)
    grid = ads.CartesianGrid(np.zeros(dim), 1.0 / (shape - 1), case.nodes)
    mesh = grid.mesh
    hessian = second_derivatives(case.field, mesh.points)
    requested = hessian
    if kind == "isotropic":  # the largest second derivative in all directions
        requested = np.abs(np.linalg.eigvalsh(hessian)).max(axis=1)[:, None, None] * np.eye(dim)
    order, before = 2.0 / dim, None
    for _ in range(8):
        metric = ads.metric_from_hessian(mesh, hessian=requested, elements=number, hmax=layers.HMAX)
        limited = metric if g is None else ads.limit_metric(grid, metric, g)
        found = limited.predicted_elements(mesh)
        excess = np.log(error_of_regular(mesh, limited, hessian) / goal)
        if abs(excess) < 0.03:
            break
        if before is not None:  # the secant method; few elements have a higher order
            order = (before[1] - excess) / np.log(number / before[0])
            order = float(np.clip(order, 2.0 / dim, 4.0))
        before = number, excess
        number *= np.exp(excess / order)
    return float(found * np.exp(excess / order))


def error_of_regular(mesh, metric, hessian):
    """Return the norm of L2 of the error on simplices that are regular in a metric."""
    length = np.einsum("nij,nj,nkj->nik", metric.directions, metric.sizes, metric.directions)
    values = np.linalg.eigvalsh(length @ hessian @ length)
    trace, of_squares = values.sum(axis=1) ** 2, (values**2).sum(axis=1)
    squares = (21.0 / 8.0 * trace + 0.75 * of_squares) / 720.0
    if mesh.dim == 3:
        squares = (4.0 * trace + of_squares) / 1680.0
    return np.sqrt((squares[mesh.cells].mean(axis=1) * mesh.measures).sum())


def summary(steps):
    """Return rows of the elements for equal errors, those of regular ones, and their ratios."""
    rows = []
    for name, goal in [(key, goal) for key, case in CASES.items() for goal in case.goals]:
        if (name, layers.KINDS[0]) not in steps:
            continue
        found = {}
        for kind in layers.KINDS:
            errors = [step.error for step in steps[name, kind]]
            if not min(errors) <= goal <= max(errors):
                break
            made = layers.number_for(steps[name, kind], goal)
            regular = [
                regular_number(CASES[name], kind, g, goal, made) for g in (LIMITS[kind], None)
            ]
            found[kind] = np.array([made, *regular])
            rows.append([name, f"{goal:.1e}", kind, *np.rint(found[kind]).astype(int).tolist()])
        if len(found) == 2:
            ratios = found["isotropic"] / found["anisotropic"]
            rows.append([name, f"{goal:.1e}", "ratio", *np.round(ratios, 1).tolist()])
    return rows


def main():
    options = arguments_of(__doc__)
    layers.loop(jittered_rectangle([0, 0], [1, 1], 12), layers.curved_layer, "isotropic", (300,))
    layers.loop(jittered_rectangle([0, 0], [1, 1], 12), layers.curved_layer, "anisotropic", (300,))
    steps, rows = {}, []
    for name, case in CASES.items():
        in_space = len(case.nodes) == 3
        numbers = NUMBERS_IN_SPACE if in_space else NUMBERS
        for kind in layers.KINDS:
            few = numbers[kind][:2] if options.quick else numbers[kind]
            if not (options.quick and in_space):
                steps[name, kind], found = rows_of(name, kind, few)
                rows += found
    compared = summary(steps)
    formats = {
        "error": "{:.2e}", "largest": "{:.1e}", "scaled": "{:.2f}", "order": "{:.2f}",
        "in band": "{:.2f}", "aspect": "{:.0f}",
    }  # fmt: skip
    cells = [
        [
            "" if v is None else three(v) if k == "s" else formats.get(k, "{}").format(v)
            for k, v in row.items()
        ]
        for row in rows
    ]
    heads = ["field", "error", "sizes", "elements", "regular", "regular without g"]
    text = "\n\n".join([
        "# Anisotropic adaptation", machine(), table(list(rows[0]), cells),
        table(heads, compared),
    ])  # fmt: skip
    report = {"machine": machine(), "loops": rows, "elements": compared}
    write(options.output, "anisotropic", text + "\n", report)


if __name__ == "__main__":
    main()
