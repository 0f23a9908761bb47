"""L2 projection from a space of finite elements onto that of another mesh."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from adaptsize.adaptation.field_transfer import FieldTransfer
from adaptsize.adaptation.pieces import common_points, points_of_cells, rule_of
from adaptsize.background import SimplexMesh
from adaptsize.typing import FloatArray, IntArray

#: A new cell of which a larger share is outside the old mesh is not covered by it.
_MISSING = 1e-11


class Space(Protocol):
    """A space of functions on a mesh, of which `values` and `load` are evaluated in cells."""

    degree: int

    @property
    def n(self) -> int:
        """Number of coefficients."""

    def values(self, held: npt.NDArray[Any], cells: IntArray, places: FloatArray) -> FloatArray:
        """Return the values of columns of coefficients at places in cells, float64[p, q, c]."""

    def load(self, cells: IntArray, places: FloatArray, values: FloatArray) -> FloatArray:
        """Return the sums of values times the functions of the space, float64[n, c]."""

    def solve(self, load: FloatArray) -> FloatArray:
        """Return the coefficients of the functions whose products with the space are ``load``."""


def projected(transfer: FieldTransfer, old: Space, new: Space, held: FloatArray) -> FloatArray:
    """Return the coefficients of the L2 projection of columns of old coefficients.

    Beyond the old mesh, the field goes on with its values at the nearest points, and what counts
    inside is the difference from that.
    """
    degree = old.degree + new.degree
    outside = np.flatnonzero(transfer.coverage < 1.0 - _MISSING).astype(np.int32)
    load: Any = 0.0
    for at in common_points(transfer, degree):
        kept = ~np.isin(at.cells, outside)
        own = at.some(kept)
        values = old.values(held, own.old_cells, own.old_places)
        load = load + new.load(own.cells, own.places, own.weights[:, :, None] * values)
    if len(outside) == 0:
        return new.solve(load)
    at = points_of_cells(transfer, degree, outside)
    values = old.values(held, at.old_cells, at.old_places)
    base = new.solve(load + new.load(at.cells, at.places, at.weights[:, :, None] * values))
    load = 0.0
    for at in common_points(transfer, degree):
        values = old.values(held, at.old_cells, at.old_places)
        values = values - new.values(base, at.cells, at.places)
        load = load + new.load(at.cells, at.places, at.weights[:, :, None] * values)
    return base + new.solve(load)


def magnitude_of(space: Space, held: npt.NDArray[Any], mesh: SimplexMesh) -> float:
    """Return the integral of the absolute value of the largest column of coefficients."""
    rule = rule_of(mesh.cell_dim, 2 * space.degree)
    places = np.broadcast_to(rule.places, (mesh.n_cells, *rule.places.shape))
    values = np.abs(space.values(held, np.arange(mesh.n_cells, dtype=np.int32), places))
    sums = np.einsum("pqc,q,p->c", values, rule.weights, mesh.measures)
    return float(sums.max(initial=0.0))
