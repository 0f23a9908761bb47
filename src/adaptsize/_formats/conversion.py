"""Conversion of meshes to and from objects of meshio and PyVista: methods of `SimplexMesh`."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from adaptsize._checks import as_flag, check_type, describe
from adaptsize._formats import assembly, vtk, writers
from adaptsize._formats.blocks import RawMesh, check_raw
from adaptsize.background import SimplexMesh
from adaptsize.errors import MeshFileError, MeshRepairWarning


def from_object(
    cls: type[SimplexMesh], mesh: Any, *, kind: str | None = None, flatten: bool = True
) -> SimplexMesh:
    """Return the simplices of a mesh of another program, with its tags and their names.

    Functions that take a mesh to remesh, limit, write or draw call this themselves.

    Parameters
    ----------
    mesh : object
        A mesh of meshio, PyVista (or a data set of VTK), trimesh, scikit-fem, Netgen or NGSolve.
        Not changed.
    kind, flatten
        Which cells to read, and whether a coordinate z = 0 is dropped, as for `read`.

    Returns
    -------
    SimplexMesh
        Subdomains of scikit-fem and materials of Netgen are cell tags, boundaries are tagged
        facets, with their names.

    Raises
    ------
    ValueError
        If the object is none of these, or has no such cells.

    Examples
    --------
    >>> import trimesh
    >>> SimplexMesh.from_object(trimesh.creation.box())
    SimplexMesh(8 points in 3-D, 12 triangles)
    """
    package = type(mesh).__module__.partition(".")[0]
    if package == "meshio":
        return from_meshio(cls, mesh, kind=kind, flatten=flatten)
    if package in ("pyvista", "vtkmodules"):
        return from_pyvista(cls, mesh, kind=kind, flatten=flatten)
    if hasattr(mesh, "vertices") and hasattr(mesh, "faces"):  # trimesh
        points, faces = np.array(mesh.vertices), np.array(mesh.faces)
        return _built(lambda: RawMesh(points, [("triangle", faces)]), kind, flatten)
    if hasattr(mesh, "boundaries") and hasattr(mesh, "subdomains"):
        return _built(partial(_raw_of_skfem, mesh), kind, flatten)
    if hasattr(getattr(mesh, "ngmesh", mesh), "Elements2D"):
        return _built(partial(_raw_of_netgen, getattr(mesh, "ngmesh", mesh)), kind, flatten)
    raise ValueError(
        "mesh must be of meshio, PyVista, VTK, trimesh, scikit-fem, Netgen or NGSolve, "
        f"got {describe(mesh)}"
    )


def _raw_of_skfem(mesh: Any) -> RawMesh:
    kinds = {2: "line", 3: "triangle", 4: "tetra"}
    if not type(mesh).__name__.startswith(("MeshLine", "MeshTri", "MeshTet")):
        raise MeshFileError("must hold triangles or tetrahedra; use mesh.to_meshtri or to_meshtet")
    n_corners = mesh.p.shape[0] + 1
    points, cells = np.array(mesh.p).T, np.array(mesh.t)[:n_corners].T
    blocks, tags, names = [(kinds[n_corners], cells)], [np.zeros(len(cells), np.int32)], {}
    for number, (name, part) in enumerate((mesh.subdomains or {}).items(), start=1):
        tags[0][np.asarray(part)] = number
        names[n_corners - 1, number] = str(name)
    if mesh.boundaries and n_corners > 2:
        parts = [np.array(mesh.facets)[:, np.asarray(part)].T for part in mesh.boundaries.values()]
        blocks.append((kinds[n_corners - 1], np.concatenate(parts)))
        numbers = range(1, len(parts) + 1)
        tags.append(np.repeat(numbers, [len(part) for part in parts]).astype(np.int32))
        names |= {(n_corners - 2, i): str(n) for i, n in enumerate(mesh.boundaries, start=1)}
    return RawMesh(points, blocks, {}, {"cell_tags": tags}, names)


def _raw_of_netgen(mesh: Any) -> RawMesh:
    blocks, tags = [], []
    for n, kind, elements in (
        (2, "line", mesh.Elements1D()),
        (3, "triangle", mesh.Elements2D()),
        (4, "tetra", mesh.Elements3D()),
    ):
        found = elements.NumPy()
        if len(found):
            blocks.append((kind, found["nodes"][:, :n].astype(np.int64) - 1))
            tags.append(found["index"].astype(np.int32))
    dim, names = mesh.dim, {}
    for of_dim, name_of in ((dim, mesh.GetMaterial), (dim - 1, lambda i: mesh.GetBCName(i - 1))):
        kind = {1: "line", 2: "triangle", 3: "tetra"}[of_dim]
        numbers = [tag for (name, _), tag in zip(blocks, tags, strict=True) if name == kind]
        for number in np.unique(np.concatenate([np.empty(0, np.int32), *numbers])).tolist():
            names[of_dim, number] = str(name_of(number))
    points = np.array(mesh.Coordinates(), np.float64)
    good = {key: name for key, name in names.items() if name not in ("", "default")}
    return RawMesh(points, blocks, {}, {"cell_tags": tags}, good)


def to_trimesh(mesh: SimplexMesh) -> Any:
    """Return a ``trimesh.Trimesh`` of triangles in space, or of the boundary of tetrahedra.

    Points and triangles are in the same order.  Tags are left out.
    """
    import trimesh

    surface = writers.content_of(writers.surface_of(mesh), "cell_tags", pad=True)
    return trimesh.Trimesh(surface.points, surface.blocks[0][1], process=False)


def to_skfem(mesh: SimplexMesh) -> Any:
    """Return a mesh of scikit-fem with named subdomains and boundaries.

    Returns
    -------
    skfem.MeshLine, MeshTri or MeshTet
        Tags without a name in ``tag_names`` are called by their number.

    Raises
    ------
    ValueError
        If the cells do not have the dimension of the points.
    """
    import skfem

    if mesh.cell_dim != mesh.dim:
        raise ValueError(f"mesh must fill its space for scikit-fem, got {mesh!r}")
    kind = {1: skfem.MeshLine, 2: skfem.MeshTri, 3: skfem.MeshTet}[mesh.dim]
    made = kind(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.cells.T))
    if mesh.cell_tags is not None:
        made = made.with_subdomains(
            {name: np.flatnonzero(mesh.cell_tags == tag)
             for tag, name in _named(mesh, mesh.cell_tags, mesh.dim)}
        )  # fmt: skip
    if mesh.tagged_facets is not None and mesh.facet_tags is not None:
        place = {tuple(nodes): i for i, nodes in enumerate(np.sort(made.facets.T, axis=1).tolist())}
        rows = [place[tuple(nodes)] for nodes in np.sort(mesh.tagged_facets, axis=1).tolist()]
        made = made.with_boundaries(
            {name: np.array(rows)[mesh.facet_tags == tag]
             for tag, name in _named(mesh, mesh.facet_tags, mesh.dim - 1)}
        )  # fmt: skip
    return made


def _named(mesh: SimplexMesh, tags: Any, dim: int) -> list[tuple[int, str]]:
    """Return the tags except 0 with their names."""
    numbers = [tag for tag in np.unique(tags).tolist() if tag]
    return [(tag, mesh.tag_names.get((dim, tag), str(tag))) for tag in numbers]


def from_meshio(
    cls: type[SimplexMesh], mesh: Any, *, kind: str | None = None, flatten: bool = True
) -> SimplexMesh:
    """Return the simplices of a ``meshio.Mesh``, with tags, tagged facets, names and fields.

    Parameters
    ----------
    mesh : meshio.Mesh
        Not changed.
    kind, flatten
        Which cells to read, and whether a coordinate z = 0 is dropped, as for `read`.

    Returns
    -------
    SimplexMesh
        The mesh that `read` returns for a file with the same contents.  It has the cells
        of the highest dimension; cells that are not simplices are split.  Tags come from
        cell data of a known name (``"cell_tags"``, ``"gmsh:physical"``, ...), their names
        from ``field_data``.  Cell sets are ignored.

    Raises
    ------
    ValueError
        If the argument is not a ``meshio.Mesh`` or has no such cells.

    Warns
    -----
    MeshRepairWarning
        If cells were dropped or converted, with their number.

    Examples
    --------
    >>> import meshio
    >>> points = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
    >>> SimplexMesh.from_meshio(meshio.Mesh(points, [("triangle", [[0, 1, 2]])]))
    SimplexMesh(3 points in 2-D, 1 triangles)
    """
    import meshio

    if not isinstance(mesh, meshio.Mesh):
        raise ValueError(f"mesh must be a meshio.Mesh, got {describe(mesh)}")
    names = {}
    for name, value in mesh.field_data.items():
        pair = np.asarray(value)
        if pair.shape == (2,) and pair.dtype.kind in "iu" and 0 <= pair[1] <= 3:
            names[int(pair[1]), int(pair[0])] = str(name)
    raw = RawMesh(
        np.asarray(mesh.points, np.float64),
        [(block.type, np.asarray(block.data)) for block in mesh.cells],
        mesh.point_data,
        mesh.cell_data,
        names,
    )
    return _built(lambda: raw, kind, flatten)


def to_meshio(mesh: SimplexMesh, *, tag_name: str = "cell_tags") -> Any:
    """Return a ``meshio.Mesh`` with the same cells, tags, tagged facets, names and fields.

    Parameters
    ----------
    tag_name : str, default "cell_tags"
        Name of the cell data for the tags.  Use ``"gmsh:physical"`` for files of Gmsh.
        meshio writes these with groups as ``file_format="gmsh22"``; in version 4.1 of the
        format it omits them.  Cells without a tag then form a separate group, as for
        `write`.

    Returns
    -------
    meshio.Mesh
        Tagged facets form a second block of cells.  Other cell data are NaN there, or 0
        for integers.  Names of tags are in ``field_data``, like those of Gmsh's groups.

    Raises
    ------
    ValueError
        If two tags have the same name, or a field is not numeric.
    """
    import meshio

    check_type("tag_name", tag_name, str)
    content = writers.content_of(mesh, tag_name, pad=False)
    names: Mapping[tuple[int, int], str] = mesh.tag_names
    if tag_name == "gmsh:physical":
        groups, names = writers.gmsh_groups(mesh, content)
        content.cell_data = {**content.cell_data, **groups}
    field_data = {name: np.array([tag, dim]) for (dim, tag), name in names.items()}
    if len(field_data) < len(names):
        held = list(names.values())
        twice = next(name for name in held if held.count(name) > 1)
        raise ValueError(
            "tag_names must be distinct for meshio, which keeps one tag per name, "
            f"got {twice!r} twice"
        )
    return meshio.Mesh(
        np.array(content.points),
        [(cell_type, np.array(cells)) for cell_type, cells in content.blocks],
        {name: np.array(values) for name, values in content.point_data.items()},
        {name: [np.array(part) for part in parts] for name, parts in content.cell_data.items()},
        field_data,
    )


def from_pyvista(
    cls: type[SimplexMesh], mesh: Any, *, kind: str | None = None, flatten: bool = True
) -> SimplexMesh:
    """Return the simplices of a PyVista data set, with tags, tagged facets, names and fields.

    Parameters
    ----------
    mesh : pyvista.DataSet, pyvista.MultiBlock or object of VTK
        An ``UnstructuredGrid``, ``PolyData`` or any other data set, or several.  Not changed.
    kind, flatten
        Which cells to read, and whether a coordinate z = 0 is dropped, as for `read`.

    Returns
    -------
    SimplexMesh
        The mesh that `read` returns for a file with the same contents.  Names of tags are
        those that `to_pyvista` writes.

    Raises
    ------
    ValueError
        If it is not a data set, or has no such cells or polyhedra.

    Warns
    -----
    MeshRepairWarning
        If cells were dropped or converted, with their number.
    """
    is_a = getattr(mesh, "IsA", lambda name: False)
    if not (is_a("vtkDataSet") or is_a("vtkCompositeDataSet")):
        raise ValueError(f"mesh must be a PyVista data set, got {describe(mesh)}")
    return _built(partial(vtk.raw_of, mesh), kind, flatten)


def to_pyvista(mesh: SimplexMesh) -> Any:
    """Return a ``pyvista.UnstructuredGrid`` with the same cells, tags, names and fields.

    Returns
    -------
    pyvista.UnstructuredGrid
        Tags are the cell data ``"cell_tags"``.  Tagged facets are additional cells, on which
        other cell data are NaN, or 0 for integers.  Names of tags are strings in the field
        data ``"tag_names"``.  Points of plane meshes get z = 0.
    """
    import pyvista

    return pyvista.wrap(vtk.grid_of(writers.content_of(mesh, "cell_tags", pad=True)))


def _built(read: Callable[[], RawMesh], kind: str | None, flatten: bool) -> SimplexMesh:
    flatten = as_flag("flatten", flatten)
    notes: list[str] = []
    try:
        raw = read()
        check_raw(raw)
        made = assembly.build(raw, kind=kind, flatten=flatten, notes=notes)
    except MeshFileError as error:
        raise ValueError(f"mesh {error}") from error
    if notes:
        warnings.warn("; ".join(notes), MeshRepairWarning, stacklevel=3)
    return made
