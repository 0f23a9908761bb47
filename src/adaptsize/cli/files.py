"""Checks of the files on the command line, before the work starts."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh

#: Suffixes of what is neither a mesh nor sizes.
_SUFFIXES = {
    "picture": (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"),
    "report": (".html", ".htm"),
}

#: What a command writes: a mesh, sizes on a mesh, sizes and other fields, or sizes on a grid.
Content = Literal["mesh", "sizes", "fields", "sizes of an image"]


def check_files(
    inputs: Sequence[Path | None],
    outputs: Mapping[str, tuple[Path | None, Content | Literal["picture", "report"]]],
) -> None:
    """Refuse output files that cannot be written, or would replace an input or each other.

    Parameters
    ----------
    inputs : sequence of Path or None
    outputs : mapping of str to tuple
        The name of the option, the file or None, and what is to be written.

    Raises
    ------
    ValueError
        If a suffix is unknown or the format cannot hold the content, a directory is missing
        or not writable, or two files are the same.
    """
    taken = {os.path.realpath(path): "the input" for path in inputs if path is not None}
    for option, (path, content) in outputs.items():
        if path is None:
            continue
        allowed = _SUFFIXES.get(content)
        if allowed is not None:
            if path.suffix.lower() not in allowed:
                raise ValueError(f"{option} must end in {', '.join(allowed)}, got {str(path)!r}")
        else:
            _check_format(path, content)  # type: ignore[arg-type]
        check_place(path)
        for written in (path, beside(path) if content == "mesh" else None):
            if written is None:
                continue
            place = os.path.realpath(written)
            if place in taken:
                raise ValueError(f"{option} {written} is also {taken[place]}; give another name")
            taken[place] = option


def read_mesh(path: Path) -> SimplexMesh:
    """Return the mesh in a file, or the triangulated surface of a CAD model."""
    from adaptsize.io import read
    from adaptsize.remeshing.cad import is_cad_file, read_cad

    return read_cad(path) if is_cad_file(path) else read(path)


def beside(path: Path) -> Path | None:
    """Return the file with the sizes that is written beside a mesh without fields, if any."""
    return path.with_suffix(".sol") if path.suffix.lower() in (".mesh", ".meshb") else None


def _check_format(path: Path, content: Content) -> None:
    from adaptsize._formats.writers import format_of

    chosen = format_of(path, None)
    name = path.name
    if content == "mesh" and chosen.only_sizes:
        raise ValueError(f"{name} would hold sizes but no mesh; write .vtu, or .mesh with a .sol")
    if content != "sizes of an image" and chosen.holds_grids:
        raise ValueError(f"{name} holds grids, not meshes; write .vtu")
    if content != "mesh" and not chosen.holds_fields:
        hint = ".sol (for Mmg) or .vtu" if content == "sizes" else ".vtu"
        raise ValueError(f"{name} cannot hold nodal fields such as the sizes; write {hint}")
    if content == "fields" and chosen.only_sizes:
        raise ValueError(f"{name} holds only sizes and no other fields; write .vtu")


def check_cells(path: Path, mesh: SimplexMesh) -> None:
    """Refuse a format that cannot hold the cells of a mesh.

    Raises
    ------
    ValueError
        If the file holds only triangles and the mesh has segments, or only cells of full
        dimension and the mesh is a surface in space.
    """
    from adaptsize._formats.writers import format_of

    chosen = format_of(path, None)
    if chosen.only_triangles and mesh.cell_dim == 1:
        raise ValueError(f"{path.name} cannot hold segments; write .vtu")
    if chosen.only_full and (mesh.cell_dim < mesh.dim or mesh.dim == 1):
        raise ValueError(
            f"{path.name} holds triangles in the plane or tetrahedra, got {mesh!r}; write .vtu"
        )


def check_place(path: Path) -> None:
    """Refuse a directory, and a place where no file can be written."""
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
