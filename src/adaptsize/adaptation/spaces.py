"""L2 projection from a space of finite elements onto that of another mesh."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from adaptsize.adaptation.field_transfer import FieldTransfer
from adaptsize.adaptation.pieces import (
    Points,
    common_pieces,
    points_of_cells,
    rule_of,
    some_cells,
)
from adaptsize.background import SimplexMesh
from adaptsize.typing import FloatArray, IntArray

#: A new cell of which a larger share is outside the old mesh is not covered by it.
_MISSING = 1e-11


class Space(Protocol):
    """A space of functions on a mesh, of which `values` and `load` are evaluated in cells."""

    degree: int

    @property
    def key(self) -> Hashable:
        """Equal for equal spaces on a mesh."""

    @property
    def n(self) -> int:
        """Number of coefficients."""

    def values(self, held: npt.NDArray[Any], cells: IntArray, places: FloatArray) -> FloatArray:
        """Return the values of columns of coefficients at places in cells, float64[p, q, c]."""

    def load(self, cells: IntArray, places: FloatArray, values: FloatArray) -> FloatArray:
        """Return the sums of values times the functions of the space, float64[n, c]."""

    def solve(self, load: FloatArray) -> FloatArray:
        """Return the coefficients of the functions whose products with the space are ``load``."""


class ToProject(NamedTuple):
    """A field that is to be projected."""

    old: Space
    new: Space
    held: FloatArray
    """Columns of coefficients in the old space."""


class Moving(NamedTuple):
    """A field on its way to another mesh."""

    task: ToProject
    made: Callable[[FloatArray], Any]
    """Takes the coefficients of the projection, and returns the field on the new mesh."""


class Made(NamedTuple):
    """A field that is on the new mesh without a projection from the old one."""

    field: Any


class Checked(Protocol):
    """A checked field of finite elements on the old mesh."""

    how: str
    """How it is transferred."""
    kind: str
    """What it is, for messages."""

    def kept(self) -> Any:
        """Return the field on the old mesh, as the caller gave it."""

    def on(self, transfer: FieldTransfer) -> Moving | Made:
        """Return what is to be projected, or the field on the new mesh if that is known."""

    def integral(self, made: Any, mesh: SimplexMesh) -> npt.NDArray[Any]:
        """Return the integral of a field of this kind on a mesh."""

    def before(self, mesh: SimplexMesh) -> tuple[npt.NDArray[Any], float]:
        """Return the integral on the old mesh, and that of the absolute value.

        The latter is the largest of all components.
        """


def projected(transfer: FieldTransfer, fields: Sequence[ToProject]) -> list[FloatArray]:
    """Return the coefficients of the L2 projections of fields, which share the intersections.

    Beyond the old mesh, a field goes on with its values at the nearest points, and what counts
    inside is the difference from that.
    """
    if not fields:
        return []
    # Those of the same spaces are columns of one.
    groups: dict[tuple[Hashable, Hashable], list[ToProject]] = {}
    for field in fields:
        groups.setdefault((field.old.key, field.new.key), []).append(field)
    sums = [
        _Sums(own[0]._replace(held=np.hstack([f.held for f in own]))) for own in groups.values()
    ]
    outside = np.flatnonzero(transfer.coverage < 1.0 - _MISSING).astype(np.int32)
    for pieces in common_pieces(transfer):
        inside = ~np.isin(pieces.cells, outside)
        for own in sums:
            own.add(pieces.points(own.degree).some(inside))
    if len(outside):
        for own in sums:
            for at in points_of_cells(transfer, own.degree, outside):
                own.add(at)
            own.go_on()
        for pieces in common_pieces(transfer):
            for own in sums:
                own.add(pieces.points(own.degree))
    found: dict[int, FloatArray] = {}
    for of_one, own in zip(groups.values(), sums, strict=True):
        ends = np.cumsum([field.held.shape[1] for field in of_one])[:-1]
        parts = np.split(own.solution(), ends, axis=1)
        found |= {id(field): part for field, part in zip(of_one, parts, strict=True)}
    return [found[id(field)] for field in fields]


class _Sums:
    """The products of a field, or of what is missing of it, with the functions of a space."""

    def __init__(self, field: ToProject) -> None:
        self._field, self.degree = field, field.old.degree + field.new.degree
        self._base: FloatArray | None = None
        self._load = np.zeros((field.new.n, field.held.shape[1]))

    def add(self, at: Points) -> None:
        """Add the products at some points."""
        new = self._field.new
        values = self._field.old.values(self._field.held, at.old_cells, at.old_places)
        if self._base is not None:
            values = values - new.values(self._base, at.cells, at.places)
        self._load += new.load(at.cells, at.places, at.weights[:, :, None] * values)

    def go_on(self) -> None:
        """Take the solution so far, and add what is missing of the field from now on."""
        self._base = self._field.new.solve(self._load)
        self._load = np.zeros_like(self._load)

    def solution(self) -> FloatArray:
        """Return the coefficients."""
        found = self._field.new.solve(self._load)
        return found if self._base is None else self._base + found


def magnitude_of(space: Space, held: npt.NDArray[Any], mesh: SimplexMesh) -> float:
    """Return the integral of the absolute value of the largest column of coefficients."""
    rule = rule_of(mesh.cell_dim, 2 * space.degree)
    parts = []
    for cells in some_cells(rule, np.arange(mesh.n_cells, dtype=np.int32)):
        places = np.broadcast_to(rule.places, (len(cells), *rule.places.shape))
        values = np.abs(space.values(held, cells, places))
        parts.append(np.einsum("pqc,q,p->c", values, rule.weights, mesh.measures[cells]))
    return float(np.max(sum(parts), initial=0.0))
