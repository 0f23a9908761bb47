"""Sizes and metrics at nodes in the formats of mesh generators.

Metrics are nodal fields of nine components, or symmetric matrices in Mmg's ``.sol``.
"""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_sizes, refuse_where, warn_caller
from adaptsize._formats.text import numbers, write_text
from adaptsize.background import SimplexMesh
from adaptsize.errors import InputWarning, MeshFileError
from adaptsize.metrics import Metric
from adaptsize.typing import FloatArray


def _sizes_of(mesh: SimplexMesh, generator: str) -> FloatArray:
    """Return the nodal field ``h`` if it is valid as sizes for a generator."""
    if "h" not in mesh.point_data:
        raise ValueError(f"obj must hold nodal sizes as the field 'h' for {generator}")
    values = as_sizes("h", mesh.point_data["h"], mesh.nodal_shape)
    wanted = f"must be finite for {generator}; clip it first: size.clip(hmax=...)"
    refuse_where("h", np.isinf(values), values, wanted)
    return values


def _sizes_or_metric(mesh: SimplexMesh, generator: str) -> FloatArray:
    """Return the sizes, float64[n], or matrices, float64[n, 3, 3], for a generator."""
    if METRIC not in mesh.point_data:
        return _sizes_of(mesh, generator)
    values = mesh.point_data[METRIC]
    if values[0].size != 9:
        raise ValueError(f"metric must have nine components per node, got {values.shape}")
    return np.asarray(values, np.float64).reshape(-1, 3, 3)


def write_view(path: Path, mesh: SimplexMesh) -> None:
    """Write sizes or a metric as a list-based view of Gmsh in its parsed text form (``.pos``).

    One line, triangle or tetrahedron per cell, of scalars (SL, ST, SS) or tensors (TL, TT, TS):
    three coordinates for each node, then the values of the nodes, those of tensors row by row.
    """
    values = _sizes_or_metric(mesh, "Gmsh")
    if mesh.cell_dim < mesh.dim:
        warn_caller(
            "the view has sizes on the surface only, none inside: for a volume, write the sizes on "
            "a grid around it (CartesianGrid.around)",
            InputWarning,
        )
    kind, title = ("S", "h") if values.ndim == 1 else ("T", "metric")
    name = kind + {1: "L", 2: "T", 3: "S"}[mesh.cell_dim]
    n_nodes = mesh.cell_dim + 1
    corners = np.zeros((mesh.n_cells, n_nodes, 3))
    corners[..., : mesh.dim] = mesh.points[mesh.cells]
    of_cells = values.reshape(mesh.n_points, -1)[mesh.cells].reshape(mesh.n_cells, -1)
    rows = np.hstack([corners.reshape(mesh.n_cells, -1), of_cells])
    coordinates = ",".join(["%.17g"] * (3 * n_nodes))
    line = f"{name}({coordinates}){{{','.join(['%.17g'] * of_cells.shape[1])}}};\n"
    write_text(path, f'View "{title}" {{\n', (line, rows), "};\n")


def write_sol(path: Path, mesh: SimplexMesh) -> None:
    """Write one size or symmetric matrix per node in Mmg's format (``.sol``), for a ``.mesh``.

    The order is that of the lower triangle by rows: xx, xy, yy, xz, yz, zz.
    """
    i, j = np.tril_indices(mesh.dim)
    values = _sizes_or_metric(mesh, "mmg")
    rows, kind = (values[:, None], _SCALAR) if values.ndim == 1 else (values[:, i, j], _SYMMETRIC)
    head = f"MeshVersionFormatted 2\n\nDimension {mesh.dim}\n\nSolAtVertices\n{mesh.n_points}\n"
    line = " ".join(["%.17g"] * rows.shape[1]) + "\n"
    write_text(path, f"{head}1 {kind}\n", (line, rows), "\nEnd\n")


def write_jigsaw(path: Path, mesh: SimplexMesh) -> None:
    """Write triangles in the plane or tetrahedra with nodal values as JIGSAW's ``.msh``.

    Sections of the format, version 3: POINT, TRIA3 or TRIA4, VALUE.  Fields are separated by
    semicolons, nodes are numbered from 0, and each row of the first two ends with a tag.
    """
    cell_name = {2: "TRIA3", 3: "TRIA4"}[mesh.cell_dim]
    tags = np.zeros(mesh.n_cells, np.int32) if mesh.cell_tags is None else mesh.cell_tags
    point = ";".join(["%.17g"] * mesh.dim) + ";0\n"
    cell = ";".join(["%d"] * (mesh.cell_dim + 2)) + "\n"
    write_text(
        path,
        f"MSHID=3;euclidean-mesh\nNDIMS={mesh.dim}\nPOINT={mesh.n_points}\n",
        (point, mesh.points),
        f"{cell_name}={mesh.n_cells}\n",
        (cell, np.column_stack([mesh.cells, tags])),
        f"VALUE={mesh.n_points};1\n",
        ("%.17g\n", _sizes_of(mesh, "JIGSAW")[:, None]),
    )


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
    try:
        words = path.read_text(encoding="ascii").split()
    except UnicodeDecodeError:
        raise MeshFileError("is not a text file") from None
    try:
        dim, start = int(words[words.index("Dimension") + 1]), words.index("SolAtVertices")
        n, n_kinds, kind = (int(word) for word in words[start + 1 : start + 4])
    except (ValueError, IndexError):
        raise MeshFileError("lacks Dimension or SolAtVertices with its counts") from None
    if dim not in (2, 3) or n < 1 or n_kinds != 1 or kind not in (_SCALAR, _SYMMETRIC):
        raise MeshFileError(
            "must hold one size (type 1) or symmetric matrix (type 3) per node in 2-D or 3-D, got "
            f"{n} nodes in {dim}-D with {n_kinds} values, the first of type {kind}"
        )
    count = n if kind == _SCALAR else n * (dim * (dim + 1) // 2)
    held = words[start + 4 : words.index("End") if "End" in words else None]
    if len(held) < count:
        raise MeshFileError(f"ends after {len(held)} of {count} numbers")
    values = numbers(held[:count], np.float64)
    if kind == _SCALAR:
        return Metric.isotropic(values, dim)
    i, j = np.tril_indices(dim)
    matrices = np.empty((n, dim, dim))
    matrices[:, i, j] = matrices[:, j, i] = values.reshape(n, -1)
    return Metric.from_matrices(matrices)


def _padded(matrices: FloatArray) -> FloatArray:
    missing = 3 - matrices.shape[-1]
    full = np.pad(matrices, ((0, 0), (0, missing), (0, missing)))
    return np.asarray(full.reshape(len(matrices), 9))
