"""The options of the public functions, each declared once: default, range, unit and text.

A record is a `TypedDict` whose fields are annotated with an `Option`.  From it follow the check of
what is given (`checked`), the signature and the docstring of the function (`with_options`), the
options of the command line and of its files, and the test that wrong values are refused.  To add
an option, declare it in the file of its subject and use it in the function.
"""

from adaptsize.options.bounds import (
    ClipOptions,
    CurvatureOptions,
    ErrorOptions,
    FeatureOptions,
    HessianOptions,
    ScaleOptions,
)
from adaptsize.options.checking import checked, refuse_unused
from adaptsize.options.entrances import DOMAINS, ENTRANCES, entrances_with, joined
from adaptsize.options.loops import AdaptOptions, NeedOptions, StoppingOptions, TransferOptions
from adaptsize.options.meshes import (
    DetailOptions,
    DistanceOptions,
    FamilyOptions,
    GeneratorOptions,
    ImageMeshOptions,
    LimitOptions,
    MeshOptions,
    PartsOptions,
    RemeshOptions,
    RemeshToElementsOptions,
)
from adaptsize.options.option import Option
from adaptsize.options.pictures import PictureOptions, ScaledPictureOptions
from adaptsize.options.records import check_fields, options_of
from adaptsize.options.signatures import with_options
from adaptsize.options.sizes import (
    BoundOptions,
    BudgetOptions,
    CapOptions,
    CreaseOptions,
    ElementsOptions,
    FunctionSizeOptions,
    ImageOptions,
    ImageSizeOptions,
    MeshSizeOptions,
    NamedPartOptions,
    NumberOptions,
    SizeFunctionOptions,
    SizeOptions,
)

__all__ = [
    "DOMAINS",
    "ENTRANCES",
    "AdaptOptions",
    "BoundOptions",
    "BudgetOptions",
    "CapOptions",
    "ClipOptions",
    "CreaseOptions",
    "CurvatureOptions",
    "DetailOptions",
    "DistanceOptions",
    "ElementsOptions",
    "ErrorOptions",
    "FamilyOptions",
    "FeatureOptions",
    "FunctionSizeOptions",
    "GeneratorOptions",
    "HessianOptions",
    "ImageMeshOptions",
    "ImageOptions",
    "ImageSizeOptions",
    "LimitOptions",
    "MeshOptions",
    "MeshSizeOptions",
    "NamedPartOptions",
    "NeedOptions",
    "NumberOptions",
    "Option",
    "PartsOptions",
    "PictureOptions",
    "RemeshOptions",
    "RemeshToElementsOptions",
    "ScaleOptions",
    "ScaledPictureOptions",
    "SizeFunctionOptions",
    "SizeOptions",
    "StoppingOptions",
    "TransferOptions",
    "check_fields",
    "checked",
    "entrances_with",
    "joined",
    "options_of",
    "refuse_unused",
    "with_options",
]
