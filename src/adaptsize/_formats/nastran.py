"""Reading of Nastran files: fields of 8 or 16 characters or between commas, in either case."""

import codecs
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from adaptsize._formats.blocks import RawMesh, n_nodes_of
from adaptsize._formats.text import numbers, rows_of
from adaptsize.errors import MeshFileError

#: Cells by the card of an element, those of order 1 first.
_CELLS = {
    **dict.fromkeys(("CROD", "CBAR", "CBEAM", "CTUBE", "CBEND"), ("line",)),
    **dict.fromkeys(("CTRIA3", "CTRIAR", "CTRAX3"), ("triangle",)),
    **dict.fromkeys(("CQUAD4", "CQUADR", "CSHEAR"), ("quad",)),
    "CBEAM3": ("line", "line3"),
    "CTRIA6": ("triangle", "triangle6"),
    "CQUAD8": ("quad", "quad8"),
    "CTETRA": ("tetra", "tetra10"),
    "CPYRAM": ("pyramid", "pyramid13"),
    "CPENTA": ("wedge", "wedge15"),
    "CHEXA": ("hexahedron", "hexahedron20"),
}
#: Cards that begin like elements and are none: coordinate systems, and the end of the case control.
_NO_ELEMENTS = re.compile(r"CORD|CEND|CYSYM|CYJOIN|CAERO|COMPGRP|CSUPER")
_N_NODES = {kind: n_nodes_of(kind) for kinds in _CELLS.values() for kind in kinds}
_BEGIN = re.compile(r"^[ \t]*BEGIN[ \t]+BULK.*$|^[ \t]*BEGIN[ \t]+SUPER.*$", re.M | re.IGNORECASE)
_REFUSED = re.compile(r"^(GRDSET|INCLUDE)\b", re.M | re.IGNORECASE)
_END = re.compile(r"^ENDDATA", re.M | re.IGNORECASE)
#: Exponents with D, or without a letter as in 2.1+11.
_EXPONENT = re.compile(r"(?<=[\d.])(?:[Dd]([+-]?\d+)|([+-]\d+))$")


def read(path: Path) -> RawMesh:
    """Return the cells with the numbers of their properties as tags.

    Raises
    ------
    MeshFileError
        If the file is damaged or has no ENDDATA, includes another file, or has nodes in coordinate
        systems of their own.

    References
    ----------
    The format of cards and the order of nodes are those of the MSC Nastran Quick Reference Guide.
    """
    text = path.read_bytes().removeprefix(codecs.BOM_UTF8).decode("latin-1")
    end = _END.search(text)
    if end is None:
        raise MeshFileError("is truncated (no ENDDATA)")
    if found := _REFUSED.search(text):
        raise MeshFileError(f"has {found[1].upper()}, which cannot be read")
    begin = _BEGIN.search(text, 0, end.start())
    points: list[list[str]] = []
    cells: dict[str, list[list[str]]] = {}
    left_out = Counter[str]()
    for name, fields in _cards_in(text[begin.end() if begin else 0 : end.start()]):
        if name == "GRID":
            points.append((fields + [""] * 5)[:5])
        elif name in _CELLS:
            kind, nodes = _cell_of(name, fields)
            cells.setdefault(kind, []).append([fields[1] or "0", *nodes])
        elif name.startswith("C") and not _NO_ELEMENTS.match(name):
            left_out[name] += 1
    if any(row[1] not in ("", "0") for row in points):
        raise MeshFileError("has nodes in coordinate systems (CP of GRID), which cannot be read")
    raw = _raw_of(points, cells)
    if left_out:
        listed = ", ".join(f"{n} {name}" for name, n in left_out.items())
        raw.notes.append(f"elements that are not cells left out: {listed}")
    return raw


def _raw_of(points: list[list[str]], cells: dict[str, list[list[str]]]) -> RawMesh:
    ids = numbers([row[0] for row in points], np.int64)
    words = [_real(word) for row in points for word in row[2:]]
    raw = RawMesh(numbers(words, np.float64).reshape(-1, 3), [])
    tags = []
    for kind, rows in cells.items():
        width = len(rows[0])
        table = numbers([word for row in rows for word in row], np.int64).reshape(-1, width)
        raw.blocks.append((kind, rows_of(table[:, 1:], ids, "an element")))
        tags.append(table[:, 0])
    raw.cell_data = {"nastran:ref": tags}
    return raw


def _cards_in(text: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the name of each card in capital letters and its fields, with those of continuations.

    A line continues the last card if its first field is empty or begins with + or *, whether it
    repeats the mark at the end of the line before or not.
    """
    card: tuple[str, list[str]] | None = None
    for line in re.sub(r"\$.*", "", text).expandtabs(8).splitlines():
        if not line or line.isspace():
            continue
        name, fields = _fields_of(line)
        if name[:1] in ("", "+", "*"):
            if card is not None:
                card[1].extend(fields)
            continue
        if card is not None:
            yield card
        card = name.rstrip("*").upper(), fields
    if card is not None:
        yield card


def _fields_of(line: str) -> tuple[str, list[str]]:
    """Return the first field of a line and those with data, as many as the line can have."""
    if "," in line:
        name, *fields = (word.strip() for word in line.split(","))
        n = 4 if "*" in name else 8
        if len(fields) > n + 1:  # some programs do not break lines
            return name, fields
    else:
        name = line[:8].strip()
        n = 4 if "*" in name else 8
        width = 64 // n
        fields = [line[k : k + width].strip() for k in range(8, min(len(line), 72), width)]
    return name, (fields + [""] * n)[:n]


def _cell_of(name: str, fields: list[str]) -> tuple[str, list[str]]:
    """Return the type of cell and the numbers of its nodes, corners only if others are missing."""
    for kind in reversed(_CELLS[name]):
        n = _N_NODES[kind]
        nodes = fields[2 : 2 + n]
        if len(nodes) == n and "" not in nodes and "0" not in nodes:
            return kind, nodes
    raise MeshFileError(f"has {name} {fields[0][:20]} without its {n} corners")


def _real(word: str) -> str:
    """Return a number as other programs write it; an empty field is 0."""
    return _EXPONENT.sub(lambda found: f"e{found[1] or found[2]}", word) or "0"
