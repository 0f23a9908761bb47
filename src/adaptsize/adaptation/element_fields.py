"""Fields of finite elements other than linear ones, and data at points of quadrature.

They are projected onto the same elements of another mesh, by quadrature that is exact over the
intersections of the cells.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    as_flag,
    as_plain_array,
    as_values,
    as_whole_number,
    check_type,
    describe,
    refuse_where,
)
from adaptsize.adaptation._fields import Arrays, as_columns, as_field, from_columns
from adaptsize.adaptation.field_transfer import FieldTransfer
from adaptsize.adaptation.lagrange import LagrangeSpace
from adaptsize.adaptation.pieces import rule_of, some_cells
from adaptsize.adaptation.skfem_fields import OfSkfem
from adaptsize.adaptation.spaces import Moving, ToProject, magnitude_of, projected
from adaptsize.background import AnyMesh, SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.typing import FloatArray, IntArray

#: Degree for which functions are integrated, beyond that of the elements.
_OF_FUNCTIONS = 6
#: Highest order of the polynomials that represent data at points of quadrature.
_MOST = 2


@dataclass(frozen=True, eq=False)
class ElementField:
    """A field of Lagrange elements of order 0 to 2, as `adapt` and `transfer_fields` take it.

    It is projected onto the same elements of the new mesh (L2), so that its integral is kept.

    Parameters
    ----------
    values : array_like or callable
        Values at the nodes of the elements, which `nodes` returns, of any trailing shape.
        Or a function of points, float64[n, dim], which is integrated on each mesh anew.
    order : int, default 1
        0 to 2.
    continuous : bool, default True
        Whether cells share nodes.  Elements of order 0 are discontinuous.
    log : bool, default False
        Transfer the logarithms of symmetric positive definite matrices, shape (..., d, d), so that
        they stay positive at the nodes.  The integral changes then.

    Examples
    --------
    >>> old = SimplexMesh([[0, 0], [2, 0], [0, 2]], [[0, 1, 2]])
    >>> new = SimplexMesh([[0, 0], [2, 0], [0, 2], [1, 1]], [[0, 1, 3], [0, 3, 2]])
    >>> x = ElementField.nodes(old, 2)
    >>> x[3:].tolist()
    [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
    >>> from adaptsize import transfer_fields
    >>> made = transfer_fields(old, new, fields={"u": ElementField(x[:, 0] ** 2, order=2)})
    >>> bool(np.allclose(made.fields["u"].values, ElementField.nodes(new, 2)[:, 0] ** 2))
    True
    """

    values: Any
    order: int = 1
    continuous: bool = True
    log: bool = False

    def __post_init__(self) -> None:
        as_whole_number("order", self.order, lower=0, upper=2)
        as_flag("continuous", self.continuous)
        if as_flag("log", self.log) and callable(self.values):
            raise ValueError("log must be False if values is a function")

    @staticmethod
    def nodes(mesh: SimplexMesh, order: int, *, continuous: bool = True) -> FloatArray:
        """Return the nodes of the elements of a mesh, in the order of ``values``.

        Parameters
        ----------
        mesh : SimplexMesh
        order : int
            0 to 2.
        continuous : bool, default True
            Whether cells share nodes.

        Returns
        -------
        ndarray of float64
            Of continuous elements shape (n, dim): the nodes of the mesh, for order 2 followed by
            the middles of ``mesh.edges``.  Of discontinuous ones shape (n_cells, k, dim): the
            corners of each cell, for order 2 followed by the middles of its edges (0, 1), (0, 2),
            ... (2, 3); for order 0 shape (n_cells, dim), the centroids.
        """
        mesh = as_mesh("mesh", mesh)
        order = as_whole_number("order", order, lower=0, upper=2)
        space = LagrangeSpace(mesh, order, as_flag("continuous", continuous))
        return space.nodes.reshape(*space.shape, mesh.dim)

    @staticmethod
    def at_points(
        values: npt.ArrayLike,
        points: npt.ArrayLike,
        weights: npt.ArrayLike,
        *,
        log: bool = False,
    ) -> QuadratureField:
        """Return data at points of quadrature in each cell as a field.

        In each cell they are represented by the polynomial of order 0 to 2 that fits them best,
        which is projected onto those of the new mesh and evaluated at its points (L2).  The
        integral by the rule is kept.

        Parameters
        ----------
        values : array_like of float, shape (n_cells, n, ...)
        points : array_like of float, shape (n, dim)
            The points in the simplex with a corner at the origin, which is the first node of a
            cell, and the others at distance 1 along the axes.
        weights : array_like of float, shape (n,)
            Positive.  Only their ratios count.
        log : bool, default False
            As for other elements.

        Returns
        -------
        QuadratureField
            With ``values``, ``points``, ``weights`` and ``log``.
        """
        places = as_values("points", points)
        if places.ndim != 2 or len(places) == 0:
            raise ValueError(f"points must have shape (n, dim), got {places.shape}")
        rule = as_values("weights", weights, (len(places),))
        refuse_where("weights", rule <= 0.0, rule, "must be positive")
        data = as_plain_array("values", values)
        if data.dtype.kind not in "biufc" or data.ndim < 2 or data.shape[1] != len(places):
            raise ValueError(
                f"values must be numbers of shape (n_cells, {len(places)}, ...), got "
                f"{describe(values)}"
            )
        kind = np.complex128 if data.dtype.kind == "c" else np.float64
        return QuadratureField(data.astype(kind), places, rule, as_flag("log", log))


@dataclass(frozen=True, eq=False)
class QuadratureField:
    """Data at points of quadrature in each cell, see `ElementField.at_points`."""

    values: Any
    points: Any
    weights: Any
    log: bool = False


class Checked(Protocol):
    """A checked field of finite elements on the old mesh."""

    how: str
    """How it is transferred."""
    kind: str
    """What it is, for messages."""

    def kept(self) -> Any:
        """Return the field on the old mesh, as the caller gave it."""

    def on(self, transfer: FieldTransfer) -> Moving:
        """Return what is to be projected, and a function for the field on the new mesh."""

    def integral(self, made: Any, mesh: SimplexMesh) -> npt.NDArray[Any]:
        """Return the integral of a field of this kind on a mesh."""

    def before(self, mesh: SimplexMesh) -> tuple[npt.NDArray[Any], float]:
        """Return the integral on the old mesh, and that of the absolute value.

        The latter is the largest of all components.
        """


class _OfElements:
    """A checked `ElementField`, or a function."""

    def __init__(self, name: str, given: Any, mesh: SimplexMesh) -> None:
        self._given, self._mesh = given, mesh
        field = given if isinstance(given, ElementField) else ElementField(given)
        self.order, self.log = int(field.order), bool(field.log)
        self.continuous = bool(field.continuous) and self.order > 0
        space = self._space(mesh)
        self.how = f"projected ({'P' if self.continuous else 'DG'}{self.order})"
        self.kind = "a function" if callable(field.values) else "a field of finite elements"
        if callable(field.values):
            self._function: Callable[[FloatArray], npt.ArrayLike] | None = field.values
            self._name = name
            return
        self._function = None
        array = as_field(name, field.values, space.shape[0])
        k = len(space.shape)
        if array.shape[:k] != space.shape:
            raise ValueError(
                f"{name} must have shape {(*space.shape, '...')}, the nodes of elements of order "
                f"{self.order}, got {array.shape}"
            )
        floats = array.astype(np.float64) if array.dtype.kind in "biu" else array
        self.values = _logarithms(name, floats) if self.log else floats

    def _space(self, mesh: SimplexMesh) -> LagrangeSpace:
        return LagrangeSpace(mesh, self.order, self.continuous)

    def kept(self) -> Any:
        """Return the given field, of a function its projection."""
        if self._function is None:
            return self._given
        space = self._space(self._mesh)
        return self._made(self._of_function(space, self._function), space)

    def on(self, transfer: FieldTransfer) -> Moving:
        """Return what is to be projected, and a function for the field on the new mesh."""
        new = self._space(transfer.new)
        if self._function is not None:
            function = self._function
            return Moving(None, lambda _: self._made(self._of_function(new, function), new))
        old = self._space(transfer.old)
        flat = self.values.reshape(old.n, *self.values.shape[len(old.shape) :])
        columns = as_columns(flat)

        def made(found: FloatArray | None) -> Any:
            assert found is not None
            loose = np.flatnonzero(new.is_loose)
            if len(loose):
                cells, places, _ = transfer.old.locator.nearest(new.nodes[loose])
                found[loose] = old.values(columns, cells, places[:, None])[:, 0]
            own = from_columns(found, flat)
            return self._made(_exponentials(own) if self.log else own, new)

        return Moving(ToProject(old, new, columns), made)

    def _made(self, found: npt.NDArray[Any], new: LagrangeSpace) -> Any:
        values = found.reshape(*new.shape, *found.shape[1:])
        is_field = isinstance(self._given, ElementField)
        return replace(self._given, values=values) if is_field else values

    def _of_function(
        self, space: LagrangeSpace, function: Callable[[FloatArray], npt.ArrayLike]
    ) -> npt.NDArray[Any]:
        load: Any = 0.0
        for at in self._at_points(space, function):
            weighted = as_columns(at.values.reshape(at.weights.size, -1))
            weighted = (at.weights.reshape(-1, 1) * weighted).reshape(*at.weights.shape, -1)
            own = space.load(at.cells, at.places, weighted)
            like = np.empty((0, *at.values.shape[2:]), at.values.dtype)
            load = load + from_columns(own, like)
        found = from_columns(space.solve(as_columns(load)), load)
        loose = np.flatnonzero(space.is_loose)
        if len(loose):
            at_nodes = function(space.nodes[loose])
            found[loose] = as_field(f"{self._name}(points)", at_nodes, len(loose))
        return found

    def _at_points(
        self, space: LagrangeSpace, function: Callable[[FloatArray], npt.ArrayLike]
    ) -> Iterator[_FunctionAt]:
        """Return values of a function at points of quadrature, of some cells at a time."""
        mesh, shape = space.mesh, None
        rule = rule_of(mesh.cell_dim, space.degree + _OF_FUNCTIONS)
        for cells in some_cells(rule, np.arange(mesh.n_cells, dtype=np.int32)):
            places = np.broadcast_to(rule.places, (len(cells), *rule.places.shape))
            points = (places @ mesh.points[mesh.cells[cells]]).reshape(-1, mesh.dim)
            values = as_field(f"{self._name}(points)", function(points), len(points))
            values = values.astype(np.float64) if values.dtype.kind in "biu" else values
            shape = values.shape[1:] if shape is None else shape
            if values.shape[1:] != shape:
                raise ValueError(
                    f"{self._name}(points) must have one shape per point, got {shape} and "
                    f"{values.shape[1:]}"
                )
            weights = mesh.measures[cells][:, None] * rule.weights
            yield _FunctionAt(cells, places, weights, values.reshape(*places.shape[:2], *shape))

    def integral(self, made: Any, mesh: SimplexMesh) -> npt.NDArray[Any]:
        """Return the integral of a field on a mesh."""
        values = np.asarray(made.values if isinstance(made, ElementField) else made)
        space = self._space(mesh)
        flat = values.reshape(space.n, *values.shape[len(space.shape) :])
        return np.asarray(np.tensordot(space.integrals, flat, axes=1))

    def before(self, mesh: SimplexMesh) -> tuple[npt.NDArray[Any], float]:
        """Return the integral on the old mesh, and that of the absolute value."""
        space = self._space(mesh)
        if self._function is None:
            largest = magnitude_of(space, self.values.reshape(space.n, -1), mesh)
            return self.integral(self._given, mesh), largest
        total: Any = 0.0
        size: Any = 0.0
        for at in self._at_points(space, self._function):
            total = total + np.tensordot(at.weights, at.values, axes=2)
            size = size + np.tensordot(at.weights, np.abs(at.values), axes=2)
        return np.asarray(total), float(np.max(size, initial=0.0))


class _FunctionAt(NamedTuple):
    """Values of a function at points of quadrature in some cells."""

    cells: IntArray
    places: FloatArray
    weights: FloatArray
    """float64[p, q]"""
    values: npt.NDArray[Any]
    """[p, q, ...]"""


class _OfQuadrature:
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
        self.values = _logarithms(name, floats) if self.log else floats
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

    def kept(self) -> Any:
        """Return the given field."""
        return self._given

    def on(self, transfer: FieldTransfer) -> Moving:
        """Return what is to be projected, and a function for the field on the new mesh."""
        old, new = (LagrangeSpace(m, self.order, False) for m in (transfer.old, transfer.new))
        values = self.values
        columns = as_columns(values.reshape(-1, *values.shape[2:]))
        columns = columns.reshape(*values.shape[:2], -1)
        held = (self.fit @ columns).reshape(old.n, columns.shape[2])

        def made(found: FloatArray | None) -> Any:
            assert found is not None
            found = found.reshape(transfer.new.n_cells, -1, held.shape[1])
            at_points = (new.functions(self.places) @ found).reshape(-1, held.shape[1])
            like = np.empty((len(at_points), *values.shape[2:]), values.dtype)
            own = from_columns(at_points, like)
            own = own.reshape(transfer.new.n_cells, *values.shape[1:])
            return replace(self._given, values=_exponentials(own) if self.log else own)

        return Moving(ToProject(old, new, held), made)

    def integral(self, made: Any, mesh: SimplexMesh) -> npt.NDArray[Any]:
        """Return the integral of a field on a mesh, by its rule."""
        means = np.tensordot(self.weights, np.asarray(made.values), axes=(0, 1))
        return np.asarray(np.tensordot(mesh.measures, means, axes=1))

    def before(self, mesh: SimplexMesh) -> tuple[npt.NDArray[Any], float]:
        """Return the integral on the old mesh, and that of the absolute value."""
        size = replace(self._given, values=np.abs(np.asarray(self._given.values)))
        largest = float(self.integral(size, mesh).max(initial=0.0))
        return self.integral(self._given, mesh), largest


def _logarithms(name: str, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
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


def _exponentials(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the exponentials of symmetric matrices."""
    values = 0.5 * (values + np.swapaxes(values, -1, -2))
    eigenvalues, vectors = np.linalg.eigh(values)
    made = (vectors * np.exp(eigenvalues)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return np.asarray(0.5 * (made + np.swapaxes(made, -1, -2)))


class CheckedFields(NamedTuple):
    """Checked fields with a row per node, and those of finite elements."""

    arrays: Arrays
    elements: dict[str, Checked]

    def on(self, transfer: FieldTransfer) -> dict[str, Any]:
        """Return those of finite elements on the new mesh."""
        moving = {name: field.on(transfer) for name, field in self.elements.items()}
        tasks = {name: own.task for name, own in moving.items() if own.task is not None}
        found = dict(zip(tasks, projected(transfer, list(tasks.values())), strict=True))
        return {name: own.made(found.get(name)) for name, own in moving.items()}

    def kept(self, names: Iterable[str]) -> dict[str, Any]:
        """Return the fields on the old mesh, in the order of their names."""
        of_elements = {name: field.kept() for name, field in self.elements.items()}
        return {name: (self.arrays | of_elements)[name] for name in names}


def as_nodal_fields(fields: Mapping[str, Any] | None, mesh: AnyMesh) -> CheckedFields:
    """Return the checked ``fields`` of `adapt` and `transfer_fields`.

    Raises
    ------
    ValueError
        If a field is none of those that are taken, which the message names.
    """
    given = {} if fields is None else fields
    check_type("fields", given, Mapping)
    found = CheckedFields({}, {})
    for key, value in given.items():
        name = f"fields[{key!r}]"
        element = as_element_field(name, value, mesh)
        if element is not None:
            found.elements[key] = element
            continue
        array = as_plain_array(name, value)
        is_filled = isinstance(mesh, SimplexMesh) and mesh.cell_dim == mesh.dim
        if array.shape[:1] != (mesh.n_points,) and is_filled:
            assert isinstance(mesh, SimplexMesh)
            raise ValueError(
                f"{name} must be an array with a row for each of the {mesh.n_points} nodes, an "
                "ElementField, a function of points, or (basis, x) of "
                f"scikit-fem, got shape {array.shape}{orders_with(mesh, array.shape)}"
            )
        found.arrays[key] = as_field(name, value, mesh.n_points)
    return found


def methods_of_arrays(method: Any, fields: CheckedFields) -> Any:
    """Return the method without those of fields of finite elements, which are projected."""
    for name in fields.elements:
        own = method.get(name) if isinstance(method, Mapping) else method
        if not (own is None or (isinstance(own, str) and own == "project")):
            raise ValueError(
                f'method must be "project" or None for fields[{name!r}], '
                f"{fields.elements[name].kind}, which is always projected, got {describe(own)}; "
                "methods of other fields may be given by name"
            )
    if isinstance(method, Mapping):
        return {name: own for name, own in method.items() if name not in fields.elements}
    return method


def as_element_field(name: str, given: Any, mesh: AnyMesh) -> Checked | None:
    """Return a checked field of finite elements; None if it is to be an array."""
    is_basis = isinstance(given, tuple) and len(given) == 2 and hasattr(given[0], "element_dofs")
    if not (is_basis or isinstance(given, ElementField | QuadratureField) or callable(given)):
        return None
    if not isinstance(mesh, SimplexMesh) or mesh.cell_dim != mesh.dim:
        kind = "meshes in parts"
        if isinstance(mesh, SimplexMesh):
            kind = "triangles in space: two triangulations of a curved surface do not overlap"
        raise ValueError(
            f"{name} must be an array with a row per node for {kind}; got {describe(given)}"
        )
    if isinstance(given, QuadratureField):
        return _OfQuadrature(name, given, mesh)
    if is_basis:
        return OfSkfem(name, given, mesh)
    return _OfElements(name, given, mesh)


def orders_with(mesh: SimplexMesh, shape: tuple[int, ...]) -> str:
    """Return a hint at the elements of which an array of a shape has the values, for messages."""
    fits = []
    for order, shared in ((1, False), (2, True), (2, False)):
        space = LagrangeSpace(mesh, order, shared)
        end = f", order={order}" + ("" if shared else ", continuous=False") + ")"
        if shape[: len(space.shape)] == space.shape:
            fits.append(f"ElementField(values{end}")
        elif shape[:1] == (space.n,):
            fits.append(f"ElementField(values.reshape({(*space.shape, *shape[1:])}){end}")
    return f"; as values at nodes of elements: {' or '.join(fits)}" if fits else ""
