"""Sizes and metrics at nodes in the formats of mesh generators.

Metrics are nodal fields of nine components, or symmetric matrices in Mmg's ``.sol``.  ``.solb`` is
its binary form, as the library libMeshb stores it: the integers 1, whose bytes show their order,
and the version; then keywords, each a code, the place of the next one, and data.  Integers have 4
bytes; places have 8 from version 3 on and counts from version 4.  Numbers have 4 bytes in version 1
and 8 in others.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize.background import SimplexMesh
from adaptsize.errors import MeshFileError
from adaptsize.metrics import Metric
from adaptsize.typing import FloatArray

_ROWS_AT_ONCE = 20_000  # formatted together, for speed; the text is limited to a few MB


def write_view(path: Path, mesh: SimplexMesh, values: FloatArray, title: str) -> None:
    """Write a list-based view of Gmsh in its parsed text form (``.pos``).

    One line, triangle or tetrahedron per cell, of scalars (SL, ST, SS) or tensors (TL, TT, TS):
    three coordinates for each node, then the values of the nodes, those of tensors row by row.
    """
    name = ("S" if values.ndim == 1 else "T") + {1: "L", 2: "T", 3: "S"}[mesh.cell_dim]
    n_nodes = mesh.cell_dim + 1
    corners = np.zeros((mesh.n_cells, n_nodes, 3))
    corners[..., : mesh.dim] = mesh.points[mesh.cells]
    of_cells = values.reshape(mesh.n_points, -1)[mesh.cells].reshape(mesh.n_cells, -1)
    rows = np.hstack([corners.reshape(mesh.n_cells, -1), of_cells])
    coordinates = ",".join(["%.17g"] * (3 * n_nodes))
    line = f"{name}({coordinates}){{{','.join(['%.17g'] * of_cells.shape[1])}}};\n"
    _write_text(path, [f'View "{title}" {{\n'], _formatted(line, rows), ["};\n"])


def write_sol(path: Path, mesh: SimplexMesh, values: FloatArray) -> None:
    """Write one size or symmetric matrix per node in Mmg's format (``.sol``), for a ``.mesh``.

    The order is that of the lower triangle by rows: xx, xy, yy, xz, yz, zz.
    """
    i, j = np.tril_indices(mesh.dim)
    rows, kind = (values[:, None], _SCALAR) if values.ndim == 1 else (values[:, i, j], _SYMMETRIC)
    head = f"MeshVersionFormatted 2\n\nDimension {mesh.dim}\n\nSolAtVertices\n{mesh.n_points}\n"
    line = " ".join(["%.17g"] * rows.shape[1]) + "\n"
    _write_text(path, [f"{head}1 {kind}\n"], _formatted(line, rows), ["\nEnd\n"])


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


#: Name of the nodal field of the matrices M, and of that of the lengths L, for ellipsoids.
METRIC, LENGTHS = "metric", "metric.lengths"
#: Types of values in a ``.sol``: a number, a symmetric matrix.
_SCALAR, _SYMMETRIC = 1, 3


def fields_of(metric: Metric) -> dict[str, FloatArray]:
    """Return the nodal fields that hold a metric, nine components by rows.

    The matrices of 2-D metrics are padded by zeros, as ParaView expects.
    """
    fields = {METRIC: _padded(metric.matrices)}
    if np.isfinite(metric.sizes).all():
        fields[LENGTHS] = _padded(metric.lengths)
    return fields


def as_tensors(values: npt.NDArray[Any]) -> FloatArray:
    """Return a field of nine components as float64[n, 3, 3]."""
    if values[0].size != 9:
        raise ValueError(f"metric must have nine components per node, got {values.shape}")
    return np.asarray(values, np.float64).reshape(-1, 3, 3)


def metric_in(values: npt.NDArray[Any], dim: int) -> Metric:
    """Return the metric in a nodal field: one size per node, or a matrix by rows."""
    n = len(values)
    columns = np.asarray(values, np.float64).reshape(n, -1)
    if columns.shape[1] == 1:
        return Metric.isotropic(columns[:, 0], dim)
    if columns.shape[1] == 9:
        return Metric.from_matrices(columns.reshape(n, 3, 3)[:, :dim, :dim])
    if columns.shape[1] == dim * dim:
        return Metric.from_matrices(columns.reshape(n, dim, dim))
    raise MeshFileError(f"holds {columns.shape[1]} components per node, not a matrix")


def read_sol(path: Path) -> Metric:
    """Return the metric in a file for Mmg: sizes or symmetric matrices at nodes."""
    found = read_solb(path) if path.suffix.lower() == ".solb" else _text_of(path)
    dim, kinds, n, values = found
    if dim not in (2, 3) or n < 1 or len(kinds) != 1 or kinds[0] not in (_SCALAR, _SYMMETRIC):
        raise MeshFileError(
            "must hold one size (type 1) or symmetric matrix (type 3) per node in 2-D or 3-D, got "
            f"{n} nodes in {dim}-D with {len(kinds)} values, the first of type {kinds[0]}"
        )
    width = 1 if kinds[0] == _SCALAR else dim * (dim + 1) // 2
    values = values[: n * width]
    if len(values) < n * width:
        raise MeshFileError(f"ends after {len(values)} of {n * width} numbers")
    if kinds[0] == _SCALAR:
        return Metric.isotropic(values, dim)
    i, j = np.tril_indices(dim)
    matrices = np.empty((n, dim, dim))
    matrices[:, i, j] = matrices[:, j, i] = values.reshape(n, width)
    return Metric.from_matrices(matrices)


def _text_of(path: Path) -> Solution:
    """Return the values in a text file."""
    try:
        words = path.read_text(encoding="ascii").split()
    except UnicodeDecodeError:
        raise MeshFileError("is not a text file; is it a .solb?") from None
    try:
        dim = int(words[words.index("Dimension") + 1])
        start = words.index("SolAtVertices")
        n, n_kinds, kind = (int(word) for word in words[start + 1 : start + 4])
    except (ValueError, IndexError):
        raise MeshFileError("lacks Dimension or SolAtVertices with its counts") from None
    most = n * (1 if kind == _SCALAR else dim * (dim + 1) // 2) if dim in (2, 3) else 0
    try:
        values = np.array(words[start + 4 : start + 4 + max(most, 0)], np.float64)
    except ValueError:
        raise MeshFileError("holds something else than numbers, or ends early") from None
    return Solution(dim, [kind] * max(n_kinds, 1), n, values)


def _padded(matrices: FloatArray) -> FloatArray:
    missing = 3 - matrices.shape[-1]
    full = np.pad(matrices, ((0, 0), (0, missing), (0, missing)))
    return np.asarray(full.reshape(len(matrices), 9))


_DIMENSION, _END, _SOL_AT_VERTICES = 3, 54, 62


class Solution(NamedTuple):
    """Values at nodes."""

    dim: int
    kinds: list[int]
    """Types of the values of a node: 1 a number, 2 a vector, 3 a symmetric matrix."""
    n: int
    """Number of nodes."""
    values: FloatArray
    """One after another; fewer than there should be if the file ends early."""


class _Content:
    """Bytes, read one after another."""

    def __init__(self, content: bytes) -> None:
        self.content, self.at = content, 0
        is_little = content[:4] == (1).to_bytes(4, "little")
        self.order: Literal["little", "big"] = "little" if is_little else "big"
        if self.integer() != 1:
            raise MeshFileError("does not begin as a binary .solb")

    def integer(self, n_bytes: int = 4) -> int:
        part = self.content[self.at : self.at + n_bytes]
        if len(part) < n_bytes:
            raise MeshFileError("ends early")
        self.at += n_bytes
        return int.from_bytes(part, self.order, signed=True)


def read_solb(path: Path) -> Solution:
    """Return the values at the nodes in a binary file."""
    content = _Content(path.read_bytes())
    version = content.integer()
    if not 1 <= version <= 4:
        raise MeshFileError(f"has version {version} of the format; 1 to 4 can be read")
    dim = 0
    while True:
        code = content.integer()
        if code == _END:
            raise MeshFileError("has no values at nodes")
        following = content.integer(4 if version < 3 else 8)
        if code == _DIMENSION:
            dim = content.integer()
        elif code == _SOL_AT_VERTICES:
            break
        if following <= content.at - 4 or following >= len(content.content):
            raise MeshFileError("ends early, or is damaged")
        content.at = following
    n = content.integer(4 if version < 4 else 8)
    n_kinds = content.integer()
    if not 0 < n_kinds < 100:
        raise MeshFileError(f"has {n_kinds} values per node")
    kinds = [content.integer() for _ in range(n_kinds)]
    widths = {1: 1, 2: dim, 3: dim * (dim + 1) // 2}
    if dim not in (2, 3) or n < 1 or not set(kinds) <= set(widths):
        raise MeshFileError(f"has {n} nodes in {dim}-D with values of the types {kinds}")
    kind = np.dtype("f4" if version == 1 else "f8").newbyteorder(content.order)
    count = min(
        n * sum(widths[k] for k in kinds), (len(content.content) - content.at) // kind.itemsize
    )
    values = np.frombuffer(content.content, kind, count, content.at)
    return Solution(dim, kinds, n, values.astype(np.float64))
