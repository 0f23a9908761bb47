"""``adaptsize remesh``: a new mesh with the requested sizes."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from adaptsize._defaults import GRADIENT_LIMIT, TOLERANCE
from adaptsize.cli.console import Console, with_console
from adaptsize.cli.files import beside, check_files, read_mesh
from adaptsize.cli.in_parts import remesh_in_parts, runs_in_parts
from adaptsize.cli.memory import announce_memory_of_mesh, announce_memory_of_sizes
from adaptsize.cli.metric import remesh_with_metric
from adaptsize.cli.output import draw, print_written, write_mesh
from adaptsize.cli.remesh_options import Options
from adaptsize.cli.size import as_dict, size_of_mesh
from adaptsize.cli.sources import parse_source

if TYPE_CHECKING:
    from adaptsize._size_function import SizeFunction
    from adaptsize.background import SimplexMesh
    from adaptsize.cli.steps import Steps
    from adaptsize.domain_size.report import SizeReport
    from adaptsize.reporting.outcome import Outcome

#: Names of the parts of meshing by the texts of the generators' progress.
_PARTS = {
    "adapting the surface with Mmg": "surface",
    "filling the surface with Netgen": "first volume",
    "tetrahedralizing with pytetwild": "first volume",
    "adapting with Mmg": "Mmg",
    "meshing with Gmsh": "Gmsh",
}
_PARTS_WITHOUT_MMG = {"tetrahedralizing with pytetwild": "fTetWild"}

#: Options passed on to the sizes.
_OF_SIZES = (
    "elements_per_radian elements_across elements_between hmin hmax crease_angle tolerance "
    "max_elements"
)


@with_console
def remesh(console: Console, options: Options) -> None:
    """Make a new mesh with the requested sizes.  A closed surface becomes tetrahedra.

    Parameters that are not given are chosen from the part, and the values are printed.
    """
    if options.metric is not None:
        remesh_with_metric(console, options)
    elif runs_in_parts(console, options.file, options.output, mpi=options.mpi):
        remesh_in_parts(console, options)
    else:
        _remesh_whole(console, options)


def _remesh_whole(console: Console, options: Options) -> None:
    """Make a mesh in this process, with sizes that do not depend on the direction."""
    from adaptsize._checks import as_number, as_tolerance
    from adaptsize.domain_size.elements import tolerance_of
    from adaptsize.domain_size.request import check_elements
    from adaptsize.remeshing.registry import check_installed
    from adaptsize.reporting.outcome import outcome_of_remeshing

    output, plot, page = options.output, options.plot, options.report
    _check_outputs(options.file, output, plot, page)
    check_installed(options.backend)
    as_tolerance("tolerance", TOLERANCE if options.tolerance is None else options.tolerance)
    as_number("timeout", options.timeout, lower=0.0, strict=True)
    check_elements(options.elements, options.max_elements, options.nodes)
    sources = [parse_source(text) for text in options.source or ()]
    with console.steps(5) as steps:
        steps.begin("reading")
        mesh = _read(console, options)
        new, found, report = _made(console, steps, mesh, options, sources)
        allowed = tolerance_of(report, options.tolerance)
        new = new.with_data(point_data={"h": found(new.points)})
        steps.begin("writing")
        written = write_mesh(output, new)
        steps.begin("checks")
        outcome = outcome_of_remeshing(new, mesh, found, report, allowed, options.elements)
        draw(console, plot, new)
        _write_page(console, page, new, found, original=mesh, size_report=report, tolerance=allowed)
    console.record(input=str(options.file), size=as_dict(report), mesh=outcome.as_dict())
    nodes = None if options.nodes is None else (new.n_points, options.nodes)
    _print_report(console, outcome, written, nodes)


def _read(console: Console, options: Options) -> SimplexMesh:
    """Return the mesh in the file, closed if that is requested; refuse what cannot be meshed."""
    from adaptsize.remeshing.driver import check_backend

    mesh = read_mesh(options.file)
    check_backend(mesh, options.target, options.backend)
    if mesh.cell_dim < mesh.dim and options.target != "triangles":
        share = TOLERANCE if options.tolerance is None else options.tolerance
        mesh = _accepted(
            console, mesh, share * mesh.diagonal, close=options.close, strict=options.strict
        )
    elif options.close:
        raise ValueError(f"--close applies to surfaces that become tetrahedra, got {mesh!r}")
    _announce(console, options.output, mesh, options.target)
    return mesh


def _made(
    console: Console, steps: Steps, mesh: SimplexMesh, options: Options, sources: list[Any]
) -> tuple[SimplexMesh, SizeFunction, SizeReport]:
    """Return the new mesh, and the sizes that it was made for with their report."""
    from adaptsize import remeshing
    from adaptsize.domain_size.elements import reach_number, tolerance_of
    from adaptsize.errors import OpenSurfaceWarning

    elements, nodes = options.elements, options.nodes
    g = GRADIENT_LIMIT if options.gradient is None else options.gradient
    for_sizes = options.named(_OF_SIZES) | {"g": g, "sources": sources, "progress": steps.report}

    def sized(elements: float | None, nodes: float | None) -> tuple[SizeFunction, SizeReport]:
        steps.begin("sizes")
        return size_of_mesh(
            console, mesh, options.field, elements=elements, nodes=nodes, **for_sizes
        )

    def meshed(old: SimplexMesh, found: SizeFunction, report: SizeReport) -> SimplexMesh:
        announce_memory_of_mesh(console, mesh, options.target, report.n_elements)
        for_mesh = options.named("target backend timeout strict") | {
            "g": g,
            "hmax": report.hmax,
            "tolerance": tolerance_of(report, options.tolerance),
            "progress": steps.following(_names_of_parts(options.backend)),
        }
        return cast("SimplexMesh", remeshing.remesh(old, found, **for_mesh))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OpenSurfaceWarning)  # printed by _accepted
        if elements is None and nodes is None:
            found, report = sized(None, None)
            return meshed(mesh, found, report), found, report
        return reach_number(mesh, elements, nodes, sized, meshed)


def _names_of_parts(backend: str) -> Callable[[str], str]:
    """Return a function from texts of the generators' progress to names of the parts of meshing."""
    from adaptsize.remeshing.registry import is_usable

    with_mmg = backend == "mmg" or (backend == "auto" and is_usable("mmg"))
    names = _PARTS if with_mmg else _PARTS | _PARTS_WITHOUT_MMG
    return lambda text: names.get(text, text)


def _check_outputs(file: Path, output: Path, plot: Path | None, page: Path | None) -> None:
    """Refuse files that cannot be written, before the work."""
    from adaptsize.reporting.page import check_plotly

    check_files(
        [file],
        {
            "--output": (output, "mesh"),
            "--plot": (plot, "picture"),
            "--report": (page, "report"),
        },
    )
    if page is not None:
        check_plotly()


def _write_page(
    console: Console, page: Path | None, mesh: SimplexMesh, size: SizeFunction, **options: Any
) -> None:
    """Write the page to look at, if one is requested."""
    from adaptsize.reporting.page import report

    if page is not None:
        report(page, mesh, size, times=console.times, **options)
        console.say(f"report: {page}")


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
    for held in written:
        print_written(console, held)


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
    from adaptsize.remeshing.hole_filling import close_holes
    from adaptsize.remeshing.surface_checks import near_bodies, open_boundary, overlapping_bodies

    holes = open_boundary(mesh, tolerance)
    if close and holes is not None:
        closed = close_holes(mesh)
        console.record(closed_boundary=vars(holes))
        count = closed.n_cells - mesh.n_cells
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
    from adaptsize._formats.writers import format_of

    announce_memory_of_sizes(console, mesh)
    chosen = format_of(output, None)
    if chosen.only_triangles and mesh.dim == 3 and target != "triangles":
        console.warn(
            f"{output.name} holds triangles only: the boundary of the tetrahedra is written; "
            "write .vtu or .msh for the tetrahedra"
        )
    sizes = beside(output)
    if sizes is not None:
        console.say(f"{output.name} holds no fields: the sizes are written to {sizes.name}")
    elif not chosen.holds_fields:
        console.say(f"{output.name} holds no fields: the sizes are not written")
