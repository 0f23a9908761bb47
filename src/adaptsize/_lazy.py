"""Public names that a package imports on first use (PEP 562)."""

import sys
from importlib import import_module

TYPE_CHECKING = False  # typing itself is not imported, to be quick
if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from typing import Any


def lazily(
    package: str, homes: "Mapping[str, str]", submodules: "Sequence[str]" = ()
) -> "tuple[Callable[[str], Any], Callable[[], list[str]]]":
    """Return ``__getattr__`` and ``__dir__`` of a package.

    Parameters
    ----------
    package : str
    homes : mapping of str to str
        For each public name, the module of the package to import it from.
    submodules : sequence of str
        Modules that are public names themselves.
    """

    def get(name: str) -> "Any":
        if name in submodules:
            return import_module(f"{package}.{name}")
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(f"{package}.{homes[name]}"), name)
        setattr(sys.modules[package], name, value)
        return value

    def names() -> list[str]:
        own = {name for name in vars(sys.modules[package]) if name.startswith("__")}
        return sorted({*own, *homes, *submodules})

    return get, names
