"""Meshes of scikit-fem, MFEM, Netgen, DOLFINx and Gmsh, with the names of their tags."""

from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._formats import writers
from adaptsize._formats.blocks import SIMPLEX, UNTAGGED, RawMesh, dimension_of, n_nodes_of
from adaptsize._formats.for_solvers import groups_of
from adaptsize._formats.gmsh import text_of_further
from adaptsize._pickling import once
from adaptsize.background import PartitionedMesh, SimplexMesh
from adaptsize.distributed import DolfinxMesh, from_dolfinx
from adaptsize.distributed import to_dolfinx as distributed_to_dolfinx
from adaptsize.distributed.solvers import nodal_functions
from adaptsize.errors import MeshFileError


class Program(NamedTuple):
    """How the mesh of a program is read, and how a mesh becomes one of that program."""

    read: Callable[[], RawMesh]
    write: Callable[[SimplexMesh], Any]


def program_of(mesh: Any) -> Program | None:
    """Return the program that a mesh is of; None if it is none of these."""
    if hasattr(getattr(mesh, "model", mesh), "getPhysicalGroups"):
        return Program(partial(_raw_of_gmsh, getattr(mesh, "model", mesh)), to_gmsh)
    if hasattr(mesh, "GetBdrElement"):
        return Program(partial(_raw_of_mfem, mesh), to_mfem)
    if hasattr(mesh, "boundaries") and hasattr(mesh, "subdomains"):
        return Program(partial(_raw_of_skfem, mesh), to_skfem)
    if hasattr(mesh, "ngmesh"):
        return Program(partial(_raw_of_netgen, mesh.ngmesh), _to_ngsolve)
    if hasattr(mesh, "Elements2D"):
        return Program(partial(_raw_of_netgen, mesh), to_netgen)
    if hasattr(mesh, "topology"):
        return Program(partial(_raw_of_dolfinx, mesh), lambda own: to_dolfinx(own).mesh)
    if hasattr(getattr(mesh, "mesh", None), "topology"):
        return Program(partial(_raw_of_dolfinx, mesh), to_dolfinx)
    return None


class _Groups(NamedTuple):
    """The cells and the tagged facets of a mesh, each with a positive tag."""

    points: npt.NDArray[Any]
    """In space."""
    cells: list[npt.NDArray[Any]]
    """The cells and, if there are any, the tagged facets."""
    tags: list[npt.NDArray[np.int32]]
    names: dict[tuple[int, int], str]
    """Names by dimension and tag; of tags without a name, the number."""


def _groups_of(mesh: SimplexMesh, *, with_boundary: bool = False) -> _Groups:
    """Return the groups for programs in which each cell has a positive tag.

    Untagged cells of a mesh with tags get a group of their own, as in files of Gmsh.  Solvers need
    ``with_boundary``: if no facets are tagged, all of the boundary is a group.
    """
    content = writers.content_of(mesh, "gmsh:physical", pad=True)
    if mesh.cell_dim == mesh.dim:  # MFEM needs cells of positive orientation
        turned = np.array(mesh.cells)
        turned[mesh.signed_measures < 0.0, :2] = turned[mesh.signed_measures < 0.0, 1::-1]
        content.blocks[0] = (content.blocks[0][0], turned)
    groups, names = writers.gmsh_groups(mesh, content)
    cells = [rows for _, rows in content.blocks]
    tags = [np.ones(len(rows), np.int32) for rows in cells]
    tags = [np.asarray(part, np.int32) for part in groups.get("gmsh:physical", tags)]
    if with_boundary and len(cells) == 1 and mesh.cell_dim > 1:
        boundary = mesh.boundary()
        cells.append(boundary.nodes[boundary.mesh.cells])
        tags.append(np.ones(len(cells[1]), np.int32))
    if min(part.min(initial=1) for part in tags) < 1:
        raise ValueError("cell_tags and facet_tags must be positive for this program")
    held = [(rows.shape[1] - 1, tag) for rows, part in zip(cells, tags, strict=True)
            for tag in np.unique(part).tolist()]  # fmt: skip
    return _Groups(content.points, cells, tags, {key: names.get(key, str(key[1])) for key in held})


def _raw_of_skfem(mesh: Any) -> RawMesh:
    if not type(mesh).__name__.startswith(("MeshLine", "MeshTri", "MeshTet")):
        raise MeshFileError("must hold triangles or tetrahedra; use mesh.to_meshtri or to_meshtet")
    n_corners = mesh.p.shape[0] + 1
    points, cells = np.array(mesh.p).T, np.array(mesh.t)[:n_corners].T
    blocks, tags, names = [(SIMPLEX[n_corners - 1], cells)], [np.zeros(len(cells), np.int32)], {}
    further = Counter[tuple[int, int]]()
    for number, (name, part) in enumerate((mesh.subdomains or {}).items(), start=1):
        own = np.asarray(part)
        is_first = tags[0][own] == 0
        tags[0][own[is_first]] = number
        names[n_corners - 1, number] = str(name)
        if not is_first.all():
            further[n_corners - 1, number] = int(np.count_nonzero(~is_first))
    notes = [text_of_further(further, names)] if further else []
    if mesh.boundaries and n_corners > 2:
        parts = [np.array(mesh.facets)[:, np.asarray(part)].T for part in mesh.boundaries.values()]
        blocks.append((SIMPLEX[n_corners - 2], np.concatenate(parts)))
        numbers = range(1, len(parts) + 1)
        tags.append(np.repeat(numbers, [len(part) for part in parts]).astype(np.int32))
        names |= {(n_corners - 2, i): str(n) for i, n in enumerate(mesh.boundaries, start=1)}
    return RawMesh(points, blocks, {}, {"cell_tags": tags}, names, notes)


#: Names of the cells of Netgen by the codes of its types; the corners come first.
_OF_NETGEN = {
    0: "line", 10: "triangle", 12: "triangle", 11: "quad", 13: "quad", 14: "quad", 20: "tetra",
    21: "tetra10", 22: "pyramid", 28: "pyramid", 23: "wedge", 24: "wedge", 27: "wedge",
    25: "hexahedron", 26: "hexahedron",
}  # fmt: skip


def _raw_of_netgen(mesh: Any) -> RawMesh:
    blocks, tags = [], []
    for usual, elements in (
        (0, mesh.Elements1D()),
        (10, mesh.Elements2D()),
        (20, mesh.Elements3D()),
    ):
        found = elements.NumPy()
        types = found["type"] if "type" in found.dtype.names else np.full(len(found), usual)
        for code in np.unique(types).tolist():
            if code not in _OF_NETGEN:
                raise MeshFileError(f"holds elements of type {code} of Netgen")
            name, rows = _OF_NETGEN[code], found[types == code]
            blocks.append((name, rows["nodes"][:, : n_nodes_of(name)].astype(np.int64) - 1))
            tags.append(rows["index"].astype(np.int32))
    dim, names = mesh.dim, {}
    for of_dim, name_of in ((dim, mesh.GetMaterial), (dim - 1, lambda i: mesh.GetBCName(i - 1))):
        held = [
            t for (name, _), t in zip(blocks, tags, strict=True) if dimension_of(name) == of_dim
        ]
        for number in np.unique(np.concatenate([np.empty(0, np.int32), *held])).tolist():
            names[of_dim, number] = str(name_of(number))
    points = np.array(mesh.Coordinates(), np.float64)
    good = {key: name for key, name in names.items() if name not in ("", "default")}
    return RawMesh(points, blocks, {}, {"cell_tags": tags}, good)


def to_skfem(mesh: SimplexMesh) -> Any:
    """Return a mesh of scikit-fem with named subdomains and boundaries.

    See `SimplexMesh.to_skfem`.
    """
    import skfem

    if mesh.cell_dim != mesh.dim:
        raise ValueError(f"mesh must fill its space for scikit-fem, got {mesh!r}")
    kind = {1: skfem.MeshLine, 2: skfem.MeshTri, 3: skfem.MeshTet}[mesh.dim]
    made = kind(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.cells.T))
    if mesh.cell_tags is not None:
        parts = groups_of(mesh, mesh.dim, mesh.cell_tags)
        made = made.with_subdomains({n: own for n, own in parts.items() if mesh.cell_tags[own[0]]})
    if mesh.tagged_facets is not None and mesh.facet_tags is not None:
        place = {tuple(nodes): i for i, nodes in enumerate(np.sort(made.facets.T, axis=1).tolist())}
        rows = [place[tuple(nodes)] for nodes in np.sort(mesh.tagged_facets, axis=1).tolist()]
        parts = groups_of(mesh, mesh.dim - 1, mesh.facet_tags)
        made = made.with_boundaries(
            {n: np.array(rows)[own] for n, own in parts.items() if mesh.facet_tags[own[0]]}
        )
    return made


#: Names of the cells of MFEM by the codes of its geometries, and of Gmsh by its names.
_OF_MFEM = {1: "line", 2: "triangle", 3: "quad", 4: "tetra", 5: "hexahedron", 6: "wedge",
            7: "pyramid"}  # fmt: skip
_OF_GMSH = {"Point": "vertex", "Line": "line", "Triangle": "triangle", "Quadrilateral": "quad",
            "Pyramid": "pyramid", "Tetrahedron": "tetra", "Hexahedron": "hexahedron",
            "Prism": "wedge"}  # fmt: skip


def _raw_of_mfem(mesh: Any) -> RawMesh:
    dim, blocks, tags, names = mesh.Dimension(), [], [], {}
    for of_dim, count, element, attributes, sets in (
        (dim, mesh.GetNE(), mesh.GetElement, mesh.GetAttributeArray, "attribute_sets"),
        (dim - 1, mesh.GetNBE(), mesh.GetBdrElement, mesh.GetBdrAttributeArray,
         "bdr_attribute_sets"),
    ):  # fmt: skip
        elements = [element(i) for i in range(count)]
        types = np.array([each.GetGeometryType() for each in elements], np.int64)
        for code in np.unique(types).tolist() if of_dim else []:
            rows = np.flatnonzero(types == code)
            blocks.append(
                (_OF_MFEM[code], np.array([elements[i].GetVerticesArray() for i in rows]))
            )
            tags.append(np.asarray(attributes(), np.int32)[rows])
        held = getattr(mesh, sets, None)  # since MFEM 4.7
        if held is None:
            continue
        for name in sorted(held.GetAttributeSetNames()):
            numbers = list(held.GetAttributeSet(name).ToList())
            if len(numbers) == 1:
                names[of_dim, int(numbers[0])] = str(name)
    points = np.array(mesh.GetVertexArray(), np.float64)
    notes = ["hanging nodes are not joined to their edges"] * bool(mesh.Nonconforming())
    return RawMesh(points, blocks, {}, {"cell_tags": tags}, names, notes)


def to_mfem(mesh: SimplexMesh) -> Any:
    """Return an ``mfem.ser.Mesh``, tags as attributes and their names as sets of attributes.

    See `SimplexMesh.to_mfem`.
    """
    import mfem.ser

    groups = _groups_of(mesh, with_boundary=True)
    counts = [len(rows) for rows in groups.cells]
    made = mfem.ser.Mesh(mesh.cell_dim, mesh.n_points, counts[0], sum(counts[1:]), mesh.dim)
    for point in groups.points.tolist():
        made.AddVertex(*point)
    add = {1: made.AddSegment, 2: made.AddTriangle, 3: made.AddTet}
    add_boundary = {1: made.AddBdrSegment, 2: made.AddBdrTriangle}
    for i, (rows, tags) in enumerate(zip(groups.cells, groups.tags, strict=True)):
        add_one = (add_boundary if i else add)[rows.shape[1] - 1]
        for nodes, tag in zip(rows.tolist(), tags.tolist(), strict=True):
            add_one(nodes, tag)
    made.FinalizeTopology()
    made.Finalize()
    named: dict[tuple[int, str], list[int]] = {}
    for (dim, tag), name in groups.names.items():
        if (dim, tag) in mesh.tag_names or name == UNTAGGED:
            named.setdefault((dim, name), []).append(tag)
    for (dim, name), own in named.items():
        sets = made.attribute_sets if dim == mesh.cell_dim else made.bdr_attribute_sets
        sets.SetAttributeSet(name, mfem.ser.intArray(own))
    return made


def to_netgen(mesh: SimplexMesh) -> Any:
    """Return a ``netgen.meshing.Mesh``; ``ngsolve.Mesh`` of it is that of NGSolve.

    See `SimplexMesh.to_netgen`.
    """
    from netgen.meshing import FaceDescriptor
    from netgen.meshing import Mesh as NetgenMesh

    if mesh.cell_dim != mesh.dim or mesh.dim == 1:
        raise ValueError(f"mesh must be triangles in the plane or tetrahedra, got {mesh!r}")
    groups = _groups_of(mesh, with_boundary=True)
    made = NetgenMesh(dim=mesh.dim)
    made.AddPoints(np.ascontiguousarray(groups.points))
    for rows, tags in zip(groups.cells, groups.tags, strict=True):
        dim = rows.shape[1] - 1
        kinds, index = np.unique(tags, return_inverse=True)
        for number, tag in enumerate(kinds.tolist(), start=1):
            if dim == 2:
                made.Add(
                    FaceDescriptor(surfnr=number, domin=number if mesh.dim == 2 else 1, bc=number)
                )
            name = groups.names[dim, tag]
            if dim == mesh.dim:
                made.SetMaterial(number, name)
            else:
                made.SetBCName(number - 1, name)
        for part in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(index)) + 1):
            data = np.ascontiguousarray(rows[part], np.int32)
            made.AddElements(dim=dim, index=int(index[part[0]]) + 1, data=data, base=0)
    return made


def _raw_of_gmsh(model: Any) -> RawMesh:
    """Return the mesh of a model of Gmsh in the order of its numbers, with physical groups."""
    numbers, coordinates, _ = model.mesh.getNodes()
    order = np.argsort(numbers)
    place = np.zeros(int(max(numbers, default=0)) + 1, np.int64)
    place[numbers[order].astype(np.int64)] = np.arange(len(numbers))
    held: dict[str, list[Any]] = {}
    further = Counter[tuple[int, int]]()
    for dim, entity in model.getEntities():
        groups = model.getPhysicalGroupsForEntity(dim, entity)
        for kind, tags, nodes in zip(*model.mesh.getElements(dim, entity), strict=True):
            name, _, _, width, _, n_corners = model.mesh.getElementProperties(kind)
            base = _OF_GMSH.get(name.split()[0])
            if base is None:
                raise MeshFileError(f"holds elements of the type {name!r}")
            rows = place[nodes.astype(np.int64)].reshape(-1, width)
            base = base if width == n_corners else f"{base}{width}"
            group = np.full(len(rows), groups[0] if len(groups) else 0, np.int32)
            held.setdefault(base, []).append((tags, rows, group))
            further.update({(dim, int(other)): len(rows) for other in groups[1:]})
    blocks, physical = [], []
    top = max(map(dimension_of, held), default=0)
    for base, parts in held.items():
        tags, rows, group = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        by_number = np.argsort(tags)
        if dimension_of(base) < top:  # boundaries in no group are left out
            by_number = by_number[group[by_number] != 0]
        blocks.append((base, rows[by_number]))
        physical.append(group[by_number])
    found = {key: model.getPhysicalName(*key) for key in model.getPhysicalGroups()}
    names = {key: name for key, name in found.items() if name}
    points = coordinates.reshape(-1, 3)[order]
    notes = [text_of_further(further, names)] if further else []
    return RawMesh(points, blocks, {}, {"gmsh:physical": physical}, names, notes)


def _to_ngsolve(mesh: SimplexMesh) -> Any:
    import ngsolve

    return ngsolve.Mesh(to_netgen(mesh))


def to_gmsh(mesh: SimplexMesh, name: str = "adaptsize") -> Any:
    """Make the mesh a new model of Gmsh, with tags as physical groups, and return ``gmsh.model``.

    See `SimplexMesh.to_gmsh`.
    """
    import gmsh

    groups = _groups_of(mesh)
    if not gmsh.isInitialized():
        gmsh.initialize(interruptible=False)
    gmsh.model.add(name)
    points, n_elements = groups.points, 0
    for rows, tags in zip(groups.cells, groups.tags, strict=True):
        dim = rows.shape[1] - 1
        for tag in np.unique(tags).tolist():
            entity = gmsh.model.addDiscreteEntity(dim)
            if len(points):  # on the first entity; Gmsh moves them to their own
                gmsh.model.mesh.addNodes(dim, entity, np.arange(1, len(points) + 1), points.ravel())
                points = points[:0]
            own = np.flatnonzero(tags == tag)
            kind, numbers = {1: 1, 2: 2, 3: 4}[dim], n_elements + 1 + own
            gmsh.model.mesh.addElementsByType(entity, kind, numbers, rows[own].ravel() + 1)
            if mesh.cell_tags is not None or len(groups.cells) > 1:
                group = groups.names[dim, tag]
                named = (dim, tag) in mesh.tag_names or group == UNTAGGED
                gmsh.model.addPhysicalGroup(dim, [entity], tag, group if named else "")
        n_elements += len(rows)
    gmsh.model.mesh.reclassifyNodes()
    return gmsh.model


def _raw_of_dolfinx(mesh: Any) -> RawMesh:
    if getattr(mesh, "mesh", mesh).comm.size > 1:
        raise MeshFileError("is distributed; use adaptsize.distributed.from_dolfinx")
    part = from_dolfinx(mesh).part.mesh
    if part is None:
        raise MeshFileError("has no cells")
    return writers.content_of(part, "cell_tags", pad=False)


def to_dolfinx(mesh: SimplexMesh) -> DolfinxMesh:
    """Return a ``dolfinx.mesh.Mesh`` on this process, with its tags and nodal fields.

    See `SimplexMesh.to_dolfinx`.
    """
    bare = mesh.without_data()
    # Fields of DOLFINx that `adapt` returns are on the same mesh of DOLFINx.
    made = once(mesh, "_dolfinx", lambda: distributed_to_dolfinx(PartitionedMesh.from_serial(bare)))
    values = {name: np.asarray(field) for name, field in mesh.point_data.items()}
    return made._replace(functions=nodal_functions(made.mesh, values))
