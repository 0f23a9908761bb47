"""Nodal sizes in the file formats of other mesh generators."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize.background import SimplexMesh
from adaptsize.typing import FloatArray

_ROWS_AT_ONCE = 20_000  # formatted together, for speed; the text is limited to a few MB


def write_gmsh_view(path: Path, mesh: SimplexMesh, sizes: FloatArray) -> None:
    """Write a list-based view of Gmsh in its parsed text form (``.pos``).

    One scalar line, triangle or tetrahedron (SL, ST, SS) per cell: three coordinates
    for each node, then the sizes of the nodes.
    """
    name = {1: "SL", 2: "ST", 3: "SS"}[mesh.cell_dim]
    _write_view(path, mesh, name, sizes[:, None], "h")


def _write_view(
    path: Path, mesh: SimplexMesh, cell_name: str, values: FloatArray, title: str
) -> None:
    """Write a view with the same number of values at each node."""
    n_nodes = mesh.cell_dim + 1
    corners = np.zeros((mesh.n_cells, n_nodes, 3))
    corners[..., : mesh.dim] = mesh.points[mesh.cells]
    of_cells = values[mesh.cells].reshape(mesh.n_cells, -1)
    rows = np.hstack([corners.reshape(mesh.n_cells, -1), of_cells])
    coordinates = ",".join(["%.17g"] * (3 * n_nodes))
    line = f"{cell_name}({coordinates}){{{','.join(['%.17g'] * of_cells.shape[1])}}};\n"
    _write_text(path, [f'View "{title}" {{\n'], _formatted(line, rows), ["};\n"])


def write_medit_sol(path: Path, mesh: SimplexMesh, sizes: FloatArray) -> None:
    """Write one scalar per node in Mmg's format (``.sol``), for a ``.mesh`` of the same name."""
    head = (
        f"MeshVersionFormatted 2\n\nDimension {mesh.dim}\n\nSolAtVertices\n{mesh.n_points}\n1 1\n"
    )
    _write_text(path, [head], _formatted("%.17g\n", sizes[:, None]), ["\nEnd\n"])


def write_metric_view(path: Path, mesh: SimplexMesh, matrices: FloatArray) -> None:
    """Write a view of tensors (TL, TT, TS): nine numbers per node, row by row."""
    name = {1: "TL", 2: "TT", 3: "TS"}[mesh.cell_dim]
    _write_view(path, mesh, name, matrices.reshape(mesh.n_points, 9), "metric")


def write_metric_sol(path: Path, mesh: SimplexMesh, matrices: FloatArray) -> None:
    """Write a symmetric matrix per node in Mmg's format (``.sol``).

    The order is that of the lower triangle by rows: xx, xy, yy, xz, yz, zz.
    """
    i, j = np.tril_indices(mesh.dim)
    head = (
        f"MeshVersionFormatted 2\n\nDimension {mesh.dim}\n\nSolAtVertices\n{mesh.n_points}\n1 3\n"
    )
    line = " ".join(["%.17g"] * len(i)) + "\n"
    _write_text(path, [head], _formatted(line, matrices[:, i, j]), ["\nEnd\n"])


def write_jigsaw(path: Path, mesh: SimplexMesh, sizes: FloatArray) -> None:
    """Write triangles in the plane or tetrahedra with nodal values as JIGSAW's ``.msh``.

    Sections of the format, version 3: POINT, TRIA3 or TRIA4, VALUE.  Fields are separated by
    semicolons, nodes are numbered from 0, and each row of the first two ends with a tag.
    """
    cell_name = {2: "TRIA3", 3: "TRIA4"}[mesh.cell_dim]
    tags = np.zeros(mesh.n_cells, np.int32) if mesh.cell_tags is None else mesh.cell_tags
    point = ";".join(["%.17g"] * mesh.dim) + ";0\n"
    cell = ";".join(["%d"] * (mesh.cell_dim + 2)) + "\n"
    _write_text(
        path,
        [f"MSHID=3;euclidean-mesh\nNDIMS={mesh.dim}\nPOINT={mesh.n_points}\n"],
        _formatted(point, mesh.points),
        [f"{cell_name}={mesh.n_cells}\n"],
        _formatted(cell, np.column_stack([mesh.cells, tags])),
        [f"VALUE={mesh.n_points};1\n"],
        _formatted("%.17g\n", sizes[:, None]),
    )


def _formatted(line: str, rows: npt.NDArray[Any]) -> Iterator[str]:
    """Yield the rows as text, many at a time."""
    for start in range(0, len(rows), _ROWS_AT_ONCE):
        part = rows[start : start + _ROWS_AT_ONCE]
        yield (line * len(part)) % tuple(part.ravel().tolist())


def _write_text(path: Path, *pieces: Iterable[str]) -> None:
    with path.open("w", encoding="ascii", newline="\n") as file:
        for piece in pieces:
            file.writelines(piece)
