"""Names of physical groups in files of Gmsh, and the refusal of partitions.

meshio keeps only one group per name, but a volume and its surface may share a name.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

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
