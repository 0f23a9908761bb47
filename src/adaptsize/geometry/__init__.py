"""Geometry of the domain, independent of sizes."""

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
