"""``adaptsize image``: mesh the objects in a picture or a volume."""

from __future__ import annotations

from adaptsize.cli.files import check_outputs, numbers
from adaptsize.cli.options import (
    MAX_ELEMENTS,
    Across,
    Gradient,
    ImageFile,
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
from adaptsize.cli.output import draw, print_written
from adaptsize.cli.sources import parse_source


def image(
    file: ImageFile,
    output: Output,
    spacing: Spacing = None,
    label: Label = None,
    threshold: Threshold = None,
    smoothing: Smoothing = None,
    elements_per_radian: PerRadian = None,
    elements_across: Across = None,
    gradient: Gradient = 0.25,
    hmin: Smallest = None,
    hmax: Largest = None,
    source: Sources = None,
    max_elements: MaxElements = MAX_ELEMENTS,
    plot: Picture = None,
) -> None:
    """Mesh the objects in a mask or label image.

    A picture gives triangles, a volume gives tetrahedra.  Sizes come from the curvature of the
    boundaries of the objects and from their width.  Labels become the regions of the mesh.
    """
    from adaptsize.domain_size.images import mesh_image
    from adaptsize.io import read_image, write

    check_outputs(output, plot)
    mesh = mesh_image(
        read_image(file),
        None if spacing is None else numbers("--spacing", spacing),
        label=label,
        threshold=threshold,
        smoothing=2.0 if smoothing is None else smoothing,
        elements_per_radian=elements_per_radian,
        elements_across=elements_across,
        g=gradient,
        hmin=hmin,
        hmax=hmax,
        sources=[parse_source(text) for text in source or ()],
        max_elements=max_elements,
        progress=True,
    )
    write(output, mesh)
    draw(plot, mesh)
    print_written(output, mesh)
