"""Mesh quality, and conformity of a mesh with a size function.

Names are imported on first use, since a summary needs little of it.
"""

from typing import TYPE_CHECKING

from adaptsize._lazy import lazily

if TYPE_CHECKING:
    from adaptsize.quality.certificate import check_mesh
    from adaptsize.quality.conformity import size_conformity

_HOMES = {
    "check_mesh": "certificate",
    "size_conformity": "conformity",
}

__all__ = [
    "check_mesh",
    "size_conformity",
]

__getattr__, __dir__ = lazily(__name__, _HOMES)
