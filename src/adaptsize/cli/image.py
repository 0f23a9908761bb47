"""``adaptsize image``: mesh the objects in a picture or a volume."""

from __future__ import annotations

from adaptsize._defaults import GRADIENT_LIMIT, MAX_ELEMENTS
from adaptsize.cli.console import Console, with_console
from adaptsize.cli.files import check_files, numbers
from adaptsize.cli.options import (
    Gradient,
    ImageAcross,
    ImageFile,
    ImageMaxElements,
    ImagePerRadian,
    ImageSmallest,
    Label,
    Largest,
    MeshOutput,
    Picture,
    Smoothing,
    Sources,
    Spacing,
    Threshold,
)
from adaptsize.cli.output import draw, print_written, write_mesh
from adaptsize.cli.sources import parse_source

#: Name of the step that begins with a text of the progress of `mesh_image`.
_STEPS = {"placing nodes": "meshing"}


@with_console
def image(
    console: Console,
    file: ImageFile,
    output: MeshOutput,
    spacing: Spacing = None,
    label: Label = None,
    threshold: Threshold = None,
    smoothing: Smoothing = None,
    elements_per_radian: ImagePerRadian = None,
    elements_across: ImageAcross = None,
    gradient: Gradient = GRADIENT_LIMIT,
    hmin: ImageSmallest = None,
    hmax: Largest = None,
    source: Sources = None,
    max_elements: ImageMaxElements = MAX_ELEMENTS,
    plot: Picture = None,
) -> None:
    """Mesh the objects in a mask or label image.

    A picture gives triangles, a volume gives tetrahedra.  Sizes come from the curvature of the
    boundaries of the objects and from their width.  Labels become the regions of the mesh.
    """
    from adaptsize.domain_size.images import mesh_image
    from adaptsize.io import read_image
    from adaptsize.reporting.outcome import outcome_of_mesh

    check_files([file], {"--output": (output, "mesh"), "--plot": (plot, "picture")})
    sources = [parse_source(text) for text in source or ()]
    size_of_pixel = None if spacing is None else numbers("--spacing", spacing)
    with console.steps(5) as steps:
        steps.begin("reading")
        pixels = read_image(file)
        steps.begin("sizes")
        mesh = mesh_image(
            pixels,
            size_of_pixel,
            label=label,
            threshold=threshold,
            smoothing=2.0 if smoothing is None else smoothing,
            elements_per_radian=elements_per_radian,
            elements_across=elements_across,
            g=gradient,
            hmin=hmin,
            hmax=hmax,
            sources=sources,
            max_elements=max_elements,
            progress=steps.following(_STEPS.get),
        )
        steps.begin("writing")
        written = write_mesh(output, mesh)
        steps.begin("checks")
        outcome = outcome_of_mesh(mesh)
        draw(console, plot, mesh)
    console.record(input=str(file), mesh=outcome.as_dict())
    console.print(outcome)
    for text in outcome.warnings():
        console.warn(text)
    for held in written:
        print_written(console, held)
