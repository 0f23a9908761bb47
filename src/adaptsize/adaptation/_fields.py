"""Fields with one row per node or cell: checks, a view as columns, and logarithms."""

from collections.abc import Mapping
from typing import Any, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_plain_array, check_type, describe, one_of, refuse_where
from adaptsize.background import AnyMesh
from adaptsize.typing import FloatArray, NodalMethod

#: Fields by name.
Arrays: TypeAlias = dict[str, npt.NDArray[Any]]


def as_fields(name: str, fields: Mapping[str, npt.ArrayLike] | None, n: int) -> Arrays:
    """Return checked fields with n rows each."""
    given = {} if fields is None else fields
    check_type(name, given, Mapping)
    return {key: as_field(f"{name}[{key!r}]", values, n) for key, values in given.items()}


def as_field(name: str, values: npt.ArrayLike, n: int) -> npt.NDArray[Any]:
    """Return a field with n rows as integers, booleans, float64 or complex128."""
    array = as_plain_array(name, values)
    if array.dtype.kind not in "biufc":
        raise ValueError(f"{name} must be an array of numbers, got {describe(values)}")
    if array.ndim == 0 or len(array) != n:
        raise ValueError(f"{name} must have {n} rows, got shape {array.shape}")
    if array.dtype.kind in "biu":
        return array
    array = array.astype(np.complex128 if array.dtype.kind == "c" else np.float64)
    refuse_where(name, ~np.isfinite(array), array, "must be finite")
    return array


def methods_of(
    method: NodalMethod | Mapping[str, NodalMethod] | None,
    fields: Mapping[str, npt.NDArray[Any]],
    mesh: AnyMesh,
) -> dict[str, NodalMethod]:
    """Return the checked method of transfer of each nodal field."""
    if not isinstance(method, Mapping):
        return {name: as_method("method", method, mesh) for name in fields}
    for name in method:
        if name not in fields:
            raise ValueError(f"method must be for names of fields, got {name!r}")
    return {name: as_method(f"method[{name!r}]", method.get(name), mesh) for name in fields}


def as_method(name: str, method: NodalMethod | None, mesh: AnyMesh) -> NodalMethod:
    """Return the checked method of transfer of one nodal field."""
    on_surface = mesh.cell_dim != mesh.dim
    if method is None:
        return "interpolate" if on_surface else "bounded"
    found: NodalMethod = one_of(name, method, get_args(NodalMethod))  # type: ignore[assignment]
    if on_surface and found != "interpolate":
        raise ValueError(
            f'{name} must be "interpolate" for triangles in space: two triangulations of a '
            f'curved surface do not overlap, got "{found}"'
        )
    return found


def as_columns(field: npt.NDArray[Any]) -> FloatArray:
    """Return a field as float64[n, k]; integers below 2^53 are exact."""
    flat = field.reshape(len(field), int(np.prod(field.shape[1:], dtype=np.int64)))
    if field.dtype.kind == "c":
        return np.ascontiguousarray(flat).view(np.float64)
    return np.ascontiguousarray(flat, np.float64)


def from_columns(columns: FloatArray, field: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return columns in the type and the trailing shape of a field."""
    columns = np.ascontiguousarray(columns)
    typed = (
        columns.view(field.dtype)
        if field.dtype.kind == "c"
        else columns.astype(field.dtype, copy=False)
    )
    return typed.reshape((len(columns), *field.shape[1:]))


def logarithms(name: str, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the logarithms of symmetric positive definite matrices."""
    is_square = values.ndim > 2 and values.shape[-1] == values.shape[-2]
    if not is_square or values.dtype.kind != "f":
        raise ValueError(
            f"{name} must have real matrices for log, shape (..., d, d), got {values.dtype} of "
            f"shape {values.shape}"
        )
    size = np.abs(values).max(initial=0.0)
    skew = np.abs(values - np.swapaxes(values, -1, -2)).max(axis=(-1, -2))
    refuse_where(name, skew > 1e-9 * size, values, "must be symmetric for log")
    eigenvalues, vectors = np.linalg.eigh(values)
    lowest = eigenvalues[..., 0]
    refuse_where(name, lowest <= 0.0, values, "must be positive definite for log")
    return np.asarray((vectors * np.log(eigenvalues)[..., None, :]) @ np.swapaxes(vectors, -1, -2))


def exponentials(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the exponentials of symmetric matrices."""
    values = 0.5 * (values + np.swapaxes(values, -1, -2))
    eigenvalues, vectors = np.linalg.eigh(values)
    made = (vectors * np.exp(eigenvalues)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return np.asarray(0.5 * (made + np.swapaxes(made, -1, -2)))
