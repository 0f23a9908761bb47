"""Geometry of the domain, independent of sizes.

Names are imported on first use, since gradient limiting needs the boundary only.
"""

from typing import TYPE_CHECKING

from adaptsize._lazy import lazily

if TYPE_CHECKING:
    from adaptsize.geometry.curvatures import curvature
    from adaptsize.geometry.distance.function import SignedDistance
    from adaptsize.geometry.distance.signed_distance import signed_distance
    from adaptsize.geometry.level_sets import level_set_curvature
    from adaptsize.geometry.medial.feature_size import feature_size, medial_axis
    from adaptsize.geometry.separation import boundary_separation
    from adaptsize.geometry.width import boundary_width

_HOMES = {
    "curvature": "curvatures",
    "SignedDistance": "distance.function",
    "signed_distance": "distance.signed_distance",
    "level_set_curvature": "level_sets",
    "medial_axis": "medial.feature_size",
    "feature_size": "medial.feature_size",
    "boundary_separation": "separation",
    "boundary_width": "width",
}

__all__ = [
    "SignedDistance",
    "boundary_separation",
    "boundary_width",
    "curvature",
    "feature_size",
    "level_set_curvature",
    "medial_axis",
    "signed_distance",
]

__getattr__, __dir__ = lazily(__name__, _HOMES)
