"""Geometry of the domain, independent of sizes."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from adaptsize.geometry.curvature import (
        corner_curvature,
        crease_curvature,
        crease_edges,
        polyline_curvature,
        surface_curvature,
    )
    from adaptsize.geometry.distance.api import signed_distance
    from adaptsize.geometry.distance.function import SignedDistance
    from adaptsize.geometry.faces import tag_faces
    from adaptsize.geometry.level_sets import level_set_curvature
    from adaptsize.geometry.medial.axis import MedialAxis, medial_axis
    from adaptsize.geometry.medial.feature_size import feature_size
    from adaptsize.geometry.medial.inscribed_spheres import InscribedSpheres, inscribed_spheres

_HOMES = {
    "corner_curvature": "curvature",
    "crease_curvature": "curvature",
    "crease_edges": "curvature",
    "polyline_curvature": "curvature",
    "surface_curvature": "curvature",
    "SignedDistance": "distance.function",
    "signed_distance": "distance.api",
    "tag_faces": "faces",
    "level_set_curvature": "level_sets",
    "MedialAxis": "medial.axis",
    "medial_axis": "medial.axis",
    "feature_size": "medial.feature_size",
    "InscribedSpheres": "medial.inscribed_spheres",
    "inscribed_spheres": "medial.inscribed_spheres",
}

__all__ = [
    "InscribedSpheres",
    "MedialAxis",
    "SignedDistance",
    "corner_curvature",
    "crease_curvature",
    "crease_edges",
    "feature_size",
    "inscribed_spheres",
    "level_set_curvature",
    "medial_axis",
    "polyline_curvature",
    "signed_distance",
    "surface_curvature",
    "tag_faces",
]


def __getattr__(name: str) -> Any:
    """Import a function from its home on first use: limiting needs the boundary only (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    own = {name for name in globals() if name.startswith("__")}
    return sorted({*own, *__all__})
