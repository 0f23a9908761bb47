"""Whether a file holds all that its header announces.

The readers of other packages do not check it.
"""

import math
import re
from functools import partial

import numpy as np

from adaptsize._formats.blocks import RawMesh
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


def check_gmsh(content: bytes) -> None:
    """Refuse a file without its header, with partitions, or with a section that does not end."""
    if not re.match(rb"(\xef\xbb\xbf)?\s*\$(MeshFormat|Comments|NOD)\b", content[:1000]):
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


def check_ply(content: bytes, raw: RawMesh) -> None:
    """Refuse a text file whose last number may have been cut."""
    head = content.partition(b"end_header")[0]
    if re.search(rb"^format[ \t]+ascii", head, re.M):
        ends_in_nodes = re.search(rb"vertex_ind\w+\s*\Z", head)
        check_last_number(content, len(raw.points) if ends_in_nodes else math.inf)


def check_su2_points(content: bytes) -> None:
    """Refuse a file without points, for which the reader fails by an error of its own."""
    if not re.search(rb"^[ \t]*NPOIN=[ \t]*0*[1-9]", content, re.MULTILINE):
        raise MeshFileError("holds no points (no line NPOIN= with their number)")


def check_su2(content: bytes, raw: RawMesh) -> None:
    """Refuse fewer points or cells than the file promises."""
    lines = re.sub(rb"%[^\r\n]*", b"", content)
    points, cells = _sum(lines, rb"NPOIN"), _sum(lines, rb"NELEM") + _sum(lines, rb"MARKER_ELEMS")
    _compare("points", points, len(raw.points))
    _compare("cells", cells, sum(len(block) for _, block in raw.blocks))
    markers = len(re.findall(rb"^[ \t]*MARKER_TAG\s*=", lines, re.MULTILINE))
    _compare("markers", _sum(lines, rb"NMARK"), markers)
    check_last_number(lines, len(raw.points))


def _sum(lines: bytes, name: bytes) -> int:
    found = re.findall(rb"^[ \t]*" + name + rb"[ \t]*=[ \t]*(\d+)", lines, re.MULTILINE)
    return sum(map(int, found))


def check_vtk(content: bytes) -> None:
    """Refuse a text file whose last number may have been cut."""
    if re.match(rb"[^\n]*\n[^\n]*\n\s*ASCII\b", content):
        check_last_number(content)


def check_vtk_xml(content: bytes) -> None:
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


def _compare(what: str, promised: int, held: int) -> None:
    if held < promised:
        raise MeshFileError(f"is truncated (promises {promised} {what}, holds {held})")


check_obj = partial(_check_last_line, words=(b"#", b"o", b"g", b"s", b"u", b"m"))
check_abaqus = partial(_check_last_line, words=(b"*",))
