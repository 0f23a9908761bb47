"""The fields of the old mesh on the new one: the option ``--fields`` of ``remesh``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from adaptsize._defaults import is_of_sizes
from adaptsize.cli import files
from adaptsize.cli.console import Console
from adaptsize.typing import ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh

Fields = dict[str, npt.NDArray[Any]]


def with_fields(
    console: Console,
    old: SimplexMesh,
    new: SimplexMesh,
    output: Path,
    progress: ProgressCallback,
) -> SimplexMesh:
    """Return the new mesh with the fields of the old one, as far as the file of output holds them.

    Fields that cannot be transferred are named in a message.

    Parameters
    ----------
    console : Console
    old, new : SimplexMesh
    output : Path
    progress : callable
    """
    nodal, by_cell = dict(old.point_data), dict(old.cell_data)
    if not (nodal or by_cell):
        return new
    chosen = files.format_of(output)
    if "fields" not in chosen.holds:
        console.say(f"{output.name} holds no fields: {_listed(nodal, by_cell)} not written")
        return new
    if "cell fields" not in chosen.holds and by_cell:
        console.say(f"{output.name} holds no cell fields: {_listed(by_cell)} not written")
        by_cell = {}
    if new.cell_dim != old.cell_dim:
        console.warn(
            f"fields of a surface are not known inside: {_listed(nodal, by_cell)} left out"
        )
        return new
    nodal, by_cell = (_finite(console, data) for data in (nodal, by_cell))
    if not (nodal or by_cell):
        return new
    from adaptsize.adaptation import transfer_fields  # takes a while

    found = transfer_fields(
        old,
        new,
        fields=nodal,
        cell_fields=by_cell,
        conservative=old.cell_dim == old.dim,
        progress=progress,
    )
    return new.with_data(point_data=found.fields, cell_data=found.cell_fields)


def without(mesh: SimplexMesh, used: str | None) -> SimplexMesh:
    """Return a mesh without the fields of its sizes, and without a nodal field that gave them."""
    nodal = {
        name: values
        for name, values in mesh.point_data.items()
        if name != used and not is_of_sizes(name)
    }
    return mesh.without_data().with_data(point_data=nodal, cell_data=mesh.cell_data)


def _finite(console: Console, data: Fields) -> Fields:
    """Return the fields whose values are all finite, and name the others."""
    finite = {name: values for name, values in data.items() if np.isfinite(values).all()}
    for name in (name for name in data if name not in finite):
        bad = int(np.count_nonzero(~np.isfinite(data[name])))
        console.warn(f"field {name!r} is left out: {bad} of its values are not finite")
    return finite


def _listed(*fields: Fields) -> str:
    names = [name for data in fields for name in data]
    return f"{', '.join(names)} {'is' if len(names) == 1 else 'are'}"
