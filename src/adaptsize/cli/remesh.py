"""``adaptsize remesh``: a new mesh with the requested sizes."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from adaptsize._defaults import CREASE_ANGLE, GRADIENT_LIMIT, TOLERANCE
from adaptsize.cli.console import Console, with_console
from adaptsize.cli.files import beside, check_files, read_mesh
from adaptsize.cli.in_parts import remesh_in_parts, runs_in_parts
from adaptsize.cli.memory import announce_memory_of_mesh, announce_memory_of_sizes
from adaptsize.cli.metric import remesh_with_metric
from adaptsize.cli.options import (
    Across,
    Crease,
    Elements,
    Field,
    Input,
    Largest,
    MaxElements,
    MeshOutput,
    MetricField,
    Mpi,
    Nodes,
    PerRadian,
    Picture,
    Report,
    Smallest,
    Sources,
)
from adaptsize.cli.output import draw, print_written, write_mesh
from adaptsize.cli.size import as_dict, size_of_mesh
from adaptsize.cli.sources import parse_source

if TYPE_CHECKING:
    from adaptsize._size_function import SizeFunction
    from adaptsize.background import SimplexMesh
    from adaptsize.domain_size.report import SizeReport
    from adaptsize.reporting.outcome import Outcome

_BACKENDS = ("auto", "tetwild", "mmg", "gmsh")
_TARGETS = ("auto", "tetrahedra", "triangles")

#: Names of the parts of meshing by the texts of the generators' progress.
_PARTS = {
    "adapting the surface with Mmg": "surface",
    "filling the surface with Netgen": "first volume",
    "tetrahedralizing with pytetwild": "first volume",
    "adapting with Mmg": "Mmg",
    "meshing with Gmsh": "Gmsh",
}
_PARTS_WITHOUT_MMG = {"tetrahedralizing with pytetwild": "fTetWild"}


@with_console
def remesh(
    console: Console,
    file: Input,
    output: MeshOutput,
    elements_per_radian: PerRadian = None,
    elements_across: Across = None,
    gradient: Annotated[
        float | None,
        typer.Option(
            "-g",
            "--gradient",
            metavar="NUMBER",
            help="Gradient limit: growth of the size per length.  [default: 0.25; 1 with --metric]",
        ),
    ] = None,
    hmin: Smallest = None,
    hmax: Largest = None,
    crease_angle: Crease = CREASE_ANGLE,
    source: Sources = None,
    field: Field = None,
    metric: MetricField = None,
    target: Annotated[
        str,
        typer.Option(
            metavar="KIND",
            autocompletion=lambda: list(_TARGETS),
            help="Cells to make from a surface: auto, tetrahedra or triangles.",
        ),
    ] = "auto",
    backend: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            autocompletion=lambda: list(_BACKENDS),
            help="Mesh generator: auto, tetwild, mmg or gmsh.",
        ),
    ] = "auto",
    tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="NUMBER",
            help="Distance of the new boundary from the old one, over the diagonal.  "
            "[default: 0.001, more if --max-elements or --elements requires it]",
        ),
    ] = None,
    close: Annotated[
        bool,
        typer.Option("--close", help="Close the holes of a surface first, by nearly plane caps."),
    ] = False,
    strict: Annotated[
        bool,
        typer.Option(
            "--strict",
            help="Write only a mesh that meets the demands of check; refuse open surfaces, and "
            "bodies that overlap or are closer than the tolerance.",
        ),
    ] = False,
    max_elements: MaxElements = None,
    elements: Elements = None,
    nodes: Nodes = None,
    timeout: Annotated[
        float, typer.Option(metavar="SECONDS", help="Time limit of the mesh generators.")
    ] = 3600.0,
    plot: Picture = None,
    page: Report = None,
    mpi: Mpi = False,
    gather: Annotated[
        bool, typer.Option("--gather", help="Under MPI, mesh on one rank instead of in parts.")
    ] = False,
) -> None:
    """Make a new mesh with the requested sizes.  A closed surface becomes tetrahedra.

    Parameters that are not given are chosen from the part, and the values are printed.
    """
    if metric is not None:
        return remesh_with_metric(
            console,
            file,
            output,
            metric,
            gradient,
            (hmin, hmax),
            plot,
            options={
                "target": target,
                "backend": backend,
                "tolerance": tolerance,
                "max_elements": max_elements,
                "timeout": timeout,
                "strict": strict,
            },
            refused={
                "--elements-per-radian": elements_per_radian is not None,
                "--elements-across": elements_across is not None,
                "--source": bool(source),
                "--field": field is not None,
                "--close": close,
                "--elements": elements is not None,
                "--report": page is not None,
                "--mpi": mpi or console.world is not None,
            },
        )
    from adaptsize.domain_size.request import check_elements

    g = GRADIENT_LIMIT if gradient is None else gradient
    if runs_in_parts(console, file, output, mpi=mpi):
        refused = {
            "--elements-per-radian": elements_per_radian is not None,
            "--elements-across": elements_across is not None,
            "--source": bool(source),
            "--close": close,
            "--strict": strict,
            "--plot": plot is not None,
            "--report": page is not None,
            "--elements": elements is not None,
            "--nodes": nodes is not None,
            "--target triangles": target == "triangles",
            f"--backend {backend}": backend not in ("auto", "mmg"),
        }
        remesh_in_parts(
            console,
            file,
            output,
            field,
            g,
            (hmin, hmax),
            {
                "how": "gather" if gather else "parts",
                "tolerance": tolerance,
                "max_elements": max_elements,
                "timeout": timeout,
            },
            refused,
        )
        return
    from adaptsize import remeshing
    from adaptsize._checks import as_number, as_tolerance
    from adaptsize.domain_size.elements import reach_number, tolerance_of
    from adaptsize.errors import OpenSurfaceWarning
    from adaptsize.remeshing.driver import check_backend
    from adaptsize.remeshing.registry import check_installed
    from adaptsize.reporting.outcome import outcome_of_remeshing

    _check_outputs(file, output, plot, page)
    check_installed(backend)
    allowed = as_tolerance("tolerance", TOLERANCE if tolerance is None else tolerance)
    as_number("timeout", timeout, lower=0.0, strict=True)
    check_elements(elements, max_elements, nodes)
    sources = [parse_source(text) for text in source or ()]
    with console.steps(5) as steps:
        steps.begin("reading")
        mesh = read_mesh(file)
        check_backend(mesh, target, backend)  # type: ignore[arg-type]
        if mesh.cell_dim < mesh.dim and target != "triangles":
            mesh = _accepted(console, mesh, allowed * mesh.diagonal, close=close, strict=strict)
        elif close:
            raise ValueError(f"--close applies to surfaces that become tetrahedra, got {mesh!r}")
        _announce(console, output, mesh, target)

        def sized(elements: float | None, nodes: float | None) -> tuple[SizeFunction, SizeReport]:
            steps.begin("sizes")
            return size_of_mesh(
                console,
                mesh,
                field,
                elements_per_radian=elements_per_radian,
                elements_across=elements_across,
                g=g,
                hmin=hmin,
                hmax=hmax,
                crease_angle=crease_angle,
                tolerance=tolerance,
                sources=sources,
                max_elements=max_elements,
                elements=elements,
                nodes=nodes,
                progress=steps.report,
            )

        def meshed(old: SimplexMesh, found: SizeFunction, report: SizeReport) -> SimplexMesh:
            announce_memory_of_mesh(console, mesh, target, report.n_elements)
            return cast(
                "SimplexMesh",
                remeshing.remesh(
                    old,
                    found,
                    target=target,
                    backend=backend,
                    g=g,
                    hmax=report.hmax,
                    tolerance=tolerance_of(report, tolerance),
                    timeout=timeout,
                    strict=strict,
                    progress=steps.following(_names_of_parts(backend)),
                ),
            )

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", OpenSurfaceWarning)  # printed by _accepted
            if elements is None and nodes is None:
                found, report = sized(None, None)
                new = meshed(mesh, found, report)
            else:
                new, found, report = reach_number(mesh, elements, nodes, sized, meshed)
        allowed = tolerance_of(report, tolerance)
        new = new.with_data(point_data={"h": found(new.points)})
        steps.begin("writing")
        written = write_mesh(output, new)
        steps.begin("checks")
        outcome = outcome_of_remeshing(new, mesh, found, report, allowed, elements)
        draw(console, plot, new)
        _write_page(console, page, new, found, original=mesh, size_report=report, tolerance=allowed)
    console.record(input=str(file), size=as_dict(report), mesh=outcome.as_dict())
    _print_report(console, outcome, written, None if nodes is None else (new.n_points, nodes))


def _names_of_parts(backend: str) -> Callable[[str], str]:
    """Return a function from texts of the generators' progress to names of the parts of meshing."""
    from adaptsize.remeshing.registry import is_usable

    with_mmg = backend == "mmg" or (backend == "auto" and is_usable("mmg"))
    names = _PARTS if with_mmg else _PARTS | _PARTS_WITHOUT_MMG
    return lambda text: names.get(text, text)


def _check_outputs(file: Path, output: Path, plot: Path | None, page: Path | None) -> None:
    """Refuse files that cannot be written, before the work."""
    from adaptsize.reporting.api import check_plotly

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
    from adaptsize.reporting.api import report

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
    from adaptsize.remeshing.open_surface import near_bodies, open_boundary
    from adaptsize.remeshing.overlaps import overlapping_bodies

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
