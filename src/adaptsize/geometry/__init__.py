"""What the domain looks like; knows nothing of sizes."""

from adaptsize.geometry.curvature import (
    corner_curvature,
    crease_curvature,
    crease_edges,
    polyline_curvature,
    surface_curvature,
)
from adaptsize.geometry.distance import signed_distance
from adaptsize.geometry.inscribed_spheres import InscribedSpheres, inscribed_spheres
from adaptsize.geometry.level_sets import level_set_curvature

__all__ = [
    "InscribedSpheres",
    "corner_curvature",
    "crease_curvature",
    "crease_edges",
    "inscribed_spheres",
    "level_set_curvature",
    "polyline_curvature",
    "signed_distance",
    "surface_curvature",
]
