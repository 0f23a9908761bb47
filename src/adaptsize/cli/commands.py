"""The commands.  Each reads files, calls one function of the library, writes and prints."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from adaptsize.cli.adapt import adapt
from adaptsize.cli.check import check
from adaptsize.cli.console import Console, with_console
from adaptsize.cli.files import check_cells, check_files, nodal_field, read_mesh
from adaptsize.cli.image import image
from adaptsize.cli.in_parts import limit_in_parts, refuse_in_parts, runs_in_parts
from adaptsize.cli.metric import check_metric_options, limit_with_metric
from adaptsize.cli.options import Gradient, Input, MetricField, Mpi, Picture, SizesOutput
from adaptsize.cli.output import draw, print_written, write_sizes
from adaptsize.cli.remesh import remesh
from adaptsize.cli.size import size
from adaptsize.cli.sources import controlling_nodes, describe_roots
from adaptsize.cli.warmup import announce_compilation, warmup

if TYPE_CHECKING:
    from adaptsize.limiting import LimitingInfo
    from adaptsize.limiting.options import Method

app = typer.Typer(
    name="adaptsize",
    epilog="With --debug, an error shows its traceback.  Results go to standard output, "
    "messages to standard error.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from adaptsize import __version__

        print(f"adaptsize {__version__}")
        raise typer.Exit


@app.callback()
def options(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Mesh size functions with gradient limiting.

    For example, "adaptsize remesh part.stl -o part.vtu" fills a surface with graded tetrahedra.
    "adaptsize COMMAND -h" lists the options of a command.
    """
    announce_compilation(context.obj)


@app.command()
@with_console
def info(console: Console, file: Input) -> None:
    """Summarize a mesh: cells, extent, tags, fields, quality."""
    from adaptsize.quality import summarize

    with console.steps(2) as steps:
        steps.begin("reading")
        mesh = read_mesh(file)
        steps.begin("checks")
        summary = summarize(mesh)
    console.record(input=str(file), **summary.as_dict())
    console.print(summary)


app.command()(size)


@app.command()
@with_console
def limit(
    console: Console,
    file: Input,
    output: SizesOutput,
    gradient: Gradient,
    field: Annotated[
        str | None,
        typer.Option(
            "--field", metavar="NAME", help="Nodal field with the upper bounds.  [default: none]"
        ),
    ] = None,
    metric: MetricField = None,
    method: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="auto, or a method of limit_gradient, such as fast-marching."
        ),
    ] = "auto",
    sources: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Also write this file, with the controlling node as the field source.  "
            "[default: none]",
        ),
    ] = None,
    plot: Picture = None,
    mpi: Mpi = False,
) -> None:
    """Limit the gradient of a nodal field.  The result is written as the field h, or metric."""
    if (field is None) == (metric is None):
        raise ValueError("give either --field or --metric")
    if metric is not None:
        refused = {
            "--method": method != "auto",
            "--sources": sources is not None,
            "--mpi": mpi or console.world is not None,
        }
        check_metric_options(file, metric, refused, output, plot)
        limit_with_metric(console, file, output, metric, gradient, plot)
        return
    assert field is not None
    if runs_in_parts(console, file, output, mpi=mpi):
        refuse_in_parts({"--sources": sources is not None, "--plot": plot is not None})
        limit_in_parts(console, file, output, field, gradient, method)
        return
    _limit_sizes(console, file, output, field, gradient, cast("Method", method), sources, plot)


def _limit_sizes(
    console: Console,
    file: Path,
    output: Path,
    field: str,
    gradient: float,
    method: Method,
    sources: Path | None,
    plot: Path | None,
) -> None:
    """Limit a field of sizes on one process."""
    from adaptsize.io import read
    from adaptsize.limiting import limit_gradient

    outputs = {
        "--output": (output, "sizes"),
        "--sources": (sources, "fields"),
        "--plot": (plot, "picture"),
    }
    check_files([file], outputs)  # type: ignore[arg-type]
    with console.steps(3) as steps:
        steps.begin("reading")
        mesh = read(file)
        for path in (output, sources):
            if path is not None:
                check_cells(path, mesh)
        h0 = nodal_field(mesh, field)
        steps.begin("limiting")
        h, found = limit_gradient.with_info(
            mesh, h0, gradient, method=method, progress=steps.report
        )
        if sources is not None and found.sources is None:
            raise ValueError(
                "--sources needs the exact method (a flat mesh, one gradient limit), "
                f"got method {found.method!r}"
            )
        steps.begin("writing")
        written = [write_sizes(output, mesh, {"h": h})]
        roots = None
        if sources is not None and found.sources is not None:
            roots = found.sources.roots()
            written.append(write_sizes(sources, mesh, {"h": h, "source": roots}))
        draw(console, plot, mesh, h)
    console.record(input=str(file), method=found.method, g=gradient, n_points=mesh.n_points)
    _print_limited(console, found, mesh.n_points)
    print_written(console, written[0])
    if roots is not None:
        console.record(sources=controlling_nodes(mesh.points, roots))
        for line in describe_roots(mesh.points, roots):
            console.print(line)
        print_written(console, written[1])


def _print_limited(console: Console, found: LimitingInfo, n_points: int) -> None:
    """Print how far sizes were limited, and record it."""
    quantiles = found.cell_gradient_quantiles
    console.record(
        n_lowered=found.n_changed,
        largest_edge_slope=found.largest_edge_slope,
        cell_gradient_quantiles=quantiles,
    )
    levels = ", ".join(f"{share:g}: {q:.3f}" for share, q in quantiles.items())
    console.print(f"{found.method}: {found.n_changed} of {n_points} nodes lowered")
    console.print(f"largest slope along an edge over g: {found.largest_edge_slope:.6f}")
    console.print(f"gradient in the cells over g, quantiles: {levels}")


app.command()(remesh)


app.command()(adapt)


app.command()(image)


app.command()(check)


app.command()(warmup)
