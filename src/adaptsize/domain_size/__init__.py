"""The complete size function: curvature, feature size and sources, with gradient limiting."""

from adaptsize._size_report import SizeReport
from adaptsize.domain_size.complete_size import size_function
from adaptsize.domain_size.elements import MeshOfElements, remesh_to_elements
from adaptsize.domain_size.family import Convergence, MeshFamily, mesh_family
from adaptsize.domain_size.images import mesh_image
from adaptsize.domain_size.sparse import SparseSize

__all__ = [
    "Convergence",
    "MeshFamily",
    "MeshOfElements",
    "SizeReport",
    "SparseSize",
    "mesh_family",
    "mesh_image",
    "remesh_to_elements",
    "size_function",
]
