"""Options of the functions that make one bound on the sizes."""

from typing import Annotated, TypedDict

from adaptsize._defaults import CORNER_ANGLE, CREASE_ANGLE, GRADIENT_LIMIT
from adaptsize.options.option import Option
from adaptsize.typing import GradientLimit


class ClipOptions(TypedDict, total=False):
    """Limits of the sizes.

    hmin
        Smallest size; it overrides the bound.
    hmax
        Largest size.
    """

    hmin: Annotated[float | None, Option(unit="length", above=True)]
    hmax: Annotated[float | None, Option(unit="length", above=True)]


class ScaleOptions(ClipOptions, total=False):
    """Sizes scaled to an error or a number of elements.

    tolerance
        Target for the error.  Either this or ``elements``.
    elements
        Target for the number of elements, after all limits.
    g
        Gradient limit, as in `limit_gradient`, which is then applied to the sizes.  By default
        the sizes are not limited, so that other bounds can be added before limiting.
    backend
        If given, ``elements`` is the number that this mesh generator makes ("mmg", "tetwild"),
        see `adaptsize.sizes.predict`.  Otherwise it is a number of regular simplices.
    """

    tolerance: Annotated[float | None, Option(above=True)]
    elements: Annotated[float | None, Option(lower=1.0)]
    g: Annotated[
        GradientLimit | None,
        Option(is_slope=True, of_sizes=True, type_text="float, array_like, callable or tuple"),
    ]
    backend: Annotated[str | None, Option()]


class ErrorOptions(ScaleOptions, total=False):
    """Sizes from errors.

    max_refine
        Largest factor by which sizes may shrink.  Indicators predict little about much smaller
        cells at a singular point.
    max_coarsen
        Largest factor by which sizes may grow.  Indicators predict nothing where they are zero.
    """

    max_refine: Annotated[float, Option(4.0, lower=1.0)]
    max_coarsen: Annotated[float, Option(2.0, lower=1.0, inf=True)]


class HessianOptions(ScaleOptions, total=False):
    """Sizes from second derivatives.

    norm
        Norm q of the error.
    """

    norm: Annotated[float, Option(float("inf"), lower=1.0, inf=True)]


class CurvatureOptions(ClipOptions, total=False):
    """Sizes from curvature.

    elements_per_radian
        K.  An edge that spans the angle t has 1 / K = 2 sin(t / 2).
    crease_angle
        Angle between facets above which their edge is a feature edge (crease), and between
        segments above which their node is a corner.  It must exceed the angle between the
        facets of a tessellated smooth surface.  Tagged edges of a surface are feature edges at
        any angle.  With distances it applies to kinks, and to boundaries that turn by more
        within one spacing.
    smoothing
        Layers of neighbours over which the curvature is averaged; 1 or 2 for scanned surfaces.
        Distances are averaged this number of times before they are differentiated, see
        `adaptsize.geometry.level_set_curvature`: about 16 for images.
    tolerance
        Distance up to which a node counts as lying on ``boundary``.
    g
        Only with distances: the gradient limit that is used afterwards.
    """

    elements_per_radian: Annotated[float, Option(4.0, above=True)]
    crease_angle: Annotated[float, Option(CREASE_ANGLE, unit="degrees", upper=180.0)]
    smoothing: Annotated[int, Option(0)]
    tolerance: Annotated[
        float | None,
        Option(
            chosen="0.001 of the diagonal of ``boundary``; on a grid the diagonal of a box; on an "
            "octree the nodes of the leaves that the boundary passes count; with distances two of "
            "the largest spacings",
            unit="length",
        ),
    ]
    g: Annotated[float, Option(GRADIENT_LIMIT, is_slope=True, of_sizes=True)]


class FeatureOptions(ClipOptions, total=False):
    """Sizes from the local width.

    elements_across
        Number n of elements.
    crease_angle
        As for `adaptsize.geometry.boundary_width`.  Distances on grids have none.
    corner_angle
        As for `adaptsize.geometry.boundary_width`.
    tolerance
        Nodes up to this distance outside ``boundary`` get a size too.  On a background of lower
        dimension, only nodes within this distance of ``boundary`` get one.  Only for rays, with
        ``boundary``.
    """

    elements_across: Annotated[float, Option(4.0, above=True)]
    crease_angle: Annotated[float, Option(CREASE_ANGLE, unit="degrees", upper=180.0)]
    corner_angle: Annotated[float, Option(CORNER_ANGLE, unit="degrees", upper=180.0)]
    tolerance: Annotated[
        float | None,
        Option(
            chosen="0.001 of the diagonal of ``boundary``; on a grid the diagonal of a box; on an "
            "octree the nodes of the leaves that the boundary passes count",
            unit="length",
        ),
    ]
