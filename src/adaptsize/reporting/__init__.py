"""Reports on a mesh: the comparison with the request, and a page to look at.

Names are imported on first use: the command line needs the comparison only.
"""

from adaptsize._lazy import lazily

_HOMES = {"report": "page"}

__all__ = [*_HOMES]  # noqa: PLE0604 - the keys are strings

__getattr__, __dir__ = lazily(__name__, _HOMES)
