"""Meshes of other programs and packages: methods of `SimplexMesh`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from adaptsize._checks import as_flag, check_type, describe, warn_caller
from adaptsize._formats import assembly, foreign, vtk, writers
from adaptsize._formats.blocks import RawMesh, check_raw
from adaptsize._messages import Message
from adaptsize.background import SimplexMesh
from adaptsize.bridges import solvers
from adaptsize.errors import InputWarning, MeshFileError


def program_of(name: str, mesh: Any) -> solvers.Program:
    """Return the program or package that an object is a mesh of.

    Raises
    ------
    ValueError
        If it is of none.
    """
    found = solvers.program_of(mesh)
    if type(mesh).__module__.partition(".")[0] == "meshio":
        found = solvers.Program(partial(_raw_of_meshio, mesh), to_meshio)
    elif getattr(mesh, "IsA", lambda _: False)("vtkDataObject"):
        found = solvers.Program(partial(vtk.raw_of, mesh), to_pyvista)
    elif found is None and any(map(partial(hasattr, mesh), ("faces", "graph"))):
        found = solvers.Program(partial(foreign.raw_of_trimesh, mesh), to_trimesh)
    if found is None:
        raise ValueError(
            f"{name} must be of meshio, PyVista, VTK, trimesh, scikit-fem, DOLFINx, MFEM, Netgen "
            f"or NGSolve, or gmsh.model, got {describe(mesh)}"
        )
    return found


def like(mesh: SimplexMesh, other: Any) -> Any:
    """Return a mesh as an object of the program that another one is of.

    See `SimplexMesh.like`.
    """
    return mesh if isinstance(other, SimplexMesh) else program_of("other", other).write(mesh)


def from_object(mesh: Any, *, kind: str | None = None, flatten: bool = True) -> SimplexMesh:
    """Return the simplices of a mesh of another program, with its tags and their names.

    See `SimplexMesh.from_object`.
    """
    flatten = as_flag("flatten", flatten)
    read = program_of("mesh", mesh).read
    notes: list[str] = []
    try:
        raw = read()
        check_raw(raw)
        notes += raw.notes
        made = assembly.build(raw, kind=kind, flatten=flatten, notes=notes)
    except MeshFileError as error:
        raise ValueError(f"mesh {error}") from error
    if notes:
        warn_caller(Message.joined("; ", notes), InputWarning)
    return made


def _raw_of_meshio(mesh: Any) -> RawMesh:
    names = {}
    for name, value in mesh.field_data.items():
        pair = np.asarray(value)
        if pair.shape == (2,) and pair.dtype.kind in "iu" and 0 <= pair[1] <= 3:
            names[int(pair[1]), int(pair[0])] = str(name)
    blocks = [(block.type, np.asarray(block.data)) for block in mesh.cells]
    points = np.asarray(mesh.points, np.float64)
    return RawMesh(points, blocks, mesh.point_data, mesh.cell_data, names)


def to_trimesh(mesh: SimplexMesh) -> Any:
    """Return a ``trimesh.Trimesh`` of triangles in space, or of the boundary of tetrahedra.

    Points and triangles are in the same order.  Tags are left out.
    """
    import trimesh

    surface = writers.content_of(writers.surface_of(mesh), "cell_tags", pad=True)
    return trimesh.Trimesh(surface.points, surface.blocks[0][1], process=False)


def to_meshio(mesh: SimplexMesh, *, tag_name: str = "cell_tags") -> Any:
    """Return a ``meshio.Mesh`` with the same cells, tags, tagged facets, names and fields.

    See `SimplexMesh.to_meshio`.
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


def to_pyvista(mesh: SimplexMesh) -> Any:
    """Return a ``pyvista.UnstructuredGrid`` with the same cells, tags, names and fields.

    See `SimplexMesh.to_pyvista`.
    """
    import pyvista

    return pyvista.wrap(vtk.grid_of(writers.content_of(mesh, "cell_tags", pad=True)))
