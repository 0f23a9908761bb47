"""Five cycles with conditions and materials by names; run by mpiexec on any number of ranks.

Two layers of conductivities 1 and 100 between a cold and a hot wall: the solution is linear in each
of them, so that it is exact on each mesh, unless a wall, a name or a region is lost on the way.
"""

from mpi4py import MPI  # loads the library of MPI that the wheel of DOLFINx needs

# isort: split
import sys
import traceback

import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import LinearProblem

from adaptsize import SimplexMesh, adapt
from adaptsize import distributed as ads

comm = MPI.COMM_WORLD
CONDUCTIVITY = {"foam": 1.0, "steel": 100.0}


def first_mesh(dim):
    """Return a box of two layers, with names."""
    box = mesh.create_unit_square if dim == 2 else mesh.create_unit_cube
    plain = SimplexMesh.from_object(box(MPI.COMM_SELF, *[6] * dim))
    facets = plain.facets[plain.facet_cell_counts == 1]
    x = plain.points[facets].mean(axis=1)[:, 0]
    tags = np.select([x < 1e-9, x > 1.0 - 1e-9], [4, 9], 2)
    steel = plain.points[plain.cells].mean(axis=1)[:, 0] > 0.5
    return SimplexMesh(
        plain.points, plain.cells, cell_tags=np.where(steel, 8, 3), tagged_facets=facets,
        facet_tags=tags, tag_names={(dim, 3): "foam", (dim, 8): "steel", (dim - 1, 4): "cold",
                                    (dim - 1, 9): "hot", (dim - 1, 2): "insulated"},
    )  # fmt: skip


def solve(there):
    """Return the temperature, 0 at the cold wall and 1 at the hot one."""
    domain, groups = there.mesh, there.physical_groups
    dim = domain.topology.dim
    space = fem.functionspace(domain, ("Lagrange", 1))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    domain.topology.create_connectivity(dim - 1, dim)
    conditions = []
    for name, value in (("cold", 0.0), ("hot", 1.0)):
        facets = there.facet_tags.find(groups[name][1])
        dofs = fem.locate_dofs_topological(space, dim - 1, facets)
        conditions.append(fem.dirichletbc(value, dofs, space))
    dx = ufl.Measure("dx", domain, subdomain_data=there.cell_tags)
    flow = sum(
        k * ufl.inner(ufl.grad(u), ufl.grad(v)) * dx(groups[name][1])
        for name, k in CONDUCTIVITY.items()
    )
    load = fem.Constant(domain, 0.0) * v * ufl.dx
    options = {"ksp_type": "cg", "pc_type": "jacobi", "ksp_rtol": 1e-12}
    return LinearProblem(
        flow, load, bcs=conditions, petsc_options_prefix="layers", petsc_options=options
    ).solve()


def exact(x):
    """Return the temperature: flux 2 / (1 + 1 / 100) through layers of thickness 1/2."""
    flux = 2.0 / 1.01
    return np.where(x <= 0.5, flux * x, 1.0 - flux / 100.0 * (1.0 - x))


def check(dim, cycles):
    """Run a loop that refines at a corner."""
    start = first_mesh(dim) if comm.rank == 0 else None
    there = ads.to_dolfinx(ads.PartitionedMesh.from_serial(start, None, comm))
    for cycle in range(cycles + 1):
        found = solve(there)
        old = ads.from_dolfinx(there)
        part = old.part
        u = found.x.array[old.dofs(found.function_space)]
        worst = comm.allreduce(np.abs(u - exact(part.points[:, 0])).max(initial=0.0), MPI.MAX)
        assert worst < 1e-8, f"cycle {cycle}: error {worst}"
        if cycle == cycles:
            break
        x = part.points[part.cells].mean(axis=1)
        eta = np.exp(-4.0 * np.linalg.norm(x, axis=1)) * part.measures
        result = adapt(
            part, eta, elements=(300 if dim == 2 else 1500) * 1.5**cycle, fields={"u": u}
        )
        assert result.remeshed
        assert not result.report.lost_tags
        there = ads.to_dolfinx(result.mesh, fields=result.fields)
        assert set(there.functions) == {"u"}
    if comm.rank == 0:
        print(f"{part.n_global_cells} cells, all right", flush=True)


try:
    check(int(sys.argv[1]), int(sys.argv[2]))
except BaseException:  # the other ranks must not wait
    traceback.print_exc()
    comm.Abort(1)
