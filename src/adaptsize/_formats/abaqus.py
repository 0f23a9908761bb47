"""Reading of Abaqus input files, with parts, instances and sets.

meshio takes the last list of nodes for all, ends a list at a comment, and ignores instances.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import RawMesh, dimension_of, n_nodes_of
from adaptsize._formats.guards import neighbour
from adaptsize._formats.text import numbers, rows_of
from adaptsize.errors import MeshFileError
from adaptsize.typing import FloatArray

#: Types of elements with their numbers of nodes, and the cells by these: CalculiX has S6.
_ELEMENTS: tuple[tuple[re.Pattern[str], dict[int, str]], ...] = (
    (re.compile(r"(?:D?C|AC|COH)3D(\d+)|SC(\d)"), {
        4: "tetra", 5: "pyramid", 6: "wedge", 8: "hexahedron", 10: "tetra10", 13: "pyramid13",
        15: "wedge15", 20: "hexahedron20",
    }),
    (re.compile(r"(?:CP[SE]G?|D?CAX|ACAX|D?C2D|AC2D|S|DS|STRI|[MR]3D|SFM3D)(\d)"), {
        3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9",
    }),
    (re.compile(r"T[23]D(\d)"), {2: "line", 3: "line3"}),
    (re.compile(r"(?:B|PIPE)[23](\d)"), {1: "line", 2: "line3", 3: "line"}),  # 3: cubic
)  # fmt: skip
#: Elements without a cell of their own: masses, springs, dashpots, gaps, connectors, rigid and
#: coupling elements.
_NO_CELLS = re.compile(
    r"MASS|ROTARYI|HEATCAP|SPRING|DASHPOT|CONN|GAP|ITT|JOINT|DCOUP|DIST|U\d|RB[23]D|[RP]POINT|F[23]D"
)
#: Corners of the faces of cells, in the order of their numbers, which are those of Abaqus.
_FACES = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "hexahedron": (
        (0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0),
    ),
}  # fmt: skip
#: The set of all elements, in files for CalculiX.
_ALL = "EALL"
#: Keywords that make nodes or elements from others, or move them.
_MAKING = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM", "INCLUDE")
_COMMENT = re.compile(r"^\*\*.*\n?", re.MULTILINE)
_CONTINUED = re.compile(r"^(\*.*,)[ \t]*\n", re.MULTILINE)
_INCLUDE = re.compile(
    r"^\*[ \t]*INCLUDE[ \t]*,[ \t]*INPUT[ \t]*=(.*)$", re.MULTILINE | re.IGNORECASE
)


@dataclass
class _PartOfFile:
    """What is between the keywords of a part or an instance, or outside of all."""

    nodes: list[str] = field(default_factory=list)
    """Lines."""
    elements: list[tuple[str, npt.NDArray[np.int64]]] = field(default_factory=list)
    """The type of cells, and rows of numbers of the element and its nodes."""
    sets: dict[str, list[range | npt.NDArray[np.int64] | str]] = field(default_factory=dict)
    """Numbers of elements, or names of other sets, by the name in capital letters."""
    sections: list[str] = field(default_factory=list)
    """Sets with a material: no element is in two."""
    surfaces: dict[str, list[str]] = field(default_factory=dict)
    """Lines with an element or a set of them, and the number of a face, by the name."""
    of_assembly: dict[str, list[Any]] = field(default_factory=dict)
    """Sets that the assembly makes of elements of this instance, for its surfaces."""
    offset: FloatArray = field(default_factory=lambda: np.zeros(3))

    @property
    def regions(self) -> list[str]:
        """The sets with a section, or all but those of other sets, and of all elements."""
        of_sets = {
            name for name, items in self.sets.items() if any(isinstance(i, str) for i in items)
        }
        chosen = [name for name in self.sections if name != _ALL]
        listed = chosen or [name for name in self.sets if name not in of_sets and name != _ALL]
        return listed or self.sections

    def holds(
        self, name: str, elements: npt.NDArray[np.int64], *, in_assembly: bool = False
    ) -> npt.NDArray[np.bool_]:
        """Return which of some elements are in a set."""
        names, found = [name.upper()], np.zeros(len(elements), bool)
        sets = self.of_assembly if in_assembly else self.sets
        for known in names:  # grows
            for item in sets.get(known, ()):
                if isinstance(item, range):
                    inside = (elements >= item.start) & (elements < item.stop)
                    found |= inside & ((elements - item.start) % item.step == 0)
                elif isinstance(item, str):
                    names += [item] * (item not in names)
                else:
                    found |= np.isin(elements, item)
        return found


def read(path: Path) -> RawMesh:
    """Return the elements of all instances, or of all parts, with their sets as tags.

    Tags are the sets with a section, if there are any.  Otherwise an element has the tag of the
    last set that lists it.  Surfaces of faces of elements become tagged facets.  Sets that the
    assembly makes of elements of instances are no tags, but its surfaces may name them.

    Raises
    ------
    MeshFileError
        If the file is damaged, rotates an instance, or makes nodes or elements by keywords.

    References
    ----------
    Keywords, types of elements and translations of instances are those of the Abaqus Keywords
    Reference Guide.
    """
    whole = current = _PartOfFile()
    parts, instances, names = {"": whole}, dict[str, _PartOfFile](), dict[str, str]()
    skipped = Counter[str]()
    for keyword, options, lines in _keywords_in(_text_of(path, set())):
        is_mesh = keyword in ("NODE", "ELEMENT")
        if keyword in _MAKING or (is_mesh and options.keys() & {"INPUT", "SYSTEM"}):
            raise MeshFileError(f"has the keyword *{keyword}, of a kind that cannot be read")
        named = options.get("ELSET", "")
        if named and keyword in ("ELEMENT", "ELSET"):
            names.setdefault(named.upper(), named)
        if keyword == "PART":
            current = parts.setdefault(options.get("NAME", "").upper(), _PartOfFile())
        elif keyword == "INSTANCE":
            name = options.get("PART", "")
            if name.upper() not in parts:
                raise MeshFileError(f"has an instance of the part {name!r}, which it does not hold")
            current = _instance_of(parts[name.upper()], lines)
            instances[options.get("NAME", "").upper()] = current
        elif keyword in ("END PART", "END INSTANCE"):
            current = whole
        elif keyword == "NODE":
            current.nodes += lines
        elif keyword == "ELEMENT":
            kind = options.get("TYPE", "").upper()
            if _NO_CELLS.match(kind):
                skipped[kind] += len(lines)
                continue
            current.elements.append(_elements_of(kind, lines))
            current.sets.setdefault(named.upper(), []).append(current.elements[-1][1][:, 0])
        elif keyword == "ELSET" and "INSTANCE" not in options:
            items = _items_of(lines, is_range="GENERATE" in options)
            current.sets.setdefault(named.upper(), []).extend(items)
        elif keyword == "ELSET" and options["INSTANCE"].upper() in instances:
            items = _items_of(lines, is_range="GENERATE" in options)
            instances[options["INSTANCE"].upper()].of_assembly.setdefault(named.upper(), []).extend(
                items
            )
        elif keyword.endswith(" SECTION") and named:
            current.sections.append(named.upper())
        elif keyword == "SURFACE" and options.get("TYPE", "ELEMENT").upper() == "ELEMENT":
            current.surfaces.setdefault(options.get("NAME", ""), []).extend(lines)
    raw = _joined([whole, *instances.values()] if instances else [*parts.values()], names)
    if skipped:
        listed = ", ".join(f"{n} {kind}" for kind, n in skipped.items())
        raw.notes.append(f"elements that are not cells left out: {listed}")
    return raw


def _text_of(path: Path, known: set[Path]) -> str:
    """Return the text of a file with those that it includes, without comments."""
    known.add(path.resolve())
    text = _COMMENT.sub("", path.read_text(encoding="utf-8-sig", errors="replace"))

    def included(found: re.Match[str]) -> str:
        file = neighbour(path, found[1].strip(' "'))
        if not file.exists():
            raise MeshFileError(f"includes {file.name!r}, which does not exist")
        if file.resolve() in known:
            raise MeshFileError(f"includes {file.name!r} twice")
        return _text_of(file, known)

    return _INCLUDE.sub(included, text)


def _keywords_in(text: str) -> Iterator[tuple[str, dict[str, str], list[str]]]:
    """Yield keywords in capital letters with their options and the lines of data."""
    for block in re.split(r"^\*", _CONTINUED.sub(r"\1", text), flags=re.MULTILINE)[1:]:
        head, *lines = block.splitlines() or [""]
        keyword, *words = (word.strip() for word in head.split(","))
        pairs = (word.partition("=") for word in words)
        options = {key.strip().upper(): value.strip(' "') for key, _, value in pairs}
        yield " ".join(keyword.upper().split()), options, [row for row in lines if row.strip()]


def _instance_of(part: _PartOfFile, lines: list[str]) -> _PartOfFile:
    if len(lines) > 1:
        raise MeshFileError("has a rotated instance, which cannot be read")
    words, offset = _words_in(lines), np.zeros(3)
    if len(words) > 3:
        raise MeshFileError(f"moves an instance by {lines[0][:40]!r}, which is not three numbers")
    offset[: len(words)] = numbers(words, np.float64)
    sets = {name: [*items] for name, items in part.sets.items()}
    return replace(
        part,
        nodes=[*part.nodes],
        elements=[*part.elements],
        sets=sets,
        sections=[*part.sections],
        surfaces=dict(part.surfaces),
        of_assembly={},
        offset=offset,
    )


def _elements_of(kind: str, lines: list[str]) -> tuple[str, npt.NDArray[np.int64]]:
    found = next(
        ((found, cells) for pattern, cells in _ELEMENTS if (found := pattern.match(kind))), None
    )
    name = found[1].get(int(found[0][1] or found[0][2])) if found else None
    if name is None:
        raise MeshFileError(f"holds elements of type {kind!r}, which cannot be read")
    n, words = n_nodes_of(name), _words_in(lines)
    if len(words) % (n + 1):
        raise MeshFileError(f"has elements {kind} of other than {n} nodes")
    return name, numbers(words, np.int64).reshape(-1, n + 1)


def _words_in(lines: list[str]) -> list[str]:
    return [word for word in map(str.strip, ",".join(lines).split(",")) if word]


def _items_of(lines: list[str], *, is_range: bool) -> Iterator[Any]:
    if is_range:
        for line in lines:
            limits = numbers(_words_in([line]), np.int64).tolist()
            if len(limits) not in (2, 3) or limits[2:] == [0]:
                raise MeshFileError(f"has a set with the range {line[:40]!r}")
            yield range(limits[0], limits[1] + 1, *limits[2:])
        return
    words = _words_in(lines)
    yield numbers([word for word in words if word.isdigit()], np.int64)
    yield from (word.strip('"').upper() for word in words if not word.isdigit())


def _joined(parts: list[_PartOfFile], names: dict[str, str]) -> RawMesh:
    """Return the elements of all parts as one mesh, with their surfaces as further cells."""
    points, blocks, tags, n_points, width = [], [], [], 0, 3
    regions = {name for part in parts for name in part.regions}
    labels = {name: label for name, label in names.items() if name in regions}
    number = {name: k for k, name in enumerate(labels, start=1)}
    surfaces = dict.fromkeys(name for part in parts for name in part.surfaces)
    faces: list[tuple[str, int, npt.NDArray[np.int64]]] = []
    for k, part in enumerate(parts):
        rows = [line.split(",")[:4] for line in part.nodes]
        width = max([width, *map(len, rows)])
        words = [word if word.strip() else "0" for row in rows for word in [*row, "", "", ""][:4]]
        points.append(numbers(words, np.float64).reshape(-1, 4)[:, 1:] + part.offset)
        ids = numbers([row[0] for row in rows], np.int64)
        for cell_type, elements in part.elements:
            own, nodes = elements[:, 0], elements[:, 1:]
            cells = rows_of(nodes, ids, "an element") + n_points
            blocks.append((cell_type, cells))
            tags.append(np.zeros(len(own), np.int32))
            for name in filter(number.get, part.regions):
                tags[-1][part.holds(name, own)] = number[name]
            for tag, name in enumerate(surfaces, start=1):
                of_part = _faces_of(part.surfaces.get(name, []), part, cell_type, own, cells)
                of_whole = parts[0].surfaces.get(name, []) if k and part.of_assembly else []
                of_part += _faces_of(of_whole, part, cell_type, own, cells, in_assembly=True)
                faces += [(face_type, tag, found) for face_type, found in of_part]
        n_points += len(ids)
    label = [*labels.values()]
    tag_names = {
        (dimension_of(cell_type), tag): label[tag - 1]
        for (cell_type, _), held in zip(blocks, tags, strict=True)
        for tag in np.unique(held[held > 0]).tolist()
    }
    tag_names |= {(dimension_of(kind), tag): [*surfaces][tag - 1] for kind, tag, _ in faces}
    blocks += [(face_type, found) for face_type, _, found in faces]
    tags += [np.full(len(found), tag, np.int32) for _, tag, found in faces]
    coordinates = np.concatenate(points)[:, : width - 1]
    return RawMesh(coordinates, blocks, {}, {"cell_tags": tags}, tag_names)


def _faces_of(
    lines: list[str],
    part: _PartOfFile,
    cell_type: str,
    elements: npt.NDArray[np.int64],
    cells: npt.NDArray[np.int64],
    *,
    in_assembly: bool = False,
) -> list[tuple[str, npt.NDArray[np.int64]]]:
    """Return the faces of some cells in a surface, as cells of their type.

    Sides of shells, and all faces of a set without a number, are left out.
    """
    base, found = cell_type.rstrip("0123456789"), []
    by_number: dict[int, npt.NDArray[np.bool_]] = {}
    items: dict[int, list[str]] = {}
    for line in lines:
        item, _, label = (word.strip() for word in line.partition(","))
        if re.fullmatch(r"[Ss]\d+", label):
            items.setdefault(int(label[1:]), []).append(item)
    for face, held in items.items():
        single = numbers([item for item in held if item.isdigit()], np.int64)
        by_number[face] = np.isin(elements, single)
        for item in dict.fromkeys(item.strip('"') for item in held if not item.isdigit()):
            by_number[face] |= part.holds(item, elements, in_assembly=in_assembly)
    for face, corners in enumerate(_FACES.get(base, ()), start=1):
        if face in by_number and by_number[face].any():
            kind = {2: "line", 3: "triangle", 4: "quad"}[len(corners)]
            found.append((kind, cells[by_number[face]][:, corners]))
    return found
