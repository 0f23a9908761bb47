"""``adaptsize remesh``: a new mesh with the requested sizes."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import adaptsize as ads
from adaptsize._checks import as_tolerance, count_text, refusal
from adaptsize._defaults import TOLERANCE
from adaptsize._messages import Message
from adaptsize.cli import files, tuning
from adaptsize.cli.command import command
from adaptsize.cli.console import Console, plain, print_message
from adaptsize.cli.metric import remesh_with_metric
from adaptsize.cli.options import (
    FACES,
    FIELD,
    FIELDS,
    METRIC,
    OF_POLYGONS,
    ORDER,
    PERIODIC,
    PLOT,
    READING,
    REPORT,
    SOURCE,
    Given,
    Input,
    MeshOutput,
    of_library,
    own,
    reading,
)
from adaptsize.cli.provenance import typed_text
from adaptsize.cli.size import as_dict, bounded, print_outcome
from adaptsize.cli.transfer import with_fields
from adaptsize.options import RemeshToElementsOptions, options_of
from adaptsize.options.meshes import MeshOptions
from adaptsize.options.sizes import BudgetOptions

if TYPE_CHECKING:
    from adaptsize._size_function import SizeFunction
    from adaptsize.background import SimplexMesh
    from adaptsize.domain_size.elements import MadeMesh
    from adaptsize.reporting.outcome import Outcome

#: Options of the command itself.
_OWN = ("plot", "report", "order", "fields", "close_holes", "faces")


@command(
    RemeshToElementsOptions,
    BudgetOptions,
    SOURCE,
    FIELD,
    replace(METRIC, text=f"{METRIC.text}  -g is then 1."),
    replace(
        options_of(MeshOptions)["strict"],
        text="Write only a mesh that passes check; refuse open surfaces, and bodies that overlap "
        "or nearly touch.",
    ),
    own(
        "Mesh generator", "close_holes", bool,
        "First close the holes of a surface by flat caps.",
    ),
    PERIODIC,
    ORDER,
    FACES,
    FIELDS,
    *READING,
    *OF_POLYGONS,
    PLOT,
    REPORT,
)  # fmt: skip
def remesh(console: Console, file: Input, output: MeshOutput, given: Given) -> int:
    """Make a mesh with the requested sizes; closed surfaces become tetrahedra.

    Parameters that are not given are chosen from the part and printed.
    """
    if "metric" in given:
        return remesh_with_metric(console, file, output, given)
    from adaptsize.domain_size.elements import Listener, mesh_with_sizes
    from adaptsize.domain_size.reports import report_of
    from adaptsize.remeshing.preparation import repair_mesh
    from adaptsize.reporting.outcome import outcome_of_remeshing

    plot, page, order = given.get("plot"), given.get("report"), given.get("order", 1)
    files.check_files([file], output, "mesh", order, plot=plot, report=page)
    with console.steps(5) as steps:
        steps.begin("reading")
        mesh, target = _read(console, file, output, given)
        options = of_library(given, *_OWN) | ({} if target == "auto" else {"target": target})
        steps.begin("sizes")

        def found(size: SizeFunction) -> None:
            report = report_of(size)
            console.say(f"sizes: {report.choices}")
            if mesh.cell_dim == mesh.dim or target != "triangles":
                n = report.n_elements
                files.announce(console, tuning.PER_ELEMENT * n, f"about {count_text(n)} elements")

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ads.errors.OpenSurfaceWarning)  # printed by _accepted
            warnings.simplefilter("ignore", ads.errors.ConnectionWarning)  # and by `read`
            following = steps.following()
            made = mesh_with_sizes(
                mesh.without_data(),
                bounded(mesh, options),
                listener=Listener(console.say, found),
                progress=following,
            )
        new, size, report = made.mesh, made.size, report_of(made.size)
        allowed = given.get("tolerance", TOLERANCE)
        steps.begin("writing")
        fields = given.get("fields", "all"), given.get("field")
        new = with_fields(console, mesh, new, output, fields, steps.report)
        new = new.with_data(point_data={"h": size(new.points)})
        record = _record(options, as_dict(report), allowed, new)
        files.write_result(console, output, new, order=order, record=record)
        steps.begin("checks")
        repaired = repair_mesh(mesh).mesh
        check = None if made.attempts is None else made.attempts.check
        outcome = outcome_of_remeshing(
            new, repaired, size, allowed, given.get("elements"), check, made.elements
        )
        outcome = replace(outcome, over_cap=made.excess)
        files.draw(console, "size", plot, new)
        files.write_report(console, page, file, new, size, outcome, outcome.check)
    console.record(size=as_dict(report))
    return _printed(console, outcome, made, new, given)


def _printed(
    console: Console, outcome: Outcome, made: MadeMesh, new: SimplexMesh, given: Given
) -> int:
    """Print how good a new mesh is and how long it took, and return the exit code."""
    times = ", ".join(f"{name} {seconds:.1f}" for name, seconds in console.times)
    lines = [f"{'time':10}{console.seconds:.1f} s: {times}"]
    if "nodes" in given:
        off = f"{new.n_points / given['nodes'] - 1.0:+.1%}"
        nodes = f"{'nodes':10}{new.n_points}, {given['nodes']:.0f} requested ({off})"
        lines.insert(0, nodes)
    code, attempts = print_outcome(console, outcome, *lines), made.attempts
    if attempts is None:
        return code
    console.record(attempts=attempts.as_list())
    if attempts.is_cut_short and console.quiet:
        print_message("error: stopped at the time limit with the best mesh so far")
    return max(code, int(attempts.is_cut_short))


def _record(
    options: Given, sizes: Mapping[str, Any], tolerance: float, mesh: SimplexMesh
) -> dict[str, Any]:
    """Return what else is stored with a mesh, plain values."""
    record: dict[str, Any] = plain(
        {
            "options": {
                name: typed_text(value) for name, value in options.items() if name != "sources"
            },
            "tolerance": tolerance,
            "sizes": sizes,
            "units": {"length": "unit of the coordinates", "tolerance": "diagonal of the input"},
            "n_points": mesh.n_points,
            "n_cells": mesh.n_cells,
        }
    )
    return record


def _read(console: Console, file: Path, output: Path, given: Given) -> tuple[SimplexMesh, str]:
    """Return the mesh in the file, closed if that is requested, and the kind of the new cells.

    What cannot be meshed is refused.
    """
    from adaptsize.remeshing.driver import check_backend

    tolerance = as_tolerance("tolerance", given.get("tolerance", TOLERANCE))
    # Half of the tolerance is for the mesh generator.
    mesh = files.read_mesh(file, 0.5 * tolerance, **reading(given))
    if files.is_of_polygons(file):
        console.say("the lines are simplified within half of the tolerance")
    _doubt_tolerance(console, tolerance, mesh)
    target = _target(console, output, mesh, given)
    check_backend(mesh, target, given.get("backend", "auto"))
    is_filled = mesh.cell_dim < mesh.dim and target != "triangles"
    files.check_cells(output, mesh.dim, max(mesh.dim if is_filled else mesh.cell_dim, 2))
    if is_filled:
        mesh = _accepted(console, mesh, tolerance * mesh.diagonal, given)
    elif given.get("close_holes"):
        raise refusal("close_holes", f"applies to surfaces that become tetrahedra, got {mesh!r}")
    mesh = files.without_details(console, mesh, given)
    if given.get("faces"):
        mesh = files.with_named_faces(mesh)
    elif files.by_faces(given):
        mesh = files.with_faces(mesh)
    if "periodic" in given:
        _check_translations(mesh, given, is_filled=is_filled)
    files.announce_sizes(console, mesh)
    _say_what_is_not_written(console, output, mesh, target)
    return mesh, target


def _check_translations(mesh: SimplexMesh, given: Given, *, is_filled: bool) -> None:
    """Refuse translations that do not fit to a mesh, before its sizes are computed."""
    if is_filled:
        raise refusal("periodic", "needs a mesh of the same cells: make tetrahedra first")
    from adaptsize.limiting.periodic import as_periodicity
    from adaptsize.remeshing.preparation import repair_mesh

    as_periodicity(repair_mesh(mesh).mesh, given["periodic"])  # kept with the mesh


def _doubt_tolerance(console: Console, tolerance: float, mesh: SimplexMesh) -> None:
    """Warn of a tolerance that looks like a length."""
    if tolerance >= tuning.LOOSE:
        text = (
            f"= {tolerance:g} is a share of the diagonal, not a length: the boundary may move by "
            f"{tolerance * mesh.diagonal:.3g}, and check accepts it"
        )
        console.warn(Message.about("tolerance", text))


def _target(console: Console, output: Path, mesh: SimplexMesh, given: Given) -> str:
    """Return the kind of the new cells, and say which one was chosen."""
    from adaptsize.geometry.planes import is_in_plane

    if "target" in given:
        return str(given["target"])
    if not given.get("close_holes") and _is_for_surfaces(output, mesh, given):
        text = (
            "{} holds triangles: the surface is remeshed; {target:tetrahedra} fills it and writes "
            "the boundary"
        )
        console.say(Message(text, output.name))
        return "triangles"
    if is_in_plane(mesh):
        console.say("the surface lies in a plane: it is remeshed there")
        return "triangles"
    return "auto"


def _say_what_is_not_written(
    console: Console, output: Path, mesh: SimplexMesh, target: str
) -> None:
    """Say which parts of the result the format of a file does not hold."""
    chosen, sizes = files.format_of(output), files.beside(output)
    if "triangles" in chosen.holds and mesh.dim == 3 and target != "triangles":
        console.warn(
            f"{output.name} holds triangles only: the boundary of the tetrahedra is written; "
            "write .vtu or .msh for the tetrahedra"
        )
    if sizes is not None:
        console.say(f"{output.name} holds no fields: the sizes are written to {sizes.name}")
    elif "fields" not in chosen.holds:
        console.say(f"{output.name} holds no fields: the sizes are not written")


def _is_for_surfaces(output: Path, mesh: SimplexMesh, given: Given) -> bool:
    """Return whether a surface is to be written to a file of triangles, and can be remeshed."""
    if "triangles" not in files.format_of(output).holds or not mesh.cell_dim < mesh.dim == 3:
        return False
    backend, mmg = given.get("backend", "auto"), ads.remeshing.available_backends()["mmg"]
    return backend == "mmg" or (backend == "auto" and bool(mmg.installed))


def _accepted(console: Console, mesh: SimplexMesh, tolerance: float, given: Given) -> SimplexMesh:
    """Return the surface to fill, and say what happens if it is open.

    Raises
    ------
    ValueError
        If the surface is open, or has bodies that overlap or are closer than the tolerance, and
        ``strict`` is given.
    """
    from adaptsize.remeshing.hole_filling import close_holes, merged_surface
    from adaptsize.remeshing.surface_checks import doubts, open_boundary

    holes = open_boundary(mesh, tolerance) if given.get("close_holes") else None
    if holes is not None:
        closed = close_holes(mesh)
        console.record(closed_boundary=vars(holes))
        count = closed.n_cells - merged_surface(mesh).n_cells  # STL files repeat triangles
        console.say(f"surface closed by {count} triangles; it had {holes}")
        mesh = closed
    for name, found, text in doubts(mesh, tolerance):
        console.record(**{name: vars(found)})
        if given.get("strict", False):
            raise ValueError(text)
        console.warn(text)
    return mesh
