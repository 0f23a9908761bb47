"""The names of `adaptsize.geometry` for type checkers; tests/test_types.py writes this file."""

from adaptsize.geometry.curvatures import curvature as curvature
from adaptsize.geometry.distance.function import SignedDistance as SignedDistance
from adaptsize.geometry.distance.signed_distance import signed_distance as signed_distance
from adaptsize.geometry.level_sets import level_set_curvature as level_set_curvature
from adaptsize.geometry.medial.feature_size import feature_size as feature_size
from adaptsize.geometry.medial.feature_size import medial_axis as medial_axis
from adaptsize.geometry.separation import boundary_separation as boundary_separation
from adaptsize.geometry.width import boundary_width as boundary_width

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
