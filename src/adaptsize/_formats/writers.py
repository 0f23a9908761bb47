"""Writing of meshes in each format: by VTK, by meshio, and as text for solvers."""

import re
from collections.abc import Callable, Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import check_type, describe
from adaptsize._formats import sizes, vtk
from adaptsize._formats.blocks import SIMPLEX, UNTAGGED, RawMesh
from adaptsize._formats.text import write_text
from adaptsize._size_function import SizeFunction
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.background.simplex import as_own
from adaptsize.metrics import MetricFunction
from adaptsize.typing import IntArray

#: Linear elements by the dimensions of cells and space.
_ELEMENTS = {(1, 2): "T2D2", (1, 3): "T3D2", (2, 2): "CPS3", (2, 3): "S3", (3, 3): "C3D4"}
#: Names of Nastran, and numbers of VTK, for segments, triangles and tetrahedra.
_CARDS, _VTK = {1: "CROD", 2: "CTRIA3", 3: "CTETRA"}, {1: 3, 2: 5, 3: 10}


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


def write_vtk(path: Path, mesh: SimplexMesh, suffix: str) -> None:
    """Write a mesh in one of VTK's formats, by its suffix."""
    content = content_of(mesh, "cell_tags", pad=True)
    if suffix == ".vtkhdf":
        vtk.write_hdf(path, content)
    else:
        vtk.write(path, suffix, (vtk.surface_of if suffix == ".vtp" else vtk.grid_of)(content))


def write_xdmf(path: Path, mesh: SimplexMesh) -> None:
    """Write a mesh as XDMF, with its numbers in the XML."""
    content = content_of(mesh, "cell_tags", pad=mesh.dim == 1)
    _write_with_meshio(path, content, "xdmf", data_format="XML")


def write_gmsh(path: Path, mesh: SimplexMesh) -> None:
    """Write a mesh with tags and nodal fields as Gmsh 2.2."""
    # Version 2.2: in 4.1 a physical group belongs to an entity, which a SimplexMesh lacks.
    # No cell fields: meshio cannot read them back from version 2.2.
    content = content_of(mesh, "gmsh:physical", pad=True)
    tags, names = gmsh_groups(mesh, content)
    nodal = {name: _gmsh_components(values) for name, values in content.point_data.items()}
    # Without zeros, meshio adds them and prints a warning.
    tags = tags or dict.fromkeys(("gmsh:physical", "gmsh:geometrical"), _no_tags(content))
    slim = RawMesh(content.points, content.blocks, nodal, tags)
    _write_with_meshio(path, slim, "gmsh22")
    if names:
        lines = [f'{dim} {tag} "{name}"\n' for (dim, tag), name in sorted(names.items())]
        section = f"$PhysicalNames\n{len(lines)}\n{''.join(lines)}$EndPhysicalNames\n"
        head, end, rest = path.read_bytes().partition(b"$EndMeshFormat\n")
        path.write_bytes(head + end + section.encode() + rest)


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


def _no_tags(content: RawMesh) -> list[npt.NDArray[np.int32]]:
    return [np.zeros(len(cells), np.int32) for _, cells in content.blocks]


def write_medit(path: Path, mesh: SimplexMesh) -> None:
    """Write a mesh with tags for Medit and Mmg, as text or binary."""
    content = content_of(mesh, "medit:ref", pad=False)
    tags = content.cell_data.get("medit:ref", _no_tags(content))
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


def write_abaqus(path: Path, mesh: SimplexMesh) -> None:
    """Write the cells, with a set of elements per tag, and a set of nodes per tag of facets.

    The sets have the names of the tags, or ``region1`` and ``boundary1``.
    """
    pieces: list[Any] = [
        "*HEADING\nwritten by adaptsize\n*NODE\n",
        ("%d, %.16e, %.16e, %.16e\n", _numbered(_in_space(mesh))),
        f"*ELEMENT, TYPE={_ELEMENTS[mesh.cell_dim, mesh.dim]}\n",
        ("%d" + ", %d" * (mesh.cell_dim + 1) + "\n", _numbered(mesh.cells + 1)),
    ]
    # Names of Abaqus are the same in capital letters.
    regions = groups_of(mesh, mesh.cell_dim, mesh.cell_tags, "region", _plain)
    for name, cells in regions.items():
        pieces += [f"*ELSET, ELSET={name}\n", ("%d\n", cells + 1)]
    parts = groups_of(mesh, mesh.cell_dim - 1, mesh.facet_tags, "boundary", _plain)
    for name, facets in parts.items():
        assert mesh.tagged_facets is not None
        nodes = np.unique(mesh.tagged_facets[facets])
        pieces += [f"*NSET, NSET={name}\n", ("%d\n", nodes + 1)]
    write_text(path, *pieces)


def write_nastran(path: Path, mesh: SimplexMesh) -> None:
    """Write cells and tagged facets, with their tags as numbers of properties.

    These start at 1: those without a tag get the smallest number that is not a tag.
    """
    pieces: list[Any] = [
        "$ written by adaptsize\nBEGIN BULK\n",
        (f"GRID*   %-16d{'':16}%16.9E%16.9E\n*       %16.9E\n", _numbered(_in_space(mesh))),
    ]
    first = 1
    for cells, tags in ((mesh.cells, mesh.cell_tags), (mesh.tagged_facets, mesh.facet_tags)):
        if cells is not None:
            held = np.zeros(len(cells), np.int32) if tags is None else tags
            properties = np.where(held > 0, held, next(k for k in count(1) if k not in held))
            line = f"{_CARDS[cells.shape[1] - 1]:<8}{'%-8d' * (2 + cells.shape[1])}\n"
            pieces.append((line, _numbered(np.column_stack([properties, cells + 1]), first)))
            first += len(cells)
    write_text(path, *pieces, "ENDDATA\n")


def write_su2(path: Path, mesh: SimplexMesh) -> None:
    """Write the cells, and the tagged facets as markers with the names or numbers of the tags."""
    groups = groups_of(mesh, mesh.cell_dim - 1, mesh.facet_tags, label=_plain)
    pieces: list[Any] = [
        f"NDIME= {mesh.dim}\nNPOIN= {mesh.n_points}\n",
        (" ".join(["%.16e"] * mesh.dim) + "\n", mesh.points),
        f"NELEM= {mesh.n_cells}\n",
        (_su2_line(mesh.cells), mesh.cells),
        f"NMARK= {len(groups)}\n",
    ]
    for name, facets in groups.items():
        assert mesh.tagged_facets is not None
        own = mesh.tagged_facets[facets]
        pieces += [f"MARKER_TAG= {name}\nMARKER_ELEMS= {len(own)}\n", (_su2_line(own), own)]
    write_text(path, *pieces)


def _su2_line(cells: IntArray) -> str:
    return f"{_VTK[cells.shape[1] - 1]}{' %d' * cells.shape[1]}\n"


def _in_space(mesh: SimplexMesh) -> npt.NDArray[np.float64]:
    return np.pad(mesh.points, ((0, 0), (0, 3 - mesh.dim)))


def _numbered(rows: npt.NDArray[Any], first: int = 1) -> npt.NDArray[Any]:
    return np.column_stack([np.arange(first, first + len(rows)), rows])


def _plain(name: str) -> str:
    """Return a name of letters, digits and underscores, which solvers take."""
    return re.sub(r"\W", "_", name, flags=re.ASCII)[:80]


def groups_of(
    mesh: SimplexMesh,
    dim: int,
    tags: IntArray | None,
    kind: str = "",
    label: Callable[[str], str] = str,
) -> dict[str, npt.NDArray[np.intp]]:
    """Return the cells or facets with each name, or with each tag that has none, by labels.

    A tag without a name gets its ``kind`` and number as the name.  Where the labels of different
    names are equal, a number is appended.  If ``kind`` is given, labels are compared without regard
    to case, as Abaqus does.
    """
    tags_of: dict[str | int, list[int]] = {}
    for tag in [] if tags is None else np.unique(tags).tolist():
        tags_of.setdefault(mesh.tag_names.get((dim, tag), tag), []).append(tag)
    groups, taken = {}, set[str]()
    for name, own in tags_of.items():
        first, numbers = label(name if isinstance(name, str) else f"{kind}{name}"), count(own[0])
        chosen = first
        while (key := chosen.upper() if kind else chosen) in taken:
            chosen = f"{first[:60]}_{next(numbers)}"
        taken.add(key)
        groups[chosen] = np.flatnonzero(np.isin(np.asarray(tags), own))
    return groups


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
