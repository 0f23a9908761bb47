"""An adaptive loop with DOLFINx on any number of ranks: the L-shape, or its extrusion into space.

    mpiexec -n 2 python corner_loop.py [--space] [--cycles 5] [--first 300]

Each cycle solves the Laplace equation with linear elements and estimates the error of each cell
from the jumps of the normal derivative.  `adapt` then computes sizes for twice as many cells,
limits their gradient, remeshes in parallel, and transfers the solution to the new mesh.  The
solution is known, r^(2/3) sin(2/3 phi), so the error is too.
"""

import argparse
from dataclasses import replace

from mpi4py import MPI  # loads the library of MPI that the wheel of DOLFINx needs

# isort: split
import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import LinearProblem
from petsc4py import PETSc

from adaptsize import SimplexMesh, adapt
from adaptsize import distributed as ads

G = 0.3
#: Tag of the facets on which the solution is given.
FIXED = 5


def first_mesh(dim, n=4):
    """Return the L-shape, or its extrusion, as a structured mesh with a tagged boundary."""
    box = mesh.create_rectangle if dim == 2 else mesh.create_box
    corners = [[-1.0] * 2, [1.0] * 2] if dim == 2 else [[-1.0, -1.0, 0.0], [1.0, 1.0, 1.0]]
    whole = box(MPI.COMM_SELF, corners, [2 * n, 2 * n, n][:dim])
    points = whole.geometry.x[:, :dim]
    cells = np.asarray(whole.geometry.dofmaps[0])
    x = points[cells].mean(axis=1)
    kept = cells[~((x[:, 0] > 0.0) & (x[:, 1] < 0.0))]
    nodes, local = np.unique(kept, return_inverse=True)
    plain = SimplexMesh(points[nodes], local.reshape(kept.shape))
    boundary = plain.boundary()
    facets = boundary.nodes[boundary.mesh.cells]
    return replace(plain, tagged_facets=facets, facet_tags=np.full(len(facets), FIXED))


def exact(x):
    """Return the solution, singular at the corner."""
    angle = np.arctan2(x[1], x[0])
    angle = np.where(angle < -0.25 * np.pi, angle + 2.0 * np.pi, angle)  # 0 to 3/2 pi
    return np.hypot(x[0], x[1]) ** (2.0 / 3.0) * np.sin(2.0 / 3.0 * angle)


def solve(domain, facet_tags):
    """Return the finite element solution, the indicator of each cell, and the error in H1."""
    space = fem.functionspace(domain, ("Lagrange", 1))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    domain.topology.create_connectivity(domain.topology.dim - 1, domain.topology.dim)
    dofs = fem.locate_dofs_topological(space, domain.topology.dim - 1, facet_tags.find(FIXED))
    known = fem.Function(space)
    known.interpolate(exact)
    zero = fem.Constant(domain, PETSc.ScalarType(0.0))
    problem = LinearProblem(
        ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx,
        zero * v * ufl.dx,
        bcs=[fem.dirichletbc(known, dofs)],
        petsc_options_prefix="corner",
        petsc_options={"ksp_type": "cg", "pc_type": "jacobi", "ksp_rtol": 1e-10},
    )
    found = problem.solve()
    constants = fem.functionspace(domain, ("DG", 0))
    w = ufl.TestFunction(constants)
    jump = ufl.jump(ufl.grad(found), ufl.FacetNormal(domain))
    width = ufl.avg(ufl.CellDiameter(domain))
    form = fem.form(0.5 * width * jump**2 * (w("+") + w("-")) * ufl.dS)
    squares = fem.assemble_vector(form)
    squares.scatter_reverse(_add())
    eta = np.sqrt(squares.array[: constants.dofmap.index_map.size_local])
    fine = fem.functionspace(domain, ("Lagrange", 3))
    best = fem.Function(fine)
    best.interpolate(exact)
    difference = ufl.grad(best - found)
    square = fem.assemble_scalar(fem.form(ufl.inner(difference, difference) * ufl.dx))
    return found, eta, np.sqrt(domain.comm.allreduce(square))


def _add():
    from dolfinx.la import InsertMode

    return InsertMode.add


def main():
    """Run the loop, and print a line for each cycle."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--space", action="store_true")
    parser.add_argument("--cycles", type=int, default=5)
    parser.add_argument("--first", type=int, default=300, help="cells after the first cycle")
    parser.add_argument("--how", choices=("parts", "gather"), default="parts")
    given = parser.parse_args()
    comm = MPI.COMM_WORLD
    start = first_mesh(3 if given.space else 2) if comm.rank == 0 else None
    there = ads.to_dolfinx(ads.PartitionedMesh.from_serial(start, None, comm))
    for cycle in range(given.cycles + 1):
        found, eta, error = solve(there.mesh, there.facet_tags)
        old = ads.from_dolfinx(there)
        part = old.part
        if comm.rank == 0:
            print(f"{part.n_global_cells:7d} cells, error {error:.5f}", flush=True)
        if cycle == given.cycles:
            break
        u = found.x.array[old.dofs(found.function_space)]
        result = adapt(
            part, eta, elements=given.first * 2**cycle, g=G, how=given.how, fields={"u": u}
        )
        if comm.rank == 0:
            print(result, flush=True)
        # A nonlinear solver would start from there.functions["u"].
        there = ads.to_dolfinx(result.mesh, fields=result.fields)


if __name__ == "__main__":
    main()
