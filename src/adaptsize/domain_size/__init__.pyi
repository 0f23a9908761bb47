"""The names of `adaptsize.domain_size` for type checkers; tests/test_types.py writes this file."""

from adaptsize.domain_size.complete_size import size_function as size_function
from adaptsize.domain_size.elements import remesh_to_elements as remesh_to_elements
from adaptsize.domain_size.family import mesh_family as mesh_family
from adaptsize.domain_size.images import mesh_image as mesh_image
from adaptsize.domain_size.sparse import SparseSize as SparseSize

__all__ = [
    "SparseSize",
    "mesh_family",
    "mesh_image",
    "remesh_to_elements",
    "size_function",
]
