"""Whether a file holds all that its header announces.

The readers of other packages do not check it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from adaptsize._formats import vtk
from adaptsize._formats.blocks import RawMesh
from adaptsize._formats.guards import about_file, files_named_in
from adaptsize._formats.text import check_last_number
from adaptsize.errors import MeshFileError

_GMSH_SECTIONS = (
    b"Entities",
    b"PartitionedEntities",
    b"PhysicalNames",
    b"Nodes",
    b"Elements",
    b"NodeData",
    b"ElementData",
)
#: Keywords of binary Medit files are numbers; this one is End.
_MEDIT_END = 54


def check_end(suffix: str, content: bytes) -> None:
    """Refuse a file that lacks the end mark of its format, before it is read.

    Raises
    ------
    MeshFileError
        The message does not have the path.
    """
    check = _ENDS.get(suffix)
    if check is not None:
        check(content)


def check_named(path: Path, first: int = 0, step: int = 1) -> None:
    """Refuse a file that names incomplete ones; of these, every ``step``-th is checked."""
    for file in sorted(files_named_in(path))[first::step]:
        try:
            check_end(file.suffix.lower(), file.read_bytes())
        except MeshFileError as error:
            raise about_file(f"names {file.name}", error) from error


def check_counts(suffix: str, content: bytes, raw: RawMesh) -> None:
    """Refuse a mesh with fewer points, cells or values than its file promises.

    Raises
    ------
    MeshFileError
        The message has both numbers, without the path.
    """
    check = _COUNTS.get(suffix)
    if check is not None:
        check(content, raw)


def _check_gmsh(content: bytes) -> None:
    if not re.match(rb"\s*\$(MeshFormat|Comments|NOD)\b", content[:1000]):
        raise MeshFileError("cannot be read as a mesh (no $MeshFormat at the start; is it Gmsh's?)")
    for name in _GMSH_SECTIONS:
        begun = len(re.findall(rb"^\$" + name + rb"\s*$", content, re.MULTILINE))
        if begun > content.count(b"$End" + name):
            raise MeshFileError(f"is truncated (no $End{name.decode()})")
    if b"\n$PartitionedEntities" in content:
        raise MeshFileError(
            "has partitions of Gmsh, which cannot be read; save the mesh without (gmsh -part 1, or "
            "gmsh.model.mesh.unpartition)"
        )


def _check_medit_end(content: bytes) -> None:
    if not re.search(rb"^\s*End\s*$", content[-1000:], re.MULTILINE | re.IGNORECASE):
        raise MeshFileError("is truncated (no End)")


class BinaryMedit:
    """A binary file of Medit: sections, each with a keyword and the place of the next one.

    Integers have 4 bytes; places have 8 from version 3 on, and counts from version 4.  Numbers
    have 4 bytes in version 1 and 8 in others.
    """

    def __init__(self, content: bytes) -> None:
        self.content = content
        self.order = "<" if content[:4] == b"\x01\0\0\0" else ">"
        self.version = self.integer(4)
        if self.integer(0) != 1 or not 1 <= self.version <= 4:
            raise MeshFileError("is not a binary file of Medit of version 1 to 4")
        self.places: dict[int, int] = {}
        """Where the data of each keyword begin."""
        place = 8 if self.version > 2 else 4
        at = 8
        while (keyword := self.integer(at)) != _MEDIT_END:
            self.places[keyword] = at + 4 + place
            following = self.integer(at + 4, place)
            if not at < following < len(content):
                raise MeshFileError("is truncated (no End)")
            at = following

    def integer(self, at: int, size: int = 4) -> int:
        """Return an integer of ``size`` bytes."""
        if at + size > len(self.content):
            raise MeshFileError("is truncated (no End)")
        return int(np.frombuffer(self.content, f"{self.order}i{size}", 1, at)[0])


def _check_ply(content: bytes, raw: RawMesh) -> None:
    head = content.partition(b"end_header")[0]
    for name, held in (("vertex", len(raw.points)), ("face", _n_cells(raw))):
        promised = re.search(rb"^element[ \t]+" + name.encode() + rb"[ \t]+(\d+)", head, re.M)
        _compare(
            {"vertex": "vertices"}.get(name, "faces"), int(promised[1]) if promised else 0, held
        )
    if re.search(rb"^format[ \t]+ascii", head, re.M):
        ends_in_nodes = re.search(rb"vertex_ind\w+\s*\Z", head)
        check_last_number(content, len(raw.points) if ends_in_nodes else math.inf)


def _check_nastran_end(content: bytes) -> None:
    if not re.search(rb"^ENDDATA", content, re.MULTILINE):
        raise MeshFileError("is truncated (no ENDDATA)")


def _check_su2_points(content: bytes) -> None:
    """Refuse a file without points, for which the reader fails by an error of its own."""
    if not re.search(rb"^[ \t]*NPOIN=[ \t]*0*[1-9]", content, re.MULTILINE):
        raise MeshFileError("holds no points (no line NPOIN= with their number)")


def _check_su2(content: bytes, raw: RawMesh) -> None:
    lines = re.sub(rb"%[^\r\n]*", b"", content)
    points, cells = _sum(lines, rb"NPOIN"), _sum(lines, rb"NELEM") + _sum(lines, rb"MARKER_ELEMS")
    _compare("points", points, len(raw.points))
    _compare("cells", cells, _n_cells(raw))
    markers = len(re.findall(rb"^[ \t]*MARKER_TAG\s*=", lines, re.MULTILINE))
    _compare("markers", _sum(lines, rb"NMARK"), markers)
    check_last_number(lines, len(raw.points))


def _sum(lines: bytes, name: bytes) -> int:
    found = re.findall(rb"^[ \t]*" + name + rb"[ \t]*=[ \t]*(\d+)", lines, re.MULTILINE)
    return sum(map(int, found))


def _check_vtk(content: bytes) -> None:
    if re.match(rb"[^\n]*\n[^\n]*\n\s*ASCII\b", content):
        check_last_number(content)


def _check_vtk_xml(content: bytes) -> None:
    """Refuse appended numbers that end early; VTK would return whatever is in its memory."""
    if not content.rstrip().endswith(b"</VTKFile>"):
        raise MeshFileError("is truncated (no </VTKFile>)")
    head, _, appended = content.partition(b"<AppendedData")
    if not re.match(rb"[^>]*\braw\b", appended):
        return
    data = appended[appended.index(b"_") + 1 :]
    order = ">" if b'"BigEndian"' in head else "<"
    kind = np.dtype(f"{order}u8" if b'"UInt64"' in head[:1000] else f"{order}u4")
    for word in re.findall(rb'\boffset="(\d{1,18})"', head):
        start, length = int(word), kind.itemsize
        if b"compressor=" in head[:1000] and start + length <= len(data):
            length *= 3 + int(np.frombuffer(data, kind, 1, start)[0])
        if start + length <= len(data):
            stored = np.frombuffer(data, kind, length // kind.itemsize, start)
            length += int(stored[0]) if len(stored) == 1 else sum(stored[3:].tolist())
        if start + length > len(data):
            raise MeshFileError("ends inside its numbers")


def _check_last_line(content: bytes, raw: RawMesh, words: tuple[bytes, ...]) -> None:
    """Check the last number, unless the last line begins as one that has no numbers."""
    if not content[-1000:].splitlines()[-1].lstrip().startswith(words):
        check_last_number(content, len(raw.points))


def _n_cells(raw: RawMesh) -> int:
    return sum(len(cells) for _, cells in raw.blocks)


def _compare(what: str, promised: int, held: int) -> None:
    if held < promised:
        raise MeshFileError(f"is truncated (promises {promised} {what}, holds {held})")


_ENDS: dict[str, Callable[[bytes], object]] = {
    ".msh": _check_gmsh,
    ".mesh": _check_medit_end,
    ".meshb": BinaryMedit,
    **dict.fromkeys((".bdf", ".nas", ".fem"), _check_nastran_end),
    ".su2": _check_su2_points,
    ".vtk": _check_vtk,
    **dict.fromkeys(vtk.XML, _check_vtk_xml),
}
_COUNTS: dict[str, Callable[[bytes, RawMesh], None]] = {
    ".ply": _check_ply,
    ".su2": _check_su2,
    ".obj": partial(_check_last_line, words=(b"#", b"o", b"g", b"s", b"u", b"m")),
    ".inp": partial(_check_last_line, words=(b"*",)),
}
