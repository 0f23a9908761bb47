"""ADCIRC's fort.14 and SCHISM's hgrid.gr3: triangles in the plane with a depth at each node."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats.blocks import RawMesh
from adaptsize._formats.completeness import check_last_number, numbers
from adaptsize.background import SimplexMesh
from adaptsize.errors import MeshFileError

#: The nodal field that the third column holds.
DEPTH = "depth"


def read(path: Path) -> RawMesh:
    """Return the triangles and the depth.  Lists of boundaries are left out.

    Raises
    ------
    MeshFileError
        If the file is damaged, or ends before the counts in its header are reached.
    """
    content = path.read_bytes()
    lines = content.splitlines()
    if len(lines) < 2:
        raise MeshFileError("is truncated (the second line must hold two counts)")
    counts = lines[1].split()[:2]
    if len(counts) < 2 or not all(word.isdigit() for word in counts):
        raise MeshFileError("cannot be read as a mesh (the second line must hold two counts)")
    n_cells, n_points = int(counts[0]), int(counts[1])
    rows = [line.split() for line in lines[2 : 2 + n_points + n_cells]]
    if len(rows) < n_points + n_cells:
        raise MeshFileError(
            f"is truncated (promises {n_points} nodes and {n_cells} elements, holds {len(rows)})"
        )
    if len(lines) == 2 + n_points + n_cells:  # the lists of boundaries are missing
        check_last_number(content)
    points = _columns(rows[:n_points], 4, np.float64)
    cells = _columns(rows[n_points:], 5, np.int64)
    if (cells[:, 1] != 3).any():
        raise MeshFileError("holds elements that are no triangles, which cannot be read")
    order = np.argsort(points[:, 0], kind="stable")
    names = points[order, 0]
    place = np.searchsorted(names, cells[:, 2:]).clip(0, max(n_points - 1, 0))
    if n_points == 0 or (names[place] != cells[:, 2:]).any():
        raise MeshFileError("has an element with a node that is not in the file")
    return RawMesh(points[:, 1:3], [("triangle", order[place])], {DEPTH: points[:, 3]})


def _columns(rows: list[list[bytes]], count: int, dtype: type) -> npt.NDArray[Any]:
    short = next((row for row in rows if len(row) < count), None)
    if short is not None:
        raise MeshFileError(f"has a line with {len(short)} numbers, where {count} are required")
    found = numbers([word for row in rows for word in row[:count]], dtype)
    return found.reshape(-1, count)


def write(path: Path, mesh: SimplexMesh) -> None:
    """Write triangles in the plane with the nodal field ``depth``, or 0 without it.

    The last part of the file, the lists of open and land boundaries, has no entry: they follow
    from what the flow model does at each boundary.
    """
    if mesh.dim != 2 or mesh.cell_dim != 2:
        raise ValueError(f"obj must be triangles in the plane for fort.14, got {mesh!r}")
    depth = np.asarray(mesh.point_data.get(DEPTH, np.zeros(mesh.n_points)), dtype=np.float64)
    if depth.ndim != 1:
        raise ValueError(f"the field {DEPTH!r} must be one number per node, got {depth.shape}")
    text = io.StringIO()
    text.write(f"adaptsize\n{mesh.n_cells} {mesh.n_points}\n")
    nodes = np.column_stack([np.arange(1, mesh.n_points + 1), mesh.points, depth])
    np.savetxt(text, nodes, fmt=["%d", "%.17g", "%.17g", "%.17g"])
    three = np.full(mesh.n_cells, 3)
    cells = np.column_stack([np.arange(1, mesh.n_cells + 1), three, mesh.cells + 1])
    np.savetxt(text, cells, fmt="%d")
    text.write("0 = number of open boundaries\n0 = total number of open boundary nodes\n")
    text.write("0 = number of land boundaries\n0 = total number of land boundary nodes\n")
    path.write_text(text.getvalue(), encoding="ascii")
