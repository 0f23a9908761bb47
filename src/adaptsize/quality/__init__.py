"""Mesh quality, and conformity of a mesh with a size function.

Names are imported on first use, since a summary needs little of it.
"""

from adaptsize._lazy import lazily

_HOMES = {
    "check_mesh": "certificate",
    "size_conformity": "conformity",
}

__all__ = [*_HOMES]  # noqa: PLE0604 - the keys are strings

__getattr__, __dir__ = lazily(__name__, _HOMES)
