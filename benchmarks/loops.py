"""Adaptive loops of adaptsize beside those of other programs: error, vertices, processor time.

    python benchmarks/loops.py [--quick] [--output benchmarks/results]

One thread; kernels compiled beforehand; processor time of this process and of those it starts.
*Solves* are what all loops share: assembly, solution, estimators and errors.  *Adaptation* is the
rest: metrics, meshes, transfer.

*Corner*: Laplace's equation on an L with the solution r^(2/3) sin(2 t / 3), linear elements of
scikit-fem and the jumps of the gradient as estimator, until the error in the energy norm is below
0.012.  *Spot*: the heat equation of docs/measurements/unsteady_loop.py with about 8000 triangles,
remeshed 19 times; the relative error in L2 at the end.  *Front*: tanh((|x| - r) / 0.02) in the unit
square, whose radius grows from 0.3 by 0.02 in each of five cycles, stretched triangles, about
15 500 vertices; the error of linear interpolation in L2, the mean of the cycles.

*Adapt*, *bisection*: `adapt` with Mmg and ``backend="bisection"``, which does not coarsen, so that
it has no part in what moves.  *mmgpy*: its `compute_hessian` and `create_metric_from_hessian`, Mmg
in this process, linear interpolation by SciPy; ``target_error`` is corrected in each cycle, for the
same number of triangles or, in the row "equal error", for the error of `adapt`.  *FreeFEM*: its
`adaptmesh`, with ``err`` corrected in the same way, and its own solves, in one process.  *NGSolve*:
its bisection of the cells whose estimator, from the recovered flux, exceeds a quarter of the
largest, and its own solves.
Programs that are not installed are left out.

Writes `loops.md` and `loops.json`.
"""

import shutil
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage

import numpy as np
from _timing import arguments_of, machine, table, three, write
from scipy.sparse.linalg import splu

import adaptsize as ads

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs" / "measurements"))
import unsteady_loop as heat  # noqa: E402

ENERGY, SPOT_CELLS, STEPS, EVERY = 0.012, 8000, 40, 2
FRONT_VERTICES, WIDTH, RADII = 15_500, 0.02, 0.3 + 0.02 * np.arange(6)
FREEFEM = shutil.which("FreeFem++-nw")


class Clock:
    """Processor time of two kinds of work."""

    def __init__(self):
        self.seconds = {"solves": 0.0, "adaptation": 0.0}

    def run(self, kind, work):
        """Return what work returns, and count its time."""
        before = used()
        result = work()
        self.seconds[kind] += used() - before
        return result


def used():
    """Return the processor time of this process and of those it started."""
    both = [getrusage(who) for who in (RUSAGE_SELF, RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in both)


def row(problem, method, vertices, error, clock, cycles):
    """Return a row of the table."""
    return {
        "problem": problem, "method": method, "cycles": cycles, "vertices": int(vertices),
        "error": float(error), **clock.seconds,
    }  # fmt: skip


# The corner ---------------------------------------------------------------------------------------


def l_shape():
    """Return 96 triangles of (-1, 1)^2 without its lower right quarter."""
    mesh = ads.CartesianGrid((-1.0, -1.0), 0.25, (9, 9)).mesh
    x, y = mesh.points[mesh.cells].mean(axis=1).T
    used_nodes, cells = np.unique(mesh.cells[(x < 0.0) | (y > 0.0)], return_inverse=True)
    return ads.SimplexMesh(mesh.points[used_nodes], cells.reshape(-1, 3))


def corner_solution(x):
    """Return r^(2/3) sin(2 t / 3) at points of shape (2, ...), and its gradient."""
    r, t = np.hypot(*x), np.arctan2(x[1], x[0]) % (2.0 * np.pi)
    slope = 2.0 / 3.0 * np.maximum(r, 1e-12) ** (-1.0 / 3.0)
    return r ** (2 / 3) * np.sin(2 * t / 3), slope * np.stack([-np.sin(t / 3), np.cos(t / 3)])


def solved_corner(mesh):
    """Return the jump estimator of each cell, and the energy error."""
    from skfem import Basis, ElementTriP1, Functional, MeshTri, condense, solve
    from skfem.models.poisson import laplace

    m = MeshTri(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.cells.T))
    basis = Basis(m, ElementTriP1(), intorder=8)
    u = corner_solution(m.p)[0]
    u = solve(*condense(laplace.assemble(basis), x=u, D=m.boundary_nodes()))
    error = Functional(lambda w: ((w.u.grad - corner_solution(w.x)[1]) ** 2).sum(axis=0))
    square = error.assemble(basis, u=basis.interpolate(u))
    slope = np.einsum("cvd,cv->cd", heat.gradients(mesh), u[mesh.cells])
    inner = np.flatnonzero(m.f2t[1] >= 0)
    one, other = m.f2t[:, inner]
    squared_length = ((m.p[:, m.facets[1]] - m.p[:, m.facets[0]]) ** 2).sum(axis=0)
    jumps = np.zeros(m.nfacets)  # h times the squared jump of the gradient, over each edge
    jumps[inner] = squared_length[inner] * ((slope[one] - slope[other]) ** 2).sum(axis=1)
    return np.sqrt(0.5 * jumps[m.t2f].sum(axis=0)), np.sqrt(square)


def corner(method, goal):
    """Return the row of `adapt` with Mmg or by bisection."""
    clock, mesh, cycles = Clock(), l_shape(), 0
    backend = "mmg" if method == "adapt" else method
    while True:
        eta, error = clock.run("solves", lambda: solved_corner(mesh))  # noqa: B023
        if error <= goal:
            return row("corner", method, mesh.n_points, error, clock, cycles)
        options = {"elements": 200 * 2**cycles, "order": 1, "max_refine": 16.0, "enough": 2.0}
        mesh = clock.run(
            "adaptation",
            lambda: ads.adapt(mesh, eta, backend=backend, **options).mesh,  # noqa: B023
        )
        cycles += 1


def corner_by_ngsolve(goal):
    """Return the row of NGSolve."""
    import ngsolve as ng
    from netgen.geom2d import SplineGeometry

    outline, clock, cycles = SplineGeometry(), Clock(), 0
    corners = [(-1, -1), (0, -1), (0, 0), (1, 0), (1, 1), (-1, 1)]
    numbers = [outline.AppendPoint(*corner) for corner in corners]
    for start, end in zip(numbers, [*numbers[1:], numbers[0]], strict=True):
        outline.Append(["line", start, end])
    mesh = ng.Mesh(outline.GenerateMesh(maxh=0.25))
    angle = ng.atan2(ng.y, ng.x)
    angle = ng.IfPos(-1e-9 - angle, angle + 2.0 * np.pi, angle)
    r = ng.sqrt(ng.x**2 + ng.y**2 + 1e-24)
    exact = r ** (2 / 3) * ng.sin(2.0 / 3.0 * angle)
    slope = 2 / 3 * r ** (-1 / 3) * ng.CF((-ng.sin(angle / 3), ng.cos(angle / 3)))

    def solved():
        """Return the squared estimator of each cell, and the error."""
        space = ng.H1(mesh, order=1, dirichlet=".*")
        u, v = space.TnT()
        stiffness = ng.BilinearForm(ng.grad(u) * ng.grad(v) * ng.dx).Assemble()
        found = ng.GridFunction(space)
        found.Set(exact, ng.BND)
        rest = (-stiffness.mat * found.vec).Evaluate()
        found.vec.data += stiffness.mat.Inverse(space.FreeDofs(), "sparsecholesky") * rest
        flux = ng.GridFunction(ng.VectorH1(mesh, order=1))
        flux.Set(ng.grad(found))
        eta = ng.Integrate((ng.grad(found) - flux) ** 2, mesh, element_wise=True)
        square = ng.Integrate((ng.grad(found) - slope) ** 2, mesh, order=8)
        return eta.NumPy(), np.sqrt(square)

    def refine():
        mesh.ngmesh.Elements2D().NumPy()["refine"] = eta > 0.25 * eta.max()
        mesh.Refine()

    while True:
        eta, error = clock.run("solves", solved)
        if error <= goal:
            return row("corner", "NGSolve", mesh.nv, error, clock, cycles)
        clock.run("adaptation", refine)
        cycles += 1


# The spot -----------------------------------------------------------------------------------------


def by_adapt(mesh, u, n_cells):
    """Return the next mesh by `adapt`, and the field on it."""
    eta = ads.zz_indicator(mesh, u)
    result = ads.adapt(mesh, eta, elements=n_cells, order=2, fields={"u": u}, enough=2.0)
    return result.mesh, result.fields["u"]


class ByMmgpy:
    """The next mesh by mmgpy alone, with a target error that is corrected."""

    def __init__(self, *, is_moved, **limits):
        self.target, self.is_moved, self.limits = 1e-3, is_moved, limits

    def __call__(self, mesh, u, n_cells):
        """Return the next mesh, and the field on it."""
        from mmgpy import MmgMesh2D, metrics

        cells = np.array(mesh.cells, np.int32)
        hessian = metrics.compute_hessian(mesh.points, cells, u)
        metric = metrics.create_metric_from_hessian(hessian, self.target, **self.limits)
        made = MmgMesh2D(mesh.points, cells)
        made.set_field("tensor", metric)
        made.remesh(verbose=-1)
        points, triangles = made.get_vertices(), made.get_triangles()
        self.target *= (len(triangles) / n_cells) ** 0.7
        new = ads.SimplexMesh(points, triangles)
        if not self.is_moved:
            return new, None
        moved = ads.transfer_fields(mesh, new, fields={"u": u}, method="interpolate")
        return new, moved.fields["u"]


def spot(method, remeshed, n_cells):
    """Return the row of a loop on the heat equation."""
    clock, dt = Clock(), 1.0 / STEPS
    mesh = heat.square(n_cells)
    for _ in range(5):
        mesh = remeshed(mesh, heat.spot(mesh.points, 0.0), n_cells)[0]
    u = heat.spot(mesh.points, 0.0)
    for step in range(STEPS):
        if step % EVERY == 0:
            if step:
                mesh, u = clock.run("adaptation", lambda: remeshed(mesh, u, n_cells))  # noqa: B023
            before = used()
            mass, operator = heat.of_heat(mesh)
            quadrature = heat.Quadrature(mesh)
            solver = splu((mass + 0.5 * dt * operator).tocsc())
            clock.seconds["solves"] += used() - before
        before, t = used(), step * dt
        load = dt * quadrature.load(heat.source(quadrature.points, t + 0.5 * dt))
        u = solver.solve(mass @ u - 0.5 * dt * (operator @ u) + load)
        clock.seconds["solves"] += used() - before
    error = quadrature.error(u, heat.spot(quadrature.points, 1.0))
    return row("spot", method, mesh.n_points, error, clock, STEPS // EVERY - 1)


# The front ----------------------------------------------------------------------------------------


def front(x, radius):
    """Return the field at points."""
    return np.tanh((np.linalg.norm(x, axis=-1) - radius) / WIDTH)


def front_error(mesh, radius):
    """Return the L2 norm of the error of interpolation."""
    quadrature = heat.Quadrature(mesh)
    nodal = front(mesh.points, radius)[mesh.cells] @ quadrature.shapes.T
    difference = nodal - front(quadrature.points, radius)
    return np.sqrt((quadrature.weights * difference**2).sum())


def stretched(mesh, u, n_cells):
    """Return the next anisotropic mesh by `adapt`, and the field on it."""
    result = ads.adapt(mesh, elements=n_cells, fields={"u": u}, anisotropic="u", enough=2.0)
    return result.mesh, result.fields["u"]


def moving_front(method, remeshed, n_cells):
    """Return the row of a loop that follows the front."""
    clock, mesh, errors, numbers = Clock(), heat.square(n_cells), [], []
    for _ in range(4):
        mesh = remeshed(mesh, front(mesh.points, RADII[0]), n_cells)[0]
    for radius in RADII[1:]:
        u = front(mesh.points, radius)
        mesh = clock.run("adaptation", lambda: remeshed(mesh, u, n_cells)[0])  # noqa: B023
        errors.append(front_error(mesh, radius))
        numbers.append(mesh.n_points)
    return row("front", method, np.mean(numbers), np.mean(errors), clock, len(errors))


def of_equal_error(goal, n_cells):
    """Return the row of mmgpy with the number of cells at which its error is that of `adapt`."""
    for _ in range(4):
        found = moving_front(
            "mmgpy, equal error", ByMmgpy(is_moved=False, hmin=1e-5, hmax=0.2), round(n_cells)
        )
        if abs(found["error"] / goal - 1.0) < 0.05:
            break
        n_cells *= found["error"] / goal  # errors of order 2 in the spacing
    return found


# FreeFEM ------------------------------------------------------------------------------------------

OF_FREEFEM = {
    "corner": """
    border a(t=0, 1){ x = -1 + t; y = -1; label = 1; }
    border b(t=0, 1){ x = 0; y = -1 + t; label = 1; }
    border c(t=0, 1){ x = t; y = 0; label = 1; }
    border d(t=0, 1){ x = 1; y = t; label = 1; }
    border e(t=0, 1){ x = 1 - 2 * t; y = 1; label = 1; }
    border f(t=0, 1){ x = -1; y = 1 - 2 * t; label = 1; }
    mesh Th = buildmesh(a(4) + b(4) + c(4) + d(4) + e(8) + f(8));
    fespace Vh(Th, P1);
    Vh u, v;
    func angle = atan2(y, x) < -1e-9 ? atan2(y, x) + 2 * pi : atan2(y, x);
    func r = max(sqrt(x * x + y * y), 1e-12);
    func exact = r ^ (2. / 3) * sin(2 * angle / 3);
    func dxu = -2. / 3 * r ^ (-1. / 3) * sin(angle / 3);
    func dyu = 2. / 3 * r ^ (-1. / 3) * cos(angle / 3);
    real level = 0.05, error = 1;
    while (error >= GOAL && cycles < 30) {
        if (cycles > 0) {
            real begun = clock();
            level /= 2;
            Th = adaptmesh(Th, u, err=level, nbvx=200000, hmin=1e-8);
            adaptation += clock() - begun;
        }
        cycles++;
        real begin = clock();
        solve laplace(u, v, solver=UMFPACK)
            = int2d(Th)(dx(u) * dx(v) + dy(u) * dy(v)) + on(1, u=exact);
        error = sqrt(int2d(Th, qforder=9)((dx(u) - dxu)^2 + (dy(u) - dyu)^2));
        solves += clock() - begin;
    }
    cycles--;
    """,
    "spot": """
    real k = 1e-3, w = 0.04, level = 1e-3, time = 0;
    func ax = x - 0.5 - 0.25 * cos(0.25 * pi * time);
    func ay = y - 0.5 - 0.25 * sin(0.25 * pi * time);
    func spot = exp(-(ax^2 + ay^2) / w^2);
    func rate = 0.125 * pi * (-ax * sin(0.25 * pi * time) + ay * cos(0.25 * pi * time)) / w^2;
    func heat = (rate - k * (4 * (ax^2 + ay^2) / w^2 - 4) / w^2) * spot;
    mesh Th = square(64, 64);
    fespace Vh(Th, P1);
    Vh u, v, old;
    for (int i = 0; i < 5; i++) {
        u = spot;
        Th = adaptmesh(Th, u, err=level, nbvx=200000);
        level *= (1. * Th.nt / CELLS)^0.7;
    }
    u = spot;
    real dt = 1. / 40;
    for (int step = 0; step < 40; step++) {
        real begin = clock();
        if (step % 2 == 0 && step > 0) {
            Th = adaptmesh(Th, u, err=level, nbvx=200000);
            level *= (1. * Th.nt / CELLS)^0.7;
            u = u;
            cycles++;
            adaptation += clock() - begin;
            begin = clock();
        }
        old = u;
        time = (step + 0.5) * dt;
        solve step1(u, v, solver=UMFPACK)
            = int2d(Th)(u * v + 0.5 * dt * k * (dx(u) * dx(v) + dy(u) * dy(v)))
            - int2d(Th)(old * v - 0.5 * dt * k * (dx(old) * dx(v) + dy(old) * dy(v)))
            - int2d(Th)(dt * heat * v);
        solves += clock() - begin;
    }
    time = 1;
    real error = sqrt(int2d(Th)((u - spot)^2) / int2d(Th)(spot^2));
    """,
    "front": """
    real level = 1e-3, error = 0;
    mesh Th = square(64, 64);
    fespace Vh(Th, P1);
    Vh u;
    func real front(real r) { return tanh((sqrt(x * x + y * y) - r) / 0.02); }
    for (int i = 0; i < 9; i++) {
        real r = 0.3 + 0.02 * max(i - 3, 0);
        u = front(r);
        real begin = clock();
        Th = adaptmesh(Th, u, err=level, nbvx=200000, anisomax=1000, ratio=0, hmax=0.2);
        level *= (1. * Th.nt / CELLS)^0.7;
        u = u;
        if (i > 3) {
            adaptation += clock() - begin;
            cycles++;
            u = front(r);
            error += sqrt(int2d(Th)((u - front(r))^2)) / 5;
        }
    }
    """,
}


def by_freefem(problem, **numbers):
    """Return the row of a script of FreeFEM."""
    text = "verbosity = 0;\nreal solves = 0, adaptation = 0;\nint cycles = 0;\n"
    text += OF_FREEFEM[problem]
    text += 'cout << "row " << Th.nv << " " << error << " " << solves << " " << adaptation'
    text += ' << " " << cycles << endl;\n'
    for name, number in numbers.items():
        text = text.replace(name, f"{number:g}")
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "loop.edp"
        script.write_text(text)
        done = subprocess.run([FREEFEM, str(script)], capture_output=True, text=True, check=False)
    lines = [line.split()[1:] for line in done.stdout.splitlines() if line.startswith("row ")]
    if not lines:
        raise RuntimeError(f"FreeFEM failed: {done.stdout[-2000:]}")
    vertices, error, solves, adaptation, cycles = map(float, lines[0])
    clock = Clock()
    clock.seconds = {"solves": solves, "adaptation": adaptation}
    return row(problem, "FreeFEM", vertices, error, clock, int(cycles))


def measured(goal, n_spot, n_front):
    """Return all rows."""
    has_mmgpy, rows = find_spec("mmgpy") is not None, []
    if find_spec("skfem") is not None:
        rows += [corner(method, goal) for method in ("adapt", "bisection")]
    if FREEFEM:
        rows.append(by_freefem("corner", GOAL=goal))
    if find_spec("ngsolve") is not None:
        rows.append(corner_by_ngsolve(goal))
    rows.append(spot("adapt", by_adapt, n_spot))
    if has_mmgpy:
        rows.append(spot("mmgpy", ByMmgpy(is_moved=True, hmax=0.2), n_spot))
    if FREEFEM:
        rows.append(by_freefem("spot", CELLS=n_spot))
    rows.append(moving_front("adapt", stretched, n_front))
    goal = rows[-1]["error"]
    if has_mmgpy:
        rows.append(moving_front("mmgpy", ByMmgpy(is_moved=False, hmin=1e-5, hmax=0.2), n_front))
        rows.append(of_equal_error(goal, n_front))
    if FREEFEM:
        rows.append(by_freefem("front", CELLS=n_front))
    return rows


def main():
    arguments = arguments_of(__doc__)
    quick = (5.0 * ENERGY, 1000, 2000)
    measured(*quick)  # compile
    rows = measured(*(quick if arguments.quick else (ENERGY, SPOT_CELLS, 2 * FRONT_VERTICES)))
    text = "\n".join(
        [
            "# Adaptive loops",
            "",
            "Processor time in seconds.  Vertices: of the last mesh; of the front, the mean.",
            "",
            table(
                ["loop", "by", "cycles", "vertices", "error", "adaptation", "solves"],
                [
                    [
                        *(one[key] for key in ("problem", "method", "cycles", "vertices")),
                        f"{one['error']:.2e}", three(one["adaptation"]), three(one["solves"]),
                    ]
                    for one in rows
                ],
            ),
            "",
            f"{machine()}. Written by `benchmarks/loops.py`.",
            "",
        ]
    )  # fmt: skip
    write(arguments.output, "loops", text, {"machine": machine(), "loops": rows})


if __name__ == "__main__":
    main()
