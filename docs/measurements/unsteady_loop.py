"""An unsteady adaptive loop, and advection of a cone, with each transfer of nodal fields.

The last column is the processor time of a remesh, with all that `adapt` does.

The table and the figure of docs/adaptive-loops.md:  python docs/measurements/unsteady_loop.py

Heat: u_t - k div grad u = f on the unit square, linear elements, Crank-Nicolson, remeshed after
every second step.  The source f is such that the solution is a spot of constant shape that moves.
Cone: u_t + div(a u) = 0 with a rotation a, the Galerkin method and Crank-Nicolson, 400 steps once
round, remeshed after every tenth.
"""

from __future__ import annotations

import argparse
import resource
from pathlib import Path

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

import adaptsize as ads

FIGURE = Path(__file__).parents[1] / "figures" / "unsteady_loop.png"
METHODS = ("interpolate", "project", "bounded")
LOCAL = "bounded, local"
CONDUCTIVITY, WIDTH = 1e-3, 0.04


def centre(t):
    """Return where the spot is: on an eighth of a circle from t = 0 to 1."""
    return 0.5 + 0.25 * np.array([np.cos(0.25 * np.pi * t), np.sin(0.25 * np.pi * t)])


def spot(x, t):
    """Return the solution."""
    return np.exp(-((x - centre(t)) ** 2).sum(axis=-1) / WIDTH**2)


def source(x, t):
    """Return u_t - k div grad u of the spot."""
    away = x - centre(t)
    speed = 0.0625 * np.pi * np.array([-np.sin(0.25 * np.pi * t), np.cos(0.25 * np.pi * t)])
    square = (away**2).sum(axis=-1)
    rate = 2.0 * (away @ speed) / WIDTH**2
    laplacian = (4.0 * square / WIDTH**2 - 4.0) / WIDTH**2
    return (rate - CONDUCTIVITY * laplacian) * spot(x, t)


class Quadrature:
    """Points of degree 5 in each triangle, and the functions and gradients of linear elements."""

    def __init__(self, mesh):
        a, b = (6.0 - np.sqrt(15.0)) / 21.0, (6.0 + np.sqrt(15.0)) / 21.0
        rows = [[1 / 3] * 3]
        weights = [9 / 40]
        for s, w in ((a, (155 - np.sqrt(15)) / 1200), (b, (155 + np.sqrt(15)) / 1200)):
            rows += [[1 - 2 * s, s, s], [s, 1 - 2 * s, s], [s, s, 1 - 2 * s]]
            weights += [w] * 3
        self.mesh, self.shapes = mesh, np.array(rows)
        self.weights = np.array(weights) * mesh.measures[:, None]
        self.points = np.einsum("qv,cvd->cqd", self.shapes, mesh.points[mesh.cells])

    def load(self, values):
        """Return the integrals of values at the points with each hat function."""
        by_corner = np.einsum("cq,cq,qv->cv", self.weights, values, self.shapes)
        return np.bincount(self.mesh.cells.ravel(), by_corner.ravel(), self.mesh.n_points)

    def error(self, u, exact):
        """Return the L2 norm of the error, relative to that of the exact solution."""
        difference = u[self.mesh.cells] @ self.shapes.T - exact
        return np.sqrt((self.weights * difference**2).sum() / (self.weights * exact**2).sum())


def assembled(mesh, local):
    """Return the sparse matrix of those of the cells, float64[n_cells, 3, 3]."""
    rows, columns = np.repeat(mesh.cells, 3, axis=1), np.tile(mesh.cells, (1, 3))
    shape = (mesh.n_points, mesh.n_points)
    return csc_array((local.ravel(), (rows.ravel(), columns.ravel())), shape)


def gradients(mesh):
    """Return the gradients of the hat functions in each cell, float64[n_cells, 3, 2]."""
    corners = mesh.points[mesh.cells]
    e = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    (ax, ay), (bx, by) = e[:, 0].T, e[:, 1].T
    return np.stack([-e[..., 1], e[..., 0]], axis=-1) / (ax * by - ay * bx)[:, None, None]


def of_heat(mesh):
    """Return the mass matrix and that of the operator."""
    g, area = gradients(mesh), mesh.measures[:, None, None]
    return assembled(mesh, area * (1.0 + np.eye(3)) / 12.0), assembled(
        mesh, CONDUCTIVITY * area * np.einsum("cid,cjd->cij", g, g)
    )


def of_cone(mesh):
    """Return the mass matrix and that of the operator, skew-symmetric as in the interior."""
    g, area = gradients(mesh), mesh.measures[:, None, None]
    mass = area * (1.0 + np.eye(3)) / 12.0
    away = mesh.points[mesh.cells] - 0.5
    turned = 2.0 * np.pi * np.stack([-away[..., 1], away[..., 0]], axis=-1)
    carried = np.einsum("cjk,ckd->cjd", mass, turned)  # integrals of phi_j a
    operator = assembled(mesh, np.einsum("cid,cjd->cij", carried, g))
    return assembled(mesh, mass), 0.5 * (operator - operator.T)


def square(n):
    """Return about n triangles in the unit square."""
    side = max(round(np.sqrt(n / 2.0)), 2)
    return ads.CartesianGrid((0.0, 0.0), 1.0 / side, (side + 1, side + 1)).mesh


def loop(problem, n_cells, method, n_steps, every):
    """Return time, mass, error, least and largest value after each step, and those of remeshes.

    The latter are changes of mass, and seconds.
    """
    operators, exact, load = problem
    mesh, dt, rows, lost = square(n_cells), 1.0 / n_steps, [], []
    options = {"method": "bounded" if method == LOCAL else method, "local": method == LOCAL}
    if method is not None:
        for _ in range(4):
            eta = ads.zz_indicator(mesh, exact(mesh.points, 0.0))
            mesh = ads.adapt(mesh, eta, elements=n_cells, order=2).mesh
    u = None
    for step in range(n_steps):
        if method is not None and step % every == 0 and step > 0:
            start, eta = processor_time(), ads.zz_indicator(mesh, u)
            result = ads.adapt(
                mesh, eta, elements=n_cells, order=2, fields={"u": u}, enough=2.0, **options
            )
            before, after = result.report.integrals["u"]
            lost.append([after / before - 1.0, processor_time() - start])
            mesh, u = result.mesh, result.fields["u"]
        if step % every == 0 or u is None:
            mass, operator = operators(mesh)
            quadrature = Quadrature(mesh)
            if u is None:
                u = splu(mass).solve(quadrature.load(exact(quadrature.points, 0.0)))
                total = float(mass.sum(axis=0) @ u)
            solver = splu((mass + 0.5 * dt * operator).tocsc())
        t = step * dt
        right = mass @ u - 0.5 * dt * (operator @ u)
        if load is not None:
            right += dt * quadrature.load(load(quadrature.points, t + 0.5 * dt))
        u = solver.solve(right)
        error = quadrature.error(u, exact(quadrature.points, t + dt))
        rows.append([t + dt, float(mass.sum(axis=0) @ u) / total - 1.0, error, u.min(), u.max()])
    return np.array(rows), np.array(lost).reshape(-1, 2)


def processor_time():
    """Return the seconds of this process and of its children, which are the generators."""
    usage = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(used.ru_utime + used.ru_stime for used in usage)


def cone(x, t):
    """Return the solution of the second problem: a cone that turns around the centre once."""
    middle = 0.5 + 0.25 * np.array([np.cos(2.0 * np.pi * t), np.sin(2.0 * np.pi * t)])
    return np.maximum(1.0 - np.linalg.norm(x - middle, axis=-1) / 0.12, 0.0)


HEAT = (of_heat, spot, source), 40, 2
CONE = (of_cone, cone, None), 400, 10


def draw(results):
    """Draw mass and error over time."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    from adaptsize.plot.style import SETTINGS

    mpl.rcParams.update(SETTINGS)

    figure, axes = plt.subplots(1, 2, figsize=(9.5, 3.6), layout="constrained")
    looks = {None: ("0.55", ":", "uniform mesh"), "interpolate": ("C3", "-", "interpolate")}
    looks |= {"project": ("C0", "-", "project"), "bounded": ("C1", "--", "bounded")}
    looks[LOCAL] = ("C2", "-.", "bounded, local=True")
    for method, rows in results.items():
        colour, line, label = looks[method]
        axes[0].plot(rows[:, 0], 100.0 * rows[:, 1], line, color=colour, label=label)
        axes[1].semilogy(rows[:, 0], rows[:, 2], line, color=colour, label=label)
    axes[0].set(xlabel="time", ylabel="change of mass (%)")
    axes[1].set(xlabel="time", ylabel="relative L2 error")
    axes[0].legend(frameon=False)
    figure.savefig(FIGURE, dpi=110)


def main(cells, only=None):
    """Print the tables, and draw the figure for the first number of cells."""
    for name, (problem, n_steps, every) in {"heat": HEAT, "cone": CONE}.items():
        if only not in (None, name):
            continue
        print(f"{name}\ncells, transfer, mass in all, per remesh, least, largest, error, seconds")
        for n in cells:
            results = {}
            for method in (None, *METHODS, LOCAL):
                rows, lost = loop(problem, n, method, n_steps, every)
                results[method] = rows
                print(
                    f"| {n} | {method or 'uniform mesh'} | {rows[-1, 1]:.1e} | "
                    f"{np.abs(lost[:, 0]).max(initial=0.0):.1e} | {rows[:, 3].min():.3f} | "
                    f"{rows[:, 4].max():.3f}, {rows[-1, 4]:.3f} | {rows[-1, 2]:.4f} | "
                    f"{np.median(lost[:, 1]) if len(lost) else 0.0:.2f} |",
                    flush=True,
                )
            if name == "heat" and n == cells[0]:
                draw(results)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--cells", type=int, nargs="+", default=[4000, 16000])
    parser.add_argument("--only", choices=["heat", "cone"])
    arguments = parser.parse_args()
    main(arguments.cells, arguments.only)
