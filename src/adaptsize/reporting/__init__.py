"""Reports on a mesh: the comparison with the request, and a page to look at.

Names are imported on first use: the command line needs the comparison only.
"""

from importlib import import_module
from typing import Any

__all__ = ["report"]


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    if name != "report":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module(f"{__name__}.api").report


def __dir__() -> list[str]:
    return list(__all__)
