"""Mesh generation for a size function: ``remesh`` and one adapter per mesh generator.

Names are imported on first use.  The child processes that run the generators
import this package too and start faster without the mesh classes.
"""

from adaptsize._lazy import lazily

_HOMES = {
    "remesh": "driver",
    "read_cad": "cad",
    "remove_details": "details",
    "available_backends": "registry",
    "register_backend": "registry",
    "Backend": "protocol",
    "mesh_from_distance": "distmesh.from_distance",
}

__all__ = [*_HOMES]  # noqa: PLE0604 - the keys are strings

__getattr__, __dir__ = lazily(__name__, _HOMES)
