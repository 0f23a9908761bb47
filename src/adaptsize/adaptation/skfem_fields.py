"""Functions of scikit-fem, ``(basis, x)``, of any element on simplices, and data at its points."""

from __future__ import annotations

from collections.abc import Hashable
from copy import copy
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import describe
from adaptsize.adaptation._fields import as_columns, as_field, from_columns
from adaptsize.adaptation.field_transfer import FieldTransfer
from adaptsize.adaptation.spaces import Made, Moving, ToProject, magnitude_of
from adaptsize.background import SimplexMesh
from adaptsize.typing import FloatArray, IntArray

#: Deviation of the nodes of two meshes, over their size, that is rounding.
_ROUNDING = 1e-12


class SkfemSpace:
    """The space of a basis of scikit-fem on a mesh."""

    def __init__(self, name: str, basis: Any, mesh: SimplexMesh) -> None:
        self._order = _order_of_corners(name, basis, mesh)
        self.basis, self.mesh, self.elem = basis, mesh, fresh(basis.elem)
        self.n, self.degree = int(basis.N), int(basis.elem.maxdeg)

    @property
    def key(self) -> Hashable:
        """Equal for equal spaces on a mesh: only for the same basis."""
        return id(self)

    def _functions(self, cells: IntArray, places: FloatArray) -> list[FloatArray]:
        """Return the values of each function of a cell, float64[..., p, q]."""
        basis = self.basis
        places = np.take_along_axis(places, self._order[cells][:, None], axis=2)
        at = np.moveaxis(places[..., 1:], 2, 0)
        found = []
        for i in range(basis.Nbfun):
            fields = self.elem.gbasis(basis.mapping, at, i, tind=cells)
            found.append(np.asarray(fields[0]))
        return found

    def values(self, held: npt.NDArray[Any], cells: IntArray, places: FloatArray) -> FloatArray:
        """Return the values of a function, float64[p, q, c], its components and columns last."""
        terms = (
            np.moveaxis(function.reshape(-1, *function.shape[-2:]), 0, 2)[..., None]
            * held[self.basis.element_dofs[i, cells]][:, None, None, :]
            for i, function in enumerate(self._functions(cells, places))
        )
        return np.asarray(sum(terms)).reshape(*places.shape[:2], -1)

    def load(self, cells: IntArray, places: FloatArray, values: FloatArray) -> FloatArray:
        """Return the sums of values times the functions of the space, float64[n, columns]."""
        functions = self._functions(cells, places)
        n_parts = int(np.prod(functions[0].shape[:-2]))
        split = values.reshape(*values.shape[:2], n_parts, -1)
        load = np.zeros((self.n, split.shape[3]))
        for i, function in enumerate(functions):
            parts = function.reshape(-1, *function.shape[-2:])
            sums = np.einsum("apq,pqac->pc", parts, split)
            np.add.at(load, self.basis.element_dofs[i, cells], sums)
        return load

    def solve(self, load: FloatArray) -> FloatArray:
        """Return the coefficients of the functions whose products with the space are ``load``."""
        import skfem
        from scipy.sparse.linalg import splu

        def product(u: Any, v: Any, _: Any) -> Any:
            products = np.asarray(u) * np.asarray(v)
            return products.sum(axis=tuple(range(products.ndim - 2)))

        basis = skfem.Basis(self.basis.mesh, self.elem, intorder=2 * self.degree)
        return np.asarray(splu(skfem.BilinearForm(product).assemble(basis).tocsc()).solve(load))

    def integral(self, x: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the integral of a function, of each of its components."""
        import skfem

        basis = skfem.Basis(self.basis.mesh, self.elem, intorder=self.degree)
        found = np.asarray(basis.interpolate(x))
        return np.asarray((found * basis.dx).sum(axis=(-1, -2)))


def fresh(element: Any) -> Any:
    """Return a copy of an element that has not been on a mesh.

    Those that scikit-fem defines by global functions (Morley, Argyris) keep those of the mesh on
    which they were first evaluated.
    """
    from skfem.element import Element, ElementGlobal

    own = copy(element)
    for name, part in vars(own).items():  # of vectors and of discontinuous elements
        if isinstance(part, Element):
            setattr(own, name, fresh(part))
    if isinstance(own, ElementGlobal):
        own.V = None
    return own


def _order_of_corners(name: str, basis: Any, mesh: SimplexMesh) -> IntArray:
    """Return the places in the cells of a mesh of the corners in those of a basis."""
    corners, points = np.asarray(basis.mesh.t).T, np.asarray(basis.mesh.p).T
    if not basis.mesh.affine:
        raise ValueError(
            f"the basis of {name} must be on straight cells, such as those of mesh.to_skfem(), "
            f"got one on a {type(basis.mesh).__name__}"
        )
    same = corners.shape == mesh.cells.shape and basis.tind is None
    if same:
        equal = corners[:, :, None] == mesh.cells[:, None, :]
        same = bool(equal.any(axis=2).all())
    if same:
        away = np.abs(points[corners] - mesh.points[corners]).max(initial=0.0)
        same = bool(away <= _ROUNDING * np.abs(mesh.points).max())
    if not same:
        raise ValueError(
            f"the basis of {name} must be on all cells of the mesh, got {describe(basis)}"
        )
    return np.asarray(equal.argmax(axis=2).astype(np.int32))


class OfSkfem:
    """A checked function of scikit-fem."""

    kind = "a function of scikit-fem"

    def __init__(self, name: str, given: tuple[Any, Any], mesh: SimplexMesh) -> None:
        self._given, (basis, x) = given, given
        self._name = name
        self.values = as_field(f"{name}[1]", x, int(basis.N))
        if self.values.ndim != 1:
            raise ValueError(f"{name}[1] must have shape ({basis.N},), got {self.values.shape}")
        self._space = SkfemSpace(name, basis, mesh)
        cells, middle = np.zeros(1, np.int32), np.full((mesh.dim, 1, 1), 1.0 / (mesh.dim + 1))
        fields = self._space.elem.gbasis(basis.mapping, middle, 0, tind=cells)
        if len(fields) != 1:
            raise ValueError(
                f"{name} must be of one element, not of a composite one: pass a basis and x for "
                f"each part (basis.split), got {type(basis.elem).__name__}"
            )
        self.how = f"projected ({type(basis.elem).__name__})"

    def kept(self) -> Any:
        """Return the given basis and function."""
        return self._given

    def on(self, transfer: FieldTransfer) -> Moving | Made:
        """Return what is to be projected, and a function for a basis and coefficients."""
        import skfem

        old, loose = self._space.basis, int(np.count_nonzero(~transfer.new.in_a_cell))
        if loose:
            raise ValueError(
                f"{self._name} must be an array or an ElementField for a mesh with nodes in no "
                f"cell, which a basis of scikit-fem cannot be on, got {loose} of them"
            )
        basis = skfem.Basis(transfer.new.to_skfem(), fresh(old.elem), quadrature=(old.X, old.W))
        new, x = SkfemSpace(self._name, basis, transfer.new), self.values
        columns = as_columns(x[:, None])

        def made(found: FloatArray) -> tuple[Any, npt.NDArray[Any]]:
            return basis, from_columns(found, x)

        return Moving(ToProject(self._space, new, columns), made)

    def integral(self, made: Any, mesh: SimplexMesh) -> npt.NDArray[Any]:
        """Return the integral of a function of this element on a mesh."""
        basis, x = made
        return SkfemSpace(self._name, basis, mesh).integral(np.asarray(x))

    def before(self, mesh: SimplexMesh) -> tuple[npt.NDArray[Any], float]:
        """Return the integral on the old mesh, and that of the absolute value."""
        size = magnitude_of(self._space, self.values[:, None], mesh)
        return self.integral(self._given, mesh), size
