"""The regions and faces of a mesh by their names, and prescribed sizes on them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np

from adaptsize._checks import as_number, describe, refusal
from adaptsize.background import SimplexMesh
from adaptsize.geometry.creases import tag_faces
from adaptsize.geometry.faces import Faces
from adaptsize.typing import FloatArray, IntArray


class NamedPart(NamedTuple):
    """Cells of a mesh, or facets, with the same tag."""

    kind: Literal["region", "face"]
    tag: int
    name: str
    """Of the tag, else the kind and the tag."""
    cells: IntArray
    """Nodes of the cells or facets, int32[n, k + 1]."""
    measures: FloatArray
    """float64[n]"""


def parts_of(mesh: SimplexMesh) -> list[NamedPart]:
    """Return the regions of a mesh, then its faces, by tag.

    Without tags, the faces are those of `tag_faces`, and in the plane the lines between corners.
    """
    if mesh.cell_dim < mesh.dim:
        faces = mesh if mesh.cell_tags is not None else _with_tags(mesh)
        return _by_tag("face", mesh, faces, faces.cell_tags)
    found = _by_tag("region", mesh, mesh, mesh.cell_tags)
    if mesh.tagged_facets is not None:
        facets = SimplexMesh(mesh.points, mesh.tagged_facets)
        return found + _by_tag("face", mesh, facets, mesh.facet_tags)
    boundary, nodes, _ = mesh.boundary()
    faces = _with_tags(boundary)
    own = SimplexMesh(mesh.points, nodes[faces.cells])
    return found + _by_tag("face", mesh, own, faces.cell_tags)


def _with_tags(boundary: SimplexMesh) -> SimplexMesh:
    if boundary.cell_dim == 2:
        return tag_faces(boundary)
    faces = Faces.of(boundary)
    tags = np.where(faces.rows < 0, 0, faces.face[faces.rows] + 1)
    return SimplexMesh(boundary.points, boundary.cells, cell_tags=tags)


def _by_tag(
    kind: Literal["region", "face"], mesh: SimplexMesh, cells: SimplexMesh, tags: IntArray | None
) -> list[NamedPart]:
    found: list[NamedPart] = []
    for tag in [] if tags is None else np.unique(tags).tolist():
        own = tags == tag
        name = mesh.tag_names.get((cells.cell_dim, tag), f"{kind} {tag}")
        found.append(NamedPart(kind, tag, name, cells.cells[own], cells.measures[own]))
    return found


def as_sizes_of_parts(size_of: Any) -> dict[str, float]:
    """Return the prescribed sizes of parts by their names, after checking them.

    The labels of an image may be numbers.
    """
    kinds = str | int | np.integer
    if not isinstance(size_of, Mapping) or not all(isinstance(name, kinds) for name in size_of):
        raise refusal("size_of", f"must be sizes by the names of parts, got {describe(size_of)}")
    sizes = {
        str(name): as_number(f"size_of[{name!r}]", size, lower=0.0, strict=True)
        for name, size in size_of.items()
    }
    if len(sizes) < len(size_of):
        raise refusal("size_of", f"must name each part once, got {list(size_of)!r:.200}")
    return sizes


def sizes_of_parts(mesh: object, size_of: Mapping[str, float]) -> FloatArray:
    """Return the prescribed size at each node, inf where there is none.  Refuse unknown names."""
    tagged = isinstance(mesh, SimplexMesh) and (
        mesh.cell_tags is not None or mesh.tagged_facets is not None
    )
    if not (tagged and isinstance(mesh, SimplexMesh)):
        raise refusal("size_of", f"needs a mesh with tags that carries the sizes, got {mesh!r}")
    parts = parts_of(mesh)
    sizes = np.full(mesh.n_points, np.inf)
    for name, size in size_of.items():
        named = [part for part in parts if part.name == name]
        if not named:
            known = ", ".join(dict.fromkeys(part.name for part in parts))
            raise refusal("size_of", f"must name parts among {known}; got {name!r}")
        for part in named:
            sizes[part.cells] = np.minimum(sizes[part.cells], size)
    return sizes
