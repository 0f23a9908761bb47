"""Files of the commands: checks before the work, what is written, and the memory needed."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from adaptsize.cli.console import Console
from adaptsize.reporting.outcome import kind_of

if TYPE_CHECKING:
    from adaptsize._size_function import SizeFunction
    from adaptsize.background import CartesianGrid, Octree, SimplexMesh

#: Bytes for the sizes of a surface, per triangle: 0.8 GB for 600 000 (benchmarks/large_inputs.py).
_PER_TRIANGLE = 1300.0
#: Bytes for a mesh by Mmg, per element made: 1 GB for 1 million, in both processes together.
_PER_ELEMENT = 1000.0

#: What a command writes: a mesh, sizes on a mesh, or sizes on a grid.
Content = Literal["mesh", "sizes", "sizes of an image"]


def check_files(
    inputs: Sequence[Path | None], output: Path, content: Content, **others: Path | None
) -> None:
    """Refuse output files that cannot be written, or would replace an input or each other.

    Parameters
    ----------
    inputs : sequence of Path or None
    output : Path
        The file of ``--output``, and what is to be written.
    content : str
    **others : Path or None
        Files of other options by their names: of ``report`` with a page, the others with a
        picture.

    Raises
    ------
    ValueError
        If a suffix is unknown or the format cannot hold the content, a directory is missing
        or not writable, or two files are the same.
    """
    taken = {os.path.realpath(path): "the input" for path in inputs if path is not None}
    for name, path in {"output": output, **others}.items():
        if path is None:
            continue
        option = f"--{name.replace('_', '-')}"
        if name == "output":
            _check_format(path, content)
        else:
            from adaptsize.plot.pictures import SUFFIXES

            allowed = (".html", ".htm") if name == "report" else SUFFIXES
            if path.suffix.lower() not in allowed:
                raise ValueError(f"{option} must end in {', '.join(allowed)}, got {str(path)!r}")
        check_place(path)
        sizes = beside(path) if name == "output" and content == "mesh" else None
        for written in (path, sizes):
            if written is None:
                continue
            place = os.path.realpath(written)
            if place in taken:
                raise ValueError(f"{option} {written} is also {taken[place]}; give another name")
            taken[place] = option


def read_mesh(path: Path, tolerance: float = 0.0) -> SimplexMesh:
    """Return the mesh in a file, the surface of a CAD model, or the domain between polygons.

    The latter are simplified within the tolerance, over the diameter.
    """
    from adaptsize.io import polygons, read
    from adaptsize.remeshing.cad import is_cad_file, read_cad

    if is_of_polygons(path):
        return polygons(path, tolerance=tolerance)
    return read_cad(path) if is_cad_file(path) else read(path)


def is_of_polygons(path: Path) -> bool:
    """Return whether a file holds polygons or lines, by its name."""
    from adaptsize._formats.polygon_files import READERS

    return path.suffix.lower() in READERS


def beside(path: Path) -> Path | None:
    """Return the file with the sizes that is written beside a mesh without fields, if any."""
    return path.with_suffix(".sol") if path.suffix.lower() in (".mesh", ".meshb") else None


def _check_format(path: Path, content: Content) -> None:
    from adaptsize._formats.formats import format_of

    chosen = format_of(path, None)
    name = path.name
    if content == "mesh" and "sizes" in chosen.holds:
        raise ValueError(f"{name} would hold sizes but no mesh; write .vtu, or .mesh with a .sol")
    if content != "sizes of an image" and "grids" in chosen.holds:
        raise ValueError(f"{name} holds grids, not meshes; write .vtu")
    if content != "mesh" and not chosen.holds & {"fields", "sizes"}:
        hint = ".sol (for Mmg) or .vtu" if content == "sizes" else ".vtu"
        raise ValueError(f"{name} cannot hold nodal fields such as the sizes; write {hint}")


def check_cells(path: Path, mesh: SimplexMesh) -> None:
    """Refuse a format that cannot hold the cells of a mesh.

    Raises
    ------
    ValueError
        If the file holds only triangles and the mesh has segments, or only cells of full
        dimension and the mesh is a surface in space.
    """
    from adaptsize._formats.formats import format_of

    format_of(path, None).check_cells(path, mesh)


def check_place(path: Path) -> None:
    """Refuse a directory, and a place where no file can be written."""
    folder = path.parent
    if path.is_dir():
        raise ValueError(f"{path}: is a directory")
    if not folder.is_dir():
        raise ValueError(f"{path}: there is no directory {folder}")
    if not os.access(folder, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise ValueError(f"{path}: no permission to write")


def field_of(mesh: SimplexMesh, name: str) -> npt.NDArray[Any]:
    """Return a nodal field.

    Raises
    ------
    ValueError
        If there is no field of that name.  The message lists the fields of the mesh.
    """
    if name not in mesh.point_data:
        listed = ", ".join(mesh.point_data) or "none"
        raise ValueError(f"the mesh has no nodal field {name!r}; it has: {listed}")
    return np.asarray(mesh.point_data[name])


def nodal_field(mesh: SimplexMesh, name: str) -> npt.NDArray[Any]:
    """Return a nodal field with one number per node, or raise a ValueError as `field_of`."""
    values = field_of(mesh, name)
    if values.ndim == 2 and values.shape[1] == 1:
        values = values[:, 0]
    if values.ndim != 1:
        raise ValueError(f"field {name!r} must have one number per node, got {values.shape}")
    return values


def holds_more_than_sizes(output: Path) -> bool:
    """Return whether a file can hold other nodal fields besides the sizes."""
    from adaptsize._formats.formats import format_of

    return "fields" in format_of(output, None).holds


def write_mesh(path: Path, mesh: SimplexMesh) -> list[dict[str, Any]]:
    """Write a mesh with the nodal field h, and return what is in the files.

    Beside a ``.mesh``, which holds no fields, h is written to a ``.sol`` of the same name.
    """
    from adaptsize.io import write

    write(path, mesh)
    written = [contents(path, mesh)]
    sizes = beside(path)
    if sizes is not None:
        write(sizes, mesh)
        written.append(contents(sizes, mesh))
    return written


def write_sizes(
    path: Path, obj: SimplexMesh | SizeFunction, fields: Mapping[str, npt.ArrayLike]
) -> dict[str, Any]:
    """Write a size function, or nodal fields on a mesh, and return what is in the file."""
    from adaptsize._size_function import SizeFunction
    from adaptsize.io import write

    write(path, obj, fields=fields)
    if isinstance(obj, SizeFunction):
        growth = () if obj.g is None else ("h.g", *(("h.hmax",) if obj.hmax < np.inf else ()))
        return contents(path, obj.background, ("h", *growth, *fields))  # type: ignore[arg-type]
    return contents(path, obj, tuple(fields))


def contents(
    path: Path, background: SimplexMesh | CartesianGrid | Octree, more_fields: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Return what a written file holds: counts of points and cells, and names of fields."""
    from adaptsize._formats.formats import format_of
    from adaptsize._formats.writers import surface_of
    from adaptsize.background import CartesianGrid, Octree

    chosen = format_of(path, None)
    held: dict[str, Any] = {"file": str(path)}
    fields = list(more_fields)
    if isinstance(background, CartesianGrid) and "grids" in chosen.holds:
        n_points, n_cells = background.n_points, background.n_cells
        return held | {"kind": "grid", "n_points": n_points, "n_cells": n_cells, "fields": fields}
    mesh = background.mesh if isinstance(background, CartesianGrid | Octree) else background
    if "triangles" in chosen.holds:
        mesh = surface_of(mesh)
    fields = list(dict.fromkeys([*mesh.point_data, *fields]))
    if "sizes" in chosen.holds:
        fields = ["h"]
    if chosen.suffixes == (".sol",):
        return held | {"kind": "nodal sizes", "n_points": mesh.n_points, "fields": fields}
    held |= {"kind": kind_of(mesh), "n_points": mesh.n_points, "n_cells": mesh.n_cells}
    if mesh.tagged_facets is not None and "tags" in chosen.holds:
        held["n_tagged_facets"] = len(mesh.tagged_facets)
    return held | {"fields": fields if chosen.holds & {"fields", "sizes"} else []}


def print_written(console: Console, *written: Mapping[str, Any]) -> None:
    """Print what each written file holds."""
    for held in written:
        console.wrote(**held)
        console.print(f"{held['file']}: {_content_of(held)}")


def _content_of(held: Mapping[str, Any]) -> str:
    text = f"{held['n_points']} points"
    if "n_cells" in held:
        text += f", {held['n_cells']} {'boxes' if held['kind'] == 'grid' else held['kind']}"
    if held.get("n_tagged_facets"):
        text += f", {held['n_tagged_facets']} tagged facets"
    if held["fields"]:
        text += f", {'fields' if len(held['fields']) > 1 else 'field'} {', '.join(held['fields'])}"
    return text


def draw(console: Console, kind: str, path: Path | None, *what: Any) -> None:
    """Draw with ``plot_kind``, if a path is given."""
    if path is None:
        return
    from adaptsize import plot

    getattr(plot, f"plot_{kind}")(*what, path=path)
    console.wrote(file=str(path), kind="picture")


def announce_memory_of_sizes(console: Console, mesh: SimplexMesh) -> None:
    """Print how much memory the sizes of a surface in space need, if it is much."""
    if mesh.cell_dim < mesh.dim == 3:
        _announce(console, _PER_TRIANGLE * mesh.n_cells, f"the sizes of {mesh.n_cells} triangles")


def announce_memory_of_mesh(
    console: Console, old: SimplexMesh, target: str, n_elements: float
) -> None:
    """Print how much memory a new mesh needs, if it is much and is not a surface in space."""
    if old.cell_dim == old.dim or target != "triangles":
        _announce(console, _PER_ELEMENT * n_elements, f"about {n_elements:.2g} elements")


def _announce(console: Console, needed: float, what: str) -> None:
    if needed < 1e9:  # not worth a line
        return
    text = f"{what} need about {needed / 1e9:.1f} GB of memory"
    installed = _installed_memory()
    if needed > installed:
        console.warn(f"{text}; this machine has {installed / 1e9:.1f} GB")
    else:
        console.say(text)


def _installed_memory() -> float:
    """Return the bytes of memory of this machine, inf if that is not known."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # AttributeError: on Windows
        return float("inf")
