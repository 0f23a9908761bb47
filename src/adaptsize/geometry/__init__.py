"""Geometry of the domain, independent of sizes.

Names are imported on first use, since gradient limiting needs the boundary only.
"""

from typing import TYPE_CHECKING

from adaptsize._lazy import lazily

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

__getattr__, __dir__ = lazily(__name__, _HOMES)
