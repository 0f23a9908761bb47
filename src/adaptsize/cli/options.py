"""The options of the commands: those of the library, declared there, those of files, and sources.

A command takes only what is given, on the command line or in a file; defaults are the library's.
"""

import functools
import inspect
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, TypeAlias, cast, get_args, get_origin

import numpy as np
import typer
from typer.core import TyperCommand

from adaptsize._checks import refusal
from adaptsize._messages import Message, message_of
from adaptsize.cli.console import Console
from adaptsize.cli.provenance import TypedCommand
from adaptsize.errors import OptionError
from adaptsize.options import Option, joined, options_of

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

#: The options that a user gives, by their names.  Nothing changes them.
Given: TypeAlias = Mapping[str, Any]

#: Suffixes of texts with one point per line.
_TEXTS = (".txt", ".csv", ".dat", ".xy", ".xyz")
_FORMS = (
    "point:x,y,z=h, curve:x0,y0,z0:x1,y1,z1:...=h, curve:FILE=h, ball:x,y,z,r=h, "
    "box:x0,y0,z0,x1,y1,z1=h, boundary[:name]=h, region:name=h"
)


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
    f"{_FORMS}; may be repeated.  In the plane without z.  FILE: segments, or a point per line.",
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
_GENERAL = (
    own("General", "json", bool, "Print one JSON object and no other results."),
    own("General", "quiet", bool, "Print errors only.", short="-q"),
    own(
        "General", "verbose", bool, short="-v",
        text="Also print times of steps and messages of mesh generators.",
    ),
)  # fmt: skip
_OPTIONS_FILE = own(
    "General", "options", Path,
    "Read options from this TOML file; the command line wins.",
)  # fmt: skip
#: Width of the names of options in the help.  Longer ones have a line of their own.
_COLUMN = 22
#: Types of options for which Python takes several kinds of values.
_KINDS = {"label": list[int], "spacing": list[float], "g": float}


#: Finds the class whether typer vendors click or imports it.
_USAGE_ERROR = cast("type[typer.BadParameter]", typer.BadParameter.__bases__[0])
#: The options of each command, by their names.
COMMANDS: dict[str, Mapping[str, Option]] = {}


def _commands_with(word: str) -> str:
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


class GroupedCommand(TyperCommand):
    """A command whose help lists the options in named groups."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse what is typed.  Of an option that others have, the error names these."""
        try:
            return super().parse_args(ctx, args)
        except Exception as error:  # typer vendors the class that click has
            typed = getattr(error, "option_name", None)
            having = _commands_with(typed.partition("=")[0]) if isinstance(typed, str) else ""
            if not (having and hasattr(error, "possibilities")):
                raise
            raise _USAGE_ERROR(f"No such option: {typed}: it is of {having}.", ctx) from error

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments and the groups of options."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            kind = "Arguments" if parameter.param_type_name == "argument" else "General"
            row = parameter.get_help_record(ctx)
            if row is not None:
                title = getattr(parameter, "rich_help_panel", None) or kind
                groups.setdefault(title, []).append(row)
        for title, rows in groups.items():
            with formatter.section(title):
                formatter.write_dl(rows, col_max=_COLUMN)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write what the brackets are."""
        formatter.write_paragraph()
        formatter.write_text("Defaults are in brackets.")


def command(
    *listed: type | Option, without: str = ""
) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Return a decorator that makes a command of a function.

    Parameters
    ----------
    *listed : records and options
        The options of the command.
    without : str
        Names of options of the records that the command does not have.

    Notes
    -----
    The function takes a `Console`, the arguments in its signature, and, if the command has
    options, ``given``: those that the user gives, checked, by their names, read-only.  Instead of
    the texts of ``source``, it has the ``sources``.  It returns the exit code.
    """
    options: dict[str, Option] = {}
    for item in listed:
        options |= {item.name: item} if isinstance(item, Option) else options_of(item)
    for name in without.split():
        del options[name]
    for name in _KINDS.keys() & options.keys():
        options[name] = replace(options[name], type=_KINDS[name])
    general = (*_GENERAL, _OPTIONS_FILE) if options else _GENERAL
    listed_flags = {option.name: option.flags[-1] for option in (*options.values(), *general)}
    flags = {"output": "--output", "path": "--output", "sources": "--source"} | listed_flags

    def decorate(function: Callable[..., int]) -> Callable[..., int]:
        COMMANDS[function.__name__] = options

        @functools.wraps(function)
        def run(*, context: typer.Context, **values: Any) -> int:
            console: Console = context.obj
            shared = {option.name: values.pop(option.name) for option in general}
            file = shared.get("options")
            console.configure(str(context.info_name), flags, shared)
            typed = {name: values.pop(name) for name in options}
            if "output" in values:
                every = {**options, "options": _OPTIONS_FILE}
                console.request = TypedCommand.of(
                    str(context.info_name), values["file"], {**typed, "options": file}, every
                )
            if options:
                given = {} if file is None else _read_options(file, options)
                for name, other in (("g", "growth"), ("growth", "g")):
                    if typed.get(name) is not None:  # the command line wins
                        given.pop(other, None)
                given |= {
                    name: _as_value(options[name], value)
                    for name, value in typed.items()
                    if value is not None and value is not False and value != []
                }
                if "source" in given:
                    given["sources"] = [parse_source(text) for text in given.pop("source")]
                values["given"] = MappingProxyType(given)
            if "file" in values:
                console.record(input=str(values["file"]))
            with console.messages_of_generators():
                code = function(console, **values)
            console.finish()
            return code

        in_order = sorted(options.values(), key=lambda option: option.group != "Output")
        own_signature = inspect.signature(function, eval_str=True)
        keyword = inspect.Parameter.KEYWORD_ONLY
        parameters = [
            inspect.Parameter("context", keyword, annotation=typer.Context),
            *(
                parameter.replace(kind=keyword)
                for name, parameter in own_signature.parameters.items()
                if name not in ("console", "given")
            ),
            *map(_as_parameter, (*in_order, *general)),
        ]
        run.__signature__ = own_signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {p.name: p.annotation for p in parameters}
        return run

    return decorate


def _as_parameter(option: Option) -> inspect.Parameter:
    """Return the parameter from which typer makes an option."""
    kind, metavar = option.type, option.metavar
    if get_origin(kind) is list:
        metavar = option.name.upper()
    if kind is Path:
        metavar = "FILE"
    elif kind not in (float, int, bool, list[int], list[str]):
        kind = str
    if get_origin(option.type) is Mapping:
        kind, metavar = list[str], "NAME=SIZE"
    required = option.default is ...
    shown = typer.Option(
        *option.flags,
        metavar=None if kind is bool else metavar,
        help=(option.text if required else option.help).replace("`", ""),
        show_default=False,
        rich_help_panel=option.group,
        autocompletion=_backends if option.name == "backend" else lambda: list(option.choices),
    )
    return inspect.Parameter(
        option.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=inspect.Parameter.empty if required else None,
        annotation=Annotated[kind if required else kind | None, shown],
    )


def _backends() -> list[str]:
    from adaptsize.remeshing import available_backends

    return ["auto", *available_backends()]


def _as_value(option: Option, value: Any) -> Any:
    """Return the checked value of an option, typed or from a file."""
    kind = option.type
    if kind == list[float] and isinstance(value, str):
        try:
            value = [float(part) for part in value.split(",")]
        except ValueError as error:
            text = f"must be one number or several such as 1,1,2.5, got {value!r}"
            raise refusal(option.name, text) from error
        return value[0] if len(value) == 1 else value
    if kind in (list[int], list[str]):
        (member,) = get_args(kind)
        items = value if isinstance(value, list) else [value]
        if not all(type(item) is member for item in items):
            raise refusal(option.name, f"must be one or several of type {member.__name__}")
        return items
    if get_origin(kind) is Mapping and isinstance(value, list):
        pairs = [text.rpartition("=") for text in value]
        try:
            return {name: float(size) for name, _, size in pairs}
        except ValueError as error:
            raise refusal(option.name, f"must be NAME=SIZE, got {value}") from error
    if kind in (str, Path) and not isinstance(value, str | Path):
        raise refusal(option.name, f"must be a text, got {value!r}")
    return Path(value) if kind is Path else option.check(value)


def _read_options(file: Path, options: Mapping[str, Option]) -> dict[str, Any]:
    """Return the options in a TOML file, checked.  Dashes in their names are underscores."""
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"{file}: {error.strerror}") from error
    except ValueError as error:
        raise ValueError(f"{file}: is not TOML: {error}") from error
    given = {}
    for key, value in table.items():
        name = key.replace("-", "_")
        if name not in options:
            close = get_close_matches(name, options, n=1)
            hint = f"did you mean {close[0]!r}?" if close else "the command's help lists them"
            having = _commands_with(name)
            hint = f"it is of {having}" if having else hint
            raise OptionError(f"{file}: unknown option {key!r}: {hint}", ["options"])
        try:
            given[name] = _as_value(options[name], value)
        except OptionError as error:
            text = Message("{}: {}", file, message_of(error))
            raise OptionError(text, error.options) from error
    return given


def parse_source(text: str) -> Any:
    """Return the source that ``text`` describes.

    The file of a curve is a mesh of segments, or a text with one point per line, joined in this
    order.

    Raises
    ------
    ValueError
        If the text has none of the known forms, or the file of a curve cannot be read.

    Examples
    --------
    >>> parse_source("ball:0,0,0,2=0.1").radius
    2.0
    >>> parse_source("boundary:3=0.5").tags
    3
    >>> parse_source("region:inlet pipe=0.5").tags
    'inlet pipe'
    >>> parse_source("curve:0,0:1,0:1,1=0.1").curve.tolist()
    [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
    """
    from adaptsize import sizes

    what, _, size_text = text.rpartition("=")
    kind, _, where = what.partition(":")
    unknown = refusal("source", f"must be one of {_FORMS}; got {text!r}")
    by_tag = kind in ("boundary", "region") and where != ""
    try:
        size = float(size_text)
        of_curve = kind == "curve" and where != ""
        is_text = of_curve or by_tag or not where
        numbers = [] if is_text else [float(word) for word in where.split(",")]
    except ValueError:
        raise unknown from None
    curve = _curve(where) if of_curve else None
    try:
        match kind, len(numbers):
            case "curve", 0 if curve is not None:
                return sizes.CurveSource(curve, size)
            case "point", 2 | 3:
                return sizes.PointSource(numbers, size)
            case "ball", 3 | 4:
                return sizes.BallSource(numbers[:-1], numbers[-1], size)
            case "box", 4 | 6 as n:
                return sizes.BoxSource(numbers[: n // 2], numbers[n // 2 :], size)
            case "boundary", 0:
                return sizes.BoundarySource(size, tags=_tag(where) if by_tag else None)
            case "region", 0 if by_tag:
                return sizes.RegionSource(_tag(where), size)
    except ValueError as error:
        raise refusal("source", f"{text}: {error}") from error
    raise unknown


def _tag(text: str) -> int | str:
    """Return a tag: its number, or its name."""
    try:
        return int(text)
    except ValueError:
        return text.strip()


def _curve(where: str) -> Any:
    """Return the points of a curve, given as they are or in a text, or the segments in a file."""
    from adaptsize.errors import MeshFileError
    from adaptsize.io import read

    path = Path(where)
    of_text = path.suffix.lower() in _TEXTS
    rows = [point.split(",") for point in where.split(":")]
    if of_text:
        try:
            lines = path.read_text().replace(",", " ").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "is not a text"
            raise MeshFileError(f"{path}: {reason}") from error
        rows = [words for line in lines if (words := line.partition("#")[0].split())]
    try:
        points = [[float(word) for word in row] for row in rows]
    except ValueError as error:
        if not of_text:
            return read(path, kind="segments")
        raise MeshFileError(f"{path}: {error}, where a line must be a point") from error
    dims = {len(point) for point in points}
    if len(points) < 2 or dims not in ({2}, {3}):
        got = f"{len(points)} points of {' or '.join(map(str, sorted(dims)))} coordinates"
        fault = f"{where}: a curve must have at least 2 points of 2 or 3 coordinates, got {got}"
        raise MeshFileError(fault) if of_text else refusal("source", f"curve:{fault}")
    return np.array(points)
