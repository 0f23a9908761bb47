"""Metrics of the Unstructured Grid Adaptation Working Group with Mmg, limited or not.

    python benchmarks/ugawg.py [--quick] [--output benchmarks/results]

*Cube linear* is the unit cube with sizes of 0.1 by 0.1 by 0.001 + 0.198 |z - 0.5|.  The other
domains are that cube without a cylinder of radius 0.5 around the z axis: *cylinder linear* has the
same sizes; *polar-1* has 0.001 + 0.198 |r - 0.5| along the radius r and 0.1 otherwise; *polar-2*
has the same along r, 0.1 along z, and along the circles 0.025 at the cylinder, which grows to 0.1
at the distance 0.1.  (https://github.com/UGAWG/adapt-benchmarks, polar-2 as in NASA's refine.)

The metric of the formulas is evaluated at the nodes of a mesh, gradient limited or not, and given
to Mmg; this is repeated.  *None*: Mmg without a gradation.  *Mmg*: Mmg with its own, hgrad = 1.3.
*g*: `limit_metric` with this g, and Mmg without a gradation.  *Calls*: of Mmg, until the share in
the band changes by less than half a per cent.  *In band*: edges of lengths between 0.71 and 1.41 in
the metric of the formulas, and in that given to Mmg.  *Edges*: the shortest and the longest in the
metric of the formulas.  *Quality*: the least and the mean of the mean ratio, in the metric of the
formulas at the corner with the largest determinant.  *s*: processor time of Mmg and of
`limit_metric`.  Writes `ugawg.md`, `ugawg.json` and
`ugawg.png`, the meshes of g = 0.25.
"""

import os
import sys
from pathlib import Path

import numpy as np
from _timing import arguments_of, machine, table, three, write

import adaptsize as ads
from adaptsize.metrics import Metric, limit_metric
from adaptsize.remeshing.isolation import IsolatedRunner
from adaptsize.remeshing.mmg import MMG

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
from _gallery import save_panels

H0, H1 = 0.001, 0.1
BAND = (0.71, 1.41)
MOST_CALLS = 8
NONE, OWN = "none", "Mmg"


def layer(distance):
    return H0 + 2.0 * (H1 - H0) * np.abs(distance)


def linear(points):
    sizes = np.full((len(points), 3), H1)
    sizes[:, 2] = layer(points[:, 2] - 0.5)
    return Metric(sizes, np.broadcast_to(np.eye(3), (len(points), 3, 3)))


def polar(points, around):
    """Return the metric of sizes along the radius, the circle and the axis."""
    x, y = points[:, 0], points[:, 1]
    r = np.hypot(x, y)
    c, s, nil = x / r, y / r, np.zeros(len(r))
    axes = np.array([[c, -s, nil], [s, c, nil], [nil, nil, nil + 1.0]]).transpose(2, 0, 1)
    return Metric(np.column_stack([layer(r - 0.5), around(r), nil + H1]), axes)


def polar_1(points):
    return polar(points, lambda r: np.full(len(r), H1))


def polar_2(points):
    def around(r):
        d = np.minimum(10.0 * np.abs(r - 0.5), 1.0)
        return H1 * d + 0.025 * (1.0 - d)

    return polar(points, around)


def cube():
    return ads.CartesianGrid([0.0, 0.0, 0.0], 0.1, (11, 11, 11)).mesh


def without_cylinder(n=16):
    """Return the cube without the cylinder: from the arc to the sides x = 1 and y = 1."""
    grid = ads.CartesianGrid([0.0, 0.0, 0.0], [1.0 / (2 * n), 1.0 / n, 0.1], (2 * n + 1, n + 1, 11))
    t, s, z = grid.mesh.points.T
    angle = 0.5 * np.pi * t
    arc = 0.5 * np.column_stack([np.cos(angle), np.sin(angle)])
    side = np.column_stack([np.clip(2.0 - 2.0 * t, 0.0, 1.0), np.clip(2.0 * t, 0.0, 1.0)])
    plane = (1.0 - s[:, None]) * arc + s[:, None] * side
    return ads.SimplexMesh(np.column_stack([plane, z]), grid.mesh.cells[:, [0, 2, 1, 3]])


CASES = {
    "cube linear": (cube, linear),
    "cylinder linear": (without_cylinder, linear),
    "polar-1": (without_cylinder, polar_1),
    "polar-2": (without_cylinder, polar_2),
}


def adapted(mesh, metric, hgrad):
    """Return the mesh that one call of Mmg makes."""
    boundary = mesh.boundary()
    facets = boundary.nodes[boundary.mesh.cells]
    arrays = {
        "points": mesh.points,
        "cells": mesh.cells,
        "regions": np.zeros(mesh.n_cells, np.int32),
        "facets": facets.astype(np.int32),
        "facet_groups": np.zeros(len(facets), np.int32),
        "ridges": np.empty((0, 2), np.int32),
        "corners": np.empty(0, np.int32),
        "sizes": metric.matrices[(slice(None), *np.tril_indices(3))],
    }
    options = {
        "task": "tetrahedra", "hausd": 1e-3, "hgrad": hgrad, "ridge_angle": 45.0, "n_regions": 1,
        "n_groups": 1, "required_groups": [], "open_boundaries": False,
    }  # fmt: skip
    run = IsolatedRunner("mmg", None, None, lambda *_: None)
    made = run(MMG, "adapting", arrays, options)
    return ads.SimplexMesh(made["points"], made["cells"])


def qualities(mesh, metric):
    """Return the mean ratio of cells in the metric of their corner of the largest determinant."""
    corner = np.take_along_axis(
        mesh.cells, metric.density[mesh.cells].argmax(axis=1)[:, None], axis=1
    )[:, 0]
    root = np.linalg.cholesky(metric.matrices[corner]).swapaxes(1, 2)
    x = np.einsum("cij,cvj->cvi", root, mesh.points[mesh.cells])
    pairs = np.array([(a, b) for a in range(4) for b in range(a)])
    squares = ((x[:, pairs[:, 0]] - x[:, pairs[:, 1]]) ** 2).sum(axis=(1, 2))
    volume = np.linalg.det(x[:, 1:] - x[:, :1]) / 6.0
    return 12.0 * np.cbrt(3.0 * np.maximum(volume, 0.0)) ** 2 / squares


def in_band(lengths):
    return float(((lengths >= BAND[0]) & (lengths <= BAND[1])).mean())


def run(case, gradation, most_calls=MOST_CALLS):
    """Return the row of a case, and the last mesh."""
    domain, formula = CASES[case]
    mesh, before, seconds = domain(), -1.0, 0.0
    calls = 0
    while calls < most_calls:
        calls += 1
        given = formula(mesh.points)
        start = sum(os.times()[:4])  # with children
        if gradation not in (NONE, OWN):
            given = limit_metric(mesh, given, gradation, threads=1)
        mesh = adapted(mesh, given, 1.3 if gradation == OWN else -1.0)
        seconds += sum(os.times()[:4]) - start
        wanted = formula(mesh.points)
        lengths = wanted.edge_lengths(mesh.points, mesh.edges)
        share = in_band(lengths)
        if abs(share - before) < 0.005:
            break
        before = share
    judged = wanted if gradation in (NONE, OWN) else limit_metric(mesh, wanted, gradation)
    quality = qualities(mesh, wanted)
    return {
        "case": case,
        "gradation": gradation if isinstance(gradation, str) else f"g = {gradation:g}",
        "calls": calls,
        "cells": mesh.n_cells,
        "in band": share,
        "in band, as given": in_band(judged.edge_lengths(mesh.points, mesh.edges)),
        "shortest": float(lengths.min()),
        "longest": float(lengths.max()),
        "least quality": float(quality.min()),
        "mean quality": float(quality.mean()),
        "complexity": wanted.complexity(mesh),
        "seconds": seconds,
    }, mesh


def write_picture(path, meshes):
    """Write the outsides of meshes, coloured by the smallest size of the formulas."""
    panels = []
    for case, mesh in meshes.items():
        h = CASES[case][1](mesh.points).sizes.min(axis=1)
        shown = mesh.with_data(point_data={"h": h})
        image = ads.plot.plot_mesh(shown, color="h", clip=None, limits=(H0, H1), width=700)
        panels.append((f"{case}, {mesh.n_cells} cells", image))
    save_panels(path, panels, columns=2)


def main():
    arguments = arguments_of(__doc__)
    rows, meshes = [], {}
    for case in ["cube linear"] if arguments.quick else CASES:
        for gradation in (NONE, OWN, 0.25, 0.1):
            row, mesh = run(case, gradation)
            rows.append(row)
            if gradation == 0.25:
                meshes[case] = mesh
            print(row, flush=True)
    heads = ["case", "gradation", "calls", "cells", "in band", "as given", "edges", "quality", "s"]
    lines = [
        [
            row["case"], row["gradation"], row["calls"], row["cells"], f"{row['in band']:.1%}",
            f"{row['in band, as given']:.1%}", f"{row['shortest']:.2f} to {row['longest']:.2f}",
            f"{row['least quality']:.3f}, {row['mean quality']:.2f}", three(row["seconds"]),
        ]
        for row in rows
    ]  # fmt: skip
    text = "\n\n".join(["# Metrics of the working group", machine(), table(heads, lines)]) + "\n"
    write(arguments.output, "ugawg", text, {"rows": rows})
    write_picture(arguments.output / "ugawg.png", meshes)


if __name__ == "__main__":
    main()
