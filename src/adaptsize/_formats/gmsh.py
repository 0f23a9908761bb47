"""Reading of Gmsh's files, versions 2.2 and 4.1 (text and binary) and 4.0 (text).

Nodes and elements have numbers of their own, by which data are given, and which may have gaps.
"""

import codecs
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import RawMesh, corners_of, dimension_of, n_nodes_of
from adaptsize._formats.text import numbers_in, rows_of
from adaptsize.errors import MeshFileError

#: Cells by the numbers of their types.
TYPES = {
    1: "line", 2: "triangle", 3: "quad", 4: "tetra", 5: "hexahedron", 6: "wedge", 7: "pyramid",
    8: "line3", 9: "triangle6", 10: "quad9", 11: "tetra10", 12: "hexahedron27", 13: "wedge18",
    14: "pyramid14", 15: "vertex", 16: "quad8", 17: "hexahedron20", 18: "wedge15", 19: "pyramid13",
    20: "triangle9", 21: "triangle10", 22: "triangle12", 23: "triangle15", 24: "triangle15",
    25: "triangle21", 26: "line4", 27: "line5", 28: "line6", 29: "tetra20", 30: "tetra35",
    31: "tetra56", 36: "quad16", 37: "quad25", 38: "quad36", 90: "wedge40", 91: "wedge75",
    92: "hexahedron64", 93: "hexahedron125",
}  # fmt: skip
_NAME = re.compile(r'^[ \t]*([0-3])\s+(-?\d+)\s+"(.*)"[ \t\r]*$', re.M)
_SECTION = re.compile(rb"^[ \t]*\$(\w+)[ \t\r]*\n", re.M)
_DATA = ("NodeData", "ElementData", "ElementNodeData")
_Array = npt.NDArray[Any]


class _Cells(NamedTuple):
    """Elements of one type: their numbers, groups, entities, and numbers of nodes."""

    kind: str
    numbers: _Array
    groups: _Array
    entities: _Array
    nodes: _Array


class _Field(NamedTuple):
    """Data of a section: its name, time step, and rows of values by numbers."""

    name: str
    step: int
    numbers: _Array
    values: _Array
    counts: _Array
    """Values per row, in ElementNodeData."""


@dataclass
class _File:
    """The sections of a file."""

    version: str = ""
    is_binary: bool = False
    order: str = "<"
    names: dict[tuple[int, int], str] = field(default_factory=dict)
    groups: dict[tuple[int, int], list[int]] = field(default_factory=dict)
    """Physical groups of each entity, in version 4."""
    nodes: _Array = field(default_factory=lambda: np.empty(0, np.int64))
    points: _Array = field(default_factory=lambda: np.empty((0, 3)))
    cells: list[_Cells] = field(default_factory=list)
    data: dict[str, list[_Field]] = field(default_factory=lambda: {kind: [] for kind in _DATA})


def read(path: Path) -> RawMesh:
    """Return the cells with their physical groups, names of groups, and data by their numbers.

    An element in several groups has the tag of the first.  Nodes and elements without a value
    have nan.  Values at the nodes of each element become their mean at the node.

    Raises
    ------
    MeshFileError
        If the file is damaged, of another version, or has elements of an unknown type.

    References
    ----------
    The formats are those of the Gmsh Reference Manual, sections "MSH file format".
    """
    return _raw_of(_sections_of(path.read_bytes().removeprefix(codecs.BOM_UTF8)))


def _sections_of(content: bytes) -> _File:
    """Return what is in the sections of a file; unknown ones are left out."""
    file, place = _File(), 0
    while found := _SECTION.search(content, place):
        name = found[1].decode()
        # A binary section may hold the text of its end: its length is that of its numbers.
        stream = _Numbers(content, found.end(), name, file)
        if name == "MeshFormat":
            _read_format(file, content[found.end() : found.end() + 200])
        elif name == "PhysicalNames":
            text = stream.rest().decode("utf-8", "replace")
            listed = ((int(dim), int(tag), held) for dim, tag, held in _NAME.findall(text))
            file.names = {(dim, tag): held for dim, tag, held in listed if held.strip()}
        elif name == "Entities":
            _read_entities(file, stream)
        elif name == "Nodes":
            _read_nodes(file, stream)
        elif name == "Elements":
            read_elements = _read_elements_2 if file.version.startswith("2") else _read_elements_4
            file.cells += read_elements(file, stream)
        elif name in _DATA:
            file.data[name].append(_read_data(file, stream, of_nodes=name == "ElementNodeData"))
        end = content.find(b"$End" + found[1], stream.place)
        if end < 0:
            raise MeshFileError(f"is truncated (no $End{name})")
        place = end + len(found[1]) + 4
    return file


def _read_format(file: _File, head: bytes) -> None:
    words = head.split(None, 3)
    version = words[0].decode("latin-1") if len(words) > 2 else ""
    file.is_binary = len(words) > 2 and words[1] == b"1"
    file.version = {"2": "2.2", "4": "4.0"}.get(version, version)
    known = file.version[:2] == "2." or file.version in ("4.0", "4.1")
    if not known or (file.is_binary and file.version == "4.0") or words[2:3] != [b"8"]:
        kind = "binary" if file.is_binary else "text"
        raise MeshFileError(
            f"cannot be read (Gmsh's format {version or '?'} as {kind}; 2.2, 4.0 as text and 4.1 "
            "can be)"
        )
    if file.is_binary:
        line = head.partition(b"\n")[2][:4]
        file.order = "<" if line == b"\1\0\0\0" else ">"


class _Numbers:
    """The numbers of a section, one after another: of a text all are converted at once."""

    def __init__(self, content: bytes, place: int, name: str, file: _File) -> None:
        self.content, self.place, self.name, self.file = content, place, name, file
        self._used = 0

    def rest(self) -> bytes:
        """Return the bytes up to the end mark of the section."""
        end = self.content.find(b"$End" + self.name.encode(), self.place)
        if end < 0:
            raise MeshFileError(f"is truncated (no $End{self.name})")
        return self.content[self.place : end]

    def line(self) -> str:
        """Return the next line, of text in all files."""
        end = self.content.find(b"\n", self.place)
        if end < 0:
            raise self.short()
        text = self.content[self.place : end].decode("utf-8", "replace").strip()
        self.place = end + 1
        return text

    def take(self, n: int, kind: str) -> _Array:
        """Return the next ``n`` numbers; ``kind`` is the binary type."""
        if n < 0:
            raise self.short()
        if not self.file.is_binary:
            return self._take_text(n, kind)
        dtype = np.dtype(self.file.order + kind)
        if len(self.content) - self.place < n * dtype.itemsize:
            raise self.short()
        found = np.frombuffer(self.content, dtype, n, self.place)
        self.place += n * dtype.itemsize
        return found

    def peek(self, n: int, kind: str, ahead: int = 0) -> _Array:
        """Return ``n`` numbers of a text, ``ahead`` of the next one, and leave them to `take`."""
        start = self._used + ahead
        found = self._text[start : start + n]
        if len(found) < n:
            raise self.short()
        return found if kind == "f8" else found.astype(np.int64)

    def _take_text(self, n: int, kind: str) -> _Array:
        found = self.peek(n, kind)
        self._used += n
        return found

    @cached_property
    def _text(self) -> _Array:
        """All numbers of a text."""
        text = self.rest()
        self.place += len(text)
        return numbers_in(text, f"${self.name}")

    def records(self, n: int, *kinds: tuple[str, int]) -> list[_Array]:
        """Return columns of ``n`` records: pairs of a binary type and the number of values."""
        if self.file.is_binary:
            dtype = np.dtype([(str(i), self.file.order + kind, (k,))
                              for i, (kind, k) in enumerate(kinds)])  # fmt: skip
            if n < 0 or len(self.content) - self.place < n * dtype.itemsize:
                raise self.short()
            rows = np.frombuffer(self.content, dtype, n, self.place)
            self.place += n * dtype.itemsize
            return [rows[name] for name in rows.dtype.names or ()]
        widths = [k for _, k in kinds]
        table = self.take(n * sum(widths), "f8").reshape(n, sum(widths))
        parts = np.split(table, np.cumsum(widths)[:-1], axis=1)
        return [
            part if kind == "f8" else part.astype(np.int64)
            for part, (kind, _) in zip(parts, kinds, strict=True)
        ]

    def left(self) -> int:
        """Return how many numbers of a text are left."""
        return len(self._text) - self._used

    def short(self) -> MeshFileError:
        """Return the error of a section with too few numbers, or with a word that is none."""
        return MeshFileError(f"holds fewer numbers in ${self.name} than it promises")


def _read_entities(file: _File, stream: _Numbers) -> None:
    """Read the physical groups of the entities of version 4."""
    for dim, count in enumerate(stream.take(4, "u8").tolist()):
        n_box = 3 if dim == 0 and file.version == "4.1" else 6
        for _ in range(count):
            tag = int(stream.take(1, "i4")[0])
            stream.take(n_box, "f8")
            groups = stream.take(int(stream.take(1, "u8")[0]), "i4")
            if dim:
                stream.take(int(stream.take(1, "u8")[0]), "i4")  # what bounds it
            file.groups[dim, tag] = np.abs(groups).tolist()


def _read_nodes(file: _File, stream: _Numbers) -> None:
    tags: list[_Array] = [np.empty(0, np.int64)]
    places: list[_Array] = [np.empty((0, 3))]
    if file.version.startswith("2"):
        n = _count_in(stream) if file.is_binary else int(stream.take(1, "u8")[0])
        found, rows = stream.records(n, ("i4", 1), ("f8", 3))
        tags.append(found[:, 0])
        places.append(rows)
    else:
        n_blocks = int(stream.take(4 if file.version == "4.1" else 2, "u8")[0])
        for _ in range(n_blocks):
            pair, (parametric, n) = _head_of(file, stream)
            width = 3 + (pair[0] if parametric else 0)
            if file.version == "4.1":
                tags.append(stream.take(n, "u8"))
                places.append(stream.take(n * width, "f8").reshape(n, width)[:, :3])
            else:
                found, rows = stream.records(n, ("u8", 1), ("f8", width))
                tags.append(found[:, 0])
                places.append(rows[:, :3])
    file.nodes = np.concatenate([part.astype(np.int64) for part in tags])
    file.points = np.concatenate(places).astype(np.float64)


def _head_of(file: _File, stream: _Numbers) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return dimension and tag of the entity of a block of version 4, and two numbers of it."""
    first, second, third = stream.take(3, "i4").tolist()
    count = int(stream.take(1, "u8")[0])
    return ((first, second) if file.version == "4.1" else (second, first)), (third, count)


def _count_in(stream: _Numbers) -> int:
    """Return the count in the line before binary numbers of version 2."""
    line = stream.line()
    if not line.isdigit():
        raise stream.short()
    return int(line)


def _type_of(number: int) -> str:
    if number not in TYPES:
        raise MeshFileError(f"holds elements of Gmsh's type {number}, which cannot be read")
    return TYPES[number]


def _read_elements_4(file: _File, stream: _Numbers) -> Iterator[_Cells]:
    n_blocks = int(stream.take(4 if file.version == "4.1" else 2, "u8")[0])
    for _ in range(n_blocks):
        entity, (number, n) = _head_of(file, stream)
        kind = _type_of(number)
        found, nodes = stream.records(n, ("u8", 1), ("u8", n_nodes_of(kind)))
        group = (file.groups.get(entity) or [0])[0]
        yield _Cells(
            kind, found[:, 0], np.full(n, group), np.full(n, entity[1]), nodes.astype(np.int64)
        )


def _read_elements_2(file: _File, stream: _Numbers) -> Iterator[_Cells]:
    n = _count_in(stream) if file.is_binary else int(stream.take(1, "u8")[0])
    while n > 0:
        if file.is_binary:
            number, count, n_tags = stream.take(3, "i4").tolist()
            kind = _type_of(number)
            found, tags, nodes = stream.records(
                count, ("i4", 1), ("i4", n_tags), ("i4", n_nodes_of(kind))
            )
        else:
            kind, found, tags, nodes = _next_elements(stream, n)
        if not 0 < len(found) <= n:
            raise stream.short()
        n -= len(found)
        tags = np.pad(tags[:, :2].astype(np.int64), ((0, 0), (0, max(0, 2 - tags.shape[1]))))
        yield _Cells(kind, found[:, 0], tags[:, 0], tags[:, 1], nodes.astype(np.int64))


def _next_elements(stream: _Numbers, most: int) -> tuple[str, _Array, _Array, _Array]:
    """Return the next elements of a text that have the same type and number of tags."""
    _, number, n_tags = stream.peek(3, "i4").tolist()
    kind = _type_of(number)
    width = 3 + n_tags + n_nodes_of(kind)
    if n_tags < 0:
        raise stream.short()
    total, step = 0, 64
    while total < most:
        n = min(step, most - total, (stream.left() - total * width) // width)
        rows = stream.peek(max(n, 0) * width, "i4", total * width).reshape(-1, width)
        same = (rows[:, 1] == number) & (rows[:, 2] == n_tags)
        own = n if same.all() else int(np.argmin(same))
        total, step = total + own, 2 * step
        if own < n or n == 0:
            break
    rows = stream.take(total * width, "i4").reshape(total, width)
    return kind, rows[:, :1], rows[:, 3 : 3 + n_tags], rows[:, 3 + n_tags :]


def _read_data(file: _File, stream: _Numbers, *, of_nodes: bool) -> _Field:
    texts, _, integers = ([stream.line() for _ in range(_count_in(stream))] for _ in range(3))
    if len(integers) < 3 or not all(word.lstrip("-").isdigit() for word in integers):
        raise stream.short()
    step, width, n = map(int, integers[:3])
    name = texts[0].strip('"') if texts else "data"
    if not of_nodes:
        numbers, values = stream.records(n, ("i4", 1), ("f8", max(width, 0)))
        return _Field(name, step, numbers[:, 0], values, np.ones(n, np.int64))
    numbers_, counts, rows = [], [], []
    for _ in range(n):
        number, count = stream.take(2, "i4").tolist()
        numbers_.append(number)
        counts.append(count)
        rows.append(stream.take(count * width, "f8").reshape(count, width))
    values = np.concatenate([np.empty((0, width)), *rows])
    return _Field(name, step, np.array(numbers_, np.int64), values, np.array(counts, np.int64))


# --- the mesh -------------------------------------------------------------------------------------


def _raw_of(file: _File) -> RawMesh:
    raw = RawMesh(file.points, [], {}, {}, file.names)
    kinds = dict.fromkeys(cells.kind for cells in file.cells)
    blocks = [_joined([c for c in file.cells if c.kind == kind]) for kind in kinds]
    blocks = [cells._replace(nodes=rows_of(cells.nodes, file.nodes, "an element"))
              for cells in blocks]  # fmt: skip
    if file.version.startswith("2"):
        blocks, further, of_repeated = _without_repeated(blocks)
    else:
        further, of_repeated = _further_groups(file), {}
    if further:
        raw.notes.append(text_of_further(further, file.names))
    raw.blocks = [(cells.kind, cells.nodes) for cells in blocks]
    raw.cell_data = {
        "gmsh:physical": [cells.groups for cells in blocks],
        "gmsh:geometrical": [cells.entities for cells in blocks],
    }
    at_nodes = [
        (found.name, _by_number(found, file.nodes, "nodes", raw.notes))
        for found in _last_steps(file.data["NodeData"], raw.notes)
    ]
    means = _last_steps(file.data["ElementNodeData"], raw.notes)
    at_nodes += [(found.name, _mean_at_nodes(found, blocks, raw)) for found in means]
    raw.point_data = dict(at_nodes)
    fields = _last_steps(file.data["ElementData"], raw.notes)
    raw.cell_data |= {found.name: _of_elements(found, blocks, of_repeated, raw) for found in fields}
    return raw


def _of_elements(
    found: _Field, blocks: list[_Cells], of_repeated: dict[int, int], raw: RawMesh
) -> list[_Array]:
    """Return the values of the elements of each block."""
    if of_repeated:
        own = [of_repeated.get(number, number) for number in found.numbers.tolist()]
        found = found._replace(numbers=np.array(own, np.int64))
    top = max((dimension_of(cells.kind) for cells in blocks), default=0)
    wanted = [cells.numbers for cells in blocks if dimension_of(cells.kind) == top]
    _by_number(found, np.concatenate(wanted), "elements", raw.notes)
    return [_by_number(found, cells.numbers, "") for cells in blocks]


def _joined(parts: Sequence[_Cells]) -> _Cells:
    return _Cells(
        parts[0].kind, *(np.concatenate(column) for column in [*zip(*parts, strict=True)][1:])
    )


def _further_groups(file: _File) -> Counter[tuple[int, int]]:
    """Return the numbers of elements in groups of an entity after the first."""
    further: Counter[tuple[int, int]] = Counter()
    for cells in file.cells:
        dim = dimension_of(cells.kind)
        for entity in np.unique(cells.entities).tolist():
            for group in file.groups.get((dim, entity), [])[1:]:
                further[dim, group] += int(np.count_nonzero(cells.entities == entity))
    return further


def _without_repeated(
    blocks: list[_Cells],
) -> tuple[list[_Cells], Counter[tuple[int, int]], dict[int, int]]:
    """Return the first of the elements that version 2 repeats for each of their groups.

    Further results are the numbers of those dropped by their groups, and the number of the
    element that is kept for each.
    """
    kept, further, of_repeated = [], Counter[tuple[int, int]](), dict[int, int]()
    for cells in blocks:
        rows = np.sort(corners_of(cells.kind, cells.nodes), axis=1)
        _, first, of_row = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        is_first = np.zeros(len(rows), bool)
        is_first[first] = True
        dropped = np.flatnonzero(~is_first)
        dim = dimension_of(cells.kind)
        further.update((dim, group) for group in cells.groups[dropped].tolist())
        others = cells.numbers[first[of_row.ravel()[dropped]]].tolist()
        of_repeated |= zip(cells.numbers[dropped].tolist(), others, strict=True)
        kept.append(_Cells(cells.kind, *(column[is_first] for column in cells[1:])))
    return kept, further, of_repeated


def text_of_further(further: Counter[tuple[int, int]], names: dict[tuple[int, int], str]) -> str:
    """Return a note on the groups, by dimension and tag, that so many elements are in, too."""
    listed = ", ".join(f"{names.get(key, key[1])} ({n})" for key, n in sorted(further.items()))
    return f"elements in several physical groups keep the first; left out are {listed}"


def _last_steps(fields: list[_Field], notes: list[str]) -> list[_Field]:
    """Return the last time step of each field."""
    last: dict[str, _Field] = {}
    for found in fields:
        if found.name not in last or found.step >= last[found.name].step:
            last[found.name] = found
    for name in last:
        n = sum(found.name == name for found in fields)
        if n > 1:
            notes.append(f"of the {n} time steps of {name!r} the last is kept")
    return list(last.values())


def _by_number(found: _Field, numbers: _Array, what: str, notes: list[str] | None = None) -> _Array:
    """Return the values in the order of numbers, nan where there is none."""
    values = np.full((len(numbers), found.values.shape[1]), np.nan)
    place = _places(found.numbers, numbers)
    values[place[place >= 0]] = found.values[place >= 0]
    n_missing = len(numbers) - len(np.unique(place[place >= 0]))
    if notes is not None and n_missing:
        notes.append(f"{found.name!r} has no value at {n_missing} of {len(numbers)} {what} (nan)")
    return values[:, 0] if values.shape[1] == 1 else values


def _places(wanted: _Array, numbers: _Array) -> npt.NDArray[np.intp]:
    """Return the place of each wanted number among some, -1 if it is none of them."""
    if not len(numbers):
        return np.full(len(wanted), -1)
    order = np.argsort(numbers, kind="stable")
    place = order[np.searchsorted(numbers, wanted, sorter=order).clip(0, len(numbers) - 1)]
    return np.where(numbers[place] == wanted, place, -1)


def _mean_at_nodes(found: _Field, blocks: list[_Cells], raw: RawMesh) -> _Array:
    """Return the mean at each node of the values that elements have there, nan without any."""
    total = np.zeros((len(raw.points), found.values.shape[1]))
    count = np.zeros(len(raw.points))
    start = np.cumsum(found.counts) - found.counts
    for cells in blocks:
        place = _places(found.numbers, cells.numbers)
        for n in np.unique(found.counts[place >= 0]).tolist():
            rows = np.flatnonzero((place >= 0) & (found.counts == n))
            nodes = cells.nodes[place[rows], :n]
            own = start[rows][:, None] + np.arange(nodes.shape[1])
            np.add.at(total, nodes.ravel(), found.values[own.ravel()])
            np.add.at(count, nodes.ravel(), 1.0)
    mean: _Array = np.full_like(total, np.nan)
    np.divide(total, count[:, None], out=mean, where=count[:, None] > 0.0)
    note = f"{found.name!r}, given at the nodes of each element, has the mean at nodes"
    n_missing = np.count_nonzero(count == 0.0)
    raw.notes.append(note + (f" (nan at {n_missing})" if n_missing else ""))
    return mean[:, 0] if mean.shape[1] == 1 else mean
