"""Mesh generation for a size function: ``remesh`` and one adapter per mesh generator.

Names are imported on first use.  The child processes that run the generators
import this package too and start faster without the mesh classes.
"""

from adaptsize._lazy import lazily

_HOMES = {
    "remesh": "driver",
    "read_cad": "cad",
    "available_backends": "registry",
    "register_backend": "registry",
    "Backend": "protocol",
    "Problem": "protocol",
    "estimate_n_cells": "estimate",
    "close_holes": "hole_filling",
    "open_boundary": "open_surface",
    "OpenBoundary": "open_surface",
    "near_bodies": "open_surface",
    "NearBodies": "open_surface",
    "overlapping_bodies": "overlaps",
    "OverlappingBodies": "overlaps",
    "mesh_from_distance": "distmesh.from_distance",
    "SmoothingReport": "distmesh.from_distance",
}

__all__ = [*_HOMES]  # noqa: PLE0604 - the keys are strings

__getattr__, __dir__ = lazily(__name__, _HOMES)
