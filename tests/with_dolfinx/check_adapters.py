"""Meshes of DOLFINx and PETSc as distributed meshes; run by mpiexec on any number of ranks."""

from mpi4py import MPI  # loads the library of MPI that the wheel of DOLFINx needs

# isort: split
import traceback

import numpy as np
from dolfinx import fem, mesh
from petsc4py import PETSc

from adaptsize import SimplexMesh
from adaptsize import distributed as ads

comm = MPI.COMM_WORLD


def check_dolfinx(domain, measure, dim):
    """Compare the parts with the mesh of DOLFINx."""
    domain.topology.create_connectivity(dim - 1, dim)
    facets = mesh.exterior_facet_indices(domain.topology)
    n_cells = domain.topology.index_map(dim).size_local
    facet_tags = mesh.meshtags(domain, dim - 1, facets, np.full(len(facets), 7, np.int32))
    numbers = np.arange(n_cells, dtype=np.int32)
    cell_tags = mesh.meshtags(domain, dim, numbers, np.full(n_cells, comm.rank + 1, np.int32))
    found = ads.from_dolfinx(domain, cell_tags=cell_tags, facet_tags=facet_tags)
    part = found.part
    assert part.n_global_points == domain.geometry.index_map().size_global
    assert part.n_global_cells == domain.topology.index_map(dim).size_global
    assert np.array_equal(part.points, domain.geometry.x[found.nodes, :dim])
    space = fem.functionspace(domain, ("Lagrange", 1))
    u = fem.Function(space)
    u.interpolate(lambda x: 1.0 + x[0])
    assert np.allclose(u.x.array[found.dofs(space)], 1.0 + part.points[:, 0])
    whole = part.gather()
    if comm.rank == 0:
        assert abs(whole.measures.sum() - measure) < 1e-12
        assert len(whole.tagged_facets) == len(whole.boundary().cells)
        assert np.unique(whole.cell_tags).tolist() == list(range(1, comm.size + 1))
    back = ads.from_dolfinx(ads.to_dolfinx(part).mesh).part
    assert back.n_global_points == part.n_global_points
    again = back.gather()
    if comm.rank == 0:
        assert abs(again.measures.sum() - measure) < 1e-12
        order = [np.lexsort(m.points.T) for m in (whole, again)]
        assert np.array_equal(whole.points[order[0]], again.points[order[1]])


def check_names(dim):
    """Compare a mesh on this process with what comes back from DOLFINx."""
    size = [4, 3, 2][:dim]
    names = {(dim, 1): "left", (dim, 2): "right", (dim - 1, 5): "skin"}
    box = mesh.create_unit_square if dim == 2 else mesh.create_unit_cube
    plain = SimplexMesh.from_object(box(MPI.COMM_SELF, *size))
    boundary = plain.boundary()
    tagged = SimplexMesh(
        plain.points,
        plain.cells,
        cell_tags=1 + (plain.points[plain.cells].mean(axis=1)[:, 0] > 0.5),
        tagged_facets=boundary.nodes[boundary.mesh.cells],
        facet_tags=np.full(boundary.mesh.n_cells, 5),
        tag_names=names,
    )
    back = SimplexMesh.from_object(tagged.to_dolfinx())
    assert back.tag_names == names
    assert np.array_equal(back.cell_tags - 1, back.points[back.cells].mean(axis=1)[:, 0] > 0.5)
    assert len(back.tagged_facets) == len(tagged.tagged_facets)
    assert (back.facet_tags == 5).all()
    assert np.isclose(back.measures.sum(), 1.0)


def check_content(dim):
    """Compare tags, names and fields before and after DOLFINx partitions a mesh anew."""
    rng = np.random.default_rng(5)
    whole = None
    if comm.rank == 0:
        box = mesh.create_unit_square if dim == 2 else mesh.create_unit_cube
        plain = SimplexMesh.from_object(box(MPI.COMM_SELF, *[5, 4, 3][:dim]))
        facets = plain.facets[rng.permutation(len(plain.facets))[: len(plain.facets) // 2]]
        middles = plain.points[facets].mean(axis=1)
        whole = SimplexMesh(
            plain.points,
            plain.cells,
            cell_tags=1 + np.floor(9 * plain.points[plain.cells].mean(axis=1)[:, 0]).astype(int),
            tagged_facets=facets,
            facet_tags=1 + np.floor(9 * middles[:, 1]).astype(int),
            tag_names={(dim, 1): "left", (dim - 1, 2): "low"},
            point_data={"x": plain.points[:, 0]},
        )
    part = ads.PartitionedMesh.from_serial(whole, None, comm)
    there = ads.to_dolfinx(part, fields={"v": part.points, "w": part.points[:, 1] ** 2})
    domain = there.mesh
    middle = mesh.compute_midpoints(domain, dim, there.cell_tags.indices)
    assert np.array_equal(there.cell_tags.values, 1 + np.floor(9 * middle[:, 0]))
    middle = mesh.compute_midpoints(domain, dim - 1, there.facet_tags.indices)
    assert np.array_equal(there.facet_tags.values, 1 + np.floor(9 * middle[:, 1]))
    assert there.physical_groups == {"left": (dim, 1), "low": (dim - 1, 2)}
    for name, rule in (("x", lambda x: x[0]), ("v", lambda x: x[:dim]), ("w", lambda x: x[1] ** 2)):
        expected = fem.Function(there.functions[name].function_space)
        expected.interpolate(rule)
        assert np.allclose(there.functions[name].x.array, expected.x.array)
    back = ads.from_dolfinx(there).part.gather()
    if comm.rank == 0:
        assert len(back.tagged_facets) == len(whole.tagged_facets)
        assert back.tag_names == whole.tag_names
        assert np.array_equal(np.sort(back.cell_tags), np.sort(whole.cell_tags))
        assert np.array_equal(back.point_data["x"], back.points[:, 0])
        assert np.array_equal(back.point_data["v"], back.points)
    for bad in (np.zeros(1), np.zeros((part.n_points, 2, 2))):
        try:
            ads.to_dolfinx(part, fields={"u": bad})
        except ValueError:
            continue
        raise AssertionError


def plex_of_box(dim):
    """Return a DMPlex and the number of its cells."""
    box = mesh.create_unit_square if dim == 2 else mesh.create_unit_cube
    serial = box(MPI.COMM_SELF, *[5, 4, 3][:dim])
    cells = np.asarray(serial.geometry.dofmaps[0], PETSc.IntType)
    points = np.ascontiguousarray(serial.geometry.x[:, :dim])
    if comm.rank:
        cells, points = cells[:0], points[:0]
    plex = PETSc.DMPlex().createFromCellList(dim, cells, points, comm=comm)
    plex.markBoundaryFaces("Face Sets", 3)
    return plex, serial.topology.index_map(dim).size_local


def check_petsc(dim):
    """Compare the parts with a DMPlex."""
    plex, n_cells = plex_of_box(dim)
    if comm.size > 1:
        plex.distribute(overlap=1)
    found = ads.from_dmplex(plex, facet_label="Face Sets")
    whole = found.part.gather()
    assert len(found.vertices) == found.part.n_points
    if comm.rank == 0:
        assert whole.n_cells == n_cells
        assert abs(whole.measures.sum() - 1.0) < 1e-12
        assert len(whole.tagged_facets) == len(whole.boundary().cells)
        assert (whole.facet_tags == 3).all()


def check_metric(dim):
    """Pass sizes to the mesh adaptation of PETSc, as docs/how-to/dolfinx.md says."""
    plex, _ = plex_of_box(dim)
    if comm.size > 1:
        plex.distribute()
    found = ads.from_dmplex(plex)
    h = 0.1 + 0.3 * found.part.points[:, 0]

    plex.metricSetIsotropic(True)
    space = plex.clone()
    space.setField(0, PETSc.FE().createLagrange(dim, 1, True, 1, PETSc.DETERMINE, comm=plex.comm))
    space.createDS()
    indicator, section = space.createLocalVector(), space.getLocalSection()
    offsets = [section.getOffset(vertex) for vertex in found.vertices]
    indicator.array[offsets] = h**-2
    metric = plex.metricCreateIsotropic(indicator)
    plex.metricSetGradationFactor(np.exp(0.3))

    assert len(metric.array) == found.part.n_points
    assert np.array_equal(metric.array[offsets], h**-2)
    assert abs(plex.metricGetGradationFactor() - 1.35) < 1e-3
    for factor in (-1.0, 0.0):
        try:
            plex.metricSetGradationFactor(factor)
        except PETSc.Error:
            continue
        raise AssertionError


def check_all():
    """Check both adapters, in the plane and in space."""
    check_dolfinx(mesh.create_unit_square(comm, 7, 6), 1.0, 2)
    check_dolfinx(mesh.create_unit_cube(comm, 5, 4, 3), 1.0, 3)
    shared = mesh.create_cell_partitioner(mesh.GhostMode.shared_facet, 2)
    check_dolfinx(mesh.create_unit_cube(comm, 5, 4, 3, partitioner=shared), 1.0, 3)
    for bad in (None, 3):
        for adapter in (ads.from_dolfinx, ads.from_dmplex):
            try:
                adapter(bad)
            except ValueError:
                continue
            raise AssertionError
    check_names(2)
    check_names(3)
    check_content(2)
    check_content(3)
    check_petsc(2)
    check_petsc(3)
    check_metric(2)
    check_metric(3)
    if comm.rank == 0:
        print("all right")


try:
    check_all()
except BaseException:  # the other ranks must not wait
    traceback.print_exc()
    comm.Abort(1)
