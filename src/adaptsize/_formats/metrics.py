"""Metrics in files: as nodal fields of nine components, and in Mmg's ``.sol``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._formats import solb
from adaptsize.errors import MeshFileError
from adaptsize.metrics import Metric, isotropic_metric
from adaptsize.typing import FloatArray

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
        return isotropic_metric(columns[:, 0], dim)
    if columns.shape[1] == 9:
        return Metric.from_matrices(columns.reshape(n, 3, 3)[:, :dim, :dim])
    if columns.shape[1] == dim * dim:
        return Metric.from_matrices(columns.reshape(n, dim, dim))
    raise MeshFileError(f"holds {columns.shape[1]} components per node, not a matrix")


def read_sol(path: Path) -> Metric:
    """Return the metric in a file for Mmg: sizes or symmetric matrices at nodes."""
    found = solb.read(path) if path.suffix.lower() == ".solb" else _text_of(path)
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
        return isotropic_metric(values, dim)
    i, j = np.tril_indices(dim)
    matrices = np.empty((n, dim, dim))
    matrices[:, i, j] = matrices[:, j, i] = values.reshape(n, width)
    return Metric.from_matrices(matrices)


def _text_of(path: Path) -> solb.Solution:
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
    return solb.Solution(dim, [kind] * max(n_kinds, 1), n, values)


def _padded(matrices: FloatArray) -> FloatArray:
    missing = 3 - matrices.shape[-1]
    full = np.pad(matrices, ((0, 0), (0, missing), (0, missing)))
    return np.asarray(full.reshape(len(matrices), 9))
