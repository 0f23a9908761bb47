"""Cell blocks as in files, and their conversion to simplices."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize.errors import MeshFileError
from adaptsize.typing import FloatArray

#: Dimension, number of corners and plural of each type of cells, as meshio calls it.  Corners come
#: first in every format, so a prefix of a higher-order cell is its corners.
_SHAPES = {
    "line": (1, 2, "segments"),
    "triangle": (2, 3, "triangles"),
    "quad": (2, 4, "quadrilaterals"),
    "polygon": (2, 3, "polygons"),
    "tetra": (3, 4, "tetrahedra"),
    "pyramid": (3, 5, "pyramids"),
    "wedge": (3, 6, "wedges"),
    "hexahedron": (3, 8, "hexahedra"),
}
#: The simplices by their dimension, and their dimensions by the plural.
SIMPLEX = {1: "line", 2: "triangle", 3: "tetra"}
KINDS = {_SHAPES[name][2]: dim for dim, name in SIMPLEX.items()}
#: Name of the group of untagged cells in Gmsh files.  Gmsh ignores group 0.
UNTAGGED = "adaptsize untagged"
#: Larger polygons would take long, since the time grows with the cube of their corners.
_MOST_CORNERS = 1000
#: Names that programs use for the region of a cell, the most likely first, as `tag_key` gives them.
TAG_NAMES = (
    "celltag",
    "gmsh:physical",
    "medit:ref",
    "region",
    "regionid",
    "modelregionid",  # SimVascular
    "material",
    "materialid",
    "matid",
    "mat",
    "avsucd:material",
    "tetgen:ref",
    "nastran:ref",
    "su2:tag",
    "netgen:index",
    "tag",
    "cellmarker",
    "facettag",
    "cellentityid",  # VMTK and Gmsh's files of VTK
    "cellentity",
    "entityid",
    "geometryid",  # Elmer
    "elementblockid",  # Exodus: MOOSE, Cubit
    "blockid",
    "objectid",
    "subdomain",
    "subdomainid",
    "domainid",
    "partid",
    "modelfaceid",  # SimVascular
    "faceid",
    "boundary",
    "boundaryid",
    "boundarymarker",
    "sidesetid",
    "patchid",
    "label",  # ITK-SNAP
    "labelid",
    "marker",
    "ref",
    "attribute",
    "gmsh:geometrical",
)


def tag_key(name: str) -> str:
    """Return a name of a field without case, separators and plural, as programs vary these."""
    key = re.sub(r"[\s_-]", "", name.lower())
    return key.removesuffix("s") if not key.endswith(("ss", ":s")) else key


# Faces of the cells that are not simplices, in the numbering of VTK and Gmsh.  Seen from
# inside, the corners are counter-clockwise, so that (face, inner point) is positive.
_FACES = {
    "pyramid": ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "hexahedron": (
        (0, 1, 2, 3),
        (4, 7, 6, 5),
        (0, 4, 5, 1),
        (1, 5, 6, 2),
        (2, 6, 7, 3),
        (3, 7, 4, 0),
    ),
}


@dataclass
class RawMesh:
    """The content of a file, read or to be written: points, blocks of cells of one type, fields.

    ``cell_data[name]`` has one array per block.
    """

    points: npt.NDArray[Any]
    blocks: list[tuple[str, npt.NDArray[Any]]]
    point_data: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)
    cell_data: Mapping[str, Sequence[npt.NDArray[Any]]] = field(default_factory=dict)
    tag_names: Mapping[tuple[int, int], str] = field(default_factory=dict)
    """Names of the tags, by dimension and tag."""
    notes: list[str] = field(default_factory=list)
    """What was left out, for a warning."""
    is_surface: bool = False
    """Whether it is of a format for surfaces in space, some of which are flat."""


class Simplices(NamedTuple):
    """The cells of one dimension as simplices, and the origin of each."""

    cells: npt.NDArray[np.int64]
    """int64[n, k + 1]."""
    block: npt.NDArray[np.int64]
    """int64[n]: index of the original block."""
    row: npt.NDArray[np.int64]
    """int64[n]: row in that block."""
    notes: list[str]
    """What was converted, for a warning."""


def dimension_of(cell_type: str) -> int:
    """Return the dimension of a cell type of meshio, 0 to 3.  Unknown types count as 3."""
    base = _base(cell_type)
    if base is not None:
        return _SHAPES[base][0]
    return 0 if cell_type == "vertex" else 3


def n_nodes_of(cell_type: str) -> int:
    """Return the number of nodes of a cell type, for which the name ends in it or is a base."""
    if cell_type == "vertex":
        return 1
    return int(re.sub("[a-z]", "", cell_type) or _SHAPES[cell_type][1])


def corners_of(cell_type: str, cells: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the corners of cells, which come first; of unknown types all nodes."""
    base = _base(cell_type)
    return cells if base is None else cells[:, : _SHAPES[base][1]]


def name_of_polygon(n_corners: int) -> str:
    """Return the cell type of a face."""
    return {3: "triangle", 4: "quad"}.get(n_corners, "polygon")


def plural(cell_type: str) -> str:
    """Return the plural name of a cell type."""
    base = _base(cell_type)
    return cell_type if base is None else _SHAPES[base][2]


def check_raw(raw: RawMesh) -> None:
    """Refuse a mesh without cells, bad coordinates and indices out of range."""
    points = raw.points
    if points.ndim != 2 or points.shape[1] not in (1, 2, 3) or len(points) == 0:
        raise MeshFileError("holds no points")
    if not any(len(cells) for _, cells in raw.blocks):
        raise MeshFileError("holds points but no cells")
    bad = ~np.isfinite(points).all(axis=1)
    if bad.any():
        first = int(np.argmax(bad))
        listed = ", ".join(f"{x:g}" for x in points[first])
        raise MeshFileError(f"point {first} is not finite: ({listed})")
    for cell_type, cells in raw.blocks:
        if cells.dtype == object or not len(cells):
            continue
        base = _base(cell_type)
        if cells.ndim != 2 or (base is not None and cells.shape[1] < _SHAPES[base][1]):
            raise MeshFileError(f"has {plural(cell_type)} of {cells.shape[-1]} nodes")
        outside = ((cells < 0) | (cells >= len(points))).any(axis=1)
        if outside.any():
            first = int(np.argmax(outside))
            raise MeshFileError(
                f"{cell_type} {first} has nodes {cells[first].tolist()}, "
                f"but the nodes are 0 to {len(points) - 1}"
            )


#: Names that programs give to the numbers of nodes in the whole mesh.
NODE_NUMBERS = ("GlobalPointIds", "GlobalNodeIds", "GlobalPointId", "GlobalNodeId")


def numbers_of_nodes(fields: Mapping[str, npt.NDArray[Any]]) -> npt.NDArray[np.int64] | None:
    """Return the numbers of the nodes in the whole mesh, of which this may be a part."""
    name = next((name for name in NODE_NUMBERS if name in fields), None)
    return None if name is None else np.asarray(fields[name]).astype(np.int64).ravel()


def sewn(raw: RawMesh) -> RawMesh:
    """Return the mesh with one node for those of equal number, or without numbers, equal place.

    Nodes are in the order of the numbers, or of their first appearance.
    """
    key = numbers_of_nodes(raw.point_data)
    if key is None:
        key = np.unique(raw.points + 0.0, axis=0, return_inverse=True)[1].ravel()
        first = np.unique(key, return_index=True)[1]
        key = first[key]
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    point_data = {n: v[first] for n, v in raw.point_data.items() if n not in NODE_NUMBERS}
    blocks = [(name, number[cells]) for name, cells in raw.blocks]
    return replace(raw, points=raw.points[first], blocks=blocks, point_data=point_data)


def simplices_of(raw: RawMesh, dim: int) -> Simplices:
    """Return all cells of dimension ``dim`` as simplices.

    Quadrilaterals become two triangles.  Hexahedra, wedges and pyramids are split
    from their node of smallest index.  Both neighbours then split each quadrilateral
    face through its smallest node, so the result is conforming [1]_.  Higher-order
    cells are reduced to their corners.

    References
    ----------
    .. [1] J. Dompierre, P. Labbe, M.-G. Vallet, R. Camarero, "How to subdivide
       pyramids, prisms and hexahedra into tetrahedra", 8th International Meshing
       Roundtable (1999) 195-204.
    """
    cells = [np.empty((0, dim + 1), np.int64)]
    block = [np.empty(0, np.int64)]
    row = [np.empty(0, np.int64)]
    notes = []
    in_space = any(dimension_of(cell_type) == 3 and len(c) for cell_type, c in raw.blocks)
    for index, (cell_type, found) in enumerate(raw.blocks):
        if dimension_of(cell_type) != dim or not len(found):
            continue
        base = _base(cell_type)
        if base is None or found.dtype == object:
            raise MeshFileError(f"holds cells of type {cell_type!r}, which cannot be read")
        n_corners = found.shape[1] if base == "polygon" else _SHAPES[base][1]
        corners = found[:, :n_corners].astype(np.int64)
        if found.shape[1] > corners.shape[1]:
            notes.append(f"{len(found)} {plural(base)} of higher order reduced to their corners")
        parts, parent = _split(base, corners, None if in_space else raw.points)
        if base != SIMPLEX[dim] and corners.shape[1] > dim + 1:
            notes.append(
                f"{len(found)} {plural(base)} split into {len(parts)} {plural(SIMPLEX[dim])}"
            )
        cells.append(parts)
        block.append(np.full(len(parts), index))
        row.append(parent)
    return Simplices(np.concatenate(cells), np.concatenate(block), np.concatenate(row), notes)


def gather(values: Sequence[npt.NDArray[Any]], simplices: Simplices) -> npt.NDArray[Any] | None:
    """Return one row per simplex of data stored per block, or None if the blocks do not fit."""
    pieces = []
    for index in np.unique(simplices.block):
        data = np.asarray(values[index])
        rows = simplices.row[simplices.block == index]
        if data.ndim == 0 or data.dtype == object or len(data) <= rows.max():
            return None
        pieces.append(data[rows])
    if len({piece.shape[1:] for piece in pieces}) != 1:
        return None
    return np.concatenate(pieces)  # blocks were appended in ascending order


def _base(cell_type: str) -> str | None:
    base = cell_type.rstrip("0123456789")
    return base if base in _SHAPES else None


def _split(
    base: str, cells: npt.NDArray[np.int64], points: FloatArray | None
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the simplices of cells of one type and the original row of each."""
    if base in SIMPLEX.values():
        return cells, np.arange(len(cells))
    if base == "quad":
        triangles = _split_quads(cells, points)
        return triangles.reshape(-1, 3), np.repeat(np.arange(len(cells)), 2)
    if base == "polygon":
        return _split_polygons(cells, points)
    parts, parent = [], []
    smallest = np.argmin(cells, axis=1)
    for apex in range(cells.shape[1]):
        rows = np.flatnonzero(smallest == apex)
        for face in _FACES[base]:
            if apex in face or not len(rows):
                continue
            corners = cells[rows[:, None], np.array(face)]
            triangles = corners[:, None] if len(face) == 3 else _split_quads(corners, None)
            n_parts = triangles.shape[1]
            top = np.broadcast_to(cells[rows, apex][:, None, None], (len(rows), n_parts, 1))
            parts.append(np.concatenate([triangles, top], axis=2).reshape(-1, 4))
            parent.append(np.repeat(rows, n_parts))
    order = np.argsort(np.concatenate(parent), kind="stable")
    return np.concatenate(parts)[order], np.concatenate(parent)[order]


def _split_polygons(
    cells: npt.NDArray[np.int64], points: FloatArray | None
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return polygons as triangles, and the polygon of each.

    VTK cuts off one ear after another.  Without points or area, the triangles of a polygon have its
    first corner in common.
    """
    from adaptsize._formats import vtk

    n = cells.shape[1]
    if n > _MOST_CORNERS:
        raise MeshFileError(f"holds a polygon of {n} corners; {_MOST_CORNERS} can be split")
    first = np.broadcast_to(cells[:, :1], (len(cells), n - 2))
    fans = np.stack([first, cells[:, 1:-1], cells[:, 2:]], axis=2)
    if points is None or n < 4:
        return fans.reshape(-1, 3), np.repeat(np.arange(len(cells)), n - 2)
    triangles, parent = vtk.triangles_of(cells, points)
    flat = np.setdiff1d(np.arange(len(cells)), parent)
    parts = [triangles, fans[flat].reshape(-1, 3)]
    return np.concatenate(parts), np.concatenate([parent, np.repeat(flat, n - 2)])


def _split_quads(quads: npt.NDArray[np.int64], points: FloatArray | None) -> npt.NDArray[np.int64]:
    """Return each quadrilateral as two triangles, int64[n, 2, 3].

    They are split along the diagonal that lies inside, or the shorter one if both do.  Without
    points, they are split through the smallest node, a rule by which two cells split a
    common face in the same way.
    """
    if points is None:
        start = np.argmin(quads, axis=1)
    else:
        corners = np.zeros((*quads.shape, 3))
        corners[..., : points.shape[1]] = points[quads]
        along_02 = _diagonal_cost(corners, 0) <= _diagonal_cost(corners, 1)
        start = np.where(along_02, 0, 1)
    turned = np.take_along_axis(quads, (start[:, None] + np.arange(4)) % 4, axis=1)
    return turned[:, [[0, 1, 2], [0, 2, 3]]]


def _diagonal_cost(corners: FloatArray, start: int) -> FloatArray:
    """Return the length of the diagonal from corner ``start``, inf if it lies outside."""
    a, b, c, d = (corners[:, (start + i) % 4] for i in range(4))
    one_way = np.cross(b - a, c - a)
    other_way = np.cross(c - a, d - a)
    length: FloatArray = np.linalg.norm(c - a, axis=1)
    return np.where((one_way * other_way).sum(axis=1) > 0.0, length, np.inf)
