"""``adaptsize size``: the complete size function of a mesh or an image."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from adaptsize.cli.files import check_outputs, holds_more_than_sizes, nodal_field, numbers
from adaptsize.cli.options import (
    MAX_ELEMENTS,
    Across,
    Crease,
    Field,
    Gradient,
    Label,
    Largest,
    MaxElements,
    Output,
    PerRadian,
    Picture,
    Smallest,
    Smoothing,
    Sources,
    Spacing,
    Threshold,
)
from adaptsize.cli.output import draw, draw_causes, print_written, say
from adaptsize.cli.sources import parse_source

if TYPE_CHECKING:
    from adaptsize._size_function import SizeFunction
    from adaptsize.background import SimplexMesh
    from adaptsize.domain_size.report import SizeReport


def size(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="Mesh: STL, VTU, .msh ...; or image: PNG, TIFF, NIfTI, NRRD ..."
        ),
    ],
    output: Output,
    elements_per_radian: PerRadian = None,
    elements_across: Across = None,
    gradient: Gradient = 0.25,
    hmin: Smallest = None,
    hmax: Largest = None,
    crease_angle: Crease = 40.0,
    source: Sources = None,
    field: Field = None,
    spacing: Spacing = None,
    label: Label = None,
    threshold: Threshold = None,
    smoothing: Smoothing = None,
    max_elements: MaxElements = MAX_ELEMENTS,
    plot: Picture = None,
    plot_causes: Annotated[
        Path | None, typer.Option(help="Also draw which cause controls which part (.png).")
    ] = None,
) -> None:
    """Compute the size function of a mesh or an image.

    Sizes come from curvature, narrow regions and sources, and their gradient is limited.  They
    are written as the field h.  The field cause holds what controls each of them; the shares of
    the causes are printed.

    The suffix of the output selects the format.  .pos, .sol and .jig.msh hold sizes for Gmsh,
    Mmg and JIGSAW.  A surface in space is refined where its triangles are long.  The sizes of
    an image are on the grid of its pixels: write .vti.
    """
    from adaptsize.io import is_image_file, read, write

    check_outputs(output, plot)
    if plot_causes is not None:
        check_outputs(output, plot_causes)
    for_images = {
        "--label": label,
        "--threshold": threshold,
        "--spacing": spacing,
        "--smoothing": smoothing,
    }
    _refuse_idle(file, {"--field": field} if is_image_file(file) else for_images)
    options: dict[str, Any] = {
        "elements_per_radian": elements_per_radian,
        "elements_across": elements_across,
        "g": gradient,
        "hmin": hmin,
        "hmax": hmax,
        "sources": [parse_source(text) for text in source or ()],
        "max_elements": max_elements,
    }
    if is_image_file(file):
        filters = {"label": label, "threshold": threshold, "smoothing": smoothing}
        found, report = _of_image(file, spacing, **filters, **options)
    else:
        found, report = size_of_mesh(read(file), field, crease_angle=crease_angle, **options)
    fields = {"cause": report.cause.astype("int32")} if holds_more_than_sizes(output) else {}
    write(output, found, fields=fields)
    draw(plot, found)
    draw_causes(plot_causes, report)
    print(report)
    if fields:
        print("field cause: " + ", ".join(f"{k} {name}" for k, name in enumerate(report.causes)))
    print_written(output, found.background)  # type: ignore[arg-type]


def size_of_mesh(
    mesh: SimplexMesh, field: str | None, **options: Any
) -> tuple[SizeFunction, SizeReport]:
    """Return the size function and its report, and print the parameters used.

    With a field, curvature and feature size are off unless they are requested.
    """
    from adaptsize.domain_size import size_function

    if field is not None:
        options["h0"] = nodal_field(mesh, field)
        for name in ("elements_per_radian", "elements_across"):
            if options[name] is None:
                options[name] = 0.0
    found, report = size_function(mesh, **options, full_output=True, progress=True)
    say(f"sizes: {report.choices}")
    return found, report


def _of_image(file: Path, spacing: str | None, **options: Any) -> tuple[SizeFunction, SizeReport]:
    from adaptsize.domain_size.images import size_function_from_image
    from adaptsize.io import read_image

    if options["smoothing"] is None:
        del options["smoothing"]
    size_of_pixel = None if spacing is None else numbers("--spacing", spacing)
    return size_function_from_image(
        read_image(file), size_of_pixel, **options, full_output=True, progress=True
    )


def _refuse_idle(file: Path, options: dict[str, Any]) -> None:
    """Refuse options that would be ignored for this kind of file."""
    for name, value in options.items():
        if value is not None:
            raise ValueError(f"{name} does not apply to this kind of file, got it with {file}")
