"""Options of `size_function`."""

from collections.abc import Mapping, Sequence
from typing import Annotated, TypedDict

import numpy.typing as npt

from adaptsize._defaults import CREASE_ANGLE, GRADIENT_LIMIT, REFUSED_ABOVE, RELAXED_TO, TOLERANCE
from adaptsize.options.option import Option


class BoundOptions(TypedDict, total=False):
    """Sizes.

    elements_per_radian
        Elements per radian of curved boundaries, interfaces and tagged facets; 0 disables this.
    elements_across
        Elements across narrow domains and regions (``cell_tags``); 0 disables this.
    g
        Gradient limit: growth of sizes per length.
    growth
        Growth ratio of edges: 1 + g, in place of g.
    hmin
        Smallest size.  Sizes are in the unit of the coordinates.
    hmax
        Largest size.
    """

    elements_per_radian: Annotated[float | None, Option(chosen="4", short="-K")]
    elements_across: Annotated[float | None, Option(chosen="2")]
    g: Annotated[
        float | None,
        Option(chosen=f"{GRADIENT_LIMIT:g}", short="-g", is_slope=True, of_sizes=True),
    ]
    growth: Annotated[float | None, Option(lower=1.0)]
    hmin: Annotated[
        float | None,
        Option(
            chosen="1/1000 of the diameter, at least a spacing or two pixels, "
            "but at most prescribed sizes",
            unit="length",
            above=True,
        ),
    ]
    hmax: Annotated[
        float | None,
        Option(chosen="1/20 of the diameter of the domain", unit="length", above=True),
    ]


class CreaseOptions(TypedDict, total=False):
    """Sizes.

    crease_angle
        Angle above which an edge is a feature edge.  It is not curvature then.
    """

    crease_angle: Annotated[float, Option(CREASE_ANGLE, unit="degrees", upper=180.0)]


class NamedPartOptions(TypedDict, total=False):
    """Sizes.

    size_of
        Sizes of named parts.
        They replace those from the shape of regions, faces or labels.
    """

    size_of: Annotated[Mapping[str, float] | None, Option(type_text="mapping of str to float")]


class SizeOptions(BoundOptions, CreaseOptions, NamedPartOptions, total=False):
    """Sizes.

    elements_between
        Elements between features of a boundary that do not meet; 0 disables this.
    tolerance
        Allowed distance from the boundary over the diameter; inf disables this.  Sizes at a radius
        r of a mesh are at most sqrt(6 tolerance * diameter * r), or with 8 where elements are few.
    """

    elements_between: Annotated[float | None, Option(chosen="1, or 0 on rough surfaces")]
    tolerance: Annotated[
        float | None,
        Option(chosen=f"{TOLERANCE:g}", above=True, inf=True),
    ]


class ElementsOptions(TypedDict, total=False):
    """Number of elements.

    elements
        Requested number of elements.
    """

    elements: Annotated[float | None, Option(lower=1.0)]


class NumberOptions(ElementsOptions, total=False):
    """Number of elements.

    nodes
        Requested number of nodes.
    """

    nodes: Annotated[float | None, Option(lower=1.0)]


class LargestOptions(TypedDict, total=False):
    """Number of elements.

    max_elements
        Largest number; parameters not given are relaxed to it.
    """

    max_elements: Annotated[
        float | None,
        Option(
            chosen=f"{RELAXED_TO:.0f} to relax, {REFUSED_ABOVE:.0f} to refuse", lower=1.0, inf=True
        ),
    ]


class UnknownsOptions(TypedDict, total=False):
    """Number of elements.

    dofs
        Requested number of unknowns.
    """

    dofs: Annotated[float | None, Option(lower=1.0)]


class CapOptions(UnknownsOptions, LargestOptions, total=False):
    """Number of elements.

    max_memory
        Largest memory of the matrix: 8GB.
        As max_elements; both exclude elements, nodes and dofs.
    degree
        Polynomial degree, for these.
    components
        Components of the solution, for these.
    """

    max_memory: Annotated[str | None, Option()]
    degree: Annotated[int, Option(1, lower=1.0, upper=20.0)]
    components: Annotated[int, Option(1, lower=1.0, upper=1000.0)]


class BudgetOptions(NumberOptions, CapOptions, total=False):
    """Number of elements."""


class ImageOptions(TypedDict, total=False):
    """Image.

    spacing
        Size of a pixel, in the unit of the coordinates.
    label
        Labels of the objects in an image.
    threshold
        Pixels with larger values are objects, instead of labels.
    smoothing
        Standard deviation of the filter of the mask; 2 removes lines of 2 and specks of 3 pixels.
    """

    spacing: Annotated[
        npt.ArrayLike | None,
        Option(
            chosen="that of the image, or 1",
            type_text="float or array_like, shape (dim,)",
        ),
    ]
    label: Annotated[
        int | Sequence[int] | None,
        Option(chosen="all but 0", type_text="int or sequence of int"),
    ]
    threshold: Annotated[float | None, Option(lower=-float("inf"))]
    smoothing: Annotated[float | None, Option(chosen="2", unit="pixels", upper=1000.0)]


class SizeFunctionOptions(SizeOptions, BudgetOptions, ImageOptions, total=False):
    """Size function: the options of all kinds of domains."""


class MeshSizeOptions(SizeOptions, BudgetOptions, total=False):
    """Size function of a mesh or a surface."""


class FunctionSizeOptions(BoundOptions, CreaseOptions, ElementsOptions, CapOptions, total=False):
    """Size function of an implicit function, or of distances on a grid."""


class ImageSizeOptions(
    BoundOptions, NamedPartOptions, ElementsOptions, CapOptions, ImageOptions, total=False
):
    """Size function of an image."""
