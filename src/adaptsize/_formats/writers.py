"""Writing of meshes by VTK and by meshio."""

from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import check_type, describe
from adaptsize._formats import sizes, vtk
from adaptsize._formats.blocks import SIMPLEX, UNTAGGED, RawMesh
from adaptsize._formats.quadratic import with_middles
from adaptsize._formats.text import numbered, write_text
from adaptsize._size_function import SizeFunction
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.background.simplex import as_own
from adaptsize.metrics import MetricFunction

#: Gmsh's numbers of types of cells.
_GMSH_TYPES = {
    "line": 1, "triangle": 2, "tetra": 4, "line3": 8, "triangle6": 9, "tetra10": 11,
}  # fmt: skip


def content_of(mesh: SimplexMesh, tag_name: str, *, pad: bool) -> RawMesh:
    """Return the data to write, tagged facets as a second block of cells.

    ``pad`` makes points of 2-D meshes 3-D.
    """
    points = mesh.points
    if pad and mesh.dim < 3:
        points = np.pad(points, ((0, 0), (0, 3 - mesh.dim)))
    blocks = [(SIMPLEX[mesh.cell_dim], mesh.cells)]
    facets, facet_tags = mesh.tagged_facets, mesh.facet_tags
    n_facets = 0 if facets is None or mesh.cell_dim == 1 else len(facets)
    if facets is not None and n_facets:
        blocks.append((SIMPLEX[mesh.cell_dim - 1], facets))
    cell_data = {
        name: [vtk.plain(name, values)]
        for name, values in mesh.cell_data.items()
        if name != tag_name
    }
    if n_facets:
        for parts in cell_data.values():
            fill = np.nan if parts[0].dtype.kind == "f" else 0
            parts.append(np.full((n_facets, *parts[0].shape[1:]), fill, parts[0].dtype))
    if mesh.cell_tags is not None or n_facets:
        of_cells = np.zeros(mesh.n_cells, np.int32) if mesh.cell_tags is None else mesh.cell_tags
        cell_data[tag_name] = [of_cells]
        if facet_tags is not None and n_facets:
            cell_data[tag_name].append(facet_tags)
    point_data = {name: vtk.plain(name, values) for name, values in mesh.point_data.items()}
    return RawMesh(points, blocks, point_data, cell_data, dict(mesh.tag_names))


def surface_of(mesh: SimplexMesh) -> SimplexMesh:
    """Return triangles: the mesh itself, or the boundary of tetrahedra."""
    return mesh.boundary().mesh if mesh.cell_dim == 3 else mesh


def _write_with_meshio(path: Path, content: RawMesh, file_format: str, **options: Any) -> None:
    import meshio

    mesh = meshio.Mesh(content.points, content.blocks, content.point_data, content.cell_data)
    with np.errstate(invalid="ignore", divide="ignore"):  # normals of flat triangles
        meshio.write(path, mesh, file_format=file_format, **options)


def write_vtk(path: Path, mesh: SimplexMesh, suffix: str, order: int = 1) -> None:
    """Write a mesh in one of VTK's formats, by its suffix."""
    content = content_of(mesh, "cell_tags", pad=True)
    content = with_middles(content) if order == 2 else content
    if suffix == ".vtkhdf":
        vtk.write_hdf(path, content)
    else:
        vtk.write(path, suffix, (vtk.surface_of if suffix == ".vtp" else vtk.grid_of)(content))


def write_xdmf(path: Path, mesh: SimplexMesh) -> None:
    """Write a mesh as XDMF, with its numbers in the XML."""
    content = content_of(mesh, "cell_tags", pad=mesh.dim == 1)
    _write_with_meshio(path, content, "xdmf", data_format="XML")


def write_gmsh(path: Path, mesh: SimplexMesh, order: int = 1) -> None:
    """Write a mesh with tags and nodal fields as Gmsh 2.2, as text."""
    # In version 4.1, a physical group belongs to an entity, which a SimplexMesh lacks.  The readers
    # of several programs take text only, and meshio's fails on cell fields.
    content = content_of(mesh, "gmsh:physical", pad=True)
    content = with_middles(content) if order == 2 else content
    groups, names = gmsh_groups(mesh, content)
    lines = [f'{dim} {tag} "{name}"\n' for (dim, tag), name in sorted(names.items())]
    pieces: list[Any] = ["$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"]
    if names:
        pieces.append(f"$PhysicalNames\n{len(lines)}\n{''.join(lines)}$EndPhysicalNames\n")
    n = len(content.points)
    nodes = ("%d %.17g %.17g %.17g\n", numbered(content.points))
    n_cells = sum(len(cells) for _, cells in content.blocks)
    pieces += [f"$Nodes\n{n}\n", nodes, f"$EndNodes\n$Elements\n{n_cells}\n"]
    first, no_tags = 1, [np.zeros(len(cells), np.int32) for _, cells in content.blocks]
    of_blocks = zip(
        content.blocks,
        groups.get("gmsh:physical", no_tags),
        groups.get("gmsh:geometrical", no_tags),
        strict=True,
    )
    for (name, cells), group, entity in of_blocks:
        rows = cells[:, [*range(8), 9, 8]] if name == "tetra10" else cells  # the order of Gmsh
        line = f"%d {_GMSH_TYPES[name]} 2{' %d' * (2 + rows.shape[1])}\n"
        pieces.append((line, numbered(np.column_stack([group, entity, rows + 1]), first)))
        first += len(cells)
    pieces.append("$EndElements\n")
    for name, values in content.point_data.items():
        columns = _gmsh_components(values).reshape(n, -1)
        width = columns.shape[1]
        head = f'$NodeData\n1\n"{name}"\n1\n0\n3\n0\n{width}\n{n}\n'
        line = "%d" + " %.17g" * width + "\n"
        pieces += [head, (line, numbered(columns)), "$EndNodeData\n"]
    write_text(path, *pieces)


def gmsh_groups(
    mesh: SimplexMesh, content: RawMesh
) -> tuple[dict[str, Sequence[npt.NDArray[Any]]], dict[tuple[int, int], str]]:
    """Return the cell data that Gmsh needs, and the names of the physical groups.

    Group 0 means no group.  In a file with groups Gmsh ignores cells in no group, so untagged
    cells get a separate group.
    """
    names = {key: name for key, name in mesh.tag_names.items() if key[0] <= mesh.cell_dim}
    groups = content.cell_data.get("gmsh:physical")
    if groups is None:
        return {}, names
    of_cells, *of_facets = groups
    if any(part.any() for part in groups) and not of_cells.all():
        taken = {tag for dim, tag in names if dim == mesh.cell_dim}.union(of_cells.tolist())
        number = next(number for number in count(1) if number not in taken)
        names[mesh.cell_dim, number] = UNTAGGED
        groups = [np.where(of_cells == 0, np.int32(number), of_cells), *of_facets]
    # Gmsh needs an entity number above 0, and one physical group for each.
    entity = np.unique(np.concatenate(groups), return_inverse=True)[1].reshape(-1) + 1
    ends = np.cumsum([len(part) for part in groups])[:-1]
    entities = np.split(entity.astype(np.int32), ends)
    return {"gmsh:physical": groups, "gmsh:geometrical": entities}, names


def _gmsh_components(values: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Return float64 with 1, 3 or 9 components, as Gmsh requires.  Others are padded."""
    columns = values.astype(np.float64).reshape(len(values), -1)
    wanted = next((n for n in (1, 3, 9) if n >= columns.shape[1]), None)
    if wanted is None:
        raise ValueError(f"Gmsh fields have at most 9 components, got {columns.shape[1]}")
    padded = np.pad(columns, ((0, 0), (0, wanted - columns.shape[1])))
    return padded[:, 0] if wanted == 1 else padded


def write_medit(path: Path, mesh: SimplexMesh) -> None:
    """Write a mesh with tags for Medit and Mmg, as text or binary."""
    content = content_of(mesh, "medit:ref", pad=False)
    no_tags = [np.zeros(len(cells), np.int32) for _, cells in content.blocks]
    tags = content.cell_data.get("medit:ref", no_tags)
    refs = content.point_data.get("medit:ref", np.zeros(mesh.n_points, np.int32))
    slim = RawMesh(content.points, content.blocks, {"medit:ref": refs}, {"medit:ref": tags})
    _write_with_meshio(path, slim, "medit")


def write_surface(path: Path, mesh: SimplexMesh, file_format: str, **options: Any) -> None:
    """Write triangles, and to PLY the nodal fields of one component."""
    content = content_of(surface_of(mesh), "cell_tags", pad=True)
    scalars = {name: v for name, v in content.point_data.items() if v.ndim == 1}
    nodal = scalars if file_format == "ply" else {}
    slim = RawMesh(content.points, content.blocks[:1], nodal, {})
    _write_with_meshio(path, slim, file_format, **options)


def parts_of(
    obj: object, fields: Mapping[str, npt.ArrayLike] | None
) -> tuple[SimplexMesh | CartesianGrid, dict[str, npt.ArrayLike]]:
    """Return the mesh or grid, and the nodal fields that must be written."""
    nodal: dict[str, npt.ArrayLike] = {}
    obj = background = as_own(obj)
    if isinstance(obj, SizeFunction):
        background = obj.background
        nodal["h"] = obj.values
    elif isinstance(obj, MetricFunction):
        background = obj.mesh
        nodal |= sizes.fields_of(obj.metric)
    if isinstance(background, Octree):
        background = background.mesh
    if not isinstance(background, SimplexMesh | CartesianGrid):
        raise ValueError(
            "obj must be a SimplexMesh, CartesianGrid, Octree, a SizeFunction or a MetricFunction, "
            f"got {describe(background)}"
        )
    if fields is not None:
        check_type("fields", fields, Mapping)
        for name in fields:
            check_type("names of fields", name, str)
        nodal.update(fields)
    return background, nodal


def growth_of(obj: object, n_points: int) -> dict[str, npt.ArrayLike]:
    """Return how a size function grows off its background, as constant nodal fields."""
    if not isinstance(obj, SizeFunction) or obj.g is None:
        return {}
    growth = {"h.g": obj.g} | ({"h.hmax": obj.hmax} if np.isfinite(obj.hmax) else {})
    return {name: np.full(n_points, value) for name, value in growth.items()}


def growth_in(fields: Mapping[str, npt.NDArray[Any]], name: str) -> dict[str, Any]:
    """Return g and hmax of a size function from the fields of a file, if they are there."""
    return {
        part: float(np.ravel(fields[f"{name}.{part}"])[0])
        for part in ("g", "hmax")
        if f"{name}.{part}" in fields
    }
