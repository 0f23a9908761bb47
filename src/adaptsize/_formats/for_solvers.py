"""Writing of meshes for solvers, as text: Abaqus and CalculiX, Nastran, SU2."""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import RawMesh
from adaptsize._formats.quadratic import with_middles
from adaptsize._formats.text import numbered, write_text
from adaptsize.background import SimplexMesh
from adaptsize.background.topology import oriented_facets, unique_rows
from adaptsize.typing import IntArray

#: Elements of Abaqus by the dimensions of cells and space, without the number of nodes.
_ELEMENTS = {(1, 2): "T2D", (1, 3): "T3D", (2, 2): "CPS", (2, 3): "S", (3, 3): "C3D"}
#: The number of the face of an element of Abaqus that is opposite to each corner.
_FACES = {2: np.array([2, 3, 1]), 3: np.array([3, 4, 2, 1])}
#: Cards of Nastran by cells, and numbers of VTK by numbers of corners.
_CARDS = {
    "line": "CROD", "line3": "CBEAM3", "triangle": "CTRIA3", "triangle6": "CTRIA6",
    "tetra": "CTETRA", "tetra10": "CTETRA",
}  # fmt: skip
_VTK = {2: 3, 3: 5, 4: 10}


def write_abaqus(path: Path, mesh: SimplexMesh, order: int = 1) -> None:
    """Write the cells, with a set of elements per tag, and a set of nodes per tag of facets.

    The sets have the names of the tags, or ``region1`` and ``boundary1``.  ``Nall`` and ``Eall``
    hold all nodes and elements.  Each tag of facets is a surface, too, except on shells.
    """
    mesh, raw = _for_solver(mesh, order)
    cells = raw.blocks[0][1]
    kind = f"{_ELEMENTS[mesh.cell_dim, mesh.dim]}{cells.shape[1]}"
    pieces: list[Any] = [
        "*HEADING\nwritten by adaptsize\n*NODE, NSET=Nall\n",
        *_nodes_of_abaqus(raw.points),
        f"*ELEMENT, TYPE={kind}, ELSET=Eall\n",
        ("%d" + ", %d" * cells.shape[1] + "\n", numbered(cells + 1)),
    ]
    regions = groups_of(mesh, mesh.cell_dim, mesh.cell_tags, "region", _set_of_elements)
    for name, own in regions.items():
        pieces += [f"*ELSET, ELSET={name}\n", ("%d\n", own + 1)]
    parts = groups_of(mesh, mesh.cell_dim - 1, mesh.facet_tags, "boundary", _set_of_nodes)
    has_surfaces = mesh.cell_dim == mesh.dim and len(parts)
    sides = _sides_of(mesh) if has_surfaces else np.empty((0, 2))
    for name, own in parts.items():
        facets = _tagged_facets(mesh) if mesh.cell_dim == 1 else raw.blocks[1][1]
        pieces += [f"*NSET, NSET={name}\n", ("%d\n", np.unique(facets[own]) + 1)]
        if has_surfaces:
            held = sides[own][sides[own, 0] > 0]
            pieces += [f"*SURFACE, NAME={name}, TYPE=ELEMENT\n", ("%d, S%d\n", held)]
    write_text(path, *pieces)


def _for_solver(mesh: SimplexMesh, order: int) -> tuple[SimplexMesh, RawMesh]:
    """Return a mesh with cells of positive measure, and its blocks of the order, in space.

    Solvers refuse cells of negative measure.
    """
    from adaptsize._formats.writers import content_of

    if mesh.cell_dim == mesh.dim:
        cells = mesh.cells.copy()
        inverted = mesh.signed_measures < 0.0
        cells[inverted, -2:] = cells[inverted][:, [-1, -2]]
        mesh = replace(mesh, cells=cells)
    bare = replace(mesh, point_data={}, cell_data={})
    raw = content_of(bare, "cell_tags", pad=True)
    return mesh, with_middles(raw) if order == 2 else raw


def _nodes_of_abaqus(points: npt.NDArray[np.float64]) -> Iterator[str]:
    """Yield lines of nodes.  CalculiX reads 20 characters of a number."""
    for start in range(0, len(points), 20_000):
        rows = enumerate(points[start : start + 20_000].tolist(), start + 1)
        yield "".join(f"{k}, {', '.join(map(_in_20_characters, row))}\n" for k, row in rows)


def _in_20_characters(x: float) -> str:
    """Return the shortest text of a number, or if it is longer, as many digits as fit."""
    text = repr(x)
    for digits in (13, 12):
        text = text if len(text) <= 20 else f"{x:.{digits}e}"
    return text


def _tagged_facets(mesh: SimplexMesh) -> IntArray:
    """Return the facets with tags, int32[n, cell_dim]."""
    none = np.empty((0, mesh.cell_dim), np.int32)
    return none if mesh.tagged_facets is None else mesh.tagged_facets


def _sides_of(mesh: SimplexMesh) -> npt.NDArray[np.int64]:
    """Return the number of the element at each tagged facet, and that of its face, or 0.

    0 is for facets of no element, and for those that are listed again.  Of two elements it is the
    one in the region of lower tag, or within one region the one that the normal of the facet points
    away from.
    """
    tagged = _tagged_facets(mesh)
    n, n_tagged, k = len(mesh.facets), len(tagged), mesh.cell_dim
    number = unique_rows(np.concatenate([mesh.facets, tagged]), mesh.n_points)[1]
    row = np.full(int(number.max()) + 1, -1)
    row[number[n:]] = np.arange(n_tagged)
    row_of_facet = row[number[:n]]
    cell, opposite = np.nonzero(row_of_facet[mesh.cell_facets] >= 0)
    rows = row_of_facet[mesh.cell_facets[cell, opposite]]
    outward = _turned(oriented_facets(mesh.cells[cell], opposite, None))
    is_inward = (outward != _turned(tagged[rows])).any(axis=1)
    region = np.zeros(len(cell)) if mesh.cell_tags is None else mesh.cell_tags[cell]
    order = np.lexsort([cell, is_inward, region, rows])
    found, first = np.unique(rows[order], return_index=True)
    chosen = order[first]
    sides = np.zeros((n_tagged, 2), np.int64)
    sides[found] = np.column_stack([cell[chosen] + 1, _FACES[k][opposite[chosen]]])
    return sides


def _turned(facets: IntArray) -> IntArray:
    """Return facets of the same orientation that begin at their smallest node; edges unchanged."""
    k = facets.shape[1]
    if k == 2:
        return facets
    start = facets.argmin(axis=1)[:, None]
    return np.take_along_axis(facets, (start + np.arange(k)) % k, axis=1)


def write_nastran(path: Path, mesh: SimplexMesh, order: int = 1) -> None:
    """Write cells and tagged facets, with their tags as numbers of properties.

    These start at 1: those without a tag get the smallest number that is not a tag.
    """
    mesh, raw = _for_solver(mesh, order)
    pieces: list[Any] = [
        "$ written by adaptsize\nBEGIN BULK\n",
        (f"GRID*   %-16d{'':16}%16.9E%16.9E\n*       %16.9E\n", numbered(raw.points)),
    ]
    first, all_tags = 1, (mesh.cell_tags, mesh.facet_tags)
    for (name, cells), tags in zip(raw.blocks, all_tags, strict=False):
        held = np.zeros(len(cells), np.int32) if tags is None else tags
        properties = np.where(held > 0, held, next(k for k in count(1) if k not in held))
        rows = numbered(np.column_stack([properties, cells + 1]), first)
        pieces.append((_card(_CARDS[name], cells.shape[1]), rows))
        first += len(cells)
    write_text(path, *pieces, "ENDDATA\n")


def _card(name: str, n_nodes: int) -> str:
    """Return the format of an element of Nastran: eight fields of a line, then it continues."""
    fields = ["%-8d"] * (2 + n_nodes)
    lines = ["".join(fields[k : k + 8]) for k in range(0, len(fields), 8)]
    return f"{name:<8}" + f"+\n{'+':<8}".join(lines) + "\n"


def write_su2(path: Path, mesh: SimplexMesh) -> None:
    """Write the cells, and the tagged facets as markers with the names or numbers of the tags."""
    mesh, _ = _for_solver(mesh, 1)
    groups = groups_of(mesh, mesh.cell_dim - 1, mesh.facet_tags, label=_plain)
    pieces: list[Any] = [
        f"NDIME= {mesh.dim}\nNPOIN= {mesh.n_points}\n",
        (" ".join(["%.16e"] * mesh.dim) + "\n", mesh.points),
        f"NELEM= {mesh.n_cells}\n",
        (_su2_line(mesh.cells), mesh.cells),
        f"NMARK= {len(groups)}\n",
    ]
    for name, facets in groups.items():
        own = _tagged_facets(mesh)[facets]
        pieces += [f"MARKER_TAG= {name}\nMARKER_ELEMS= {len(own)}\n", (_su2_line(own), own)]
    write_text(path, *pieces)


def _su2_line(cells: IntArray) -> str:
    return f"{_VTK[cells.shape[1]]}{' %d' * cells.shape[1]}\n"


def _plain(name: str) -> str:
    """Return a name of letters, digits and underscores, which solvers take."""
    return re.sub(r"\W", "_", name, flags=re.ASCII)[:80]


def _set_of_elements(name: str) -> str:
    return _set_of(name, "region", "EALL")


def _set_of_nodes(name: str) -> str:
    return _set_of(name, "boundary", "NALL")


def _set_of(name: str, kind: str, taken: str) -> str:
    """Return a name of a set, which begins with a letter or underscore, and is not the whole."""
    plain = _plain(name)
    if plain[:1].isdigit() or plain.upper() == taken:
        return f"{kind}_{plain}"[:80]
    return plain


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
