"""Meshes of DOLFINx and of PETSc (DMPlex) as partitioned meshes, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, check_type, describe
from adaptsize._dolfinx import nodes_of_cells
from adaptsize.background import SimplexMesh
from adaptsize.background.migration import number_nodes
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.ranks import (
    Communicator,
    MpiCommunicator,
    SingleRank,
    as_communicator,
    rows_among,
)
from adaptsize.typing import FloatArray, IntArray, LongArray

#: Entities by their nodes, int32[n, k], and their tags.
_Tags: TypeAlias = tuple[IntArray, IntArray]
_KINDS = {"interval": 1, "triangle": 2, "tetrahedron": 3}


class DolfinxPart(NamedTuple):
    """A mesh of DOLFINx as a `PartitionedMesh`, and how their nodes and cells correspond."""

    part: PartitionedMesh
    nodes: IntArray
    """``nodes[i]`` is the row of ``mesh.geometry.x`` of local node i."""
    cells: IntArray
    """``cells[c]`` is the cell of the DOLFINx mesh of local cell c."""

    def dofs(self, space: Any) -> IntArray:
        """Return the dof of each local node in a space of linear Lagrange elements."""
        found = np.empty(self.part.n_points, np.int32)
        # Cells list their dofs and their nodes in the same order.
        found[self.part.cells] = np.asarray(space.dofmap.list)[: self.part.n_cells]
        return found


class DolfinxMesh(NamedTuple):
    """A mesh of DOLFINx with its tags and fields."""

    mesh: Any
    """``dolfinx.mesh.Mesh``"""
    cell_tags: Any
    """``dolfinx.mesh.MeshTags`` or None."""
    facet_tags: Any
    physical_groups: dict[str, tuple[int, int]]
    """Dimension and tag of each name."""
    functions: dict[str, Any]
    """Nodal fields as a ``dolfinx.fem.Function`` of linear Lagrange elements, by name."""


def from_dolfinx(mesh: Any, *, cell_tags: Any = None, facet_tags: Any = None) -> DolfinxPart:
    """Return the part of a ``dolfinx.mesh.Mesh`` on each rank; collective.

    Parameters
    ----------
    mesh : dolfinx.mesh.Mesh, or its MeshData or DolfinxMesh
        Of affine intervals, triangles or tetrahedra, in DOLFINx 0.8 or later.  Ghost cells are
        left out.  The latter come with tags and their names, and nodal fields.
    cell_tags, facet_tags : dolfinx.mesh.MeshTags, optional
        Tags of cells and facets, which become those of the `SimplexMesh`.

    Returns
    -------
    DolfinxPart
        Nodal values h of ``part`` become those of a function of linear Lagrange elements by
        ``f.x.array[found.dofs(space)] = h``, followed by ``f.x.scatter_forward()``.

    Raises
    ------
    ValueError
        If the argument is not such a mesh.
    """
    whole, mesh = mesh, getattr(mesh, "mesh", mesh)
    cell_tags = getattr(whole, "cell_tags", None) if cell_tags is None else cell_tags
    facet_tags = getattr(whole, "facet_tags", None) if facet_tags is None else facet_tags
    try:
        topology, geometry, comm = mesh.topology, mesh.geometry, as_communicator(mesh.comm)
        kind = topology.cell_name()
        width = np.asarray(nodes_of_cells(geometry)).shape[1]
    except AttributeError as error:
        raise ValueError(f"mesh must be a dolfinx.mesh.Mesh, got {describe(mesh)}") from error
    if kind not in _KINDS or width != _KINDS[kind] + 1:
        raise ValueError(f"mesh must have affine simplices, got {kind} with {width} nodes")
    dim = _KINDS[kind]
    topology.create_connectivity(dim, 0)
    n_cells = topology.index_map(dim).size_local
    rows = np.asarray(nodes_of_cells(geometry))[:n_cells]
    of_vertices = np.asarray(topology.connectivity(dim, 0).array)[: rows.size].reshape(rows.shape)
    nodes, local = np.unique(rows, return_inverse=True)
    vertices = np.empty(len(nodes), np.int32)
    vertices[local.ravel()] = of_vertices.ravel()
    keys = geometry.index_map().local_to_global(nodes.astype(np.int32)).astype(np.int64)
    ids, owner = number_nodes(comm, keys)
    piece = None
    if n_cells:
        # DOLFINx stores three coordinates in any dimension.
        points = np.ascontiguousarray(geometry.x[nodes, : geometry.dim])
        tags: dict[str, Any] = {}
        if cell_tags is not None:
            tags["cell_tags"] = _cell_tags(cell_tags, n_cells)
        if facet_tags is not None:
            facets, values = _tagged_facets(topology, facet_tags, dim)
            number = np.full(
                topology.index_map(0).size_local + topology.index_map(0).num_ghosts, -1
            )
            number[vertices] = np.arange(len(nodes))
            facets = number[facets]
            held = (facets >= 0).all(axis=1)
            tags |= {"tagged_facets": facets[held].astype(np.int32), "facet_tags": values[held]}
        tags["tag_names"] = _names_of(whole)
        tags["point_data"] = _nodal_values(whole, nodes, rows)
        piece = SimplexMesh(points, local.reshape(rows.shape).astype(np.int32), **tags)
    first = topology.index_map(dim).local_range[0]
    part = PartitionedMesh(piece, ids, owner, comm, cell_ids=first + np.arange(n_cells))
    return DolfinxPart(part, nodes.astype(np.int32), np.arange(n_cells, dtype=np.int32))


def _names_of(whole: Any) -> dict[tuple[int, int], str]:
    """Return the names of tags by dimension and tag."""
    groups = getattr(whole, "physical_groups", None) or {}
    return {(int(group[0]), int(group[1])): str(name) for name, group in groups.items()}


def _nodal_values(whole: Any, nodes: IntArray, rows: IntArray) -> dict[str, FloatArray]:
    """Return the values of functions of linear Lagrange elements at the nodes of this rank."""
    found = {}
    for name, function in (getattr(whole, "functions", None) or {}).items():
        space = function.function_space
        dofs = np.asarray(space.dofmap.list)[: len(rows)]
        values = function.x.array.reshape(-1, *[space.dofmap.bs] * (space.dofmap.bs > 1))
        at_nodes = np.empty((rows.max() + 1, *values.shape[1:]))
        at_nodes[rows] = values[dofs]
        found[name] = at_nodes[nodes]
    return found


def to_dolfinx(
    part: PartitionedMesh, *, fields: Mapping[str, npt.ArrayLike] | None = None
) -> DolfinxMesh:
    """Return a ``dolfinx.mesh.Mesh`` of the cells of a distributed mesh; collective.

    DOLFINx partitions the mesh anew, so that `from_dolfinx` of the result has other parts.  Tags,
    their names and fields go with the cells and nodes.

    Parameters
    ----------
    part : PartitionedMesh
    fields : mapping of str to array_like of float, shape (n_local,) or (n_local, k), optional
        Nodal fields, beside those in ``point_data`` of the mesh; one row per local node.

    Returns
    -------
    DolfinxMesh
        ``(mesh, cell_tags, facet_tags, physical_groups, functions)``.

    Raises
    ------
    ImportError
        If DOLFINx is missing.
    ValueError
        If the mesh is not on a communicator of mpi4py, or a field has another shape.
    """
    check_type("part", part, PartitionedMesh)
    comm = part.ranks
    if not isinstance(comm, MpiCommunicator) and comm.size > 1:
        raise ValueError("part must be on a communicator of mpi4py")
    own_fields = comm.agree(lambda: _nodal_fields(part, fields or {}))
    domain, first, rows = _domain_of(part)
    of_cells, of_facets = _tags_of(part)
    cell_tags = _mesh_tags(domain, part.cell_dim, rows, of_cells, comm)
    facet_tags = _mesh_tags(domain, part.cell_dim - 1, rows, of_facets, comm)
    names: dict[str, tuple[int, int]] = {}
    for known in comm.allgather({} if part.mesh is None else dict(part.mesh.tag_names)):
        names |= {name: key for key, name in known.items()}
    starts = np.array(comm.allgather(first))
    functions = {
        name: _function(domain, values[part.is_owned], starts, comm)
        for name, values in own_fields.items()
    }
    return DolfinxMesh(domain, cell_tags, facet_tags, names, functions)


def _nodal_fields(
    part: PartitionedMesh, fields: Mapping[str, npt.ArrayLike]
) -> dict[str, FloatArray]:
    """Return the nodal fields of a part and others, checked."""
    found = {}
    for name, values in {**({} if part.mesh is None else part.mesh.point_data), **fields}.items():
        array = as_float_array(f"fields[{name!r}]", values)
        if array.ndim not in (1, 2) or len(array) != part.n_points:
            raise ValueError(
                f"fields[{name!r}] must have shape ({part.n_points},) or ({part.n_points}, k), got "
                f"{array.shape}"
            )
        found[name] = array
    return found


def _domain_of(part: PartitionedMesh) -> tuple[Any, int, LongArray]:
    """Return the mesh of DOLFINx, the first input row of this rank, and the row of each node.

    Row i of the coordinates of all ranks, one after another, is node i of the input of DOLFINx.
    """
    try:
        from mpi4py import MPI  # isort: skip - before DOLFINx
        import basix.ufl
        import dolfinx
        import ufl
    except ImportError as error:
        raise ImportError(
            "to_dolfinx needs DOLFINx; on Python 3.12 or later: pip install dolfinx-solver-real"
        ) from error
    comm, own = part.ranks, part.is_owned
    first = sum(comm.allgather(int(own.sum()))[: comm.rank])
    numbers = np.zeros(part.n_points)
    numbers[own] = first + np.arange(np.count_nonzero(own))
    rows = part.exchange(numbers).astype(np.int64)
    kind = {number: name for name, number in _KINDS.items()}[part.cell_dim]
    element = basix.ufl.element("Lagrange", kind, 1, shape=(part.dim,))
    world = comm.mpi if isinstance(comm, MpiCommunicator) else MPI.COMM_SELF
    # Integrals over interior facets need the cells on both sides.
    ghosts = dolfinx.mesh.create_cell_partitioner(dolfinx.mesh.GhostMode.shared_facet, 2)
    domain = dolfinx.mesh.create_mesh(
        world, rows[part.cells], ufl.Mesh(element), part.points[own], partitioner=ghosts
    )
    return domain, first, rows


def _tags_of(part: PartitionedMesh) -> tuple[_Tags | None, _Tags | None]:
    """Return the nodes and tags of the cells of this rank, and of its tagged facets."""
    mesh = part.mesh
    if mesh is None:
        return None, None
    cells = None if mesh.cell_tags is None else (mesh.cells, mesh.cell_tags)
    if mesh.tagged_facets is None or mesh.facet_tags is None or mesh.cell_dim == 1:
        return cells, None
    return cells, (mesh.tagged_facets, mesh.facet_tags)


def _mesh_tags(
    domain: Any, dim: int, rows: LongArray, held: _Tags | None, comm: Communicator
) -> Any:
    """Return the MeshTags of the entities that any rank holds; None if no rank holds any."""
    import dolfinx

    if not comm.allreduce(int(held is not None), "max"):
        return None
    if held is None:
        held = np.empty((0, dim + 1), np.int32), np.empty(0, np.int32)
    entities, values = dolfinx.io.distribute_entity_data(
        domain, dim, rows[held[0]].reshape(-1, dim + 1), np.asarray(held[1], np.int32)
    )
    # Facets between parts arrive once for each of them.
    once = np.unique(np.sort(entities, axis=1), axis=0, return_index=True)[1]
    domain.topology.create_entities(dim)
    domain.topology.create_connectivity(dim, 0)
    domain.topology.create_connectivity(dim, domain.topology.dim)
    links = dolfinx.graph.adjacencylist(entities[once])
    return dolfinx.mesh.meshtags_from_entities(domain, dim, links, values[once])


def _function(domain: Any, own: FloatArray, starts: LongArray, comm: Communicator) -> Any:
    """Return nodal values as a function of linear Lagrange elements.

    Parameters
    ----------
    domain : dolfinx.mesh.Mesh
    own : float64[n_owned, ...]
        At the nodes that this rank has given to DOLFINx.
    starts : int64[n_ranks]
        The number of the first of these on each rank.
    comm : Communicator
    """
    import dolfinx

    wanted = np.asarray(domain.geometry.input_global_indices, np.int64)
    holder = np.searchsorted(starts, wanted, side="right") - 1
    at_nodes = comm.ask(wanted, holder, lambda rows, _: own[rows - starts[comm.rank]])
    shape = own.shape[1:]
    element = ("Lagrange", 1, shape) if shape else ("Lagrange", 1)
    space = dolfinx.fem.functionspace(domain, element)
    function = dolfinx.fem.Function(space)
    # Cells list their dofs and their nodes in the same order.
    dofs, nodes = np.asarray(space.dofmap.list), np.asarray(nodes_of_cells(domain.geometry))
    function.x.array.reshape(-1, *shape)[dofs] = at_nodes[nodes]
    return function


def nodal_functions(domain: Any, fields: Mapping[str, FloatArray]) -> dict[str, Any]:
    """Return values at the nodes of a whole mesh as functions on what `to_dolfinx` made of it."""
    starts, alone = np.zeros(1, np.int64), SingleRank()
    return {name: _function(domain, own, starts, alone) for name, own in fields.items()}


def _cell_tags(tags: Any, n_cells: int) -> IntArray:
    """Return one tag per cell, 0 for cells without one."""
    values = np.zeros(n_cells, np.int32)
    own = np.asarray(tags.indices) < n_cells
    values[np.asarray(tags.indices)[own]] = np.asarray(tags.values)[own]
    return values


def _tagged_facets(topology: Any, tags: Any, dim: int) -> tuple[IntArray, IntArray]:
    """Return the vertices of tagged facets, and the tags."""
    topology.create_connectivity(dim - 1, 0)
    links = np.asarray(topology.connectivity(dim - 1, 0).array).reshape(-1, dim)
    return links[np.asarray(tags.indices)], np.asarray(tags.values, np.int32)


class PlexPart(NamedTuple):
    """A DMPlex as a `PartitionedMesh`, and how their nodes and cells correspond."""

    part: PartitionedMesh
    vertices: IntArray
    """``vertices[i]`` is the point of the DMPlex (a vertex) of local node i."""
    cells: IntArray
    """``cells[c]`` is the point of the DMPlex (a cell) of local cell c."""


def from_dmplex(dm: Any, *, facet_label: str | None = None) -> PlexPart:
    """Return the part of a ``petsc4py.PETSc.DMPlex`` on each rank; collective.

    Parameters
    ----------
    dm : petsc4py.PETSc.DMPlex
        Interpolated, with affine simplices.  Cells that other ranks own (overlap) are left out.
    facet_label : str, optional
        Label whose values on facets become ``facet_tags``, such as "Face Sets".

    Raises
    ------
    ValueError
        If the argument is not a DMPlex of simplices.
    """
    try:
        dim, comm = dm.getDimension(), as_communicator(dm.getComm().tompi4py())
        first_vertex, last_vertex = dm.getDepthStratum(0)
        first_cell, last_cell = dm.getHeightStratum(0)
        # Global numbers; those of other ranks are -(number + 1).
        cell_numbers, vertex_numbers = (
            np.asarray(numbering.getIndices(), np.int64)
            for numbering in (dm.getCellNumbering(), dm.getVertexNumbering())
        )
        section, local = dm.getCoordinateSection(), dm.getCoordinatesLocal()
    except AttributeError as error:
        raise ValueError(f"dm must be a petsc4py.PETSc.DMPlex, got {describe(dm)}") from error
    own = np.flatnonzero(cell_numbers[: last_cell - first_cell] >= 0)

    def connect() -> IntArray:
        rows = np.empty((len(own), dim + 1), np.int32)
        for row, cell in zip(rows, own + first_cell, strict=True):
            closure = dm.getTransitiveClosure(int(cell))[0]
            found = closure[(closure >= first_vertex) & (closure < last_vertex)]
            if len(found) != dim + 1:
                raise ValueError(f"dm must have simplices, cell {cell} has {len(found)} vertices")
            row[:] = found
        return rows

    rows = comm.agree(connect)
    vertices, cells = np.unique(rows, return_inverse=True)
    keys = vertex_numbers[vertices - first_vertex]
    ids, owner = number_nodes(comm, np.where(keys < 0, -keys - 1, keys))
    piece = None
    if len(own):
        offsets = np.array([section.getOffset(int(v)) for v in vertices])
        coordinates = local.getArray(readonly=True)
        width = dm.getCoordinateDim()
        points = coordinates[offsets[:, None] + np.arange(width)].real
        tags = {} if facet_label is None else _labelled(dm, facet_label, vertices)
        piece = SimplexMesh(points, cells.reshape(rows.shape).astype(np.int32), **tags)
    part = PartitionedMesh(piece, ids, owner, comm)
    return PlexPart(part, vertices.astype(np.int32), (own + first_cell).astype(np.int32))


def _labelled(dm: Any, label: str, vertices: IntArray) -> dict[str, Any]:
    """Return the facets with a value of a label, whose nodes are all on this rank."""
    first, last = dm.getHeightStratum(1)
    low, high = dm.getDepthStratum(0)
    facets, tags = [], []
    for value in dm.getLabelIdIS(label).getIndices().tolist():
        for facet in dm.getStratumIS(label, value).getIndices().tolist():
            if first <= facet < last:
                closure = dm.getTransitiveClosure(facet)[0]
                facets.append(closure[(closure >= low) & (closure < high)])
                tags.append(value)
    if not facets:
        return {}
    rows = np.array(facets)
    at = rows_among(rows, vertices)
    held = (at >= 0).all(axis=1)
    return {"tagged_facets": at[held].astype(np.int32), "facet_tags": np.array(tags)[held]}
