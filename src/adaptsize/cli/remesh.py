"""``adaptsize remesh``: a new mesh with the requested sizes."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adaptsize._defaults import GRADIENT_LIMIT, TOLERANCE
from adaptsize.cli.console import Console
from adaptsize.cli.files import (
    announce_memory_of_mesh,
    announce_memory_of_sizes,
    beside,
    check_files,
    draw,
    is_of_polygons,
    print_written,
    read_mesh,
    write_mesh,
)
from adaptsize.cli.metric import remesh_with_metric
from adaptsize.cli.options import (
    FIELD,
    METRIC,
    PLOT,
    SOURCE,
    Given,
    Input,
    MeshOutput,
    command,
    own,
)
from adaptsize.cli.size import as_dict, size_of_domain
from adaptsize.cli.sources import parse_source
from adaptsize.options import (
    BudgetOptions,
    MeshOptions,
    RemeshToElementsOptions,
    checked,
    options_of,
)

if TYPE_CHECKING:
    from adaptsize._size_function import SizeFunction
    from adaptsize.background import SimplexMesh
    from adaptsize.cli.steps import Steps
    from adaptsize.reporting.outcome import Outcome

#: Names of the parts of meshing by the texts of the generators' progress.
_PARTS = {
    "adapting the surface with Mmg": "surface",
    "filling the surface with Netgen": "first volume",
    "tetrahedralizing with fTetWild": "first volume",
    "adapting with Mmg": "Mmg",
}
_PARTS_WITHOUT_MMG = {"tetrahedralizing with fTetWild": "fTetWild"}


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
        "Mesh generator", "close", bool,
        "First close the holes of a surface, by nearly plane caps.",
    ),
    PLOT,
    own(
        "Output", "report", Path, "Also write a page with the mesh in 3-D (.html).",
    ),
)  # fmt: skip
def remesh(console: Console, file: Input, output: MeshOutput, given: Given) -> None:
    """Make a mesh with the requested sizes; closed surfaces become tetrahedra.

    Parameters that are not given are chosen from the part and printed.
    """
    if "metric" in given:
        remesh_with_metric(console, file, output, given)
    else:
        _remesh_whole(console, file, output, given)


def _remesh_whole(console: Console, file: Path, output: Path, given: Given) -> None:
    """Make a mesh in this process, with sizes that do not depend on the direction."""
    from adaptsize._checks import as_tolerance
    from adaptsize._formats.provenance import write_provenance
    from adaptsize.domain_size.elements import report_of, tolerance_of
    from adaptsize.domain_size.request import largest_number
    from adaptsize.errors import InputWarning
    from adaptsize.remeshing.preparation import repair_mesh
    from adaptsize.remeshing.registry import check_installed
    from adaptsize.reporting.outcome import outcome_of_remeshing
    from adaptsize.reporting.page import report

    plot, page = given.pop("plot", None), given.pop("report", None)
    check_files([file], output, "mesh", plot=plot, report=page)
    check_installed(given.get("backend", "auto"))
    as_tolerance("tolerance", given.get("tolerance", TOLERANCE))
    elements, nodes = given.get("elements"), given.get("nodes")
    largest_number(
        checked(BudgetOptions, {k: given[k] for k in options_of(BudgetOptions) if k in given})
    )
    given["sources"] = [parse_source(text) for text in given.pop("source", ())]
    with console.steps(5) as steps:
        steps.begin("reading")
        mesh = _read(console, file, output, given)
        options = {name: value for name, value in given.items() if name != "sources"}
        generators: list[str] = []
        new, size = _made(console, steps, mesh, given, generators)
        found = report_of(size)
        allowed = tolerance_of(found, given.get("tolerance"))
        new = new.with_data(point_data={"h": size(new.points)})
        steps.begin("writing")
        written = write_mesh(output, new)
        write_provenance(output, _provenance(file, options, as_dict(found), allowed, new))
        steps.begin("checks")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)  # printed by `remesh`
            repaired = repair_mesh(mesh).mesh
        outcome = outcome_of_remeshing(new, repaired, size, allowed, elements)
        draw(console, "size", plot, new)
        if page is not None:
            about = {
                "input": str(file),
                "command": console.typed,
                "generator": " and ".join(dict.fromkeys(generators)),
            }
            report(page, new, size, original=repaired, tolerance=allowed, times=console.times,
                   about=about)  # fmt: skip
            console.say(f"report: {page}")
    console.record(input=str(file), size=as_dict(found), mesh=outcome.as_dict())
    _print_report(console, outcome, written, None if nodes is None else (new.n_points, nodes))


def _provenance(
    file: Path, options: Given, sizes: Mapping[str, Any], tolerance: float, mesh: SimplexMesh
) -> dict[str, Any]:
    """Return what is stored with a mesh, plain values."""
    from adaptsize import __version__

    numbers = {
        name: value if math.isfinite(value) else None
        for name, value in sizes.items()
        if isinstance(value, float | int)
    }
    return {
        "command": "remesh",
        "version": __version__,
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "input": str(file),
        "options": {name: str(value) for name, value in options.items()},
        "tolerance": tolerance,
        "sizes": numbers,
        "units": {"length": "unit of the coordinates", "tolerance": "diagonal of the input"},
        "n_points": mesh.n_points,
        "n_cells": mesh.n_cells,
    }


def _read(console: Console, file: Path, output: Path, given: Given) -> SimplexMesh:
    """Return the mesh in the file, closed if that is requested; refuse what cannot be meshed."""
    from adaptsize.remeshing.driver import check_backend

    # Half of the tolerance is for the mesh generator.
    mesh = read_mesh(file, 0.5 * given.get("tolerance", TOLERANCE))
    if is_of_polygons(file):
        console.say("the lines are simplified within half of the tolerance")
    close = given.pop("close", False)
    if "target" not in given and not close and _is_for_surfaces(output, mesh, given):
        given["target"] = "triangles"
        console.say(
            f"{output.name} holds triangles: the surface is remeshed; --target tetrahedra fills it "
            "and writes the boundary"
        )
    target = given.get("target", "auto")
    check_backend(mesh, target, given.get("backend", "auto"))
    if mesh.cell_dim < mesh.dim and target != "triangles":
        allowed = given.get("tolerance", TOLERANCE) * mesh.diagonal
        mesh = _accepted(console, mesh, allowed, close=close, strict=given.get("strict", False))
    elif close:
        raise ValueError(f"--close applies to surfaces that become tetrahedra, got {mesh!r}")
    _announce(console, output, mesh, target)
    return mesh


def _is_for_surfaces(output: Path, mesh: SimplexMesh, given: Given) -> bool:
    """Return whether a surface is to be written to a file of triangles, and can be remeshed."""
    from adaptsize._formats.formats import format_of
    from adaptsize.remeshing import available_backends

    remeshes = given.get("backend", "auto") == "mmg" or (
        given.get("backend", "auto") == "auto" and available_backends()["mmg"].installed
    )
    return (
        "triangles" in format_of(output, None).holds and mesh.cell_dim < mesh.dim == 3 and remeshes
    )


def _made(
    console: Console, steps: Steps, mesh: SimplexMesh, given: Given, generators: list[str]
) -> tuple[SimplexMesh, SizeFunction]:
    """Return the new mesh, and the sizes that it was made for; append the names of generators."""
    from adaptsize import remeshing
    from adaptsize.domain_size.elements import reach_number, report_of, tolerance_of
    from adaptsize.domain_size.request import goal_of
    from adaptsize.errors import OpenSurfaceWarning

    budget = checked(
        BudgetOptions, {k: given[k] for k in options_of(BudgetOptions).keys() & given.keys()}
    )
    for_mesh = {name: given[name] for name in options_of(MeshOptions).keys() & given.keys()}
    for_sizes = {name: value for name, value in given.items() if name not in for_mesh}
    for_sizes["progress"] = steps.report

    def sized(**number: float) -> SizeFunction:
        steps.begin("sizes")
        return size_of_domain(console, mesh, for_sizes | number)

    name_of = _names_of_parts(given.get("backend", "auto"))

    def part_of(text: str) -> str:
        generators.extend(text.split(" with ")[1:])
        return name_of(text)

    def meshed(old: SimplexMesh, size: SizeFunction) -> SimplexMesh:
        report = report_of(size)
        announce_memory_of_mesh(console, mesh, given.get("target", "auto"), report.n_elements)
        new: SimplexMesh = remeshing.remesh(
            old,
            size,
            g=given.get("g", GRADIENT_LIMIT),
            hmax=report.hmax,
            tolerance=tolerance_of(report, given.get("tolerance")),
            progress=steps.following(part_of),
            **for_mesh,
        )
        return new

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OpenSurfaceWarning)  # printed by _accepted
        goal = goal_of(budget)
        if goal is None:
            size = sized()
            return meshed(mesh, size), size
        system = (budget["degree"], budget["fields"])
        return reach_number(mesh, goal, sized, meshed, console.say, system)


def _names_of_parts(backend: str) -> Callable[[str], str]:
    """Return a function from texts of the generators' progress to names of the parts of meshing."""
    from adaptsize.remeshing import available_backends

    with_mmg = backend == "mmg" or (backend == "auto" and available_backends()["mmg"].installed)
    names = _PARTS if with_mmg else _PARTS | _PARTS_WITHOUT_MMG
    return lambda text: names.get(text, text)


def _print_report(
    console: Console,
    outcome: Outcome,
    written: list[dict[str, Any]],
    nodes: tuple[int, float] | None,
) -> None:
    """Print how good the mesh is, the time of each step, and the files.

    ``nodes`` are the numbers of nodes made and requested.
    """
    console.print(outcome)
    if nodes is not None:
        made, requested = nodes
        off = f"{made / requested - 1.0:+.1%}"
        console.print(f"{'nodes':10}{made}, {requested:.0f} requested ({off})")
    times = ", ".join(f"{name} {seconds:.1f}" for name, seconds in console.times)
    console.print(f"{'time':10}{console.seconds:.1f} s: {times}")
    for text in outcome.warnings():
        console.warn(text)
    print_written(console, *written)
    console.exit_unless(outcome.check.is_met)


def _accepted(
    console: Console, mesh: SimplexMesh, tolerance: float, *, close: bool, strict: bool
) -> SimplexMesh:
    """Return the surface to fill, and say what happens if it is open.

    Raises
    ------
    ValueError
        If the surface is open, or has bodies that overlap or are closer than the tolerance, and
        this is ``strict``.
    """
    from adaptsize.remeshing.hole_filling import close_holes, merged_surface
    from adaptsize.remeshing.surface_checks import near_bodies, open_boundary, overlapping_bodies

    holes = open_boundary(mesh, tolerance)
    if close and holes is not None:
        closed = close_holes(mesh)
        console.record(closed_boundary=vars(holes))
        count = closed.n_cells - merged_surface(mesh).n_cells  # STL files repeat triangles
        console.say(f"surface closed by {count} triangles; it had {holes}")
        mesh = closed
    elif holes is not None:
        console.record(open_boundary=vars(holes))
        if strict:
            raise ValueError(f"the surface is open: {holes}; see --close and --target triangles")
        console.warn(
            f"the surface is open: {holes}; the mesh generator closes or drops what is "
            "not clearly enclosed; consider --close, --target triangles or --strict"
        )
    overlapping = overlapping_bodies(mesh)
    if overlapping is not None:
        console.record(overlapping_bodies=vars(overlapping))
        if strict:
            raise ValueError(f"{overlapping}; join the bodies before meshing")
        console.warn(f"{overlapping}; the mesh generator fills their union")
    near = near_bodies(mesh, tolerance, overlapping=overlapping)
    if near is not None:
        console.record(near_bodies=vars(near))
        text = f"{near}, less than the tolerance of {tolerance:.3g}"
        if strict:
            raise ValueError(f"{text}; lower --tolerance")
        console.warn(f"{text}: they may be joined; lower --tolerance to keep them apart")
    return mesh


def _announce(console: Console, output: Path, mesh: SimplexMesh, target: str) -> None:
    """Say how much memory the sizes need, and what the format of the output does not hold."""
    from adaptsize._formats.formats import format_of

    announce_memory_of_sizes(console, mesh)
    chosen = format_of(output, None)
    if "triangles" in chosen.holds and mesh.dim == 3 and target != "triangles":
        console.warn(
            f"{output.name} holds triangles only: the boundary of the tetrahedra is written; "
            "write .vtu or .msh for the tetrahedra"
        )
    sizes = beside(output)
    if sizes is not None:
        console.say(f"{output.name} holds no fields: the sizes are written to {sizes.name}")
    elif "fields" not in chosen.holds:
        console.say(f"{output.name} holds no fields: the sizes are not written")
