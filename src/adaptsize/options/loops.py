"""Options of adaptive loops, and of the transfer of fields."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal, TypedDict

from adaptsize._defaults import CORNER_ANGLE, GRADIENT_LIMIT, METRIC_GRADIENT_LIMIT, TOLERANCE
from adaptsize.options.bounds import ClipOptions
from adaptsize.options.meshes import GeneratorOptions, PartsOptions
from adaptsize.options.option import Option
from adaptsize.options.sizes import LargestOptions, NumberOptions
from adaptsize.typing import GradientLimit, NodalMethod


class TransferOptions(TypedDict, total=False):
    """Transfer of fields.

    method
        How nodal fields are transferred, all or those named; see `FieldTransfer.nodal`.
    conservative
        Whether cell fields are means over the overlaps, see `FieldTransfer.cells`.
    keep_integral
        Whether the transfer preserves the integrals of cell fields.
    """

    method: Annotated[
        NodalMethod | Mapping[str, NodalMethod] | None,
        Option(
            type_text='{"interpolate", "project", "bounded"}, or mapping of str to these',
            chosen='"bounded", or "interpolate" for triangles in space',
        ),
    ]
    conservative: Annotated[bool, Option(True)]
    keep_integral: Annotated[bool, Option(False)]


class StoppingOptions(TypedDict, total=False):
    """Adaptation.

    enough
        The mesh is kept if it has this share of the next one; above 1, it never is.
    """

    enough: Annotated[float, Option(0.85)]


class NeedOptions(StoppingOptions, total=False):
    """Whether to remesh.

    least_angle
        Smallest angle of a triangle, or dihedral angle of a tetrahedron, that is allowed.  0
        accepts all.
    """

    least_angle: Annotated[float, Option(5.0, unit="degrees", upper=60.0)]


class AdaptOptions(
    NumberOptions, LargestOptions, GeneratorOptions, StoppingOptions, TransferOptions, PartsOptions,
    ClipOptions, total=False,
):  # fmt: skip
    """Adaptation.

    backend
        Mesh generator: auto, mmg, tetwild; or bisection of the cells.
    tolerance
        Target for the error, root of the sum of squares; a cycle reduces it by at most 3.
    order
        The error is proportional to this power of the size.  See `size_from_error`.
    g
        Gradient limit; None disables it.
    max_refine
        Largest factor by which ``indicator`` reduces the size in a cycle.
    max_coarsen
        Largest factor by which ``indicator`` increases the size.
    boundary_tolerance
        Allowed distance of the boundaries, over the diagonal; in space it also bounds sizes there.
    coarsen_converged
        Whether to coarsen where possible if the error is within the tolerance.
    corner_angle
        Angle of boundary facets from which on ``project`` keeps their common nodes.
    anisotropic
        Whether sizes depend on the direction, for all or some ``fields``.
    norm
        Norm of the interpolation error of these fields.
    max_aspect
        Limit of the aspect ratio then, see `metric_from_hessian`.
    local
        Whether cells in the plane that have their sizes stay, if most have.
    """

    tolerance: Annotated[float | None, Option(above=True)]
    order: Annotated[float, Option(1.0, above=True)]
    g: Annotated[
        GradientLimit | Literal["auto"] | None,
        Option(
            "auto",
            is_slope=True,
            type_text="as in `limit_gradient`, or None",
            short="-g",
            chosen=f"{GRADIENT_LIMIT:g}, {METRIC_GRADIENT_LIMIT:g} of metrics",
        ),
    ]
    max_refine: Annotated[float, Option(4.0, lower=1.0)]
    max_coarsen: Annotated[float, Option(2.0, lower=1.0, inf=True)]
    boundary_tolerance: Annotated[float, Option(TOLERANCE, above=True, upper=1.0)]
    coarsen_converged: Annotated[bool, Option(False)]
    corner_angle: Annotated[float, Option(CORNER_ANGLE, unit="degrees")]
    anisotropic: Annotated[
        bool | str | Sequence[str], Option(False, type_text="bool, str or sequence of str")
    ]
    norm: Annotated[float, Option(2.0, lower=1.0, inf=True)]
    max_aspect: Annotated[float, Option(1000.0, lower=1.0, upper=1e15)]
    local: Annotated[bool, Option(False)]
