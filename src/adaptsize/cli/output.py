"""Files that the commands write: meshes, sizes and pictures, and what is reported on them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from adaptsize.cli.console import Console
from adaptsize.cli.files import beside
from adaptsize.reporting.outcome import kind_of

if TYPE_CHECKING:
    from adaptsize._size_function import SizeFunction
    from adaptsize.background import CartesianGrid, Octree, SimplexMesh
    from adaptsize.domain_size.report import SizeReport
    from adaptsize.metrics import MetricFunction


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
    path: Path,
    background: SimplexMesh | CartesianGrid | Octree,
    more_fields: tuple[str, ...] = (),
) -> dict[str, Any]:
    """Return what a written file holds: counts of points and cells, and names of fields."""
    from adaptsize._formats.writers import format_of, surface_of
    from adaptsize.background import CartesianGrid, Octree

    chosen = format_of(path, None)
    held: dict[str, Any] = {"file": str(path)}
    fields = list(more_fields)
    if isinstance(background, CartesianGrid) and chosen.holds_grids:
        n_points, n_cells = background.n_points, background.n_cells
        return held | {"kind": "grid", "n_points": n_points, "n_cells": n_cells, "fields": fields}
    mesh = background.mesh if isinstance(background, CartesianGrid | Octree) else background
    if chosen.only_triangles:
        mesh = surface_of(mesh)
    fields = list(dict.fromkeys([*mesh.point_data, *fields]))
    if chosen.only_sizes:
        fields = ["h"]
    if chosen.suffixes == (".sol",):
        return held | {"kind": "nodal sizes", "n_points": mesh.n_points, "fields": fields}
    held |= {"kind": kind_of(mesh), "n_points": mesh.n_points, "n_cells": mesh.n_cells}
    if mesh.tagged_facets is not None and not (chosen.only_triangles or chosen.only_sizes):
        held["n_tagged_facets"] = len(mesh.tagged_facets)
    return held | {"fields": fields if chosen.holds_fields else []}


def print_written(console: Console, held: Mapping[str, Any]) -> None:
    """Print what a written file holds."""
    console.wrote(**held)
    text = f"{held['n_points']} points"
    if "n_cells" in held:
        text += f", {held['n_cells']} {_cells(held)}"
    if held.get("n_tagged_facets"):
        text += f", {held['n_tagged_facets']} tagged facets"
    if held["fields"]:
        text += f", {'fields' if len(held['fields']) > 1 else 'field'} {', '.join(held['fields'])}"
    console.print(f"{held['file']}: {text}")


def _cells(held: Mapping[str, Any]) -> str:
    return "boxes" if held["kind"] == "grid" else str(held["kind"])


def draw(console: Console, path: Path | None, *what: Any) -> None:
    """Draw the sizes."""
    from adaptsize.plot import plot_size

    _draw_with(console, plot_size, path, *what)


def draw_causes(console: Console, path: Path | None, report: SizeReport) -> None:
    """Draw which cause controls which part."""
    from adaptsize.plot import plot_causes

    _draw_with(console, plot_causes, path, report)


def draw_metric(console: Console, path: Path | None, metric: MetricFunction) -> None:
    """Draw a metric as ellipses or ellipsoids."""
    from adaptsize.plot import plot_metric

    _draw_with(console, plot_metric, path, metric)


def _draw_with(console: Console, plot: Callable[..., Any], path: Path | None, *what: Any) -> None:
    """Draw to a file, if a path is given.  If drawing is impossible, only print a warning."""
    if path is None:
        return
    from adaptsize.errors import PlotError

    try:
        plot(*what, path=path)
    except (PlotError, ImportError) as error:
        console.warn(f"no picture: {error}")
    else:
        console.wrote(file=str(path), kind="picture")
