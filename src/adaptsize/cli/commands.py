"""The commands.  Each reads files, calls one function of the library, writes and prints."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from adaptsize.cli.files import check_outputs, nodal_field
from adaptsize.cli.image import image
from adaptsize.cli.options import (
    MAX_ELEMENTS,
    Across,
    AsJson,
    Crease,
    Field,
    Gradient,
    Input,
    Largest,
    MaxElements,
    Output,
    PerRadian,
    Picture,
    Smallest,
    Sources,
)
from adaptsize.cli.output import draw, print_written
from adaptsize.cli.result import print_quality
from adaptsize.cli.size import size, size_of_mesh
from adaptsize.cli.sources import describe_roots, parse_source
from adaptsize.cli.warmup import announce_compilation, warmup

if TYPE_CHECKING:
    from adaptsize.limiting.options import Method

app = typer.Typer(
    name="adaptsize",
    epilog="With --debug, an error shows its traceback.  Results go to standard output, "
    "messages to standard error.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from adaptsize import __version__

        print(f"adaptsize {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Mesh size functions with gradient limiting."""
    announce_compilation()


@app.command()
def info(file: Input, as_json: AsJson = False) -> None:
    """Summarize a mesh file: counts, extent, tags, fields, topology, quality."""
    from adaptsize.io import read
    from adaptsize.quality import summarize

    summary = summarize(read(file))
    print(json.dumps(summary.as_dict(), indent=2) if as_json else summary)


app.command()(size)


@app.command()
def limit(
    file: Input,
    output: Output,
    field: Annotated[str, typer.Option("--field", help="Nodal field with the upper bounds.")],
    gradient: Gradient,
    method: Annotated[
        str,
        typer.Option(help="auto, or a method of limit_gradient, such as fast-marching."),
    ] = "auto",
    sources: Annotated[
        Path | None,
        typer.Option(help="Also write this file, with the controlling node as the field source."),
    ] = None,
    plot: Picture = None,
) -> None:
    """Limit the gradient of a nodal field.  The result is written as the field h."""
    from adaptsize.io import read, write
    from adaptsize.limiting import limit_gradient

    check_outputs(output, plot)
    if sources is not None:
        check_outputs(sources)
    mesh = read(file)
    h, limiting = limit_gradient(
        mesh,
        nodal_field(mesh, field),
        gradient,
        method=cast("Method", method),
        full_output=True,
        progress=True,
    )
    if sources is not None and limiting.sources is None:
        raise ValueError(
            "--sources needs the exact method (a flat mesh, one gradient limit), "
            f"got method {limiting.method!r}"
        )
    write(output, mesh, fields={"h": h})
    draw(plot, mesh, h)
    levels = ", ".join(
        f"{share:g}: {q:.3f}" for share, q in limiting.cell_gradient_quantiles.items()
    )
    print(f"{limiting.method}: {limiting.n_changed} of {mesh.n_points} nodes lowered")
    print(f"largest slope along an edge over g: {limiting.largest_edge_slope:.6f}")
    print(f"gradient in the cells over g, quantiles: {levels}")
    print_written(output, mesh)
    if sources is not None and limiting.sources is not None:
        roots = limiting.sources.roots()
        write(sources, mesh, fields={"h": h, "source": roots})
        for line in describe_roots(mesh.points, roots):
            print(line)
        print_written(sources, mesh)


@app.command()
def remesh(
    file: Input,
    output: Output,
    elements_per_radian: PerRadian = None,
    elements_across: Across = None,
    gradient: Gradient = 0.25,
    hmin: Smallest = None,
    hmax: Largest = None,
    crease_angle: Crease = 40.0,
    source: Sources = None,
    field: Field = None,
    target: Annotated[
        str,
        typer.Option(help="Cells to make from a surface: auto, tetrahedra or triangles."),
    ] = "auto",
    backend: Annotated[
        str, typer.Option(help="Mesh generator: auto, tetwild, mmg or gmsh.")
    ] = "auto",
    tolerance: Annotated[
        float,
        typer.Option(help="Distance of the new boundary from the old one, over the diagonal."),
    ] = 1e-3,
    max_elements: MaxElements = MAX_ELEMENTS,
    timeout: Annotated[float, typer.Option(help="Time limit in seconds.")] = 3600.0,
    plot: Picture = None,
) -> None:
    """Make a new mesh with the requested sizes.  A closed surface becomes tetrahedra.

    Parameters that are not given are chosen from the part, and the values are printed.
    """
    from adaptsize import remeshing
    from adaptsize.io import read, write
    from adaptsize.remeshing.driver import check_backend

    check_outputs(output, plot)
    mesh = read(file)
    check_backend(mesh, target, backend)  # type: ignore[arg-type]
    found, report = size_of_mesh(
        mesh,
        field,
        elements_per_radian=elements_per_radian,
        elements_across=elements_across,
        g=gradient,
        hmin=hmin,
        hmax=hmax,
        crease_angle=crease_angle,
        sources=[parse_source(text) for text in source or ()],
        max_elements=max_elements,
    )
    new = remeshing.remesh(
        mesh,
        found,
        target=target,
        backend=backend,
        g=gradient,
        hmax=report.hmax,
        tolerance=tolerance,
        timeout=timeout,
        progress=True,
    )
    new = new.with_data(point_data={"h": found(new.points)})
    write(output, new)
    draw(plot, new)
    print_quality(new, mesh, found, report, tolerance)
    print_written(output, new)


app.command()(image)


app.command()(warmup)


@app.command()
def check(
    file: Input,
    field: Annotated[str, typer.Option("--field", help="Nodal field with the sizes.")] = "h",
    surface: Annotated[
        Path | None, typer.Option(help="File of the surface to measure the distance to.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Report the quality of a mesh and its conformity with the sizes in a nodal field."""
    from adaptsize.io import read
    from adaptsize.quality import size_conformity

    mesh = read(file)
    other = None if surface is None else read(surface)
    found = size_conformity(mesh, nodal_field(mesh, field), surface=other)
    print(json.dumps(found.as_dict(), indent=2) if as_json else found)
