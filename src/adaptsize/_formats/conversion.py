"""Conversion of meshes to and from objects of meshio and PyVista: methods of `SimplexMesh`."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_flag, check_type, describe
from adaptsize._formats import assembly, writers
from adaptsize._formats.blocks import RawMesh, check_raw
from adaptsize.background import SimplexMesh
from adaptsize.errors import MeshFileError, MeshRepairWarning

# VTK cell types by their names in meshio.  Higher-order cells are reduced to their corners.
_FROM_VTK = {
    1: "vertex", 3: "line", 5: "triangle", 9: "quad", 10: "tetra", 12: "hexahedron", 13: "wedge",
    14: "pyramid", 21: "line3", 22: "triangle6", 23: "quad8", 24: "tetra10", 25: "hexahedron20",
    26: "wedge15", 27: "pyramid13", 28: "quad9", 29: "hexahedron27",
}  # fmt: skip
_TO_VTK = {"line": 3, "triangle": 5, "tetra": 10}
_POLYLINE, _PIXEL, _VOXEL = 4, 8, 11
# VTK's pixels and voxels number their nodes row by row, unlike other cells.
_TURNED = {_PIXEL: ("quad", [0, 1, 3, 2]), _VOXEL: ("hexahedron", [0, 1, 3, 2, 4, 5, 7, 6])}
#: PyVista's field of texts "dimension tag name".
_NAMES = "tag_names"


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
    return _built(raw, kind, flatten)


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
    mesh : pyvista.DataSet
        An ``UnstructuredGrid``, ``PolyData`` or any other data set.  Not changed.
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
        If it is not a data set, has no such cells, or has polygons of over four corners.

    Warns
    -----
    MeshRepairWarning
        If cells were dropped or converted, with their number.
    """
    import pyvista

    if not isinstance(mesh, pyvista.DataSet):
        raise ValueError(f"mesh must be a PyVista data set, got {describe(mesh)}")
    grid = mesh.cast_to_unstructured_grid()
    blocks, parents = [], []
    for cell_type, cells, parent in _blocks_of(grid):
        blocks.append((cell_type, cells))
        parents.append(parent)
    cell_data = {name: np.asarray(grid.cell_data[name]) for name in grid.cell_data}
    raw = RawMesh(
        np.array(grid.points, np.float64),
        blocks,
        {name: np.array(grid.point_data[name]) for name in grid.point_data},
        {name: [values[parent] for parent in parents] for name, values in cell_data.items()},
        _names_in(mesh),
    )
    return _built(raw, kind, flatten)


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

    content = writers.content_of(mesh, "cell_tags", pad=True)
    rows = [np.insert(cells, 0, cells.shape[1], axis=1).ravel() for _, cells in content.blocks]
    types = [np.full(len(cells), _TO_VTK[cell_type]) for cell_type, cells in content.blocks]
    grid = pyvista.UnstructuredGrid(
        np.concatenate(rows), np.concatenate(types).astype(np.uint8), np.array(content.points)
    )
    for name, values in content.point_data.items():
        grid.point_data[name] = np.array(values)
    for name, parts in content.cell_data.items():
        grid.cell_data[name] = np.concatenate(parts)
    if mesh.tag_names:
        lines = [f"{dim} {tag} {name}" for (dim, tag), name in mesh.tag_names.items()]
        grid.field_data[_NAMES] = np.array(lines)
    return grid


def _built(raw: RawMesh, kind: str | None, flatten: bool) -> SimplexMesh:
    flatten = as_flag("flatten", flatten)
    notes: list[str] = []
    try:
        check_raw(raw)
        made = assembly.build(raw, kind=kind, flatten=flatten, notes=notes)
    except MeshFileError as error:
        raise ValueError(f"mesh {error}") from error
    if notes:
        warnings.warn("; ".join(notes), MeshRepairWarning, stacklevel=3)
    return made


def _blocks_of(
    grid: Any,
) -> Iterator[tuple[str, npt.NDArray[np.int64], npt.NDArray[np.intp]]]:
    """Yield the cells of each type and size with their numbers in the grid."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    types = np.asarray(grid.celltypes)
    start = vtk_to_numpy(grid.GetCells().GetOffsetsArray()).astype(np.int64)
    nodes, width = np.asarray(grid.cell_connectivity, np.int64), np.diff(start)
    for vtk_type in np.unique(types):
        for size in np.unique(width[types == vtk_type]):
            of_type = np.flatnonzero((types == vtk_type) & (width == size))
            cells = nodes[start[of_type][:, None] + np.arange(size)]
            if vtk_type == _POLYLINE:
                pairs = np.stack([cells[:, :-1], cells[:, 1:]], axis=2)
                yield "line", pairs.reshape(-1, 2), np.repeat(of_type, size - 1)
            elif vtk_type in _TURNED:
                name, order = _TURNED[int(vtk_type)]
                yield name, cells[:, order], of_type
            elif vtk_type in _FROM_VTK:
                yield _FROM_VTK[int(vtk_type)], cells, of_type
            else:
                raise ValueError(
                    f"mesh holds cells of VTK type {vtk_type}, which cannot be converted; "
                    "mesh.triangulate() splits polygons into triangles"
                )


def _names_in(mesh: Any) -> dict[tuple[int, int], str]:
    names = {}
    for line in mesh.field_data.get(_NAMES, ()):
        dim, tag, name = str(line).split(" ", 2)
        names[int(dim), int(tag)] = name
    return names
