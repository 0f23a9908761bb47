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
        Path | None, typer.Option(help="Also draw what controls the size where (.png).")
    ] = None,
) -> None:
    """Put sizes from curvature, thin places and sources on a mesh or an image, limited.

    They are the field h; the field cause says what controls them, and so does the text.  The
    suffix of the output tells the format; .pos, .sol and .jig.msh are sizes for Gmsh, mmg and
    JIGSAW.  A surface in space is refined where its triangles are long.  Those of an image
    live on its pixels: write .vti.
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
    """Return the sizes to use, and say which; a given field alone replaces those from the part."""
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
    """Refuse options that are for the other kind of file."""
    for name, value in options.items():
        if value is not None:
            raise ValueError(f"{name} is not for this kind of file, got it with {file}")
