"""The commands.  Each reads files, calls one function of the library, writes and prints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from adaptsize.cli.adapt import adapt
from adaptsize.cli.console import Console
from adaptsize.cli.family import family
from adaptsize.cli.files import nodal_field, read_mesh
from adaptsize.cli.limit import limit
from adaptsize.cli.options import Given, GroupedCommand, Input, command, own
from adaptsize.cli.remesh import remesh
from adaptsize.cli.size import image, size
from adaptsize.cli.warmup import announce_compilation, warmup
from adaptsize.options import RemeshOptions, options_of

app = typer.Typer(
    name="adaptsize",
    epilog="With --debug, an error shows its traceback.  Results go to standard output, "
    "messages to standard error.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
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


@command()
def info(console: Console, file: Input) -> None:
    """Summarize a mesh: cells, extent, tags, fields, quality."""
    from adaptsize.quality.summary import summarize

    with console.steps(2) as steps:
        steps.begin("reading")
        mesh = read_mesh(file)
        steps.begin("checks")
        summary = summarize(mesh)
    console.record(input=str(file), **summary.as_dict())
    console.print(summary)


@command(
    own("Checks", "original", Path, "Mesh or surface whose domain the mesh must fill."),
    own("Checks", "field", str, "Nodal field with the sizes.", chosen="h, if present"),
    replace(options_of(RemeshOptions)["tolerance"], group="Checks"),
)
def check(console: Console, file: Input, given: Given) -> None:
    """Check a mesh: validity, domain, conformity with its sizes.

    The exit code is 1 if a demand is not met.  The worst places are listed.  The tolerance is that
    with which remesh made the mesh, unless another one is given.
    """
    from adaptsize._formats.provenance import read_provenance
    from adaptsize.background.interfaces import skin_of
    from adaptsize.quality import check_mesh, size_conformity
    from adaptsize.remeshing.preparation import repair_mesh

    original, field = given.pop("original", None), given.pop("field", None)
    with console.steps(2) as steps:
        steps.begin("reading")
        mesh = read_mesh(file)
        made = read_provenance(file)
        if made.get("n_cells") == mesh.n_cells and isinstance(made.get("tolerance"), float):
            given = {"tolerance": made["tolerance"]} | given
            console.say(
                f"made by adaptsize {made.get('version')} from {made.get('input')} on "
                f"{made.get('date')} with the tolerance {made['tolerance']:.3g}"
            )
        other = None if original is None else repair_mesh(read_mesh(original)).mesh
        if field is None and "h" in mesh.point_data:
            field = "h"
        size = None if field is None else nodal_field(mesh, field)
        steps.begin("checks")
        found = check_mesh(mesh, original=other, size=size, **given)
        surface = None if other is None else skin_of(other)[0]
        conformity = None if size is None else size_conformity(mesh, size, surface=surface)
    console.record(input=str(file), **found.as_dict())
    if conformity is not None:
        console.record(**conformity.as_dict())
        console.print(conformity)
    console.print(found)
    console.exit_unless(found.is_met)


for function in (info, size, limit, remesh, family, adapt, image, check, warmup):
    app.command(cls=GroupedCommand)(function)
