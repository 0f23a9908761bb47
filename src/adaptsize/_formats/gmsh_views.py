"""Views of Gmsh (``.pos``) as meshes with a nodal field.

The parsed text form lists cells, each with the coordinates and the values of its nodes:
``ST(x,y,z,x,y,z,x,y,z){h,h,h};``.  The first letter is S for numbers, V for vectors and T for
tensors, the second one L for segments, T for triangles and S for tetrahedra.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from adaptsize._formats.blocks import RawMesh
from adaptsize.background.merging import merge_equal_points
from adaptsize.errors import MeshFileError
from adaptsize.typing import FloatArray

_WIDTHS = {"S": 1, "V": 3, "T": 9}
_CELLS = {"L": ("line", 2), "T": ("triangle", 3), "S": ("tetra", 4)}
_VIEW = re.compile(r'\s*View\s+"([^"]*)"\s*\{(.*)\}\s*;\s*', re.DOTALL)
_ELEMENT = re.compile(r"([A-Z]+)\s*\(([^()]*)\)\s*\{([^{}]*)\}\s*;")


def read(path: Path) -> RawMesh:
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
        corners.append(_numbers([row for _, row, _ in of_kind], 3 * n_nodes).reshape(-1, 3))
        values.append(_numbers([row for _, _, row in of_kind], width * n_nodes).reshape(-1, width))
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


def _numbers(rows: list[str], width: int) -> FloatArray:
    """Return the numbers in rows of text, float64[n, width]."""
    parts = [row.split(",") for row in rows]
    wrong = next((part for part in parts if len(part) != width), None)
    if wrong is not None:
        raise MeshFileError(f"holds an element with {len(wrong)} numbers instead of {width}")
    try:
        return np.array(parts, np.float64)
    except ValueError:
        raise MeshFileError("holds something else than numbers in an element") from None
