"""`MedialAxis`: points of a medial axis."""

from __future__ import annotations

from dataclasses import dataclass

from adaptsize._pickling import ReadOnlyState
from adaptsize.typing import FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class MedialAxis(ReadOnlyState):
    """Points of a medial axis, found on the edges of a grid, an octree or a mesh.

    Parameters
    ----------
    points : float64[n, dim]
        Points where two fronts meet.  They lie on an edge; on octrees and meshes, points around
        curves of the axis and at its rim may be off the edge by up to twice its length.
    normals : float64[n, dim]
        Unit normals of the medial axis at these points, of either sign.  Where the axis is a curve
        in space (or a point in the plane), one of the directions across it.
    radii : float64[n]
        Distance of each point from the boundary.
    angles : float64[n]
        Angle in degrees between the directions to the two nearest points of the boundary; 180
        between parallel walls.
    distances : float64 of the nodal shape
        Distance from the medial axis at the ends of these edges, inf at all other nodes.
    corners : float64[m, dim]
        Corners of the boundary, one for each crossing close to the boundary that they cause.  One
        corner may appear many times.  In space these are points of sharp edges.
    """

    points: FloatArray
    normals: FloatArray
    radii: FloatArray
    angles: FloatArray
    distances: FloatArray
    corners: FloatArray

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            getattr(self, name).flags.writeable = False

    def __repr__(self) -> str:
        """Return the number of points."""
        return f"MedialAxis({len(self.points)} points)"
