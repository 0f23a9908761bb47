"""The fields of the old mesh on the new one: the option ``--fields`` of ``remesh``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from adaptsize._defaults import is_of_sizes
from adaptsize.cli import files
from adaptsize.cli.console import Console
from adaptsize.typing import ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh


def with_fields(
    console: Console,
    old: SimplexMesh,
    new: SimplexMesh,
    output: Path,
    how: tuple[str, str | None],
    progress: ProgressCallback,
) -> SimplexMesh:
    """Return the new mesh with the fields of the old one, as far as the file of output holds them.

    Fields that are left out are named in messages.

    Parameters
    ----------
    console : Console
    old, new : SimplexMesh
    output : Path
    how : tuple
        "all" or "none", and the name of a nodal field that gave the sizes and is left out.
    progress : callable
    """
    which, used = how
    if which == "none":
        return new
    nodal, by_cell = (
        {name: values for name, values in data.items() if name != used and not is_of_sizes(name)}
        for data in (old.point_data, old.cell_data)
    )
    holds = files.format_of(output).holds
    if "cell fields" not in holds:
        lost = [*by_cell] if "fields" in holds else [*nodal, *by_cell]
        nodal, by_cell = (nodal if "fields" in holds else {}), {}
        what = "cell fields" if "fields" in holds else "fields"
        if lost:
            verb = "is" if len(lost) == 1 else "are"
            console.say(f"{output.name} holds no {what}: {', '.join(lost)} {verb} not written")
    if not (nodal or by_cell):
        return new
    from adaptsize.adaptation.transfer import carry_fields  # takes a while

    chosen = old.without_data().with_data(point_data=nodal, cell_data=by_cell)
    carried = carry_fields(chosen, new, progress)
    for text in carried.left_out:
        console.warn(text)
    return carried.mesh
