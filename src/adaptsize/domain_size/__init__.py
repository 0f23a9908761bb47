"""The complete size function: curvature, feature size and sources, with gradient limiting."""

from adaptsize.domain_size.api import size_function
from adaptsize.domain_size.elements import MeshOfElements, remesh_to_elements
from adaptsize.domain_size.images import mesh_image, size_function_from_image
from adaptsize.domain_size.report import SizeReport

__all__ = [
    "MeshOfElements",
    "SizeReport",
    "mesh_image",
    "remesh_to_elements",
    "size_function",
    "size_function_from_image",
]
