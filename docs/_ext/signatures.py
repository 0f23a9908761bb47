"""A page of all public functions and classes with their parameters, made from the signatures."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

NAME = re.compile(r"^   ([A-Za-z_.]+)$", re.MULTILINE)
HEAD = """\
# Functions and their parameters

All public functions, generated from their signatures. Parameters after `*` are passed by name;
parameters without a default are required. The links lead to the explanations.
"""


def page(reference: Path) -> str:
    """Return the page on the names that the reference lists, one table for each module."""
    modules: dict[str, list[str]] = {}
    for listed in NAME.findall(reference.read_text(encoding="utf-8")):
        module, _, name = f"adaptsize.{listed}".rpartition(".")
        modules.setdefault(module, []).extend(_rows(module, name))
    parts = [HEAD]
    for module, rows in modules.items():
        if rows:
            table = "\n".join(["| name | parameters | |", "|---|---|---|", *rows])
            parts.append(f"## {module}\n\n{table}\n")
    return "\n".join(parts)


def _rows(module: str, name: str) -> Iterator[str]:
    """Yield the rows of a function, or of a class and its methods; none of errors."""
    found = getattr(importlib.import_module(module), name)
    if not inspect.isclass(found):
        yield _row(f"{{py:func}}`{name} <{module}.{name}>`", found, found)
        return
    if issubclass(found, BaseException):
        return
    if "__init__" in vars(found) and not getattr(found, "_is_protocol", False):
        yield _row(f"{{py:class}}`{name} <{module}.{name}>`", found, found)
    for method, value in vars(found).items():
        function = getattr(found, method, None)
        is_method = inspect.isfunction(function) or inspect.ismethod(function)
        if is_method and not method.startswith("_") and function.__doc__:
            link = f"{{py:meth}}`{name}.{method} <{module}.{name}.{method}>`"
            yield _row(link, function, value)


def _row(link: str, function: Callable[..., Any], as_defined: Any) -> str:
    signature = inspect.signature(function)
    bound = inspect.isfunction(as_defined) and "." in as_defined.__qualname__
    listed = parameters_of(signature, skip=1 if bound else 0)
    summary = (inspect.getdoc(function) or "").split("\n\n")[0].replace("\n", " ")
    return f"| {link} | {listed} | {_plain(summary)} |"


def parameters_of(signature: inspect.Signature, *, skip: int = 0) -> str:
    """Return the parameters as code, with their defaults."""
    listed, only_by_name = [], False
    for parameter in list(signature.parameters.values())[skip:]:
        if parameter.kind is parameter.VAR_POSITIONAL:
            only_by_name = True
            listed.append(f"`*{parameter.name}`")
            continue
        if parameter.kind is parameter.KEYWORD_ONLY and not only_by_name:
            only_by_name = True
            listed.append("`*`")
        text = parameter.name
        if parameter.kind is parameter.VAR_KEYWORD:
            text = f"**{text}"
        if parameter.default is not parameter.empty:
            default = repr(parameter.default)
            text += f"={default if len(default) <= 30 else '...'}"
        listed.append(f"`{text}`".replace("|", "\\|"))
    return ", ".join(listed)


def _plain(text: str) -> str:
    """Return a line of a docstring without markup that Markdown would take otherwise."""
    text = re.sub(r"\s*\[\d+\]_", "", text)  # marks of references
    return re.sub(r"`+", "`", text).replace("|", "\\|")
