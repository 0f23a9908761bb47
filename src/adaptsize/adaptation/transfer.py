"""Transfer of fields between two meshes of the same domain, whole or in parts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from adaptsize._defaults import is_of_sizes
from adaptsize.adaptation._fields import (
    Arrays,
    as_columns,
    as_fields,
    from_columns,
    methods_of,
)
from adaptsize.adaptation.between_meshes import BetweenMeshes, refuse_surfaces
from adaptsize.adaptation.element_fields import (
    CheckedFields,
    as_nodal_fields,
    methods_of_arrays,
)
from adaptsize.adaptation.field_transfer import FieldTransfer, check_kinds, refusal_of_kinds
from adaptsize.background import AnyMesh, PartitionedMesh, SimplexMesh
from adaptsize.background.bisection import Resolved
from adaptsize.background.migration import joined_pieces, send_cells
from adaptsize.background.requests import (
    boxes_around,
    boxes_of_pieces,
    ranks_that_meet,
)
from adaptsize.background.simplex import as_mesh
from adaptsize.options import TransferOptions, checked, with_options
from adaptsize.typing import FloatArray, NodalMethod, ProgressCallback, Unpack


class TransferredFields(NamedTuple):
    """Result of `transfer_fields`."""

    fields: dict[str, Any]
    """Nodal fields on the new mesh, and those of finite elements, of the kinds that were given."""
    cell_fields: dict[str, npt.NDArray[Any]]
    """Cell fields on the new mesh."""


@with_options(TransferOptions)
def transfer_fields(
    old: AnyMesh,
    new: AnyMesh,
    *,
    fields: Mapping[str, Any] | None = None,
    cell_fields: Mapping[str, npt.ArrayLike] | None = None,
    progress: ProgressCallback | bool | None = None,
    **options: Unpack[TransferOptions],
) -> TransferredFields:
    """Transfer nodal and cell fields from one mesh to another: `FieldTransfer` in one call.

    Parameters
    ----------
    old, new : SimplexMesh or PartitionedMesh
        Of the same kind.  Meshes in parts are on the same communicator; their parts need not match.
    fields : mapping of str, optional
        Fields on ``old``: arrays with one row per node, an `ElementField`, a function of points,
        ``(basis, x)`` of scikit-fem, or a ``dolfinx.fem.Function`` of Lagrange elements.
    cell_fields : mapping of str to array_like, optional
        One row per cell.
    progress : callable, bool or None
        Called with a text and the fraction completed; True shows a bar.
    **options

    Returns
    -------
    TransferredFields
        ``fields`` and ``cell_fields``, dictionaries with the same names.

    Raises
    ------
    ValueError
        If a field does not have one row per node or cell, or is not finite (checked first).

    Notes
    -----
    Between meshes in parts, the values are those for the whole meshes, to rounding.  Old cells go
    with their fields to the ranks with new cells near them.  ``keep_integral`` is not available.

    Examples
    --------
    >>> old = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> new = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 3], [1, 2, 3]])
    >>> made = transfer_fields(old, new, cell_fields={"heat": [1.0, 3.0]})
    >>> made.cell_fields["heat"]
    array([2., 2.])
    """
    old, new = as_mesh("old", old, PartitionedMesh), as_mesh("new", new, PartitionedMesh)
    check_kinds(old, new)

    def check() -> tuple[TransferOptions, CheckedFields, Arrays]:
        given = checked(TransferOptions, options)
        if given["keep_integral"] and isinstance(old, PartitionedMesh):
            raise ValueError("keep_integral must be False for meshes in parts, got True")
        by_cell = as_fields("cell_fields", cell_fields, old.n_cells)
        nodal = as_nodal_fields(fields, old)
        given["method"] = methods_of_arrays(given["method"], nodal)
        methods_of(given["method"], nodal.arrays, old)
        return given, nodal, by_cell

    given, nodal, by_cell = old.ranks.agree(check)
    made = transferred(old, new, nodal, by_cell, given, progress)
    return made._replace(fields={name: made.fields[name] for name in fields or {}})


class Carried(NamedTuple):
    """A new mesh with the fields of the old one, and why others are left out."""

    mesh: SimplexMesh
    left_out: list[str]
    """Messages."""


def carry_fields(
    old: SimplexMesh, new: SimplexMesh, progress: ProgressCallback | bool | None = None
) -> Carried:
    """Return a new mesh with the fields of an old one, as far as `transfer_fields` applies.

    Sizes, which belong to the old mesh, are left out without a message.
    """
    nodal, by_cell = (
        {name: values for name, values in data.items() if not is_of_sizes(name)}
        for data in (old.point_data, old.cell_data)
    )
    names = [*nodal, *by_cell]
    if names and new.cell_dim != old.cell_dim:
        text = f"fields of a surface are not known inside, and are left out: {', '.join(names)}"
        return Carried(new, [text])
    left_out = []
    for fields in (nodal, by_cell):
        for name, values in list(fields.items()):
            bad = int(np.count_nonzero(~np.isfinite(values)))
            if bad:
                left_out.append(f"field {name!r} is left out: {bad} of its values are not finite")
                del fields[name]
    if not (nodal or by_cell):
        return Carried(new, left_out)
    found = transfer_fields(
        old, new, fields=nodal, cell_fields=by_cell, conservative=old.cell_dim == old.dim,
        progress=progress,
    )  # fmt: skip
    mesh = new.with_data(point_data=found.fields, cell_data=found.cell_fields)
    return Carried(mesh, left_out)


def transferred(
    old: AnyMesh,
    new: AnyMesh,
    fields: CheckedFields,
    by_cell: Arrays,
    given: Mapping[str, Any],
    progress: ProgressCallback | bool | None,
    divided: Resolved | None = None,
) -> TransferredFields:
    """Return checked fields on the new mesh; ``given`` has the options of `transfer_fields`.

    ``divided`` says how the cells of the old mesh were bisected, if they were.  What is linear or
    constant in them stays the same function then, whatever the method.
    """
    nodal, method = fields.arrays, methods_of(given["method"], fields.arrays, old)
    conservative, keep_integral = given["conservative"], given["keep_integral"]
    if by_cell and conservative and divided is None:
        refuse_surfaces(old)
    if isinstance(old, PartitionedMesh) and isinstance(new, PartitionedMesh):
        return _transferred_in_parts(old, new, nodal, by_cell, method, conservative)
    if not (isinstance(old, SimplexMesh) and isinstance(new, SimplexMesh)):
        raise refusal_of_kinds(old, new)
    transfer = FieldTransfer(old, new, progress=progress)
    if divided is not None:
        return TransferredFields(
            {name: divided.extended(values) for name, values in nodal.items()}
            | fields.on(transfer),
            {name: values[divided.parents] for name, values in by_cell.items()},
        )
    found = {name: transfer.nodal(values, method=method[name]) for name, values in nodal.items()}
    cells = {
        name: transfer.cells(values, conservative=conservative, keep_integral=keep_integral)
        for name, values in by_cell.items()
    }
    return TransferredFields(found | fields.on(transfer), cells)


def _transferred_in_parts(
    old: PartitionedMesh,
    new: PartitionedMesh,
    nodal: Arrays,
    by_cell: Arrays,
    method: dict[str, NodalMethod],
    conservative: bool,
) -> TransferredFields:
    """Return fields on another mesh in parts; collective."""
    kinds = [
        [(name, array.dtype.kind, array.shape[1:]) for name, array in fields.items()]
        for fields in (nodal, by_cell)
    ]
    old.ranks.require_equal(
        fields=kinds[0], cell_fields=kinds[1], method=method, conservative=conservative
    )
    reach, slack = np.zeros(old.ranks.size), 1e-9 * old.diagonal
    while True:
        near = _cells_near(old, new, (list(nodal.values()), list(by_cell.values())), reach + slack)
        transfer = _ToPart(near, new, 1, None)
        away = transfer.farthest(nodal=bool(nodal), by_cell=bool(by_cell))
        farthest = np.array(old.ranks.allgather(away))
        if (farthest <= reach + slack).all():
            break
        reach = farthest  # some nodes are outside: the nearest old cells are no farther
    made: Arrays = {}
    of_method: dict[NodalMethod, Arrays] = {name: {} for name in get_args(NodalMethod)}
    for k, (name, values) in enumerate(nodal.items()):
        field = near.point_data[str(k)]
        if values.dtype.kind in "biu":
            made[name] = transfer.interpolated(field)
        else:
            of_method[method[name]][name] = field
    for kind, fields in of_method.items():
        if fields:  # all are sent together
            columns = [as_columns(values) for values in fields.values()]
            found = transfer.at_nodes(np.hstack(columns), kind)
            ends = np.cumsum([part.shape[1] for part in columns])[:-1]
            for (name, values), part in zip(fields.items(), np.split(found, ends, 1), strict=True):
                made[name] = from_columns(part, values)
    cells = {
        name: transfer.in_cells(near.cell_data[str(k)], conservative=conservative)
        for k, name in enumerate(by_cell)
    }
    return TransferredFields({name: made[name] for name in nodal}, cells)


class _ToPart(BetweenMeshes[PartitionedMesh]):
    """Values of the old cells near the part of this rank, on it; collective."""

    def farthest(self, *, nodal: bool, by_cell: bool) -> float:
        """Return the largest distance of a node, or centroid of a cell, from the old cells."""
        at_nodes = float(self.located[2].max(initial=0.0)) if nodal else 0.0
        return max(at_nodes, float(self.holders[2].max(initial=0.0))) if by_cell else at_nodes

    def interpolated(self, field: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the values that the owners of the nodes find."""
        made = super().interpolated(field)
        made[~self.new.is_owned] = 0
        merged: npt.NDArray[Any] = self.new.shared.merge(made, np.add)
        return merged


def _cells_near(
    old: PartitionedMesh,
    new: PartitionedMesh,
    fields: tuple[list[npt.NDArray[Any]], list[npt.NDArray[Any]]],
    reach: FloatArray,
) -> SimplexMesh:
    """Return the old cells whose boxes are near those of new cells on this rank; collective.

    Parameters
    ----------
    fields : nodal and cell fields
        They become data of the cells, named by their places in the lists.
    reach : float64[ranks]
        How far from the new cells of each rank.
    """
    comm = old.ranks
    loose = boxes_around(new.points[~new.in_a_cell], comm)
    boxes = np.concatenate([boxes_of_pieces(new), loose[:, None]], axis=1)
    boxes += np.array([[-1.0], [1.0]]) * reach[:, None, None, None]
    corners = old.points[old.cells]
    low, high = corners.min(axis=1, initial=np.inf), corners.max(axis=1, initial=-np.inf)
    # Few of many ranks have a box that meets the one around all of these cells.
    meets = boxes[:, :, 0] <= high.max(axis=0, initial=-np.inf)
    meets &= boxes[:, :, 1] >= low.min(axis=0, initial=np.inf)
    close = np.flatnonzero(meets.all(axis=2).any(axis=1))
    which, rank = ranks_that_meet(low, high, boxes[close])
    rank = close[rank]
    numbers = comm.allreduce(np.bincount(rank, minlength=comm.size), "sum")
    if comm.rank == int(np.argmax(comm.allgather(old.n_cells))):
        # All take part in what is collective: those without such cells get one anyway.
        without = np.flatnonzero(numbers == 0)
        which, rank = np.append(which, np.zeros_like(without)), np.append(rank, without)
    mesh = None
    if old.mesh is not None:
        point_data, cell_data = ({str(k): v for k, v in enumerate(some)} for some in fields)
        mesh = SimplexMesh(old.points, old.cells, point_data=point_data, cell_data=cell_data)
    return joined_pieces(send_cells(comm, mesh, old.global_ids, which, rank))[0]
