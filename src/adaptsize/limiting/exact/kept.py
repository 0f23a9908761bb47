"""What the exact method finds out about a mesh, kept as long as the mesh: loops limit often."""

from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.geometry.boundary import FlatBoundary, flat_boundary
from adaptsize.geometry.convexity import Ridges, count_corners, is_convex, ridges_of
from adaptsize.geometry.plane_boundary import plane_boundary
from adaptsize.limiting.exact.expansion import Ground, ground_of
from adaptsize.limiting.exact.obstacles_in_plane import Plane, plane_of
from adaptsize.limiting.exact.solid import Solid, solid_of

_BOUNDARIES: WeakKeyDictionary[SimplexMesh, tuple[FlatBoundary, bool]] = WeakKeyDictionary()
_CORNERS: WeakKeyDictionary[SimplexMesh, int] = WeakKeyDictionary()
_GROUNDS: WeakKeyDictionary[SimplexMesh, Ground | None] = WeakKeyDictionary()
_PLANES: WeakKeyDictionary[SimplexMesh, Plane] = WeakKeyDictionary()
#: Until the solid is known, which needs them once more.
_RIDGES: WeakKeyDictionary[SimplexMesh, Ridges] = WeakKeyDictionary()
_SOLIDS: WeakKeyDictionary[SimplexMesh, Solid] = WeakKeyDictionary()


def boundary_of(mesh: SimplexMesh, threads: int) -> tuple[FlatBoundary, bool]:
    """Return the walls of a mesh, and whether it is convex."""
    known = _BOUNDARIES.get(mesh)
    if known is None:
        boundary, ridges = flat_boundary(mesh, threads), None
        if mesh.dim == 3 and boundary.is_simple and len(boundary.facets):
            ridges = ridges_of(boundary.facets, mesh.n_points)
        known = _BOUNDARIES[mesh] = boundary, is_convex(mesh.points, boundary, ridges)
        if ridges is not None and not known[1]:
            _RIDGES[mesh] = ridges
    return known


def corners_in(mesh: SimplexMesh, boundary: FlatBoundary) -> int:
    """Return the number of corners of a mesh in the plane."""
    known = _CORNERS.get(mesh)
    if known is None:
        known = _CORNERS[mesh] = count_corners(mesh.points, boundary)
    return known


def ground_in(mesh: SimplexMesh, boundary: FlatBoundary) -> Ground | None:
    """Return what expansion needs to know of a mesh in the plane, None if it does not apply."""
    if mesh not in _GROUNDS:
        _GROUNDS[mesh] = ground_of(mesh, boundary)
    return _GROUNDS[mesh]


def plane_in(mesh: SimplexMesh, boundary: FlatBoundary) -> Plane:
    """Return the walls and corners of a mesh in the plane, these without sizes."""
    known = _PLANES.get(mesh)
    if known is None:
        known = _PLANES[mesh] = plane_of(mesh.points, plane_boundary(mesh, boundary))
    return replace(known, sizes=np.full_like(known.sizes, np.inf))


def solid_in(mesh: SimplexMesh, boundary: FlatBoundary) -> Solid:
    """Return the solid of a mesh."""
    known = _SOLIDS.get(mesh)
    if known is None:
        known = _SOLIDS[mesh] = solid_of(mesh, boundary, ridges=_RIDGES.pop(mesh, None))
    return known
