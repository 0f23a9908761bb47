"""The signature and the docstring of a function with options."""

import inspect
import textwrap
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from adaptsize.options.option import Option
from adaptsize.options.records import options_of

F = TypeVar("F", bound=Callable[..., Any])


_WIDTH = 100  # of a docstring


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
