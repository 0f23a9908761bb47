"""``adaptsize check``: whether a mesh meets the demands on it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from adaptsize.cli.console import Console, with_console
from adaptsize.cli.files import nodal_field, read_mesh
from adaptsize.cli.options import Input


@with_console
def check(
    console: Console,
    file: Input,
    original: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Mesh or surface whose domain the mesh must fill.  [default: none]",
        ),
    ] = None,
    field: Annotated[
        str | None,
        typer.Option(
            "--field", metavar="NAME", help="Nodal field with the sizes.  [default: h, if present]"
        ),
    ] = None,
    tolerance: Annotated[
        float,
        typer.Option(
            metavar="NUMBER", help="Allowed distance of the boundaries, over the diagonal."
        ),
    ] = 1e-3,
) -> None:
    """Check a mesh: validity, domain, conformity with its sizes.

    The exit code is 1 if a demand is not met.  The worst places are listed.
    """
    from adaptsize.quality import check_mesh, size_conformity
    from adaptsize.quality.boundary import skin_of
    from adaptsize.remeshing.preparation import repair_mesh

    with console.steps(2) as steps:
        steps.begin("reading")
        mesh = read_mesh(file)
        other = None if original is None else repair_mesh(read_mesh(original)).mesh
        if field is None and "h" in mesh.point_data:
            field = "h"
        size = None if field is None else nodal_field(mesh, field)
        steps.begin("checks")
        found = check_mesh(mesh, original=other, size=size, tolerance=tolerance)
        surface = None if other is None else skin_of(other)
        conformity = None if size is None else size_conformity(mesh, size, surface=surface)
    console.record(input=str(file), **found.as_dict())
    if conformity is not None:
        console.record(**conformity.as_dict())
        console.print(conformity)
    console.print(found)
    if not found.is_met:
        console.finish()
        raise typer.Exit(1)
