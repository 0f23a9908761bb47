"""The options of a record, with their texts.

The texts are in the docstrings of the records, where editors and the documentation show them, and
not a second time in the declarations.  A docstring is a title, an empty line, and for each option
its name and indented lines: the first sentence is the text, the others are its details.
"""

import inspect
import re
from collections.abc import Hashable, Mapping
from dataclasses import replace
from functools import cache
from types import NoneType
from typing import Any, cast, get_args, get_type_hints, is_typeddict

from adaptsize.options import bounds, loops, meshes, pictures, sizes
from adaptsize.options.option import Option


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


#: Where records are declared.
_RECORDS = (sizes, meshes, bounds, loops, pictures)


def _texts_of(record: type) -> dict[str, dict[str, str]]:
    """Return the text, the details and the group of each option, from docstrings of records."""
    items = record.__annotations__.items()
    known = [value for module in _RECORDS for value in vars(module).values()]
    bases = [b for b in known if is_typeddict(b) and b.__annotations__.items() <= items]
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
