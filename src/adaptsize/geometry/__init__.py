"""Geometry of the domain, independent of sizes.

Names are imported on first use, since gradient limiting needs the boundary only.
"""

from adaptsize._lazy import lazily

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

__all__ = [*_HOMES]  # noqa: PLE0604 - the keys are strings

__getattr__, __dir__ = lazily(__name__, _HOMES)
