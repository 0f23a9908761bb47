"""Checked data at points of quadrature in each cell."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_flag, as_values, refuse_where
from adaptsize.adaptation._fields import (
    as_columns,
    as_field,
    exponentials,
    from_columns,
    logarithms,
)
from adaptsize.adaptation.field_transfer import FieldTransfer
from adaptsize.adaptation.given_fields import QuadratureField
from adaptsize.adaptation.lagrange import LagrangeSpace
from adaptsize.adaptation.spaces import Made, Moving, ToProject
from adaptsize.background import SimplexMesh
from adaptsize.typing import FloatArray

#: Highest order of the polynomials that represent the data.
_MOST = 2


class OfQuadrature:
    """A checked `QuadratureField`."""

    how = "projected (points of quadrature)"
    kind = "data at points of quadrature"

    def __init__(self, name: str, given: QuadratureField, mesh: SimplexMesh) -> None:
        self._given = given
        d = mesh.cell_dim
        points = as_values(f"points of {name}", given.points)
        if points.ndim != 2 or points.shape[1] != d or len(points) == 0:
            raise ValueError(f"points of {name} must have shape (n, {d}), got {points.shape}")
        weights = as_values(f"weights of {name}", given.weights, (len(points),))
        refuse_where(f"weights of {name}", weights <= 0.0, weights, "must be positive")
        self.places = np.column_stack([1.0 - points.sum(axis=1), points])
        self.weights = weights / weights.sum()
        array = as_field(name, given.values, mesh.n_cells)
        if array.ndim < 2 or array.shape[1] != len(points):
            raise ValueError(
                f"{name} must have shape ({mesh.n_cells}, {len(points)}, ...), got {array.shape}"
            )
        floats = array.astype(np.float64) if array.dtype.kind in "biu" else array
        self.log = as_flag(f"log of {name}", given.log)
        self.values = logarithms(name, floats) if self.log else floats
        self.order, self.fit = self._fit(mesh)

    def _fit(self, mesh: SimplexMesh) -> tuple[int, FloatArray]:
        """Return the order of the polynomials, and the matrix that fits them to the data."""
        for order in range(_MOST, -1, -1):
            space = LagrangeSpace(mesh, order, False)
            at = space.functions(self.places)
            gram = at.T @ (self.weights[:, None] * at)
            is_exact = np.allclose(self.weights @ at, space.means, rtol=0.0, atol=1e-10)
            if is_exact and np.linalg.cond(gram) < 1e8:
                break
        return order, np.asarray(np.linalg.solve(gram, at.T * self.weights))

    def kept(self) -> QuadratureField:
        """Return the given field."""
        return self._given

    def on(self, transfer: FieldTransfer) -> Moving | Made:
        """Return what is to be projected, and a function for the field on the new mesh."""
        old, new = (LagrangeSpace(m, self.order, False) for m in (transfer.old, transfer.new))
        values = self.values
        columns = as_columns(values.reshape(-1, *values.shape[2:]))
        columns = columns.reshape(*values.shape[:2], -1)
        held = (self.fit @ columns).reshape(old.n, columns.shape[2])

        def made(found: FloatArray) -> QuadratureField:
            found = found.reshape(transfer.new.n_cells, -1, held.shape[1])
            at_points = (new.functions(self.places) @ found).reshape(-1, held.shape[1])
            like = np.empty((len(at_points), *values.shape[2:]), values.dtype)
            own = from_columns(at_points, like)
            own = own.reshape(transfer.new.n_cells, *values.shape[1:])
            return replace(self._given, values=exponentials(own) if self.log else own)

        return Moving(ToProject(old, new, held), made)

    def integral(self, made: QuadratureField, mesh: SimplexMesh) -> npt.NDArray[Any]:
        """Return the integral of a field on a mesh, by its rule."""
        means = np.tensordot(self.weights, np.asarray(made.values), axes=(0, 1))
        return np.asarray(np.tensordot(mesh.measures, means, axes=1))

    def before(self, mesh: SimplexMesh) -> tuple[npt.NDArray[Any], float]:
        """Return the integral on the old mesh, and that of the absolute value."""
        size = replace(self._given, values=np.abs(np.asarray(self._given.values)))
        largest = float(self.integral(size, mesh).max(initial=0.0))
        return self.integral(self._given, mesh), largest
