"""The options of the public functions, each declared once: default, range, unit and text.

A record is a `TypedDict` whose fields are annotated with an `Option`.  From it follow the check of
what is given (`checked`), the signature and the docstring of the function (`with_options`), the
options of the command line and of its files, and the test that wrong values are refused.  To add
an option, declare it here and use it in the function.
"""

import inspect
import os
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
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
)

import numpy as np
import numpy.typing as npt

from adaptsize._checks import STEEPEST, as_flag, as_number, as_whole_number, one_of, warn_caller
from adaptsize._defaults import (
    CORNER_ANGLE,
    CREASE_ANGLE,
    GRADIENT_LIMIT,
    MAX_ELEMENTS,
    METRIC_GRADIENT_LIMIT,
    TOLERANCE,
)
from adaptsize.errors import UnitWarning
from adaptsize.typing import GradientLimit, NodalMethod

__all__ = ["Option", "options_of"]

F = TypeVar("F", bound=Callable[..., Any])
R = TypeVar("R")

_WIDTH = 96  # of a docstring


@dataclass(frozen=True)
class Option:
    """The declaration of an option.

    What is not given here is that of the annotated type: whether None is allowed, and the choices
    of a ``Literal``.  Values of other types than numbers, flags and choices are checked where they
    are used.
    """

    default: Any
    text: str
    """What it is, in one sentence; also the help of the command line."""
    details: str = ""
    """Further sentences, for the docstring only."""
    chosen: str = ""
    """The default in words, if None stands for one that depends on the other arguments."""
    unit: Literal["", "length", "degrees", "seconds", "pixels"] = ""
    lower: float = 0.0
    above: bool = False
    """Whether ``lower`` itself is refused."""
    upper: float | None = None
    inf: bool = False
    """Whether inf is allowed."""
    unusual: float | None = None
    """From this value on, a gradient draws a warning: it looks like a percentage."""
    type_text: str = ""
    """The type in words, if it is not a number, a flag or one of some choices."""
    short: str = ""
    """The short name on the command line."""
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
        return "NUMBER" if self.type in (float, int) else "NAME"

    @property
    def choices(self) -> tuple[str, ...]:
        """The values of a ``Literal``, else none."""
        return get_args(self.type) if get_origin(self.type) is Literal else ()

    @property
    def help(self) -> str:
        """The text with the default, for the command line."""
        if self.type is bool:
            return self.text
        default = self.chosen or ("none" if self.default is None else f"{self.default}")
        return f"{self.text}  [default: {default.removesuffix('.0')}]"

    def check(self, value: Any) -> Any:
        """Return a value in the type of the option, after checking it."""
        if value is None and self.optional:
            return None
        if self.type is bool:
            return as_flag(self.name, value)
        if self.choices:
            return one_of(self.name, value, self.choices)
        if self.type is int:
            upper = 2**53 if self.upper is None else int(self.upper)
            return as_whole_number(self.name, value, lower=int(self.lower), upper=upper)
        if self.type is float:
            unit = self.unit if self.unit == "degrees" else ""
            value = as_number(
                self.name, value, lower=self.lower, strict=self.above, allow_inf=self.inf,
                upper=self.upper, unit=unit,
            )  # fmt: skip
        if self.unusual is not None and isinstance(value, float | int) and value >= self.unusual:
            warn_caller(
                f"{self.name} = {value:g} hardly limits anything: it is a gradient, not a "
                "percentage; 0.25 lets neighbouring edges differ by about a quarter",
                UnitWarning,
            )
        return value

    def as_parameter(self) -> inspect.Parameter:
        """Return the parameter of a function."""
        kind = self.type_text or (self.type | None if self.optional else self.type)
        return inspect.Parameter(
            self.name, inspect.Parameter.KEYWORD_ONLY, default=self.default, annotation=kind
        )

    def as_doc(self, indent: str) -> str:
        """Return the entry of the option in a docstring."""
        listed = ", ".join(f'"{choice}"' for choice in self.choices)
        kind = self.type_text or (f"{{{listed}}}" if listed else self.type.__name__)
        default = "optional" if self.default is None else f"default {self.default}"
        if isinstance(self.default, float):
            default = f"default {self.default:.10g}"
        chosen = f"The default is {self.chosen}." if self.chosen else ""
        text = "  ".join(part for part in (self.text, self.details, chosen) if part)
        lines = textwrap.wrap(text, _WIDTH - len(indent) - 4, fix_sentence_endings=True)
        return "\n".join(
            [f"{indent}{self.name} : {kind}, {default}", *(f"{indent}    {x}" for x in lines)]
        )


class SizeOptions(TypedDict, total=False):
    """Sizes."""

    elements_per_radian: Annotated[
        float | None,
        Option(
            None,
            "Elements per radian of curved boundaries; 0 disables this bound.",
            chosen="4",
            short="-K",
            details="In a mesh, also of curved interfaces and of tagged facets inside.",
        ),
    ]
    elements_across: Annotated[
        float | None,
        Option(
            None,
            "Elements across narrow regions; 0 disables this bound.",
            chosen="2",
            details="In a mesh, each region (``cell_tags``) counts separately.",
        ),
    ]
    elements_between: Annotated[
        float | None,
        Option(
            None,
            "Elements between features of the boundary that are close and do not meet; 0 "
            "disables this bound.",
            chosen="1, or 0 on rough surfaces",
            details="It has no effect on functions, images and level sets.",
        ),
    ]
    g: Annotated[
        float,
        Option(
            GRADIENT_LIMIT,
            "Gradient limit: growth of the size per length.",
            short="-g",
            unusual=10.0,
        ),
    ]
    hmin: Annotated[
        float | None,
        Option(
            None,
            "Smallest size, in the unit of the coordinates.",
            chosen="1/1000 of the diameter of the domain, at least one spacing of a level set and "
            "two pixels",
            unit="length",
            above=True,
        ),
    ]
    hmax: Annotated[
        float | None,
        Option(
            None,
            "Largest size, in the unit of the coordinates.",
            chosen="1/20 of the diameter of the domain",
            unit="length",
            above=True,
        ),
    ]
    crease_angle: Annotated[
        float,
        Option(
            CREASE_ANGLE,
            "Angle above which an edge is a feature edge, not curvature.",
            unit="degrees",
            upper=180.0,
        ),
    ]
    tolerance: Annotated[
        float | None,
        Option(
            None,
            "Allowed distance of the boundary of the mesh from that of the domain, over the "
            "diameter.",
            chosen="1e-3, or more where the number of elements requires it",
            above=True,
            inf=True,
            details="Sizes on boundaries of radius r are at most 2 sqrt(tolerance * diameter * r), "
            "on the mesh itself.  inf disables this.",
        ),
    ]


class NumberOptions(TypedDict, total=False):
    """Number of elements."""

    elements: Annotated[
        float | None, Option(None, "Requested number of elements of the mesh.", lower=1.0)
    ]
    nodes: Annotated[float | None, Option(None, "Requested number of nodes, instead.", lower=1.0)]


class BudgetOptions(NumberOptions, total=False):
    """Number of elements."""

    max_elements: Annotated[
        float | None,
        Option(
            None,
            "Parameters that are not given are relaxed until the mesh has about this many "
            "elements; inf disables this.",
            chosen=f"{MAX_ELEMENTS:.0f}",
            lower=1.0,
            inf=True,
        ),
    ]


class ImageOptions(TypedDict, total=False):
    """Image."""

    spacing: Annotated[
        npt.ArrayLike | None,
        Option(
            None,
            "Size of a pixel, in the unit of the coordinates.",
            chosen="that of the image, 1 for arrays",
            type_text="float or array_like of float, shape (dim,)",
        ),
    ]
    label: Annotated[
        int | Sequence[int] | None,
        Option(
            None,
            "Labels of the objects in an image.",
            chosen="all but 0",
            type_text="int or sequence of int",
        ),
    ]
    threshold: Annotated[
        float | None,
        Option(
            None,
            "Pixels with larger values belong to the objects, instead of labels.",
            lower=-float("inf"),
        ),
    ]
    smoothing: Annotated[
        float | None,
        Option(
            None,
            "Standard deviation of the low-pass filter of the mask.",
            chosen="2",
            unit="pixels",
            upper=1000.0,
            details="2 removes ripples, lines of 2 pixels, and specks of 3 x 3.",
        ),
    ]


class GeneratorOptions(TypedDict, total=False):
    """Mesh generator."""

    backend: Annotated[
        str,
        Option(
            "auto",
            "Mesh generator: auto, tetwild, mmg or gmsh.",
            details='"auto" is Mmg or fTetWild.',
        ),
    ]
    timeout: Annotated[
        float | None,
        Option(
            3600.0,
            "Time limit of the mesh generators.",
            unit="seconds",
            above=True,
            details="None disables it.",
        ),
    ]


class LimitOptions(TypedDict, total=False):
    """Number of elements."""

    max_elements: Annotated[
        float,
        Option(
            5e6,
            "If the sizes require more elements than this, no mesh is made.",
            lower=1.0,
            inf=True,
        ),
    ]


class MeshOptions(GeneratorOptions, total=False):
    """Mesh generator."""

    target: Annotated[
        Literal["auto", "tetrahedra", "triangles"],
        Option(
            "auto",
            "Cells to make from a surface: auto, tetrahedra or triangles.",
            details='"auto" fills it with tetrahedra.',
        ),
    ]
    strict: Annotated[
        bool,
        Option(
            False,
            "Whether the mesh must meet all demands of `check_mesh`.",
            details="If it does not, smaller tolerances and other generators are tried.",
        ),
    ]


class PartsOptions(TypedDict, total=False):
    """Meshes in parts."""

    how: Annotated[
        Literal["parts", "gather"],
        Option(
            "parts",
            "How a mesh in parts is remeshed: each rank its part in rounds, by Mmg, or rank 0 "
            "the whole mesh.",
        ),
    ]
    rounds: Annotated[int, Option(2, 'Number of rounds of "parts".', lower=1.0, upper=20.0)]


class RemeshOptions(MeshOptions, LimitOptions, PartsOptions, total=False):
    """Remeshing."""

    g: Annotated[
        float,
        Option(
            GRADIENT_LIMIT,
            "Gradient with which nodal sizes on a surface grow into the volume.",
            unusual=10.0,
            short="-g",
            details="A SizeFunction on a surface uses its own g, if it has one.",
        ),
    ]
    hmax: Annotated[
        float,
        Option(
            float("inf"),
            "Upper limit of the sizes, including those that grow into a volume.",
            unit="length",
            above=True,
            inf=True,
        ),
    ]
    tolerance: Annotated[
        float,
        Option(
            TOLERANCE,
            "Allowed distance of the new boundary from the old one, over the diagonal.",
            above=True,
            upper=1.0,
        ),
    ]


class DistanceOptions(LimitOptions, total=False):
    """Mesh from a distance."""

    clip: Annotated[
        bool,
        Option(
            False,
            "Whether the domain may extend beyond the box.",
            details="It is then cut off there.",
        ),
    ]
    seed: Annotated[
        int | np.random.Generator,
        Option(
            2004,
            "Seed of the random initial points.",
            type_text="int or numpy.random.Generator",
            details="The same seed gives the same mesh on the same machine.",
        ),
    ]
    max_iter: Annotated[int, Option(150, "Maximum number of smoothing steps.", lower=1.0)]


class SizeFunctionOptions(SizeOptions, BudgetOptions, ImageOptions, total=False):
    """Size function."""


class ImageMeshOptions(SizeOptions, BudgetOptions, ImageOptions, total=False):
    """Mesh of an image."""

    seed: Annotated[int, Option(2004, "Seed of the random initial points.")]


class RemeshToElementsOptions(SizeOptions, MeshOptions, total=False):
    """Mesh with a number of elements."""


class FamilyOptions(SizeOptions, BudgetOptions, MeshOptions, total=False):
    """Mesh family."""

    levels: Annotated[int, Option(4, "Number of meshes.", lower=2.0, upper=20.0)]
    ratio: Annotated[
        float,
        Option(2.0**0.5, "Size of each mesh over that of the next one.", lower=1.05, upper=10.0),
    ]


class TransferOptions(TypedDict, total=False):
    """Transfer of fields."""

    method: Annotated[
        NodalMethod | Mapping[str, NodalMethod] | None,
        Option(
            None,
            "How nodal fields are transferred: all, or those named.",
            type_text='{"interpolate", "project", "bounded"}, or mapping of str to these',
            chosen='"bounded", or "interpolate" for triangles in space',
            details="See `FieldTransfer.nodal`.",
        ),
    ]
    conservative: Annotated[
        bool,
        Option(
            True,
            "Whether the means over the overlaps are taken for cell fields.",
            details="See `FieldTransfer.cells`.",
        ),
    ]
    keep_integral: Annotated[
        bool, Option(False, "Whether the transfer preserves the integrals of cell fields.")
    ]


class StoppingOptions(TypedDict, total=False):
    """Adaptation."""

    enough: Annotated[
        float,
        Option(
            0.85,
            "The mesh is kept if it already has this share of the next mesh.",
            details="A value above 1 always makes a new mesh.",
        ),
    ]


class NeedOptions(StoppingOptions, total=False):
    """Whether to remesh."""

    least_angle: Annotated[
        float,
        Option(
            5.0,
            "Smallest angle of a triangle, or dihedral angle of a tetrahedron, that is allowed.",
            unit="degrees",
            upper=60.0,
            details="0 accepts all.",
        ),
    ]


class AdaptOptions(
    NumberOptions, LimitOptions, GeneratorOptions, StoppingOptions, TransferOptions, PartsOptions,
    total=False,
):  # fmt: skip
    """Adaptation."""

    tolerance: Annotated[
        float | None,
        Option(None, "Target for the total error, the root of the sum of the squares.", above=True),
    ]
    order: Annotated[
        float,
        Option(
            1.0,
            "The error is proportional to this power of the size.",
            above=True,
            details="See `size_from_error`.",
        ),
    ]
    g: Annotated[
        GradientLimit | Literal["auto"] | None,
        Option(
            "auto",
            "Gradient limit as in `limit_gradient`; None disables it.",
            unusual=10.0,
            type_text='float, array_like, callable, tuple, "auto" or None',
            short="-g",
            details=f'"auto" is {GRADIENT_LIMIT:g}, or {METRIC_GRADIENT_LIMIT:g} of metrics.',
        ),
    ]
    hmin: Annotated[float | None, Option(None, "Smallest size.", unit="length", above=True)]
    hmax: Annotated[float | None, Option(None, "Largest size.", unit="length", above=True)]
    max_refine: Annotated[
        float, Option(4.0, "Largest factor by which ``indicator`` reduces the size.", lower=1.0)
    ]
    max_coarsen: Annotated[
        float,
        Option(
            2.0, "Largest factor by which ``indicator`` increases the size.", lower=1.0, inf=True
        ),
    ]
    boundary_tolerance: Annotated[
        float,
        Option(
            TOLERANCE,
            "Allowed distance of the new boundary from the old one, over the diagonal.",
            above=True,
            upper=1.0,
            details="In space it bounds the sizes at curved boundaries.",
        ),
    ]
    coarsen_converged: Annotated[
        bool,
        Option(False, "Whether to coarsen where possible if the error is within the tolerance."),
    ]
    corner_angle: Annotated[
        float,
        Option(
            CORNER_ANGLE,
            "Angle of boundary facets from which on ``project`` keeps their common nodes.",
            unit="degrees",
        ),
    ]
    anisotropic: Annotated[
        bool | str | Sequence[str],
        Option(
            False,
            "Whether sizes depend on the direction, such that linear elements interpolate "
            "these nodal ``fields`` best: all, or those named; see `metric_from_hessian`.",
            type_text="bool, str or sequence of str",
        ),
    ]
    norm: Annotated[float, Option(2.0, "Norm of that error.", lower=1.0, inf=True)]
    max_aspect: Annotated[
        float, Option(1000.0, "Limit of the aspect ratio then.", lower=1.0, upper=1e15)
    ]


class ClipOptions(TypedDict, total=False):
    """Limits of the sizes."""

    hmin: Annotated[
        float | None,
        Option(None, "Smallest size; it overrides the bound.", unit="length", above=True),
    ]
    hmax: Annotated[float | None, Option(None, "Largest size.", unit="length", above=True)]


class ScaleOptions(ClipOptions, total=False):
    """Sizes scaled to an error or a number of elements."""

    tolerance: Annotated[
        float | None,
        Option(None, "Target for the error.  Either this or ``elements``.", above=True),
    ]
    elements: Annotated[
        float | None,
        Option(None, "Target for the number of elements, after all limits.", lower=1.0),
    ]
    g: Annotated[
        GradientLimit | None,
        Option(
            None,
            "Gradient limit, as in `limit_gradient`, which is then applied to the sizes.",
            unusual=5.0,
            type_text="float, array_like, callable or tuple",
            details="By default the sizes are not limited, so that other bounds can be added "
            "before limiting.",
        ),
    ]
    backend: Annotated[
        str | None,
        Option(
            None,
            'If given, ``elements`` is the number that this mesh generator makes ("mmg", '
            '"tetwild"), see `adaptsize.sizes.predict`.',
            details="Otherwise it is a number of regular simplices.",
        ),
    ]


class ErrorOptions(ScaleOptions, total=False):
    """Sizes from errors."""

    max_refine: Annotated[
        float,
        Option(
            4.0,
            "Largest factor by which sizes may shrink.",
            lower=1.0,
            details="Indicators predict little about much smaller cells at a singular point.",
        ),
    ]
    max_coarsen: Annotated[
        float,
        Option(
            2.0,
            "Largest factor by which sizes may grow.",
            lower=1.0,
            inf=True,
            details="Indicators predict nothing where they are zero.",
        ),
    ]


class HessianOptions(ScaleOptions, total=False):
    """Sizes from second derivatives."""

    norm: Annotated[float, Option(float("inf"), "Norm q of the error.", lower=1.0, inf=True)]


class CurvatureOptions(ClipOptions, total=False):
    """Sizes from curvature."""

    elements_per_radian: Annotated[
        float,
        Option(4.0, "K.  An edge that spans the angle t has 1 / K = 2 sin(t / 2).", above=True),
    ]
    crease_angle: Annotated[
        float,
        Option(
            CREASE_ANGLE,
            "Angle between facets above which their edge is a feature edge (crease), and "
            "between segments above which their node is a corner.",
            unit="degrees",
            upper=180.0,
            details="It must exceed the angle between the facets of a tessellated smooth surface. "
            "Tagged edges of a surface are feature edges at any angle.  With distances it applies "
            "to kinks, and to boundaries that turn by more within one spacing.",
        ),
    ]
    smoothing: Annotated[
        int,
        Option(
            0,
            "Layers of neighbours over which the curvature is averaged; 1 or 2 for scanned "
            "surfaces.",
            details="Distances are averaged this number of times before they are differentiated, "
            "see `adaptsize.geometry.level_set_curvature`: about 16 for images.",
        ),
    ]
    tolerance: Annotated[
        float | None,
        Option(
            None,
            "Distance up to which a node counts as lying on ``boundary``.",
            chosen="0.001 of the diagonal of ``boundary``; on a grid the diagonal of a box, and on "
            "an octree that of the smallest leaf, to include all corners of the boxes that the "
            "boundary passes; with distances two of the largest spacings",
            unit="length",
        ),
    ]
    g: Annotated[
        float,
        Option(
            GRADIENT_LIMIT,
            "Only with distances: the gradient limit that is used afterwards.",
            unusual=5.0,
            upper=STEEPEST,
        ),
    ]


class FeatureOptions(ClipOptions, total=False):
    """Sizes from the local width."""

    elements_across: Annotated[float, Option(4.0, "Number n of elements.", above=True)]
    crease_angle: Annotated[
        float,
        Option(
            CREASE_ANGLE,
            "As for `adaptsize.geometry.boundary_width`.",
            unit="degrees",
            upper=180.0,
            details="Distances on grids have none.",
        ),
    ]
    corner_angle: Annotated[
        float,
        Option(
            CORNER_ANGLE, "As for `adaptsize.geometry.boundary_width`.", unit="degrees", upper=180.0
        ),
    ]
    tolerance: Annotated[
        float | None,
        Option(
            None,
            "Nodes up to this distance outside ``boundary`` get a size too.",
            chosen="the diagonal of the largest box at a node of a grid or an octree, so that all "
            "corners of the boxes that the boundary passes have a size, otherwise 0.001 of the "
            "diagonal of the boundary",
            unit="length",
            details="On a background of lower dimension, only nodes within this distance of "
            "``boundary`` get one.  Only for rays, with ``boundary``.",
        ),
    ]


class PictureOptions(TypedDict, total=False):
    """Picture."""

    path: Annotated[
        str | os.PathLike[str] | None,
        Option(
            None,
            "File to write (.png, .jpg, .tif or .bmp), completely or not at all.",
            type_text="str or path",
        ),
    ]
    clip: Annotated[
        Literal["auto", "x", "y", "z"] | None,
        Option(
            "auto",
            "Axis normal to the plane through the middle at which the mesh is cut.",
            details='The whole cells behind the plane are shown.  "auto" cuts tetrahedra and boxes '
            "in space, such that the section is long.  None shows the whole.",
        ),
    ]
    width: Annotated[
        int,
        Option(
            1600,
            "Width of the picture in pixels.",
            lower=64.0,
            upper=10_000.0,
            details="The height follows from the mesh.",
        ),
    ]


class ScaledPictureOptions(PictureOptions, total=False):
    """Picture with a colour bar."""

    limits: Annotated[
        tuple[float, float] | None,
        Option(
            None,
            "Lowest and highest value of the colour bar, for pictures to be compared; not "
            "for regions.",
            chosen="those of the values",
            type_text="tuple of float",
        ),
    ]


@cache
def options_of(record: type) -> Mapping[str, Option]:
    """Return the options of a record by their names, in the order of the declaration."""
    options = {}
    for name, kind in get_type_hints(record, include_extras=True).items():
        types, option = get_args(kind)
        members = get_args(types)
        optional = NoneType in members
        if optional:
            rest = tuple(member for member in members if member is not NoneType)
            types = rest[0] if len(rest) == 1 else types
        options[name] = replace(
            option, name=name, type=types, optional=optional, group=_group_of(name, option)
        )
    return options


def _group_of(name: str, option: Option) -> str:
    """Return the title of the first record with an option."""
    for record in _GROUPS:
        kind = record.__annotations__.get(name)
        if kind is not None and option in get_args(kind):
            return (record.__doc__ or "").split(".", maxsplit=1)[0]
    return "Options"


#: Records that declare options; their titles are those of the groups on the command line.
_GROUPS: tuple[type, ...] = (
    SizeOptions,
    BudgetOptions,
    ImageOptions,
    LimitOptions,
    MeshOptions,
    PartsOptions,
    RemeshOptions,
    DistanceOptions,
    ImageMeshOptions,
    StoppingOptions,
    NeedOptions,
    FamilyOptions,
    AdaptOptions,
    ClipOptions,
    ScaleOptions,
    ErrorOptions,
    HessianOptions,
    CurvatureOptions,
    FeatureOptions,
    PictureOptions,
    ScaledPictureOptions,
)


def checked(record: type[R], given: Mapping[str, Any]) -> R:
    """Return the options of a record, checked; those that are not given have their defaults.

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
            raise TypeError(f"unexpected option {name!r}: {hint}")
    values = {
        name: option.check(given.get(name, option.default)) for name, option in options.items()
    }
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
                lines[number] = "\n".join(option.as_doc(indent) for option in options.values())
        function.__doc__ = "\n".join(lines)
        function.__options__ = record  # type: ignore[attr-defined]
        return function

    return decorate
