"""``adaptsize size``: the complete size function of a mesh or an image."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from adaptsize._defaults import CREASE_ANGLE, GRADIENT_LIMIT, MAX_ELEMENTS
from adaptsize.cli.console import Console, with_console
from adaptsize.cli.files import (
    check_cells,
    check_files,
    holds_more_than_sizes,
    nodal_field,
    numbers,
    read_mesh,
)
from adaptsize.cli.memory import announce_memory_of_sizes
from adaptsize.cli.options import (
    Across,
    Between,
    Crease,
    Field,
    Gradient,
    ImageSmallest,
    Label,
    Largest,
    MaxElements,
    Nodes,
    PerRadian,
    Picture,
    PredictedElements,
    SizesOutput,
    Smoothing,
    Sources,
    Spacing,
    Threshold,
)
from adaptsize.cli.output import draw, draw_causes, print_written, write_sizes
from adaptsize.cli.sources import parse_source
from adaptsize.cli.steps import Steps

if TYPE_CHECKING:
    from adaptsize._size_function import SizeFunction
    from adaptsize.background import SimplexMesh
    from adaptsize.domain_size.report import SizeReport


@with_console
def size(
    console: Console,
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="Mesh: STL, VTU, .msh ...; or image: PNG, TIFF, NIfTI, NRRD ..."
        ),
    ],
    output: SizesOutput,
    elements_per_radian: PerRadian = None,
    elements_across: Across = None,
    elements_between: Between = None,
    gradient: Gradient = GRADIENT_LIMIT,
    hmin: ImageSmallest = None,
    hmax: Largest = None,
    crease_angle: Crease = CREASE_ANGLE,
    source: Sources = None,
    field: Field = None,
    spacing: Spacing = None,
    label: Label = None,
    threshold: Threshold = None,
    smoothing: Smoothing = None,
    max_elements: MaxElements = None,
    elements: PredictedElements = None,
    nodes: Nodes = None,
    plot: Picture = None,
    plot_causes: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Also draw which cause controls which part (.png).  [default: none]",
        ),
    ] = None,
) -> None:
    """Compute the size function of a mesh or an image.

    Sizes come from curvature, narrow regions and sources, and their gradient is limited.  They
    are written as the field h.  The field cause holds what controls each of them; the shares of
    the causes are printed.

    A surface in space is refined where its triangles are long.  The sizes of an image are on the
    grid of its pixels: write .vti.
    """
    from adaptsize.io import is_image_file

    of_image = is_image_file(file)
    outputs = {
        "--output": (output, "sizes of an image" if of_image else "sizes"),
        "--plot": (plot, "picture"),
        "--plot-causes": (plot_causes, "picture"),
    }
    check_files([file], outputs)  # type: ignore[arg-type]
    for_images = {
        "--label": label,
        "--threshold": threshold,
        "--spacing": spacing,
        "--smoothing": smoothing,
    }
    for_meshes = {
        "--elements-between": elements_between,
        "--field": field,
        "--elements": elements,
        "--nodes": nodes,
    }
    _refuse_idle(file, for_meshes if of_image else for_images)
    options: dict[str, Any] = {
        "elements_per_radian": elements_per_radian,
        "elements_across": elements_across,
        "g": gradient,
        "hmin": hmin,
        "hmax": hmax,
        "sources": [parse_source(text) for text in source or ()],
        "max_elements": max_elements,
        "elements": elements,
        "nodes": nodes,
    }
    with console.steps(3) as steps:
        steps.begin("reading")
        options["progress"] = steps.report
        if of_image:
            filters = {"label": label, "threshold": threshold, "smoothing": smoothing}
            found, report = _of_image(console, steps, file, spacing, **filters, **options)
        else:
            mesh = read_mesh(file)
            check_cells(output, mesh)
            announce_memory_of_sizes(console, mesh)
            steps.begin("sizes")
            options |= {"elements_between": elements_between, "crease_angle": crease_angle}
            found, report = size_of_mesh(console, mesh, field, **options)
        steps.begin("writing")
        fields = {"cause": report.cause.astype("int32")} if holds_more_than_sizes(output) else {}
        written = write_sizes(output, found, fields)
        draw(console, plot, found)
        draw_causes(console, plot_causes, report)
    console.record(input=str(file), size=as_dict(report))
    console.print(report)
    if fields:
        names = ", ".join(f"{k} {name}" for k, name in enumerate(report.causes))
        console.print(f"field cause: {names}")
    print_written(console, written)


def size_of_mesh(
    console: Console, mesh: SimplexMesh, field: str | None, **options: Any
) -> tuple[SizeFunction, SizeReport]:
    """Return the size function and its report, and print the parameters used.

    With a field, curvature, width and separation are off unless they are requested, and so is the
    tolerance where it is no option.
    """
    from adaptsize.domain_size import size_function

    if field is not None:
        options["h0"] = nodal_field(mesh, field)
        for name in ("elements_per_radian", "elements_across", "elements_between"):
            if options[name] is None:
                options[name] = 0.0
        options.setdefault("tolerance", math.inf)
    found, report = size_function(mesh, **options, full_output=True)
    console.say(f"sizes: {report.choices}")
    return found, report


def as_dict(report: SizeReport) -> dict[str, Any]:
    """Return the parameters, sizes and causes of a size function, for the JSON object."""
    causes = [
        {
            "code": code,
            "name": name,
            "domain_share": report.domain_shares[name],
            "element_share": report.element_shares[name],
            "smallest": report.smallest[name],
        }
        for code, name in enumerate(report.causes)
    ]
    return {
        "elements_per_radian": report.elements_per_radian,
        "elements_across": report.elements_across,
        "elements_between": report.elements_between,
        "is_rough": report.is_rough,
        "g": report.g,
        "hmin": report.hmin,
        "hmax": report.hmax,
        "relaxation": report.relaxation,
        "smallest": min(report.smallest.values()),
        "largest": report.largest,
        "n_elements": report.n_elements,
        "n_nodes": report.n_nodes,
        "causes": causes,
    }


def _of_image(
    console: Console, steps: Steps, file: Path, spacing: str | None, **options: Any
) -> tuple[SizeFunction, SizeReport]:
    from adaptsize.domain_size.images import size_function_from_image
    from adaptsize.io import read_image

    del options["elements"], options["nodes"]  # refused before
    if options["smoothing"] is None:
        del options["smoothing"]
    if options["max_elements"] is None:
        options["max_elements"] = MAX_ELEMENTS
    size_of_pixel = None if spacing is None else numbers("--spacing", spacing)
    image = read_image(file)
    steps.begin("sizes")
    found, report = size_function_from_image(image, size_of_pixel, **options, full_output=True)
    console.say(f"sizes: {report.choices}")
    return found, report


def _refuse_idle(file: Path, options: dict[str, Any]) -> None:
    """Refuse options that would be ignored for this kind of file."""
    for name, value in options.items():
        if value is not None:
            raise ValueError(f"{name} does not apply to this kind of file, got it with {file}")
