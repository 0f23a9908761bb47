"""Files of Gmsh: names of groups, partitions (MSH 4.1, text), views (``.pos``).

*Names.*  meshio keeps only one group per name, but a volume and its surface may share a name.

*Partitions* are in one file, or in one file each.

*Views.*  The parsed text form lists cells, each with the coordinates and the values of its nodes:
``ST(x,y,z,x,y,z,x,y,z){h,h,h};``.  The first letter is S for numbers, V for vectors and T for
tensors, the second one L for segments, T for triangles and S for tetrahedra.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import RawMesh
from adaptsize.background import SimplexMesh
from adaptsize.background.merging import merge_equal_points
from adaptsize.errors import MeshFileError
from adaptsize.typing import FloatArray, IntArray

_NAMES_BEGIN = re.compile(rb"^\$PhysicalNames\s*$", re.MULTILINE)
_NAME = re.compile(r'^[ \t]*([0-3])\s+(-?\d+)\s+"([^"\n]*)"', re.MULTILINE)
_END_FORMAT = b"$EndMeshFormat\n"
#: The sections before the nodes are rarely longer than this; read in steps of it.
_STEP = 1_000_000


def read_names(path: Path) -> dict[tuple[int, int], str]:
    """Return the names in a ``.msh`` file by dimension and tag.  Other files have none."""
    if path.suffix.lower() != ".msh":
        return {}
    content = b""
    with path.open("rb") as file:
        while step := file.read(_STEP):
            content += step
            if b"$Nodes" in content or b"$EndPhysicalNames" in content:
                break
    begin = _NAMES_BEGIN.search(content)
    if begin is None:
        return {}
    section = content[begin.end() :].partition(b"$EndPhysicalNames")[0]
    found = _NAME.findall(section.decode("utf-8", "replace"))
    return {(int(dim), int(tag)): name for dim, tag, name in found if name.strip()}


def add_names(path: Path, names: Mapping[tuple[int, int], str]) -> None:
    """Put names into a ``.msh`` file that has none."""
    if not names:
        return
    lines = [f'{dim} {tag} "{name}"\n' for (dim, tag), name in sorted(names.items())]
    section = f"$PhysicalNames\n{len(lines)}\n{''.join(lines)}$EndPhysicalNames\n"
    head, end, rest = path.read_bytes().partition(_END_FORMAT)
    path.write_bytes(head + end + section.encode() + rest)


# Nodes of the elements of Gmsh by their types: points, segments, triangles, tetrahedra.
_NODES = {15: 1, 1: 2, 2: 3, 4: 4}

# Names of blocks of cells by their dimensions.
_BLOCKS = {0: "vertex", 1: "line", 2: "triangle", 3: "tetra"}

Entity = tuple[int, int]
Ids = npt.NDArray[np.int64]


class Partition(NamedTuple):
    """The content of a file."""

    mesh: SimplexMesh
    numbers: Ids
    """int64[n_points]: the numbers of the nodes in the file, and in those of other partitions."""
    parts: IntArray
    """int32[n_cells]: the partition of each cell, from 0."""


class _Entities(NamedTuple):
    """Partitioned entities by their dimension and tag."""

    partition: dict[Entity, int]
    physical: dict[Entity, int]


def split_files(path: Path) -> list[Path]:
    """Return ``name_1.msh``, ``name_2.msh``, ... for ``name.msh``, as far as they exist."""
    found: list[Path] = []
    while True:
        file = path.with_name(f"{path.stem}_{len(found) + 1}{path.suffix}")
        if not file.is_file():
            return found
        found.append(file)


def refuse_split(path: Path) -> None:
    """Raise a MeshFileError if there is no such file, but one for each of its partitions."""
    found = [] if path.exists() or path.suffix.lower() != ".msh" else split_files(path)
    if found:
        raise MeshFileError(
            f"does not exist, but its partitions are in {found[0].name} to {found[-1].name}, "
            "which adaptsize.distributed.read_parts reads"
        )


def is_partitioned(path: Path) -> bool:
    """Return whether a file of Gmsh has partitions."""
    with open(path, "rb") as file:
        return any(line.startswith(b"$PartitionedEntities") for line in file)


def read_partition(path: Path) -> Partition:
    """Return the cells of a file without its ghost cells.

    Raises
    ------
    MeshFileError
        If it is not a text file of version 4.1 with partitions of simplices.  The message does not
        have the path.
    """
    try:
        content = path.read_bytes()
        if not re.match(rb"\s*\$MeshFormat\s+4\.1\s+0\s", content):
            raise MeshFileError(
                "has partitions, and must therefore be a text file of version 4.1 (Mesh.Binary = 0)"
            )
        return _partition(_sections(content.decode()))
    except KeyError as error:
        raise MeshFileError(f"has no section ${error.args[0]}") from error
    except MeshFileError:
        raise
    except (ValueError, IndexError, OSError) as error:
        raise MeshFileError(f"cannot be read as a partitioned mesh ({error})") from error


def read_blocks(path: Path) -> RawMesh:
    """Return the cells of all partitions in a file, and the tagged facets, as blocks."""
    mesh = read_partition(path).mesh
    blocks = [(_BLOCKS[mesh.cell_dim], mesh.cells)]
    tags = [np.zeros(mesh.n_cells, np.int32) if mesh.cell_tags is None else mesh.cell_tags]
    if mesh.tagged_facets is not None and mesh.facet_tags is not None:
        blocks.append((_BLOCKS[mesh.cell_dim - 1], mesh.tagged_facets))
        tags.append(mesh.facet_tags)
    return RawMesh(mesh.points, blocks, {}, {"gmsh:physical": tags}, dict(mesh.tag_names))


def _sections(text: str) -> dict[str, list[str]]:
    """Return the lines of each section."""
    sections: dict[str, list[str]] = {}
    lines: list[str] = []
    for line in text.splitlines():
        if line.startswith("$End"):
            continue
        if line.startswith("$"):
            lines = sections.setdefault(line[1:].strip(), [])
        elif line.strip():
            lines.append(line)
    return sections


def _partition(sections: dict[str, list[str]]) -> Partition:
    entities = _entities(sections["PartitionedEntities"])
    tags, points = _nodes(sections["Nodes"])
    cell_dim = max(dim for dim, _ in entities.partition)
    cells, facets = [], []
    for entity, kind, rows in _elements(sections["Elements"]):
        if entity not in entities.partition or entity[0] < cell_dim - 1:
            continue  # ghost cells are in entities of their own
        if kind not in _NODES:
            raise MeshFileError(f"must hold linear simplices, got elements of type {kind}")
        number = np.full(len(rows), entities.partition[entity] - 1, np.int32)
        physical = np.full(len(rows), entities.physical.get(entity, 0), np.int32)
        if entity[0] == cell_dim:
            cells.append((rows, physical, number))
        elif entity[0] == cell_dim - 1 and entity in entities.physical:
            facets.append((rows, physical))
    if not cells:
        raise MeshFileError("holds no cells")
    order = np.argsort(tags)
    nodes = np.concatenate([rows for rows, _, _ in cells])
    used, local = np.unique(nodes, return_inverse=True)
    physical = np.concatenate([tag for _, tag, _ in cells])
    tagged = {}
    if facets:
        rows = np.concatenate([rows for rows, _ in facets])
        at = np.minimum(np.searchsorted(used, rows), len(used) - 1)
        held = (used[at] == rows).all(axis=1)
        tagged["tagged_facets"] = at[held].astype(np.int32)
        tagged["facet_tags"] = np.concatenate([tag for _, tag in facets])[held]
    mesh = SimplexMesh(
        points[order[np.searchsorted(tags[order], used)]],
        local.reshape(nodes.shape).astype(np.int32),
        cell_tags=physical if physical.any() else None,
        tag_names=_group_names(sections.get("PhysicalNames", ["0"])),
        **tagged,
    )
    return Partition(mesh, used, np.concatenate([part for _, _, part in cells]))


def _entities(lines: list[str]) -> _Entities:
    """Return the partition and the first physical tag of each partitioned entity."""
    n_ghosts = int(lines[1])
    at = 2 + n_ghosts if n_ghosts else 2
    counts = [int(word) for word in lines[at].split()]
    partition, physical = {}, {}
    rows = iter(lines[at + 1 :])
    for dim, count in enumerate(counts):
        for _ in range(count):
            words = next(rows).split()
            n_parts = int(words[3])
            rest = words[4 + n_parts + (3 if dim == 0 else 6) :]
            entity = (dim, int(words[0]))
            partition[entity] = int(words[4])
            if int(rest[0]):
                physical[entity] = int(rest[1])
    return _Entities(partition, physical)


def _nodes(lines: list[str]) -> tuple[Ids, FloatArray]:
    """Return the tags and the coordinates of the nodes."""
    tags, points = [], []
    at = 1
    while at < len(lines):
        count = int(lines[at].split()[3])
        tags += [int(line) for line in lines[at + 1 : at + 1 + count]]
        points += [line.split()[:3] for line in lines[at + 1 + count : at + 1 + 2 * count]]
        at += 1 + 2 * count
    if len(tags) != int(lines[0].split()[1]) or len(points) != len(tags):
        raise MeshFileError("ends early, in its nodes")
    return np.array(tags, np.int64), np.array(points, np.float64).reshape(-1, 3)


def _elements(lines: list[str]) -> Iterator[tuple[Entity, int, Ids]]:
    """Yield the entity, the type and the nodes of each block of elements."""
    at = 1
    while at < len(lines):
        dim, tag, kind, count = (int(word) for word in lines[at].split())
        block = [line.split() for line in lines[at + 1 : at + 1 + count]]
        if len(block) != count:
            raise MeshFileError("ends early, in its elements")
        yield (dim, tag), kind, np.array(block, np.int64)[:, 1:]
        at += 1 + count


def _group_names(lines: list[str]) -> dict[tuple[int, int], str]:
    """Return the names of physical groups by dimension and tag."""
    found = {}
    for line in lines[1:]:
        dim, tag, name = line.split(maxsplit=2)
        found[int(dim), int(tag)] = name.strip().strip('"')
    return found


_WIDTHS = {"S": 1, "V": 3, "T": 9}
_CELLS = {"L": ("line", 2), "T": ("triangle", 3), "S": ("tetra", 4)}
_VIEW = re.compile(r'\s*View\s+"([^"]*)"\s*\{(.*)\}\s*;\s*', re.DOTALL)
_ELEMENT = re.compile(r"([A-Z]+)\s*\(([^()]*)\)\s*\{([^{}]*)\}\s*;")


def read_view(path: Path) -> RawMesh:
    """Return the cells of a view, its equal points merged, and its values as a nodal field."""
    found = _VIEW.fullmatch(path.read_text(encoding="ascii", errors="replace"))
    if found is None:
        raise MeshFileError('must hold one list-based view, View "name" { ... };')
    title, body = found.groups()
    elements = _ELEMENT.findall(body)
    if _ELEMENT.sub("", body).strip():
        raise MeshFileError("ends early, or holds something else than elements with values")
    if not elements:
        raise MeshFileError("holds a view without elements")
    kinds = sorted({kind for kind, _, _ in elements})
    width = _WIDTHS.get(kinds[0][0])
    if width is None or any(
        len(k) != 2 or k[0] != kinds[0][0] or k[1] not in _CELLS for k in kinds
    ):
        raise MeshFileError(f"holds elements {', '.join(kinds)}; SL, ST, SS, TL, ... can be read")
    corners, values, types = [], [], []
    for kind in kinds:
        name, n_nodes = _CELLS[kind[1]]
        of_kind = [element for element in elements if element[0] == kind]
        corners.append(_view_numbers([row for _, row, _ in of_kind], 3 * n_nodes).reshape(-1, 3))
        values.append(
            _view_numbers([row for _, _, row in of_kind], width * n_nodes).reshape(-1, width)
        )
        types.append((name, n_nodes))
    points, number = merge_equal_points(np.concatenate(corners))
    field = np.empty((len(points), width))
    field[number] = np.concatenate(values)
    notes = []
    if not np.array_equal(field[number], np.concatenate(values), equal_nan=True):
        notes.append("the view jumps between cells: the last value of each node is kept")
    blocks, first = [], 0
    for (name, n_nodes), rows in zip(types, corners, strict=True):
        blocks.append((name, number[first : first + len(rows)].reshape(-1, n_nodes)))
        first += len(rows)
    return RawMesh(points, blocks, {title: field[:, 0] if width == 1 else field}, notes=notes)


def _view_numbers(rows: list[str], width: int) -> FloatArray:
    """Return the numbers in rows of text, float64[n, width]."""
    parts = [row.split(",") for row in rows]
    wrong = next((part for part in parts if len(part) != width), None)
    if wrong is not None:
        raise MeshFileError(f"holds an element with {len(wrong)} numbers instead of {width}")
    try:
        return np.array(parts, np.float64)
    except ValueError:
        raise MeshFileError("holds something else than numbers in an element") from None
