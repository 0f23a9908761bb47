"""The options that only the command line has; those of the library are declared there.

A command takes only what is given, on the command line or in a file; defaults are the library's.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import typer

from adaptsize.cli.sources import FORMS
from adaptsize.options import Option
from adaptsize.options.entrances import joined

#: The options that a user gives, by their names.  Nothing changes them.
Given: TypeAlias = Mapping[str, Any]


def _input(text: str) -> Any:
    return typer.Argument(metavar="FILE", help=text)


Input = Annotated[Path, _input("Mesh: STL, VTU, .msh, .mesh, ...")]
ImageFile = Annotated[Path, _input("Image: PNG, TIFF, NIfTI, NRRD, .npy, .npz")]
AnyFile = Annotated[Path, _input("Mesh: STL, VTU, .msh ...; or image: PNG, TIFF, NIfTI, NRRD ...")]


def _output(text: str) -> Any:
    return typer.Option("-o", "--output", metavar="FILE", rich_help_panel="Output", help=text)


MeshOutput = Annotated[
    Path,
    _output(
        "Mesh to write: .vtu, .vtk, .xdmf, .msh, .mesh (with a .sol), .inp (Abaqus), .bdf "
        "(Nastran) or .su2; triangles also .ply, .stl, .obj or .off."
    ),
]
SizesOutput = Annotated[
    Path,
    _output(
        "File to write: .vtu, .vtk, .xdmf, .msh, .ply; .pos (for Gmsh), .sol (for Mmg) or .jig.msh "
        "(for JIGSAW); .vti for images."
    ),
]


def own(group: str, name: str, kind: Any, text: str, **more: Any) -> Option:
    """Return an option that only the command line has."""
    return Option(group=group, name=name, type=kind, text=text, **{"default": None} | more)


FIELD = own(
    "Sizes", "field", str,
    "Nodal field with upper bounds.  Others are used only if requested.",
)  # fmt: skip
METRIC = own(
    "Sizes", "metric", str,
    "Sizes by direction: a nodal field of matrices, or a .sol file.",
)  # fmt: skip
SOURCE = own(
    "Sizes", "source", list[str],
    f"{FORMS}; may be repeated.  In the plane without z.  FILE: segments, or a point per line.",
)  # fmt: skip
PERIODIC = own(
    "Mesh generator", "periodic", list[str],
    "Translation X,Y,Z between matching sides; repeatable.",
)  # fmt: skip
PLOT = own("Output", "plot", Path, "Also draw the result (.png).")
REPORT = own("Output", "report", Path, "Also write a page with the mesh in 3-D (.html).")
TAGS = own("General", "tags", str, "Cell field with the tags.")
KEEP_SLITS = own(
    "General", "keep_slits", bool, "Keep nodes at one place if most facets are double."
)
FACES = own(
    "Output", "faces", bool, "Tag the faces of a surface between its feature edges: face 1, ..."
)
FIELDS = own(
    "Output", "fields", Literal["all", "none"], default="all",
    text="Fields of the file to transfer: all or none.",
)  # fmt: skip
#: Of commands that read a mesh.
READING = (TAGS, KEEP_SLITS)
#: And of those that read files of polygons.
OF_POLYGONS = (
    replace(
        own(
            "General", "least_width", float,
            "Of polygons: leave out narrower parts.",
        ),
        above=True,
    ),
    own(
        "General", "box", list[float],
        "x0,y0,x1,y1: a box that polygons are land in.",
    ),
)  # fmt: skip
ORDER = replace(
    own(
        "Output", "order", int, default=1,
        text="2 adds a node in the middle of each edge, which stays straight: .inp, .msh, .vtu, "
        ".vtk, .bdf.",
    ),
    lower=1, upper=2,
)  # fmt: skip
#: Names of the options with which a mesh is read.
_OF_READING = tuple(option.name for option in (*READING, *OF_POLYGONS))
#: The options of each command, by their names.
COMMANDS: dict[str, Mapping[str, Option]] = {}


def commands_with(word: str) -> str:
    """Return in words which commands have an option, typed or by its name; empty if none has."""
    having = [
        command
        for command, options in COMMANDS.items()
        if any(word in (option.name, *option.flags) for option in options.values())
    ]
    return joined(sorted(having))


def reading(given: Given) -> dict[str, Any]:
    """Return the options with which a mesh is read."""
    return {name: given[name] for name in _OF_READING if name in given}


def of_library(given: Given, *own: str) -> dict[str, Any]:
    """Return the options for functions of the library: all but some, and those of reading."""
    return {name: value for name, value in given.items() if name not in (*own, *_OF_READING)}
