"""Mesh generation for a size function: ``remesh`` and one adapter per mesh generator.

Names are imported on first use.  The child processes that run the generators
import this package too and start faster without the mesh classes.
"""

from importlib import import_module
from typing import Any

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
    "mesh_from_distance": "distmesh.api",
    "SmoothingReport": "distmesh.api",
}

__all__ = [
    "Backend",
    "NearBodies",
    "OpenBoundary",
    "OverlappingBodies",
    "Problem",
    "SmoothingReport",
    "available_backends",
    "close_holes",
    "estimate_n_cells",
    "mesh_from_distance",
    "near_bodies",
    "open_boundary",
    "overlapping_bodies",
    "read_cad",
    "register_backend",
    "remesh",
]


def __getattr__(name: str) -> Any:
    """Import a name from its home on first use (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module 'adaptsize.remeshing' has no attribute {name!r}")
    value = getattr(import_module(f"adaptsize.remeshing.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    own = {name for name in globals() if name.startswith("__")}
    return sorted({*own, *__all__})
