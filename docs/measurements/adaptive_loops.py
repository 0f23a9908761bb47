"""Measure the figures of docs/adaptive-loops.md; needs Mmg.

python docs/measurements/adaptive_loops.py counts mmg 2     (two minutes)
python docs/measurements/adaptive_loops.py counts mmg 3     (twelve)
python docs/measurements/adaptive_loops.py counts tetwild 3 (twenty)
python docs/measurements/adaptive_loops.py held-out mmg 2   (and so on)
python docs/measurements/adaptive_loops.py boundary
"""

import sys
from itertools import permutations
from pathlib import Path

import numpy as np

import adaptsize as ads
from adaptsize import SimplexMesh
from adaptsize.sizes import predict

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "support"))
import domains
from meshes import jittered_square, structured_square

G = 0.25


def l_shape(n):
    """Return triangles of an L."""
    mesh = structured_square(n, half_width=1.0)
    x, y = mesh.points[mesh.cells].mean(axis=1).T
    return SimplexMesh(mesh.points, mesh.cells[(x < 0.0) | (y > 0.0)])


def block(n, keep=None, *, scale=(1.0, 1.0, 1.0)):
    """Return tetrahedra of the cube (-1, 1)^3, scaled, or of what is kept of it."""
    axis = np.linspace(-1.0, 1.0, n + 1)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange((n + 1) ** 3).reshape((n + 1,) * 3)
    base = np.indices((n,) * 3).reshape(3, -1).T
    cells = []
    for order in permutations(range(3)):  # Kuhn's six tetrahedra of a cube
        path = [base]
        for axis_number in order:
            path.append(path[-1] + np.eye(3, dtype=int)[axis_number])
        cells.append(np.stack([number[tuple(corner.T)] for corner in path], axis=1))
    cells = np.concatenate(cells)
    if keep is not None:
        cells = cells[keep(points[cells].mean(axis=1))]
    return SimplexMesh(points * scale, cells)


def rounded(n, axes):
    """Return a ball (three axes) or a cylinder (two)."""
    mesh = block(n)
    points = np.array(mesh.points)
    part = points[:, axes]
    length = np.linalg.norm(part, axis=1, keepdims=True)
    points[:, axes] = part * np.abs(part).max(axis=1, keepdims=True) / np.maximum(length, 1e-30)
    return SimplexMesh(points, mesh.cells)


def shrunk(mesh):
    """Return a mesh of (-50, 50)^2 on (-1, 1)^2."""
    return SimplexMesh(mesh.points / 50.0, mesh.cells)


def fichera(n):
    """Return the cube without one of its eighths."""
    return block(n, lambda x: ~(x > 0.0).all(axis=1))


PLANE = {
    "square": lambda: jittered_square(15, 3, half_width=1.0),
    "L": lambda: l_shape(12),
    "disc": lambda: domains.disc(300, radius=1.0)[0],
    "holes": lambda: shrunk(domains.round_holes(2000)[0]),
    "maze": lambda: shrunk(domains.maze(2000)[0]),
}
SPACE = {  # cells along an edge for Mmg, and for fTetWild
    "cube": lambda fine: block(6 if fine else 5),
    "Fichera": lambda fine: fichera(6 if fine else 4),
    "ball": lambda fine: rounded(8 if fine else 6, [0, 1, 2]),
    "plate": lambda fine: block(6 if fine else 4, scale=(2.0, 1.0, 0.25)),
}
SHAPES = {
    "uniform": lambda x: np.ones(len(x)),
    "corner": lambda x: 0.02 + np.linalg.norm(x, axis=1) ** 0.75,
    "layer": lambda x: 0.15 + np.abs(np.linalg.norm(x, axis=1) - 0.6),
    "wave": lambda x: np.exp(1.2 * np.sin(4.0 * x[:, 0]) * np.cos(3.0 * x[:, 1])),
    "edge": lambda x: 0.05 + np.linalg.norm(x[:, :2], axis=1) ** 0.7,
}


def counts(backend, dim):
    """Print elements made over elements predicted."""
    ratios = []
    fine = backend == "mmg"
    for name, make in (PLANE if dim == 2 else SPACE).items():
        for shape in ("uniform", "corner", "layer", "wave" if dim == 2 else "edge"):
            for wanted in {2: (1000, 8000), 3: (5000, 20_000) if fine else (3000, 8000)}[dim]:
                mesh = make() if dim == 2 else make(fine)
                for cycle in range(2 if fine or wanted < 5000 else 1):
                    h = sizes_for(mesh, SHAPES[shape](mesh.points), wanted)
                    predicted = predict(mesh, h).cells
                    mesh = ads.remesh(mesh, ads.SizeFunction(mesh, h), backend=backend)
                    ratios.append(mesh.n_cells / predicted)
                    print(name, shape, wanted, cycle, round(predicted), mesh.n_cells,
                          f"{ratios[-1]:.3f}", flush=True)  # fmt: skip
    print(len(ratios), np.quantile(ratios, [0.0, 0.1, 0.5, 0.9, 1.0]).round(3))


def sizes_for(mesh, shape, wanted):
    """Return limited sizes like ``shape`` with the number of elements wanted."""
    scale = (predict(mesh, shape).cells / wanted) ** (1.0 / mesh.cell_dim)
    for _ in range(20):
        h = ads.limit_gradient(mesh, scale * shape, G, method="fast-marching")
        scale *= (predict(mesh, h).cells / wanted) ** (1.0 / mesh.cell_dim)
    return h


HELD_OUT = {
    2: {
        "channel": lambda _: SimplexMesh(
            structured_square(12, half_width=1.0).points * [2.0, 0.5], structured_square(12).cells
        ),
        "star": lambda _: shrunk(domains.star_holes(1500)[0]),
        "slot": lambda _: shrunk(domains.slit_square(800, width=4.0)[0]),
    },
    3: {
        "cylinder": lambda fine: rounded(6 if fine else 5, [0, 1]),
        "L-beam": lambda fine: block(
            6 if fine else 4, lambda x: (x[:, :2] < 0.0).any(axis=1), scale=(1.0, 1.0, 0.4)
        ),
    },
}


def indicator(mesh, kind):
    """Return an error at two points, along a line, or anywhere."""
    x = mesh.points[mesh.cells].mean(axis=1)
    size = mesh.measures ** (1.0 / mesh.dim + 0.5)
    if kind == "two points":
        away = [0.05 + np.linalg.norm(x - place, axis=1) for place in (0.6, -0.5)]
        return size * (1.0 / away[0] + 2.0 / away[1])
    if kind == "line":
        return size * np.exp(-8.0 * np.abs(x[:, 0] - 0.3 * x[:, 1]))
    return size * np.exp(np.random.default_rng(5).normal(size=len(x)))


def held_out(backend, dim):
    """Print elements made over elements asked for, by ``adapt``."""
    fine = backend == "mmg"
    numbers = {2: (800, 3000, 12_000), 3: (4000, 15_000) if fine else (2500, 6000)}[dim]
    for name, make in HELD_OUT[dim].items():
        for kind in ("two points", "line", "random")[: 3 if fine else 2]:
            for wanted in numbers:
                mesh = make(fine)
                for cycle in range(2 if fine else 1):
                    result = ads.adapt(mesh, indicator(mesh, kind), elements=wanted,
                                       backend=backend, enough=2.0, max_refine=8.0)  # fmt: skip
                    mesh = result.mesh
                    print(name, kind, wanted, cycle, mesh.n_cells, f"{mesh.n_cells / wanted:.3f}",
                          f"{result.report.n_meshes} meshes", flush=True)  # fmt: skip


def on_unit_sphere(x):
    """Return the nearest points of the circle or the sphere."""
    return x / np.linalg.norm(x, axis=1, keepdims=True)


def boundary():
    """Print how far nodes are from a circle and a sphere, and the missing area or volume."""
    cases = (
        ("disc", domains.disc(217, radius=1.0)[0], 2000, "mmg", 4),
        ("ball", rounded(8, [0, 1, 2]), 12_000, "mmg", 4),
        ("ball", rounded(6, [0, 1, 2]), 4000, "tetwild", 2),
    )
    for name, start, wanted, backend, n_cycles in cases:
        for project in (None, on_unit_sphere):
            mesh = start
            exact = np.pi if mesh.dim == 2 else 4.0 / 3.0 * np.pi
            print(name, backend, "projected" if project else "as it is",
                  f"{mesh.measures.sum() / exact - 1.0:.2e}")  # fmt: skip
            for cycle in range(n_cycles):
                place = np.zeros(mesh.dim)
                place[:2] = np.cos(cycle), np.sin(cycle)
                x = mesh.points[mesh.cells].mean(axis=1)
                eta = mesh.measures ** (1.0 / mesh.dim + 0.5)
                eta *= np.exp(-3.0 * np.linalg.norm(x - place, axis=1))
                result = ads.adapt(mesh, eta, elements=wanted, backend=backend,
                                   project=project, enough=2.0)  # fmt: skip
                mesh, report = result.mesh, result.report
                radii = np.linalg.norm(mesh.points[mesh.boundary().nodes], axis=1)
                print(f"  cycle {cycle}: {mesh.n_cells} cells, "
                      f"measure {mesh.measures.sum() / exact - 1.0:.2e}, "
                      f"radii {radii.min() - 1.0:.1e} {radii.max() - 1.0:.1e}, from the old "
                      f"boundary {report.boundary_distance / mesh.diagonal:.1e} diagonals, "
                      f"radius ratio {report.after.radius_ratio_min:.3f}; {report.moves}",
                      flush=True)  # fmt: skip


if __name__ == "__main__":
    task, *rest = sys.argv[1:]
    if task == "boundary":
        boundary()
    else:
        {"counts": counts, "held-out": held_out}[task](rest[0], int(rest[1]))
