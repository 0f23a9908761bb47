"""Numbers in text files, and whether a file holds all that its header announces.

The readers of other packages do not check it.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats import vtk
from adaptsize._formats.blocks import RawMesh
from adaptsize.errors import MeshFileError

#: No program writes numbers with more characters.
_LONGEST = 400


def numbers(words: Sequence[bytes] | Sequence[str], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """Return the numbers of a text as an array.

    Arrays of words, which numpy can convert too, have rows as long as the longest word.

    Raises
    ------
    MeshFileError
        If a word is not a number, or not an integer where ``dtype`` is an integer type.
    """
    kind = np.dtype(dtype)
    convert: Callable[[Any], float] = int if kind.kind in "iu" else float
    try:
        return np.fromiter(map(convert, words), kind, len(words))
    except (ValueError, OverflowError) as error:
        raise MeshFileError(f"holds {_first_bad(words, convert)!r} where {kind} is required") from (
            error
        )


def check_last_number(content: bytes, n_points: float = math.inf) -> None:
    """Refuse a text that ends inside a line after a number that may lack digits.

    Parameters
    ----------
    content : bytes
    n_points : float
        Number of points, if the last number is an index.  More digits would make many
        indices too large, so they are complete.  By default the number may be any.
    """
    last = re.split(rb"[\s,/]", content[-_LONGEST:])[-1]
    if not last or (last.isdigit() and 10 * int(last) > n_points):
        return
    raise MeshFileError(
        f"ends inside a line, after {last[-40:].decode('latin-1')!r}, so it may be truncated; "
        "if it is complete, add a line break"
    )


def _first_bad(words: Sequence[Any], convert: Callable[[Any], float]) -> str:
    for word in words:
        try:
            convert(word)
        except (ValueError, OverflowError):
            text = word.decode("latin-1") if isinstance(word, bytes) else str(word)
            return text if len(text) <= 40 else f"{text[:37]}..."
    return "a number that is too large"


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

    Some readers of other packages run forever at the end of such a file.  Also refused are Gmsh
    files whose fields promise more tags than there are lines, and SU2 files without points.

    Raises
    ------
    MeshFileError
        The message does not have the path.
    """
    check = _ENDS.get(suffix)
    if check is not None:
        check(content)


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


def _check_gmsh_sections(content: bytes) -> None:
    if not re.match(rb"\s*\$(MeshFormat|Comments|NOD)\b", content[:1000]):
        raise MeshFileError("cannot be read as a mesh (no $MeshFormat at the start; is it Gmsh's?)")
    for name in _GMSH_SECTIONS:
        begun = len(re.findall(rb"^\$" + name + rb"\s*$", content, re.MULTILINE))
        if begun > content.count(b"$End" + name):
            raise MeshFileError(f"is truncated (no $End{name.decode()})")


def _check_gmsh(content: bytes) -> None:
    _check_gmsh_sections(content)
    _check_gmsh_tags(content)


def _check_gmsh_tags(content: bytes) -> None:
    """Refuse fields with more tags than the file has lines; meshio tries to read them all."""
    n_lines = content.count(b"\n")
    file = io.BytesIO(content)
    for begun in re.finditer(rb"^\$(?:Node|Element)Data[ \t\r]*\n", content, re.MULTILINE):
        file.seek(begun.end())
        for kind in ("text", "real"):
            line = file.readline().strip()
            count = int(line) if line.isdigit() else 0
            if count > n_lines:
                raise MeshFileError(f"promises {count} {kind} tags of a field in {n_lines} lines")
            for _ in range(count):
                file.readline()


def _check_medit_end(content: bytes) -> None:
    if not re.search(rb"^\s*End\s*$", content[-1000:], re.MULTILINE | re.IGNORECASE):
        raise MeshFileError("is truncated (no End)")


def _check_binary_medit(content: bytes) -> None:
    """Follow the chain of sections, each of which has the position of the next one."""
    order = "<" if content[:4] == b"\x01\0\0\0" else ">"
    version = _integer(content, 4, f"{order}i4")
    position_type = f"{order}i8" if version > 2 else f"{order}i4"
    at = 8
    while True:
        keyword, following = _integer(content, at, f"{order}i4"), 0
        if keyword == _MEDIT_END:
            return
        following = _integer(content, at + 4, position_type)
        if not at < following < len(content):
            raise MeshFileError("is truncated (no End)")
        at = following


def _integer(content: bytes, at: int, dtype: str) -> int:
    kind = np.dtype(dtype)
    if at + kind.itemsize > len(content):
        raise MeshFileError("is truncated (no End)")
    return int(np.frombuffer(content, kind, 1, at)[0])


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


_ENDS: dict[str, Callable[[bytes], None]] = {
    ".msh": _check_gmsh,
    ".mesh": _check_medit_end,
    ".meshb": _check_binary_medit,
    **dict.fromkeys((".bdf", ".nas", ".fem"), _check_nastran_end),
    ".su2": _check_su2_points,
    ".vtk": _check_vtk,
    **dict.fromkeys(vtk.XML, _check_vtk_xml),
}
_COUNTS: dict[str, Callable[[bytes, RawMesh], None]] = {
    ".su2": _check_su2,
    ".obj": partial(_check_last_line, words=(b"#", b"o", b"g", b"s", b"u", b"m")),
    ".inp": partial(_check_last_line, words=(b"*",)),
}
