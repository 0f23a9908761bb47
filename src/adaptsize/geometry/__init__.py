"""What the domain looks like; knows nothing of sizes."""

from adaptsize.geometry.curvature import (
    crease_curvature,
    crease_edges,
    polyline_curvature,
    surface_curvature,
)

__all__ = ["crease_curvature", "crease_edges", "polyline_curvature", "surface_curvature"]
