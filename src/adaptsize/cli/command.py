"""Commands from functions: options from records, groups in the help, and values as given."""

import functools
import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, cast, get_origin

import typer
from typer.core import TyperCommand

from adaptsize.cli.console import Console
from adaptsize.cli.options import COMMANDS, commands_with, own
from adaptsize.cli.provenance import TypedCommand, writes_file
from adaptsize.cli.values import given_values
from adaptsize.options import Option, options_of

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


class GroupedCommand(TyperCommand):
    """A command whose help lists the options in named groups."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse what is typed.  Of an option that others have, the error names these."""
        try:
            return super().parse_args(ctx, args)
        except Exception as error:  # typer vendors the class that click has
            typed = getattr(error, "option_name", None)
            having = commands_with(typed.partition("=")[0]) if isinstance(typed, str) else ""
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
    options = _listed(listed, without.split())
    general = (*_GENERAL, _OPTIONS_FILE) if options else _GENERAL
    listed_flags = {option.name: option.flags[-1] for option in (*options.values(), *general)}
    flags = {"output": "--output", "path": "--output", "sources": "--source"} | listed_flags

    def decorate(function: Callable[..., int]) -> Callable[..., int]:
        COMMANDS[function.__name__] = options

        @functools.wraps(function)
        def run(*, context: typer.Context, **values: Any) -> int:
            console: Console = context.obj
            name = str(context.info_name)
            shared = {option.name: values.pop(option.name) for option in general}
            typed = {option: values.pop(option) for option in options}
            file = shared.get("options")
            console.configure(name, flags, shared)
            if "output" in values:
                every = {**options, "options": _OPTIONS_FILE}
                with_file = {**typed, "options": file}
                console.request = TypedCommand.of(name, values["file"], with_file, every)
            if options:
                values["given"] = given_values(typed, file, options)
            if console.only is not None:
                values |= _writing_only(console.only, values, options)
            if "file" in values:
                console.record(input=str(values["file"]))
            with console.messages_of_generators():
                code = function(console, **values)
            console.finish()
            return code

        in_order = sorted(options.values(), key=lambda option: option.group != "Output")
        signature = _signature(function, (*in_order, *general))
        run.__signature__ = signature  # type: ignore[attr-defined]
        run.__annotations__ = {p.name: p.annotation for p in signature.parameters.values()}
        return run

    return decorate


def _writing_only(
    file: Path, values: Mapping[str, Any], options: Mapping[str, Option]
) -> dict[str, Any]:
    """Return the output, and the given options without those that name files to write."""
    given = values["given"].items()
    kept = {k: v for k, v in given if k not in options or not writes_file(options[k])}
    return {"output": file, "given": MappingProxyType(kept)}


def _listed(listed: tuple[type | Option, ...], without: list[str]) -> dict[str, Option]:
    """Return options and those of records by their names, with the types that are typed."""
    options: dict[str, Option] = {}
    for item in listed:
        options |= {item.name: item} if isinstance(item, Option) else options_of(item)
    for name in without:
        del options[name]
    for name in _KINDS.keys() & options.keys():
        options[name] = replace(options[name], type=_KINDS[name])
    return options


def _signature(function: Callable[..., int], options: Iterable[Option]) -> inspect.Signature:
    """Return the parameters from which typer makes a command: arguments, then options."""
    keyword = inspect.Parameter.KEYWORD_ONLY
    own = inspect.signature(function, eval_str=True)
    parameters = [
        inspect.Parameter("context", keyword, annotation=typer.Context),
        *(
            parameter.replace(kind=keyword)
            for name, parameter in own.parameters.items()
            if name not in ("console", "given")
        ),
        *map(_as_parameter, options),
    ]
    return own.replace(parameters=parameters)


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
