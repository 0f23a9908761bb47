"""Checked fields of Lagrange elements, and functions, which are projected onto such elements."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize.adaptation._fields import (
    as_columns,
    as_field,
    exponentials,
    from_columns,
    logarithms,
)
from adaptsize.adaptation.field_transfer import FieldTransfer
from adaptsize.adaptation.given_fields import ElementField
from adaptsize.adaptation.lagrange import LagrangeSpace
from adaptsize.adaptation.pieces import rule_of, some_cells
from adaptsize.adaptation.spaces import Made, Moving, ToProject, magnitude_of
from adaptsize.background import SimplexMesh
from adaptsize.typing import FloatArray, IntArray

#: Degree for which functions are integrated, beyond that of the elements.
_OF_FUNCTIONS = 6

Function: TypeAlias = Callable[[FloatArray], npt.ArrayLike]


class OfElements:
    """A checked `ElementField` with values at the nodes."""

    kind = "a field of finite elements"

    def __init__(self, name: str, given: ElementField, mesh: SimplexMesh) -> None:
        self._given, space = given, _space_of(given, mesh)
        self.how = f"projected ({_named(space)})"
        array = as_field(name, given.values, space.shape[0])
        if array.shape[: len(space.shape)] != space.shape:
            raise ValueError(
                f"{name} must have shape {(*space.shape, '...')}, the nodes of elements of order "
                f"{space.degree}, got {array.shape}"
            )
        floats = array.astype(np.float64) if array.dtype.kind in "biu" else array
        values = logarithms(name, floats) if given.log else floats
        self._flat = values.reshape(space.n, *values.shape[len(space.shape) :])

    def kept(self) -> ElementField:
        """Return the given field."""
        return self._given

    def on(self, transfer: FieldTransfer) -> Moving | Made:
        """Return what is to be projected; linear elements are, as nodal fields."""
        old, new = (_space_of(self._given, mesh) for mesh in (transfer.old, transfer.new))
        if new.continuous and new.degree == 1:
            at_nodes = transfer.nodal(self._flat, method="project")
            return Made(self._made(at_nodes, new))
        columns = as_columns(self._flat)

        def made(found: FloatArray) -> ElementField:
            loose = np.flatnonzero(new.is_loose)
            if len(loose):
                cells, places, _ = transfer.old.locator.nearest(new.nodes[loose])
                found[loose] = old.values(columns, cells, places[:, None])[:, 0]
            return self._made(from_columns(found, self._flat), new)

        return Moving(ToProject(old, new, columns), made)

    def _made(self, found: npt.NDArray[Any], new: LagrangeSpace) -> ElementField:
        """Return the field with values at new nodes."""
        own = exponentials(found) if self._given.log else found
        return replace(self._given, values=own.reshape(*new.shape, *own.shape[1:]))

    def integral(self, made: ElementField, mesh: SimplexMesh) -> npt.NDArray[Any]:
        """Return the integral of a field on a mesh."""
        return _integral(made.values, _space_of(self._given, mesh))

    def before(self, mesh: SimplexMesh) -> tuple[npt.NDArray[Any], float]:
        """Return the integral on the old mesh, and that of the absolute value."""
        space = _space_of(self._given, mesh)
        largest = magnitude_of(space, self._flat.reshape(space.n, -1), mesh)
        return self.integral(self._given, mesh), largest


class OfFunction:
    """A function of points, which is integrated on each mesh anew; perhaps in an `ElementField`."""

    kind = "a function"

    def __init__(self, name: str, given: ElementField | Function, mesh: SimplexMesh) -> None:
        self._name, self._given, self._mesh = name, given, mesh
        self._field = given if isinstance(given, ElementField) else ElementField(given)
        self._function: Function = self._field.values
        self.how = f"projected ({_named(_space_of(self._field, mesh))})"

    def kept(self) -> ElementField | npt.NDArray[Any]:
        """Return the projection on the old mesh."""
        return self._on(self._mesh)

    def on(self, transfer: FieldTransfer) -> Moving | Made:
        """Return the projection on the new mesh."""
        return Made(self._on(transfer.new))

    def _on(self, mesh: SimplexMesh) -> ElementField | npt.NDArray[Any]:
        """Return the projection on a mesh, as the function was given: alone, or in a field."""
        space = _space_of(self._field, mesh)
        found = self._projected(space)
        values = found.reshape(*space.shape, *found.shape[1:])
        return values if self._given is not self._field else replace(self._field, values=values)

    def _projected(self, space: LagrangeSpace) -> npt.NDArray[Any]:
        loads = []
        for at in self._at_points(space):
            weighted = as_columns(at.values.reshape(at.weights.size, -1))
            weighted = (at.weights.reshape(-1, 1) * weighted).reshape(*at.weights.shape, -1)
            like = np.empty((0, *at.values.shape[2:]), at.values.dtype)
            loads.append(from_columns(space.load(at.cells, at.places, weighted), like))
        load = np.asarray(sum(loads))
        found = from_columns(space.solve(as_columns(load)), load)
        loose = np.flatnonzero(space.is_loose)
        if len(loose):
            at_nodes = self._function(space.nodes[loose])
            found[loose] = as_field(f"{self._name}(points)", at_nodes, len(loose))
        return found

    def _at_points(self, space: LagrangeSpace) -> Iterator[_FunctionAt]:
        """Return values of the function at points of quadrature, of some cells at a time."""
        mesh, shape = space.mesh, None
        rule = rule_of(mesh.cell_dim, space.degree + _OF_FUNCTIONS)
        for cells in some_cells(rule, np.arange(mesh.n_cells, dtype=np.int32)):
            places = np.broadcast_to(rule.places, (len(cells), *rule.places.shape))
            points = (places @ mesh.points[mesh.cells[cells]]).reshape(-1, mesh.dim)
            values = as_field(f"{self._name}(points)", self._function(points), len(points))
            values = values.astype(np.float64) if values.dtype.kind in "biu" else values
            shape = values.shape[1:] if shape is None else shape
            if values.shape[1:] != shape:
                raise ValueError(
                    f"{self._name}(points) must have one shape per point, got {shape} and "
                    f"{values.shape[1:]}"
                )
            weights = mesh.measures[cells][:, None] * rule.weights
            yield _FunctionAt(cells, places, weights, values.reshape(*places.shape[:2], *shape))

    def integral(
        self, made: ElementField | npt.NDArray[Any], mesh: SimplexMesh
    ) -> npt.NDArray[Any]:
        """Return the integral of a projection on a mesh."""
        values = made.values if isinstance(made, ElementField) else made
        return _integral(values, _space_of(self._field, mesh))

    def before(self, mesh: SimplexMesh) -> tuple[npt.NDArray[Any], float]:
        """Return the integral on the old mesh, and that of the absolute value."""
        points = [*self._at_points(_space_of(self._field, mesh))]
        totals = [np.tensordot(at.weights, at.values, axes=2) for at in points]
        sizes = [np.tensordot(at.weights, np.abs(at.values), axes=2) for at in points]
        return np.asarray(sum(totals)), float(np.max(sum(sizes), initial=0.0))


class _FunctionAt(NamedTuple):
    """Values of a function at points of quadrature in some cells."""

    cells: IntArray
    places: FloatArray
    weights: FloatArray
    """float64[p, q]"""
    values: npt.NDArray[Any]
    """[p, q, ...]"""


def _space_of(field: ElementField, mesh: SimplexMesh) -> LagrangeSpace:
    return LagrangeSpace(mesh, int(field.order), bool(field.continuous))


def _named(space: LagrangeSpace) -> str:
    """Return the short name of the elements."""
    return f"{'P' if space.continuous else 'DG'}{space.degree}"


def _integral(values: npt.ArrayLike, space: LagrangeSpace) -> npt.NDArray[Any]:
    """Return the integral of a function with values at the nodes."""
    array = np.asarray(values)
    flat = array.reshape(space.n, *array.shape[len(space.shape) :])
    return np.asarray(np.tensordot(space.integrals, flat, axes=1))
