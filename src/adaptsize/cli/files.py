"""Checks of the files on the command line, before the work starts."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh

_PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")


def check_outputs(output: Path, plot: Path | None = None) -> None:
    """Refuse output files that cannot be written.

    Raises
    ------
    ValueError
        If the suffix is unknown, or the directory is missing or not writable.
    """
    from adaptsize._formats.writers import format_of

    format_of(output, None)
    _check_place(output)
    if plot is not None:
        if plot.suffix.lower() not in _PICTURES:
            raise ValueError(f"--plot must end in {', '.join(_PICTURES)}, got {str(plot)!r}")
        _check_place(plot)


def _check_place(path: Path) -> None:
    folder = path.parent
    if path.is_dir():
        raise ValueError(f"{path}: is a directory")
    if not folder.is_dir():
        raise ValueError(f"{path}: there is no directory {folder}")
    if not os.access(folder, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise ValueError(f"{path}: no permission to write")


def nodal_field(mesh: SimplexMesh, name: str) -> npt.NDArray[Any]:
    """Return a nodal field with one number per node.

    Raises
    ------
    ValueError
        If there is no field of that name.  The message lists the fields of the mesh.
    """
    if name not in mesh.point_data:
        listed = ", ".join(mesh.point_data) or "none"
        raise ValueError(f"the mesh has no nodal field {name!r}; it has: {listed}")
    values = np.asarray(mesh.point_data[name])
    if values.ndim == 2 and values.shape[1] == 1:
        values = values[:, 0]
    if values.ndim != 1:
        raise ValueError(f"field {name!r} must have one number per node, got {values.shape}")
    return values


def holds_more_than_sizes(output: Path) -> bool:
    """Return whether a file can hold other nodal fields besides the sizes."""
    from adaptsize._formats.writers import format_of

    chosen = format_of(output, None)
    return chosen.holds_fields and not chosen.only_sizes


def numbers(name: str, text: str) -> list[float] | float:
    """Return one number, or several separated by commas.

    Raises
    ------
    ValueError
        If a part is not a number.
    """
    try:
        given = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise ValueError(
            f"{name} must be one number or several such as 1,1,2.5, got {text!r}"
        ) from error
    return given[0] if len(given) == 1 else given
