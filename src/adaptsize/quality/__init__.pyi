"""The names of `adaptsize.quality` for type checkers; tests/test_types.py writes this file."""

from adaptsize.quality.certificate import check_mesh as check_mesh
from adaptsize.quality.conformity import size_conformity as size_conformity

__all__ = [
    "check_mesh",
    "size_conformity",
]
