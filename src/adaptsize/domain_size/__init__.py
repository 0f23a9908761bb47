"""The complete size function: curvature, feature size and sources, with gradient limiting."""

from adaptsize._lazy import lazily

TYPE_CHECKING = False
if TYPE_CHECKING:
    from adaptsize.domain_size.complete_size import size_function
    from adaptsize.domain_size.elements import remesh_to_elements
    from adaptsize.domain_size.family import mesh_family
    from adaptsize.domain_size.images import mesh_image
    from adaptsize.domain_size.sparse import SparseSize

_HOMES = {
    "SparseSize": "sparse",
    "mesh_family": "family",
    "mesh_image": "images",
    "remesh_to_elements": "elements",
    "size_function": "complete_size",
}
__all__ = ["SparseSize", "mesh_family", "mesh_image", "remesh_to_elements", "size_function"]

__getattr__, __dir__ = lazily(__name__, _HOMES)
