"""The options of the public functions, each declared once: default, range, unit and text.

A record is a `TypedDict` whose fields are annotated with an `Option`.  From it follow the check of
what is given (`checked`), the signature and the docstring of the function (`with_options`), the
options of the command line and of its files, and the test that wrong values are refused.  To add
an option, declare it here and use it in the function.
"""

import inspect
import os
import re
import textwrap
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from difflib import get_close_matches
from functools import cache
from types import NoneType
from typing import (
    Annotated,
    Any,
    Literal,
    TypedDict,
    TypeVar,
    cast,
    get_args,
    get_origin,
    get_type_hints,
    is_typeddict,
)

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    as_flag,
    as_number,
    as_slope,
    as_whole_number,
    one_of,
    refusal,
    warn_caller,
    were_checked,
)
from adaptsize._defaults import (
    CORNER_ANGLE,
    CREASE_ANGLE,
    GRADIENT_LIMIT,
    LARGEST_MESH,
    MAX_ELEMENTS,
    METRIC_GRADIENT_LIMIT,
    TOLERANCE,
)
from adaptsize._messages import Message
from adaptsize.errors import InputWarning, OptionError
from adaptsize.typing import GradientLimit, NodalMethod

__all__ = ["Option", "options_of"]

F = TypeVar("F", bound=Callable[..., Any])
R = TypeVar("R")

_WIDTH = 100  # of a docstring
#: Gradient limits from this on look like percentages.
_PERCENTAGE = 10.0


@dataclass(frozen=True)
class Option:
    """The declaration of an option.

    What is not given here is that of the annotated type: whether None is allowed, and the choices
    of a ``Literal``.  The text is in the docstring of the record.  Values of other types than
    numbers, flags and choices are checked where they are used.
    """

    default: Any = None
    chosen: str = ""
    """The default in words, if it depends on the other arguments."""
    unit: Literal["", "length", "degrees", "seconds", "pixels"] = ""
    lower: float = 0.0
    above: bool = False
    """Whether ``lower`` itself is refused."""
    upper: float | None = None
    inf: bool = False
    """Whether inf is allowed."""
    is_slope: bool = False
    """Whether this is a gradient limit; a number that looks like a percentage is warned of."""
    of_sizes: bool = False
    """Whether it is one of sizes, where a number from 1 to 2 looks like a growth ratio."""
    type_text: str = ""
    """The type in words, if it is not a number, a flag or one of some choices."""
    short: str = ""
    """The short name on the command line."""
    text: str = ""
    """What it is: the first sentence in the docstring; also the help of the command line."""
    details: str = ""
    """Further sentences, for docstrings of functions only."""
    # The following are those of the field, set by `options_of`.
    name: str = ""
    type: Any = None
    """Without None."""
    optional: bool = False
    """Whether None is allowed."""
    group: str = ""
    """Title of the record that declares it."""

    @property
    def flags(self) -> tuple[str, ...]:
        """Names on the command line, the short one first."""
        long = "--" + self.name.replace("_", "-")
        return (self.short, long) if self.short else (long,)

    @property
    def metavar(self) -> str:
        """What stands for the value on the command line."""
        if self.unit:
            return self.unit.upper()
        return "N" if self.type in (float, int) else "NAME"

    @property
    def choices(self) -> tuple[str, ...]:
        """The values of a ``Literal``, else none."""
        return get_args(self.type) if get_origin(self.type) is Literal else ()

    @property
    def help(self) -> str:
        """The text with the default, if there is one, for the command line."""
        default = self.chosen or ("" if self.default is None else f"{self.default}")
        if self.type is bool or not default:
            return self.text
        return f"{self.text}  [{default.removesuffix('.0')}]"

    def check(self, value: Any) -> Any:
        """Return a value in the type of the option, after checking it."""
        if value is None and self.optional:
            return None
        if self.type is bool:
            return as_flag(self.name, value)
        if self.choices:
            return one_of(self.name, value, self.choices, or_none=self.optional)
        if self.type is int:
            upper = 2**53 if self.upper is None else int(self.upper)
            return as_whole_number(self.name, value, lower=int(self.lower), upper=upper)
        if self.is_slope and (self.type is float or isinstance(value, float | int)):
            value = as_slope(self.name, value)
        elif self.type is float:
            unit = self.unit if self.unit == "degrees" else ""
            value = as_number(
                self.name, value, lower=self.lower, strict=self.above, allow_inf=self.inf,
                upper=self.upper, unit=unit,
            )  # fmt: skip
        if not were_checked():
            self._warn_of(value)
        return value

    def _warn_of(self, value: Any) -> None:
        """Warn of a gradient that looks like a growth ratio or a percentage."""
        if self.of_sizes and isinstance(value, float | int) and 1.0 < value < 2.0:
            text = (
                "{} = {:g} lets sizes grow by {:g} per length; a growth ratio of {:g} from an "
                "element to the next is {} = {:.4g}"
            )
            name = Message.name(self.name)
            warn_caller(Message(text, name, value, value, value, name, value - 1.0), InputWarning)
        if self.is_slope and isinstance(value, float | int) and value >= _PERCENTAGE:
            text = (
                f"= {value:g} hardly limits anything: it is a gradient, not a percentage; 0.25 "
                "lets neighbouring edges differ by about a quarter"
            )
            warn_caller(Message.about(self.name, text), InputWarning)

    def as_parameter(self) -> inspect.Parameter:
        """Return the parameter of a function."""
        kind = self.type_text or (self.type | None if self.optional else self.type)
        return inspect.Parameter(
            self.name, inspect.Parameter.KEYWORD_ONLY, default=self.default, annotation=kind
        )

    @property
    def doc(self) -> tuple[str, str]:
        """Type and default, and the text, for the docstring of a function."""
        listed = ", ".join(f'"{choice}"' for choice in self.choices)
        kind = self.type_text or (f"{{{listed}}}" if listed else self.type.__name__)
        default, chosen = f"default {self.default}", self.chosen
        if isinstance(self.default, float):
            default = f"default {self.default:.10g}"
        elif self.default is None:
            default = "optional"
        if chosen and len(kind + chosen) < 64:
            default, chosen = f"default {chosen}", ""
        last = f"The default is {chosen}." if chosen else ""
        text = "  ".join(part for part in (self.text, self.details, last) if part)
        return f"{kind}, {default}", text


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


class CapOptions(TypedDict, total=False):
    """Number of elements.

    dofs
        Requested number of unknowns.
    max_elements
        Number to which parameters that are not given are relaxed.  inf disables this.
    max_memory
        Largest memory of the matrix: 8GB.
        Parameters that are not given are relaxed.
    degree
        Polynomial degree, for these.
    components
        Components of the solution, for these.
    """

    dofs: Annotated[float | None, Option(lower=1.0)]
    max_elements: Annotated[
        float | None,
        Option(chosen=f"{MAX_ELEMENTS:.0f}, or inf with max_memory", lower=1.0, inf=True),
    ]
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


class GeneratorOptions(TypedDict, total=False):
    """Mesh generator.

    backend
        Mesh generator: auto, mmg or tetwild.  "auto" is Mmg or fTetWild.
    timeout
        Time limit of all mesh generators together, after which the best mesh so far is returned.
    """

    backend: Annotated[str, Option("auto")]
    timeout: Annotated[
        float | None,
        Option(
            chosen="a limit for each generator in proportion to the number of elements",
            unit="seconds",
            above=True,
        ),
    ]


class LimitOptions(TypedDict, total=False):
    """Number of elements.

    max_elements
        If the sizes require more elements than this, no mesh is made.
    """

    max_elements: Annotated[float, Option(LARGEST_MESH, lower=1.0, inf=True)]


class MeshOptions(GeneratorOptions, total=False):
    """Mesh generator.

    target
        Made of a surface: auto, tetrahedra or triangles.  "auto" fills it with tetrahedra, unless
        it lies in a plane.
    strict
        Whether the mesh must meet all requirements of `check_mesh`.  If it does not, smaller
        tolerances and other generators are tried.
    """

    target: Annotated[Literal["auto", "tetrahedra", "triangles"], Option("auto")]
    strict: Annotated[bool, Option(False)]


class PartsOptions(TypedDict, total=False):
    """Meshes in parts.

    how
        Remesh each part in rounds by Mmg (parts), or all on rank 0 (gather).
    rounds
        Number of rounds of "parts".
    """

    how: Annotated[Literal["parts", "gather"], Option("parts")]
    rounds: Annotated[int, Option(2, lower=1.0, upper=20.0)]


class RemeshOptions(MeshOptions, LimitOptions, PartsOptions, total=False):
    """Remeshing.

    g
        Gradient with which nodal sizes on a surface grow into the volume.  A SizeFunction on a
        surface uses its own g, if it has one.
    hmax
        Upper limit of the sizes, including those that grow into a volume.
    tolerance
        Allowed distance of the new boundary from the old one, over the diagonal.
    """

    g: Annotated[float, Option(GRADIENT_LIMIT, is_slope=True, of_sizes=True, short="-g")]
    hmax: Annotated[float, Option(float("inf"), unit="length", above=True, inf=True)]
    tolerance: Annotated[float, Option(TOLERANCE, above=True, upper=1.0)]


class DistanceOptions(LimitOptions, total=False):
    """Mesh from a distance.

    clip
        Whether the domain may extend beyond the box.  It is then cut off there.
    seed
        Seed of the random initial points.  The same seed gives the same mesh on the same
        machine.
    max_iter
        Maximum number of smoothing steps.
    """

    clip: Annotated[bool, Option(False)]
    seed: Annotated[
        int | np.random.Generator, Option(2004, type_text="int or numpy.random.Generator")
    ]
    max_iter: Annotated[int, Option(150, lower=1.0)]


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


class ImageMeshOptions(ImageSizeOptions, total=False):
    """Mesh of an image.

    seed
        Seed of the random initial points.
    """

    seed: Annotated[int, Option(2004)]


class DetailOptions(TypedDict, total=False):
    """Mesh generator.

    least_detail
        First remove smaller bores, bosses and text.
        See `adaptsize.remeshing.remove_details`.
    """

    least_detail: Annotated[float | None, Option(unit="length", above=True)]


class RemeshToElementsOptions(SizeOptions, MeshOptions, DetailOptions, total=False):
    """Mesh with a number of elements."""


class FamilyOptions(SizeOptions, BudgetOptions, MeshOptions, total=False):
    """Mesh family.

    levels
        Number of meshes.
    ratio
        Size of each mesh over that of the next one.
    """

    levels: Annotated[int, Option(4, lower=2.0, upper=20.0)]
    ratio: Annotated[float, Option(2.0**0.5, lower=1.05, upper=10.0)]


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


class ClipOptions(TypedDict, total=False):
    """Limits of the sizes.

    hmin
        Smallest size; it overrides the bound.
    hmax
        Largest size.
    """

    hmin: Annotated[float | None, Option(unit="length", above=True)]
    hmax: Annotated[float | None, Option(unit="length", above=True)]


class AdaptOptions(
    NumberOptions, LimitOptions, GeneratorOptions, StoppingOptions, TransferOptions, PartsOptions,
    ClipOptions, total=False,
):  # fmt: skip
    """Adaptation.

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


class PictureOptions(TypedDict, total=False):
    """Picture.

    path
        File to write (.png, .jpg, .tif or .bmp), completely or not at all.
    clip
        Axis normal to the plane through the middle at which the mesh is cut.  The whole cells
        behind the plane are shown.  "auto" cuts tetrahedra and boxes in space, such that the
        section is long.  None shows the whole.
    width
        Width of the picture in pixels.  The height follows from the mesh.
    window
        Whether to show a window first, in which the mouse turns and enlarges what is drawn, and
        return the last view when it is closed.
    """

    path: Annotated[str | os.PathLike[str] | None, Option(type_text="str or path")]
    clip: Annotated[Literal["auto", "x", "y", "z"] | None, Option("auto")]
    width: Annotated[int, Option(1600, lower=64.0, upper=10_000.0)]
    window: Annotated[bool, Option(False)]


class ScaledPictureOptions(PictureOptions, total=False):
    """Picture with a colour bar.

    limits
        Lowest and highest value of the colour bar, for pictures to be compared; not for
        regions.
    """

    limits: Annotated[
        tuple[float, float] | None,
        Option(chosen="those of the values", type_text="tuple of float"),
    ]


#: The options that `size_function` implements, by the kind of domain.
DOMAINS: Mapping[str, type] = {
    "meshes": MeshSizeOptions,
    "implicit functions": FunctionSizeOptions,
    "images": ImageSizeOptions,
}
#: The options of the functions that make sizes or meshes.  `with_options` has the others.
ENTRANCES: Mapping[str, type] = {
    "size_function": SizeFunctionOptions,
    "remesh": RemeshOptions,
    "remesh_to_elements": RemeshToElementsOptions,
    "mesh_family": FamilyOptions,
    "mesh_image": ImageMeshOptions,
    "mesh_from_distance": DistanceOptions,
    "adapt": AdaptOptions,
}
#: Arguments of `remesh_to_elements` that other functions have as options.
_ARGUMENTS = {"remesh_to_elements": ("elements", "nodes")}
#: Values that request nothing, so that they may be given where an option is not implemented.
_OFF = {"elements_between": 0.0, "tolerance": float("inf")}


def entrances_with(name: str, entrances: Mapping[str, type]) -> str:
    """Return in words which entrances have an option; empty if none has it.

    Examples
    --------
    >>> entrances_with("spacing", ENTRANCES)
    'size_function and mesh_image'
    """
    return joined(
        [
            title
            for title, record in entrances.items()
            if name in (*options_of(record), *_ARGUMENTS.get(title, ()))
        ]
    )


def joined(names: Sequence[str]) -> str:
    """Return names in one phrase."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def refuse_unused(kind: str, given: Mapping[str, Any], what: str) -> None:
    """Refuse options of `size_function` that do not apply to a kind of domain.

    Parameters
    ----------
    kind : str
        One of `DOMAINS`.
    given : mapping
        What the user gives.
    what : str
        The domain, in words.

    Raises
    ------
    OptionError
        With the kinds of domains that have the option.
    """
    used, every = options_of(DOMAINS[kind]), options_of(SizeFunctionOptions)
    for name, value in given.items():
        is_off = value is None or (name in _OFF and value == _OFF[name])
        if name in every and name not in used and not is_off:
            having = entrances_with(name, DOMAINS)
            raise refusal(name, f"applies to {having}, got it with {what}")


@cache
def options_of(record: type) -> Mapping[str, Option]:
    """Return the options of a record by their names, in the order of the declaration."""
    options, texts = {}, _texts_of(record)
    for name, kind in get_type_hints(record, include_extras=True).items():
        # Without docstrings (python -OO) there are no texts.
        shown: dict[str, Any] = {**texts.get(name, {"group": "Options"})}
        options[name] = replace(_declared(name, kind), **shown)
    return options


def _declared(name: str, annotation: Any) -> Option:
    """Return the option of an annotated field, with what follows from its type."""
    types, option = get_args(annotation)
    members = get_args(types)
    optional = NoneType in members
    if optional:
        rest = tuple(member for member in members if member is not NoneType)
        types = rest[0] if len(rest) == 1 else types
    declared: Option = replace(option, name=name, type=types, optional=optional)
    return declared


@cache
def _options_of_fields(record: type) -> Mapping[str, Option]:
    hints = get_type_hints(record, include_extras=True)
    return {name: _declared(name, kind) for name, kind in hints.items() if _has_option(kind)}


def _has_option(annotation: Any) -> bool:
    return any(isinstance(part, Option) for part in getattr(annotation, "__metadata__", ()))


def check_fields(record: object) -> None:
    """Check the fields of a frozen dataclass that are annotated with an `Option`.

    In/Out: the fields get the checked values.
    """
    for name, option in _options_of_fields(cast(Hashable, type(record))).items():
        object.__setattr__(record, name, option.check(getattr(record, name)))


def _texts_of(record: type) -> dict[str, dict[str, str]]:
    """Return the text, the details and the group of each option, from docstrings of records."""
    items = record.__annotations__.items()
    bases = [
        b for b in globals().values() if is_typeddict(b) and b.__annotations__.items() <= items
    ]
    texts: dict[str, dict[str, str]] = {}
    for base in (record, *bases):
        for name, entry in _entries_of(base).items():
            texts.setdefault(name, entry)
    return texts


@cache
def _entries_of(record: type) -> dict[str, dict[str, str]]:
    """Return the texts in the docstring of a record."""
    title, _, entries = inspect.cleandoc(record.__doc__ or "").partition(".\n\n")
    found = {}
    for entry in re.finditer(r"^(\w+)\n((?:    .*\n?)+)", entries, re.MULTILINE):
        text, _, details = " ".join(entry[2].split()).partition(". ")
        found[entry[1]] = {
            "text": text.removesuffix(".") + ".",
            "details": details,
            "group": title,
        }
    return found


def checked(record: type[R], given: Mapping[str, Any]) -> R:
    """Return the options of a record, checked; those that are not given have their defaults.

    ``growth`` is returned as ``g``.

    Raises
    ------
    TypeError
        If the record has no option of a given name.  The message has the closest name.
    ValueError
        If a value is out of range.
    """
    options = options_of(record)  # type: ignore[arg-type]
    for name in given:
        if name not in options:
            close = get_close_matches(name, options, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(options)}"
            having = entrances_with(name, ENTRANCES)
            if having:
                hint = f"it is of {having}"
            raise TypeError(f"unexpected option {name!r}: {hint}")
    values = {
        name: option.check(given.get(name, option.default)) for name, option in options.items()
    }
    growth = values.pop("growth", None)
    if growth is not None:  # another name of g
        if values["g"] is not None:
            raise OptionError(Message("{growth} and {g} exclude each other: {growth} is 1 + {g}"))
        limit = float(Decimal(repr(growth)) - 1)  # 1.2 is 0.2 to the last bit
        values["g"] = replace(options["g"], of_sizes=False).check(limit)
    return cast(R, values)


def with_options(record: type) -> Callable[[F], F]:
    """Return a decorator that gives a function with ``**options`` the signature of a record.

    The line ``**options`` of its docstring is replaced by the entries of the options.
    """

    def decorate(function: F) -> F:
        options = options_of(record)
        signature = inspect.signature(function)
        kept = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        added = [option.as_parameter() for option in options.values()]
        function.__signature__ = signature.replace(parameters=[*kept, *added])  # type: ignore[attr-defined]
        lines = (function.__doc__ or "").split("\n")
        for number, line in enumerate(lines):
            if line.strip() == "**options":
                indent = line[: len(line) - len(line.lstrip())]
                lines[number] = _entries(options.values(), indent)
        function.__doc__ = "\n".join(lines)
        function.__options__ = record  # type: ignore[attr-defined]
        return function

    return decorate


def _entries(options: Iterable[Option], indent: str) -> str:
    """Return the entries of options in a docstring; short ones of the same type share one."""
    entries: list[tuple[str, str, str]] = []
    width = _WIDTH - len(indent) - 4
    for option in options:
        names, (kind, text) = option.name, option.doc
        if entries and entries[-1][1] == kind and len(f"{entries[-1][2]}  {text}") <= width:
            before = entries.pop()
            names, text = f"{before[0]}, {names}", f"{before[2]}  {text}"
        entries.append((names, kind, text))
    lines = []
    for names, kind, text in entries:
        wrapped = textwrap.wrap(text, width, fix_sentence_endings=True)
        lines += [f"{indent}{names} : {kind}", *(f"{indent}    {line}" for line in wrapped)]
    return "\n".join(lines)
