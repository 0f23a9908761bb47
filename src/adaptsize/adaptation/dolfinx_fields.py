"""Functions of DOLFINx, ``dolfinx.fem.Function``, of Lagrange elements of order 0 to 2."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import describe
from adaptsize._dolfinx import nodes_of_cells
from adaptsize.adaptation.field_transfer import FieldTransfer
from adaptsize.adaptation.given_fields import ElementField
from adaptsize.adaptation.lagrange import LagrangeSpace
from adaptsize.adaptation.lagrange_fields import OfElements
from adaptsize.adaptation.spaces import Made, Moving
from adaptsize.background import SimplexMesh
from adaptsize.typing import FloatArray, IndexArray, IntArray

#: Deviation of the nodes of two meshes, over the diagonal, that is rounding.
_ROUNDING = 1e-12


def is_dolfinx_function(given: object) -> bool:
    """Return whether something is a ``dolfinx.fem.Function``."""
    return type(given).__module__.startswith("dolfinx.fem") and hasattr(given, "function_space")


class OfDolfinx:
    """A checked function of DOLFINx; its values are those of an `ElementField`.

    Raises
    ------
    ValueError
        If it is of another element, on several ranks, on a mesh with other cells, or not finite.
    """

    kind = "a function of DOLFINx"

    def __init__(self, name: str, given: Any, mesh: SimplexMesh) -> None:
        self._given, space = given, given.function_space
        self._order, self._continuous = _element_of(name, space)
        own = LagrangeSpace(mesh, self._order, self._continuous)
        coefficients = np.asarray(given.x.array).reshape(-1, space.dofmap.bs)
        values = np.zeros((own.n, coefficients.shape[1]), coefficients.dtype)
        dofs = np.asarray(space.dofmap.list)
        values[_rows_of_dofs(name, space, own)] = coefficients[dofs]
        shape = tuple(int(n) for n in space.value_shape)
        held = values.reshape(*own.shape, *shape)
        self._of_elements = OfElements(name, self._field(held), mesh)
        self.how = self._of_elements.how

    def _field(self, values: npt.NDArray[Any]) -> ElementField:
        return ElementField(values, order=self._order, continuous=self._continuous)

    def kept(self) -> Any:
        """Return the given function."""
        return self._given

    def on(self, transfer: FieldTransfer) -> Moving | Made:
        """Return what is to be projected; made is a function on ``new.to_dolfinx().mesh``."""
        own = self._of_elements.on(transfer)
        if isinstance(own, Made):
            return Made(self._function(own.field, transfer.new))
        as_field = own.made
        return own._replace(made=lambda found: self._function(as_field(found), transfer.new))

    def _function(self, field: ElementField, mesh: SimplexMesh) -> Any:
        """Return a field as a function of the given element on a mesh of DOLFINx."""
        import dolfinx

        old = self._given.function_space
        space = dolfinx.fem.functionspace(mesh.to_dolfinx().mesh, old.ufl_element())
        new = dolfinx.fem.Function(space, dtype=self._given.x.array.dtype)
        new.name = self._given.name
        own = LagrangeSpace(mesh, self._order, self._continuous)
        values = np.asarray(field.values).reshape(own.n, -1)
        coefficients = new.x.array.reshape(-1, space.dofmap.bs)  # a view
        rows = _rows_of_dofs("the new field", space, own)
        coefficients[np.asarray(space.dofmap.list)] = values[rows]
        return new

    def integral(self, made: Any, mesh: SimplexMesh) -> npt.NDArray[Any]:
        """Return the integral of a function of this kind on a mesh."""
        if made is self._given:
            return self._of_elements.before(mesh)[0]
        return OfDolfinx("field", made, mesh).before(mesh)[0]

    def before(self, mesh: SimplexMesh) -> tuple[npt.NDArray[Any], float]:
        """Return the integral on the old mesh, and that of the absolute value."""
        return self._of_elements.before(mesh)


def _element_of(name: str, space: Any) -> tuple[int, bool]:
    """Return the order of a Lagrange element and whether it is continuous; refuse others."""
    element = space.ufl_element()
    family = getattr(element, "family_name", None)
    order = int(getattr(element, "degree", -1)) if family == "P" else -1
    if space.mesh.comm.size > 1:
        raise ValueError(f"{name} must be an array with a row per node for meshes in parts")
    if order not in (0, 1, 2):
        raise ValueError(
            f"{name} must be a function of Lagrange elements of order 0 to 2, continuous or not "
            f"(interpolate others first), got {describe(element)}"
        )
    return order, order > 0 and not element.discontinuous


def _rows_of_dofs(name: str, space: Any, own: LagrangeSpace) -> IndexArray:
    """Return the node of an own space for each degree of freedom of a cell, int[n_cells, k]."""
    cells, places = _cells_among(name, space.mesh, own.mesh)
    points = space.element.interpolation_points  # a method before DOLFINx 0.10
    points = np.asarray(points() if callable(points) else points)
    at = np.column_stack([1.0 - points.sum(axis=1), points])
    width, largest = at.shape[1], at.max(axis=1)
    # At centroids, corners, and the middles of edges.
    expected = {0: [1.0 / width], 1: [1.0], 2: [1.0, 0.5]}[own.degree]
    if not np.isclose(largest[:, None], expected).any(axis=1).all():
        raise ValueError(f"{name} must have its values at nodes, got {describe(space)}")
    if own.degree == 0:
        return np.asarray(own.dofs[cells], np.intp)
    pairs = np.zeros((width, width), np.int64)
    first, second = np.triu_indices(width, 1)
    pairs[first, second] = pairs[second, first] = width + np.arange(len(first))
    pairs[np.arange(width), np.arange(width)] = np.arange(width)
    # The corner of a node twice, or both ends of its edge.
    ends = np.argsort(-at, axis=1, kind="stable")[:, :2]
    is_corner = np.isclose(largest, 1.0)
    ends[is_corner, 1] = ends[is_corner, 0]
    local = pairs[places[:, ends[:, 0]], places[:, ends[:, 1]]]
    return np.asarray(own.dofs[cells[:, None], local], np.intp)


def _cells_among(name: str, domain: Any, mesh: SimplexMesh) -> tuple[IndexArray, IntArray]:
    """Return the own number of each cell of DOLFINx, and the own places of its corners."""
    rows = np.asarray(nodes_of_cells(domain.geometry))
    points = np.asarray(domain.geometry.x)[:, : mesh.dim]
    fits = rows.shape == mesh.cells.shape
    if fits:
        nodes = _nodes_among(points, np.unique(rows), mesh)[rows]
        order = np.lexsort(np.sort(nodes, axis=1).T)
        of_mesh = np.lexsort(np.sort(mesh.cells, axis=1).T)
        fits = np.array_equal(np.sort(nodes, axis=1)[order], np.sort(mesh.cells, axis=1)[of_mesh])
    if not fits:
        raise ValueError(
            f"the mesh of {name} must have the cells of mesh, got {len(rows)} cells with "
            f"{rows.shape[1]} nodes for {mesh!r}"
        )
    cells = np.empty(len(rows), np.intp)
    cells[order] = of_mesh
    equal = nodes[:, :, None] == mesh.cells[cells][:, None, :]
    return cells, equal.argmax(axis=2).astype(np.int32)


def _nodes_among(points: FloatArray, used: IndexArray, mesh: SimplexMesh) -> IndexArray:
    """Return the own node at the place of each node of DOLFINx, -1 if there is none.

    Nodes in the same order are the same; otherwise, of several at a place, any.
    """
    from scipy.spatial import cKDTree  # slow to import

    found = np.full(len(points), -1)
    limit, own = _ROUNDING * mesh.diagonal, np.flatnonzero(mesh.in_a_cell)
    if len(used) == len(own) and np.abs(points[used] - mesh.points[own]).max() <= limit:
        found[used] = own
        return found
    away, nearest = cKDTree(mesh.points[own]).query(points[used])
    found[used] = np.where(away <= limit, own[nearest], -1)
    return found
