"""The complete size function: curvature, feature size and sources, with gradient limiting."""

from adaptsize._lazy import lazily

_HOMES = {
    "SparseSize": "sparse",
    "mesh_family": "family",
    "mesh_image": "images",
    "remesh_to_elements": "elements",
    "size_function": "complete_size",
}
__all__ = ["SparseSize", "mesh_family", "mesh_image", "remesh_to_elements", "size_function"]

__getattr__, __dir__ = lazily(__name__, _HOMES)
