"""Files of the commands: checks before the work, what is written, and the memory needed."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

import adaptsize as ads
from adaptsize._checks import refusal, refuse_where
from adaptsize._defaults import CREASE_ANGLE
from adaptsize._messages import Message
from adaptsize._progress import Stage
from adaptsize._records import description, how_made, record_of, write_record
from adaptsize.cli import tuning
from adaptsize.cli.console import Console
from adaptsize.cli.provenance import provenance_of
from adaptsize.errors import OptionError
from adaptsize.reporting.outcome import kind_of

if TYPE_CHECKING:
    from adaptsize._formats.formats import Format
    from adaptsize._size_function import SizeFunction
    from adaptsize.background import SimplexMesh
    from adaptsize.metrics import MetricFunction
    from adaptsize.quality.certificate import MeshCheck
    from adaptsize.reporting.outcome import Outcome


#: What a command writes: a mesh, sizes on a mesh, or sizes on a grid.
Content = Literal["mesh", "sizes", "sizes of an image"]


def check_files(
    inputs: Sequence[Path | None],
    output: Path | None,
    content: Content,
    order: int = 1,
    **others: Path | None,
) -> None:
    """Refuse output files that cannot be written, or would replace an input or each other.

    Parameters
    ----------
    inputs : sequence of Path or None
    output : Path or None
        The file of ``--output``, if there is one, and what is to be written.
    content : str
    order : {1, 2}
        Of the cells.
    **others : Path or None
        Files of other options by their names: of ``report`` with a page, the others with a
        picture.

    Raises
    ------
    OptionError
        If a suffix is unknown or the format cannot hold the content, or two files are the same.
    ValueError
        If a directory is missing or not writable.
    """
    taken = {os.path.realpath(path): "the input" for path in inputs if path is not None}
    for name, path in {"output": output, **others}.items():
        if path is None:
            continue
        check_place(path)
        if name == "output":
            _check_format(path, content)
            format_of(path).check_order(path, order)
        else:
            from adaptsize.plot.pictures import SUFFIXES

            allowed = (".html", ".htm") if name == "report" else SUFFIXES
            if path.suffix.lower() not in allowed:
                raise refusal(name, f"must end in {', '.join(allowed)}, got {str(path)!r}")
        sizes = beside(path) if name == "output" and content == "mesh" else None
        for written in (path, sizes):
            if written is None:
                continue
            place = os.path.realpath(written)
            option = Message.name(name)
            if place in taken:
                text = "{} {} is also {}; give another name"
                raise OptionError(Message(text, option, written, taken[place]))
            taken[place] = option


def read_mesh(path: Path, tolerance: float = 0.0, **options: Any) -> SimplexMesh:
    """Return the mesh in a file, the surface of a CAD model, or the domain between polygons.

    The latter are simplified within the tolerance, over the diameter.  Options are those of `read`,
    or those of `polygons`.
    """
    from adaptsize.remeshing.cad import is_cad_file

    mesh: SimplexMesh
    of_polygons = {name: options[name] for name in ("least_width", "box") if name in options}
    if is_of_polygons(path):
        mesh = ads.io.polygons(path, tolerance=tolerance, **of_polygons)
    elif of_polygons:
        names = Message.joined(", ", map(Message.name, of_polygons))
        raise OptionError(Message("{} applies to files of polygons, got {}", names, path))
    else:
        mesh = ads.read_cad(path) if is_cad_file(path) else ads.io.read(path, **options)
    return mesh


def with_faces(mesh: SimplexMesh) -> SimplexMesh:
    """Return a mesh whose faces between feature edges are tagged, if it is a surface in space."""
    is_untagged = mesh.cell_dim == 2 < mesh.dim and mesh.cell_tags is None
    return mesh.tag_faces() if is_untagged else mesh


def by_faces(given: Mapping[str, Any]) -> bool:
    """Return whether options name parts, which may be the faces of a surface without tags."""
    several = [getattr(source, "tags", None) for source in given.get("sources", ())]
    return "size_of" in given or any(isinstance(tags, str) for tags in several)


def with_named_faces(mesh: SimplexMesh) -> SimplexMesh:
    """Return a surface with tags for the faces between feature edges: face 1, face 2, ...

    Raises
    ------
    ValueError
        If it is no surface in space, or has tags.
    """
    tagged = with_faces(mesh)
    if tagged is mesh or tagged.cell_tags is None:
        raise refusal("faces", f"applies to a surface in space without tags, got {mesh!r}")
    names = {(2, tag): f"face {tag}" for tag in range(1, int(tagged.cell_tags.max()) + 1)}
    return replace(tagged, tag_names={**tagged.tag_names, **names})


def is_of_polygons(path: Path) -> bool:
    """Return whether a file holds polygons or lines, by its name."""
    from adaptsize._formats.formats import FORMATS

    return "polygons" in FORMATS and path.suffix.lower() in FORMATS["polygons"].suffixes


def format_of(path: Path) -> Format:
    """Return the format of a file by its name."""
    from adaptsize._formats import formats

    return formats.format_of(path, None)


def beside(path: Path) -> Path | None:
    """Return the file with the sizes that is written beside a mesh without fields, if any."""
    return path.with_suffix(".sol") if path.suffix.lower() in (".mesh", ".meshb") else None


def _check_format(path: Path, content: Content) -> None:
    if not path.suffix:
        text = f"{path} has no suffix, which gives the format; write {path}.vtu"
        raise OptionError(text, ["output"])
    chosen, name = format_of(path), path.name
    if content == "mesh" and "sizes" in chosen.holds:
        text = f"{name} would hold sizes but no mesh; write .vtu, or .mesh with a .sol"
        raise OptionError(text, ["output"])
    if content != "sizes of an image" and "grids" in chosen.holds:
        raise OptionError(f"{name} holds grids, not meshes; write .vtu", ["output"])
    if content != "mesh" and not chosen.holds & {"fields", "sizes"}:
        hint = ".sol (for Mmg) or .vtu" if content == "sizes" else ".vtu"
        text = f"{name} cannot hold nodal fields such as the sizes; write {hint}"
        raise OptionError(text, ["output"])


def check_place(path: Path) -> None:
    """Refuse a directory, and a place where no file can be written."""
    folder = path.parent
    if path.is_dir():
        raise ValueError(f"{path}: is a directory")
    if not folder.is_dir():
        raise ValueError(f"{path}: there is no directory {folder}")
    if not os.access(folder, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise ValueError(f"{path}: no permission to write")


def field_of(mesh: SimplexMesh, name: str, option: str = "field") -> npt.NDArray[Any]:
    """Return the nodal field that an option names.

    Raises
    ------
    OptionError
        If there is no field of that name.  The message lists the fields of the mesh.
    """
    if name not in mesh.point_data:
        listed = ", ".join(mesh.point_data) or "none"
        raise refusal(option, f"must be a nodal field of the mesh ({listed}), got {name!r}")
    return np.asarray(mesh.point_data[name])


def nodal_field(mesh: SimplexMesh, name: str) -> npt.NDArray[Any]:
    """Return the nodal field that ``--field`` names, if it has one number per node."""
    values = field_of(mesh, name)
    if values.ndim == 2 and values.shape[1] == 1:
        values = values[:, 0]
    if values.ndim != 1:
        raise refusal("field", f"{name!r} must have one number per node, got {values.shape}")
    refuse_where(f"field {name!r}", np.isnan(values), values, "must not be nan")
    return values


def check_cells(path: Path, dim: int, cell_dim: int) -> None:
    """Refuse a file that cannot hold cells of a dimension in a space, before they are made."""
    corners = np.zeros((cell_dim + 1, dim))
    corners[1:, :cell_dim] = np.eye(cell_dim)
    format_of(path).check_cells(path, ads.SimplexMesh(corners, [range(cell_dim + 1)]))


def write_result(
    console: Console,
    path: Path,
    result: SimplexMesh | SizeFunction | MetricFunction,
    fields: Mapping[str, npt.ArrayLike] | None = None,
    order: int = 1,
    record: Mapping[str, Any] | None = None,
) -> None:
    """Write a mesh or sizes with nodal fields, and record what is in the files.

    Beside a ``.mesh``, which holds no fields, sizes are written to a ``.sol`` of the same name.
    A message names cell fields that the format does not hold.  What the files were made with is
    stored beside them, with more plain values in ``record``.
    """
    sizes = beside(path)
    bare = result.mesh if sizes and isinstance(result, ads.MetricFunction) else result
    for target, what in ((path, bare), (sizes, result)):
        if target is not None:
            of_order: dict[str, Any] = {} if order == 1 else {"order": order}
            ads.io.write(target, what, fields=fields, **of_order)
            console.wrote(**_contents(target, what, fields or ()), **of_order)
            if console.request is not None:
                more = dict(record or {})
                write_record(target, provenance_of(target, console.request) | more)
    if isinstance(result, ads.SimplexMesh) and "cell fields" not in format_of(path).holds:
        for name in result.cell_data:
            console.say(f"{path.name} holds no cell fields: {name} is not written")


def _contents(
    path: Path, result: SimplexMesh | SizeFunction | MetricFunction, fields: Iterable[str]
) -> dict[str, Any]:
    """Return what a written file holds: counts of points and cells, and names of fields."""
    from adaptsize._formats.writers import growth_of, parts_of, surface_of

    chosen = format_of(path)
    written: Any
    written, own = parts_of(result, None)
    held: dict[str, Any] = {"file": str(path), "kind": "grid"}
    names = [*own, *growth_of(result, 0), *fields]
    if "grids" not in chosen.holds:
        mesh = written.mesh if isinstance(written, ads.CartesianGrid) else written
        written = mesh = surface_of(mesh) if "triangles" in chosen.holds else mesh
        held["kind"] = kind_of(mesh)
        names = list(dict.fromkeys([*mesh.point_data, *names]))
        if "cell fields" in chosen.holds:
            held["cell_fields"] = list(mesh.cell_data)
        if mesh.tagged_facets is not None and "tags" in chosen.holds:
            held["n_tagged_facets"] = len(mesh.tagged_facets)
    if "sizes" in chosen.holds:
        names = list(own)[:1] or ["h"]
    held["fields"] = names if chosen.holds & {"fields", "sizes"} else []
    if chosen.suffixes == (".sol",):
        return held | {"kind": "nodal sizes", "n_points": written.n_points}
    return held | {"n_points": written.n_points, "n_cells": written.n_cells}


def without_details(console: Console, mesh: SimplexMesh, options: Mapping[str, Any]) -> SimplexMesh:
    """Return a surface without details below ``least_detail``, and say what was removed.

    The options are those of remesh, or their texts in its record.
    """
    if "least_detail" not in options:
        return mesh
    if mesh.cell_dim != 2 or mesh.dim != 3:
        raise refusal("least_detail", f"applies to surfaces, got {mesh!r}")
    from adaptsize.remeshing.details import remove_details

    length, angle = options["least_detail"], options.get("crease_angle", CREASE_ANGLE)
    found = remove_details(mesh, float(length), crease_angle=float(angle))
    console.record(removed_details=[vars(detail) for detail in found.details])
    console.say(f"{found} (below {float(length):g})")
    return found.mesh


def draw(console: Console, kind: str, path: Path | None, *what: Any) -> None:
    """Draw with ``plot_kind``, if a path is given."""
    if path is not None:
        getattr(ads.plot, f"plot_{kind}")(*what, path=path)
        console.wrote(file=str(path), kind="picture")


def write_report(
    console: Console,
    page: Path | None,
    file: Path,
    mesh: SimplexMesh,
    size: SizeFunction | None,
    outcome: Outcome | None,
    check: MeshCheck,
) -> None:
    """Write the page of ``--report`` on a mesh from a file, if a path is given."""
    if page is None:
        return
    from adaptsize.reporting.page import write_page  # matplotlib takes a while

    stages = [name for name, _ in console.times if isinstance(name, Stage)]
    generators = " and ".join(dict.fromkeys(s.generator for s in stages if s.generator))
    about = {"input": str(file), **about_record(file), "command": console.typed}
    about |= {"generator": generators} if generators else {}
    head = {"title": None, "times": console.times, "about": about}
    write_page(page, mesh, size, outcome, check, head)
    console.say(f"report: {page}")


def about_record(file: Path) -> dict[str, str]:
    """Return what made a file, for the head of a page, if there is a record of it."""
    made = record_of(file)
    if not made:
        return {}
    return {"input made by": f"{how_made(made)} ({description(made)})"}


def announce_sizes(console: Console, mesh: SimplexMesh) -> None:
    """Print how much memory the sizes of a surface in space need, if it is much."""
    if mesh.cell_dim < mesh.dim == 3:
        announce(
            console, tuning.PER_TRIANGLE * mesh.n_cells, f"the sizes of {mesh.n_cells} triangles"
        )


def announce(console: Console, needed: float, what: str) -> None:
    """Print how many bytes of memory something needs, if it is much."""
    if needed < tuning.WORTH_A_LINE:
        return
    text = f"{what} need about {needed / 1e9:.1f} GB of memory"
    try:
        installed = float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # AttributeError: on Windows
        installed = np.inf
    if needed > installed:
        console.warn(f"{text}; this machine has {installed / 1e9:.1f} GB")
    else:
        console.say(text)
