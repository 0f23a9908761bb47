"""Reports on a mesh: the comparison with the request, and a page to look at.

Names are imported on first use: the command line needs the comparison only.
"""

from adaptsize._lazy import lazily

__all__ = ["report"]

__getattr__, __dir__ = lazily(__name__, {"report": "page"})
