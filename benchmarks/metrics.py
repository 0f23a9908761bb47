"""Gradation of metrics: error of sweeps over edges, order of intersections, and time.

    python benchmarks/metrics.py [--quick] [--output benchmarks/results]

One core; kernels compiled beforehand; process time of one run.  *Layer*: second derivatives of
tanh(60 (x - 0.5 - 0.1 sin 2 pi y)) at all nodes, sizes for an error of 0.001, from 0.0001 to 0.3.
*Two points*: sizes of 0.001 by 0.1 and 0.002 by 0.2 at two opposite corners, in different
directions.  *Noise*: sizes of 0.001 to 1 in random directions at all nodes.  g = 0.3.  *Too large
by*: of the sizes by sweeps over edges, the largest ratio in any direction to those by growth from
all nodes along straight lines, intersected two by two in the order of the nodes, less 1; *too small
by*: the inverse.  *By order*: the same for the opposite order of the nodes.  *Elements*: those of
intersection two by two over those of `limit_metric`.  *Again*: change by limiting the result
of `limit_metric` a second time.  *s exact*: its time.  Writes `metrics.md` and `metrics.json`.
"""

import time

import numpy as np
from _edge_sweeps import METRIC, MIXED, PHYSICAL, swept, two_by_two
from _timing import arguments_of, machine, table, three, write
from scipy.spatial import Delaunay

import adaptsize as ads
from adaptsize.metrics import Metric, limit_metric

G = 0.3
LAWS = {"physical": PHYSICAL, "metric": METRIC, "mixed": MIXED}


def square(n, dim):
    """Return Delaunay cells of jittered points of the unit square or cube."""
    rng = np.random.default_rng(3)
    axis = np.linspace(0.0, 1.0, n)
    points = np.stack(np.meshgrid(*[axis] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    inner = ((points > 0.0) & (points < 1.0)).all(axis=1)
    points[inner] += rng.uniform(-0.3, 0.3, (inner.sum(), dim)) / n
    return ads.SimplexMesh(points, Delaunay(points).simplices)


def layer(mesh):
    x, y = mesh.points[:, 0], mesh.points[:, 1]
    wave = 2.0 * np.pi * y
    s, c = np.sin(wave), np.cos(wave)
    t = np.tanh(60.0 * (x - 0.5 - 0.1 * s))
    first = np.zeros((mesh.n_points, mesh.dim))
    first[:, 0], first[:, 1] = 60.0, -12.0 * np.pi * c
    slope, second = 1.0 - t * t, -2.0 * t * (1.0 - t * t)
    hessian = second[:, None, None] * first[:, :, None] * first[:, None, :]
    hessian[:, 1, 1] += slope * 24.0 * np.pi**2 * s
    return ads.metric_from_hessian(
        mesh, hessian=hessian, tolerance=1e-3, norm=np.inf, hmin=1e-4, hmax=0.3
    )


def random_directions(rng, n, dim):
    return np.linalg.qr(rng.normal(size=(n, dim, dim)))[0]


def two_points(mesh):
    sizes = np.full(mesh.points.shape, np.inf)
    sizes[0], sizes[-1] = [0.001] + [0.1] * (mesh.dim - 1), [0.002] + [0.2] * (mesh.dim - 1)
    return Metric(sizes, random_directions(np.random.default_rng(9), mesh.n_points, mesh.dim))


def noise(mesh):
    rng = np.random.default_rng(5)
    sizes = 10.0 ** rng.uniform(-3.0, 0.0, mesh.points.shape)
    return Metric(sizes, random_directions(rng, mesh.n_points, mesh.dim))


FIELDS = {"two points": two_points, "layer": layer, "noise": noise}


def excess(present, other):
    """Return by how much sizes of ``present`` exceed those of another metric, as a ratio less 1."""
    s = present.directions * present.sizes[:, None, :]
    relative = (other.directions.swapaxes(1, 2) @ s) / other.sizes[:, :, None]
    return np.linalg.norm(relative, 2, axis=(1, 2)) - 1.0


def timed(function, *arguments, **options):
    start = time.process_time()
    result = function(*arguments, **options)
    return result, time.process_time() - start


def errors(mesh, name):
    """Return rows of the errors of sweeps, and of the effect of the order of intersections."""
    metric, rows = FIELDS[name](mesh), []
    exact, seconds = timed(limit_metric, mesh, metric, G, threads=1)
    again = excess(exact, limit_metric(mesh, exact, G, threads=1)).max()
    for label, law in LAWS.items():
        (found, sweeps), of_sweeps = timed(swept, mesh, metric, G, law)
        one = two_by_two(mesh, metric, G, law)
        other = two_by_two(mesh, metric, G, law, backwards=True)
        order = max(excess(one, other).max(), excess(other, one).max())
        over, under = excess(found, one).max(), excess(one, found).max()
        extra = one.complexity(mesh) / exact.complexity(mesh) if law == PHYSICAL else ""
        rows.append([name, label, sweeps, over, under, order, extra, of_sweeps])
    rows[0] += [again, seconds]
    return rows


def times(n, dim):
    """Return rows of times, sources and active sources."""
    mesh, rows = square(n, dim), []
    for name, field in FIELDS.items():
        metric = field(mesh)
        (_, info), seconds = timed(limit_metric.with_info, mesh, metric, G, threads=1)
        rows.append([f"{dim}-D, {mesh.n_points}", name, info.n_sources, info.n_active.mean(),
                     seconds, seconds / mesh.n_points * 1e6])  # fmt: skip
    return rows


def main():
    options = arguments_of(__doc__)
    small = square(12, 2), square(6, 3)
    for mesh in small:  # compile
        for name in FIELDS:
            errors(mesh, name)
    sides = (((20, 2), (8, 3)), ((40, 2), (10, 3))) if options.quick else (
        ((40, 2), (9, 3)), ((316, 2), (46, 3)))  # fmt: skip
    accuracy = [[f"{dim}-D, {n**dim}", *row] for n, dim in sides[0]
                for name in FIELDS for row in errors(square(n, dim), name)]  # fmt: skip
    speed = [row for n, dim in sides[1] for row in times(n, dim)]
    heads = ["nodes", "field", "growth", "sweeps", "too large by", "too small by", "by order",
             "elements", "s", "again", "s exact"]  # fmt: skip
    heads_of_speed = ["nodes", "field", "sources", "active per node", "s", "us per node"]
    text = "\n\n".join([
        "# Gradation of metrics", machine(),
        table(heads, [[cell_of(cell) for cell in row] + [""] * (len(heads) - len(row))
                      for row in accuracy]),
        table(heads_of_speed, [[cell_of(cell) for cell in row] for row in speed]),
    ])  # fmt: skip
    report = {"machine": machine(), "accuracy": accuracy, "speed": speed}
    write(options.output, "metrics", text + "\n", report)


def cell_of(value):
    """Return a cell of a table: a number to two or three figures, 0 below 1e-6."""
    if isinstance(value, str | int):
        return value
    return "0" if value < 1e-6 else f"{value:.1e}" if value < 1e-3 else three(value)


if __name__ == "__main__":
    main()
