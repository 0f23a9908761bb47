"""Values of options as they are typed, or in a file of options."""

import math
import sys
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from types import MappingProxyType
from typing import Any, get_args, get_origin

from adaptsize._checks import refusal
from adaptsize._messages import Message, message_of
from adaptsize.cli.options import Given, commands_with
from adaptsize.cli.sources import parse_source
from adaptsize.errors import OptionError
from adaptsize.options import Option

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


def given_values(
    typed: Mapping[str, Any], file: Path | None, options: Mapping[str, Option]
) -> Given:
    """Return the options that are typed, or in a file, checked; the command line wins.

    Instead of the texts of ``source`` there are ``sources``, and ``periodic`` has numbers.
    """
    given = {} if file is None else read_options(file, options)
    for name, other in (("g", "growth"), ("growth", "g")):
        if typed.get(name) is not None:
            given.pop(other, None)
    given |= {
        name: as_value(options[name], value)
        for name, value in typed.items()
        if value is not None and value is not False and value != []
    }
    if "source" in given:
        given["sources"] = [parse_source(text) for text in given.pop("source")]
    if "periodic" in given:
        given["periodic"] = _translations(given["periodic"])
    return MappingProxyType(given)


def _translations(texts: list[str]) -> list[list[float]]:
    """Return the translations that are given as texts."""
    try:
        found = [[float(part) for part in text.split(",")] for text in texts]
    except ValueError as error:
        raise refusal("periodic", f"must be X,Y or X,Y,Z, got {texts}") from error
    if len({len(one) for one in found}) > 1:
        raise refusal("periodic", f"must have as many numbers each time, got {texts}")
    if not all(math.isfinite(number) for one in found for number in one):
        raise refusal("periodic", f"must be finite, got {texts}")
    return found


def as_value(option: Option, value: Any) -> Any:
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


def read_options(file: Path, options: Mapping[str, Option]) -> dict[str, Any]:
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
            having = commands_with(name)
            hint = f"it is of {having}" if having else hint
            raise OptionError(f"{file}: unknown option {key!r}: {hint}", ["options"])
        try:
            given[name] = as_value(options[name], value)
        except OptionError as error:
            text = Message("{}: {}", file, message_of(error))
            raise OptionError(text, error.options) from error
    return given
