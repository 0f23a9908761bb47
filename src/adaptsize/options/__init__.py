"""The options of the public functions, each declared once: default, range, unit and text.

A record is a `TypedDict` whose fields are annotated with an `Option`.  From it follow the check of
what is given (`checked`), the signature and the docstring of the function (`with_options`), the
options of the command line and of its files, and the test that wrong values are refused.  To add
an option, declare it in the file of its subject and use it in the function.

The records here are those of public functions.  Those that they are composed of, and what the
command line needs, are imported from their files.
"""

from adaptsize.options.bounds import CurvatureOptions, ErrorOptions, FeatureOptions, HessianOptions
from adaptsize.options.checking import checked
from adaptsize.options.loops import AdaptOptions, NeedOptions, TransferOptions
from adaptsize.options.meshes import (
    DistanceOptions,
    FamilyOptions,
    ImageMeshOptions,
    RemeshOptions,
    RemeshToElementsOptions,
)
from adaptsize.options.option import Option
from adaptsize.options.pictures import PictureOptions, ScaledPictureOptions
from adaptsize.options.records import options_of
from adaptsize.options.signatures import with_options
from adaptsize.options.sizes import SizeFunctionOptions

__all__ = [
    "AdaptOptions",
    "CurvatureOptions",
    "DistanceOptions",
    "ErrorOptions",
    "FamilyOptions",
    "FeatureOptions",
    "HessianOptions",
    "ImageMeshOptions",
    "NeedOptions",
    "Option",
    "PictureOptions",
    "RemeshOptions",
    "RemeshToElementsOptions",
    "ScaledPictureOptions",
    "SizeFunctionOptions",
    "TransferOptions",
    "checked",
    "options_of",
    "with_options",
]
