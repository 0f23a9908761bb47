"""The fields that `adapt` and `transfer_fields` take: their checks, and the transfer of them all.

A field is an array with a row per node, or one of finite elements, whose kind has a file of its
own: `lagrange_fields.py`, `quadrature_fields.py`, `skfem_fields.py`, `dolfinx_fields.py`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from adaptsize._checks import as_plain_array, check_type, describe
from adaptsize.adaptation._fields import Arrays, as_field
from adaptsize.adaptation.dolfinx_fields import OfDolfinx, is_dolfinx_function
from adaptsize.adaptation.field_transfer import FieldTransfer
from adaptsize.adaptation.given_fields import ElementField, QuadratureField
from adaptsize.adaptation.lagrange import LagrangeSpace
from adaptsize.adaptation.lagrange_fields import OfElements, OfFunction
from adaptsize.adaptation.quadrature_fields import OfQuadrature
from adaptsize.adaptation.skfem_fields import OfSkfem
from adaptsize.adaptation.spaces import Checked, Made, Moving, projected
from adaptsize.background import AnyMesh, SimplexMesh


class CheckedFields(NamedTuple):
    """Checked fields with a row per node, and those of finite elements."""

    arrays: Arrays
    elements: dict[str, Checked]

    def on(self, transfer: FieldTransfer) -> dict[str, Any]:
        """Return those of finite elements on the new mesh."""
        found = {name: field.on(transfer) for name, field in self.elements.items()}
        moving = {name: own for name, own in found.items() if isinstance(own, Moving)}
        columns = projected(transfer, [own.task for own in moving.values()])
        moved = {
            name: own.made(part) for (name, own), part in zip(moving.items(), columns, strict=True)
        }
        return {
            name: own.field if isinstance(own, Made) else moved[name] for name, own in found.items()
        }

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
        fits = array.shape[:1] == (mesh.n_points,)
        if not fits and isinstance(mesh, SimplexMesh) and mesh.cell_dim == mesh.dim:
            raise ValueError(
                f"{name} must be an array with a row for each of the {mesh.n_points} nodes, an "
                "ElementField, a function of points, (basis, x) of scikit-fem, or a Function of "
                f"DOLFINx, got shape {array.shape}{orders_with(mesh, array.shape)}"
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
        return OfQuadrature(name, given, mesh)
    if is_basis:
        return OfSkfem(name, given, mesh)
    if is_dolfinx_function(given):
        return OfDolfinx(name, given, mesh)
    is_function = callable(given.values if isinstance(given, ElementField) else given)
    return OfFunction(name, given, mesh) if is_function else OfElements(name, given, mesh)


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
