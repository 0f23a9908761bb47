"""The complete size function: curvature, feature size and sources, with gradient limiting."""

from adaptsize._size_report import SizeReport
from adaptsize.domain_size.complete_size import size_function
from adaptsize.domain_size.elements import MeshOfElements, remesh_to_elements
from adaptsize.domain_size.images import mesh_image

__all__ = ["MeshOfElements", "SizeReport", "mesh_image", "remesh_to_elements", "size_function"]
