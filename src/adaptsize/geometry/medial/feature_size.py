"""The medial axis of a boundary and the local feature size, on grids, octrees and meshes."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_angle, as_float_array, check_type, describe, refuse_where
from adaptsize._defaults import CORNER_ANGLE, CREASE_ANGLE
from adaptsize._progress import reporting
from adaptsize.background import AnyBackground, CartesianGrid, Octree, SimplexMesh
from adaptsize.geometry.distance.closest_points import (
    Boundary,
    DistanceFunction,
    FunctionBoundary,
    OwnBoundary,
    SurfaceBoundary,
)
from adaptsize.geometry.distance.signed_distance import signed_distance
from adaptsize.geometry.medial.fronts import MedialAxis
from adaptsize.geometry.medial.on_grids import DomainOnGrid
from adaptsize.geometry.medial.on_meshes import SEPARATION_ANGLE, DomainOnMesh
from adaptsize.typing import FloatArray, ProgressCallback

__all__ = ["MedialAxis", "feature_size", "medial_axis"]

_Boundary: TypeAlias = SimplexMesh | DistanceFunction | npt.ArrayLike | None


def medial_axis(
    background: AnyBackground,
    boundary: SimplexMesh | DistanceFunction | npt.ArrayLike | None = None,
    *,
    corner_angle: float = CORNER_ANGLE,
    separation_angle: float = SEPARATION_ANGLE,
    progress: ProgressCallback | bool | None = None,
) -> MedialAxis:
    r"""Return points of the medial axis, where the fronts of a distance function meet.

    *On a CartesianGrid* this is Algorithm 1 of [1]_.  For each edge of the grid, one parabola is
    fitted to the distance at three nodes on either side.  The point where the parabolas cross is
    accepted if the second one is steeper throughout, and if the gradients on both sides differ by
    more than the curvature of the fronts explains,

    .. math:: \nabla\phi_i \cdot \nabla\phi_{i+1}
              < 1 - \tfrac12 \gamma^2 \max(\kappa_{i-1}, \kappa_{i+2}, \kappa_{tol})^2 \Delta x^2

    with the curvature kappa, a factor gamma of 2, and kappa_tol of 4 over the diameter.

    *On an Octree or a SimplexMesh* there is no such stencil, but the closest boundary point of
    any point is available.  Consider the edges of the mesh (of the conforming mesh of the octree)
    whose ends have directions to the boundary that differ by the separation angle.  They are
    bisected eight times.  If the directions still differ, they jump, and the point of the axis is
    where both fronts are equally far.  If they only turn rapidly, around a curve or a point of
    the axis, the point is searched for in the inward direction from there.  The rim of the axis
    is searched for in the inward direction from corners.

    Points between two pieces of the boundary that meet at a corner are omitted.  The medial axis
    reaches the boundary there, and the feature size would vanish.

    Parameters
    ----------
    background : CartesianGrid, Octree or SimplexMesh
        Inactive nodes of a grid are treated as missing.  Meshes must consist of triangles in the
        plane or of tetrahedra.
    boundary : SimplexMesh, callable or array_like of float
        *SimplexMesh*: triangles in space or segments in the plane, as for `signed_distance`.

        *array of float*, on a CartesianGrid only: signed distance at the nodes, negative inside.
        Its error must be well below a spacing at three nodes on either side of the medial axis.

        *callable*: takes points, float64[n, dim], and returns n signed distances, negative
        inside.  On octrees and meshes they must be exact, and points may lie anywhere.  On grids
        the requirements are those of `signed_distance`.

        *None*, for a SimplexMesh: its own boundary.
    corner_angle : float, optional
        Smallest angle inside the domain between two pieces that form a corner, in degrees, 0 to
        180.  Two pieces at a smaller angle form a narrow region.
    separation_angle : float, optional
        On octrees and meshes: smallest angle between the directions to the boundary at a point of
        the axis, in degrees, 0 to 180.  Smaller angles are attributed to curvature, noise, or the
        facets of a curved boundary.
    progress : callable or bool, optional
        Called with a text and the fraction completed; True shows a progress bar on a terminal.
        An exception raised in it (or Ctrl-C) stops the computation.

    Returns
    -------
    MedialAxis
        Points, normals, radii and angles, and the distances at the nodes next to them.

    Raises
    ------
    ValueError
        If a shape is wrong; if a distance is not finite at an active node, or nowhere negative; if
        an option is out of range or does not apply to the background; or if the boundary is not
        supported on the background.  Nodal distances are not enough on an octree.

    See Also
    --------
    feature_size : Local feature size from the medial axis.
    adaptsize.geometry.boundary_width : Local width without a background.

    Notes
    -----
    *On grids* points lie within 0.001 to 0.3 spacings of surfaces of the medial axis (third order
    between smooth fronts), and within 1.2 spacings of curves in space and points in the plane.
    Some points are missing, mostly where two surfaces of the axis meet, at its rim, and where it
    is as steep as an edge is long; the points are not connected to each other.  The centre of a
    ball is a single point and may lie between the edges; `feature_size` detects it by its depth.

    Gradients are one-sided differences on the side with the smaller second difference, since
    the upwind side crosses the axis.  The directions of both fronts are then evaluated again half
    path to the boundary.  Two pieces form a corner if the boundary follows their tangents up to
    the point where these meet.  Corners are not resolved closer than three spacings to the
    boundary; there, only points between walls that form no corner are accepted.

    The time is O(n), two seconds for 256^3 nodes.  Memory is up to 25 bytes per node besides
    the distances.

    *On octrees and meshes* points on surfaces of the axis are exact to rounding between plane
    pieces.  Otherwise their error is the square of 1/256 of an edge over the radius.  One edge
    across a narrow region is sufficient, even if both of its ends are outside.  The time is
    O(n log n), mostly for closest points: one per node, and ten to thirty per edge that may
    contain a point.

    References
    ----------
    .. [1] P.-O. Persson, "Mesh size functions for implicit geometries and PDE-based
       gradient limiting", Engineering with Computers 22 (2006) 95-109, section 4.

    Examples
    --------
    The medial axis of a ring of radii 1 and 2 is the circle of radius 1.5:

    >>> import numpy as np
    >>> grid = CartesianGrid.around([[-2.0, -2.0], [2.0, 2.0]], spacing=0.1, margin=0.2)
    >>> radius = np.linalg.norm(grid.points, axis=1).reshape(grid.shape)
    >>> medial = medial_axis(grid, np.maximum(1.0 - radius, radius - 2.0))
    >>> bool(np.allclose(np.linalg.norm(medial.points, axis=1), 1.5, atol=1e-3))
    True
    >>> bool(np.allclose(medial.radii, 0.5, atol=1e-3))
    True

    The same on a quadtree that is coarse where the axis is:

    >>> from adaptsize import Octree, refine_at_boundary
    >>> def ring(x):
    ...     return np.abs(np.linalg.norm(x, axis=1) - 1.5) - 0.5
    >>> tree = Octree.build([-2.3, -2.3], [2.3, 2.3], refine_at_boundary(ring, 0.2), max_level=9)
    >>> medial = medial_axis(tree, ring)
    >>> bool(np.allclose(np.linalg.norm(medial.points, axis=1), 1.5, atol=1e-4))
    True
    """
    check_type("background", background, SimplexMesh, CartesianGrid, Octree)
    corner_angle = as_angle("corner_angle", corner_angle)
    separation = as_angle("separation_angle", separation_angle)
    if isinstance(background, CartesianGrid) and separation != SEPARATION_ANGLE:
        raise ValueError("separation_angle is for octrees and meshes, got it with a grid")
    with reporting(progress) as report:
        return _domain(background, boundary, report, corner_angle, separation).medial_axis()


def feature_size(
    background: AnyBackground,
    boundary: SimplexMesh | DistanceFunction | npt.ArrayLike | None = None,
    medial: MedialAxis | None = None,
    *,
    crease_angle: float = CREASE_ANGLE,
    corner_angle: float = CORNER_ANGLE,
    progress: ProgressCallback | bool | None = None,
) -> FloatArray:
    r"""Return the local feature size inside the domain: half the width of the part.

    .. math:: lfs(x) = |\phi(x)| + |\phi_{MA}(x)|,

    the sum of the distances from the boundary and from the medial axis, equation (6) of [1]_.
    The latter is marched from the points of the medial axis through the domain, so that thin
    walls beyond a gap have no effect.  A size of ``lfs / R`` gives 2 R elements across.

    Parameters
    ----------
    background : CartesianGrid, Octree or SimplexMesh
        Inactive nodes of a grid are outside.
    boundary : SimplexMesh, callable or array_like of float
        Boundary as for `medial_axis`: triangles, segments, signed distances at the nodes of a
        grid, or a function that returns them.
    medial : MedialAxis, optional
        Result of `medial_axis`, for other options than its defaults.
    crease_angle : float, optional
        On octrees and meshes: nodes where a boundary of segments turns by more are corners, in
        degrees.  At 180, a closed line has none.
    corner_angle : float, optional
        As for `medial_axis`, if ``medial`` is not given.
    progress : callable or bool, optional
        Called with a text and the fraction completed; True shows a progress bar on a terminal.
        An exception raised in it (or Ctrl-C) stops the computation.

    Returns
    -------
    ndarray of float64, of the nodal shape
        inf outside and at inactive nodes, finite at all others: each component of the domain has
        a deepest node, which is used as a point of the medial axis if no other point is near.  On
        octrees and meshes, nodes outside the domain have a finite size if their cells reach into
        the domain: the feature size of the boundary next to them.

    Raises
    ------
    ValueError
        If a shape is wrong, or a distance is not finite at an active node or nowhere negative.

    Notes
    -----
    Between parallel walls, the feature size is half their distance.  On the boundary of a smooth
    part it is the distance from the medial axis.  At corners it is not zero, but the distance from
    the nearest region that is narrow for another reason; see `medial_axis`.

    In the plane, the size at a boundary edge between two corners is at most the length of the
    edge; away from the edge, the bound grows with the distance.  On octrees and meshes this needs
    a boundary of segments.

    *On grids* the error is that of the medial axis (up to a spacing) plus that of marching at
    first order.  The time is O(n), 4 seconds for 256^3 nodes of which half are inside.  Memory is
    50 bytes per node besides the distances.

    *On octrees and meshes* half the distance of parallel walls is exact for any number of leaves
    between them.  Elsewhere the size is too large by at most the difference between the distances
    to the nearest point of the axis and to the axis itself; the points are about an edge apart.
    If the error is too large, refine by the size and compute the feature size again.  A narrow
    region that lies between two outside nodes only affects these two nodes.

    References
    ----------
    .. [1] P.-O. Persson, "Mesh size functions for implicit geometries and PDE-based
       gradient limiting", Engineering with Computers 22 (2006) 95-109, section 4.

    Examples
    --------
    A strip of width 1 and length 3.  The feature size is half the width in the middle, and more at
    the corners:

    >>> import numpy as np
    >>> grid = CartesianGrid(origin=[-0.2, -0.2], spacing=0.05, shape=(69, 29))
    >>> x, y = np.abs(grid.points - [1.5, 0.5]).T - [[1.5], [0.5]]
    >>> outside = np.hypot(np.maximum(x, 0.0), np.maximum(y, 0.0))
    >>> phi = (outside + np.minimum(np.maximum(x, y), 0.0)).reshape(grid.shape)
    >>> size = feature_size(grid, phi)
    >>> size[34, [4, 9, 14]].round(3)  # at x = 1.5: on the wall, between, in the middle
    array([0.5, 0.5, 0.5])
    >>> float(size[4, 4].round(1))  # at the corner
    0.7

    On an octree whose nodes all lie outside:

    >>> from adaptsize import Octree
    >>> tree = Octree([-2.0, -2.0], [6.0, 6.0], (4, 4), [0] * 16)
    >>> strip = SimplexMesh([[-1, 1], [5, 1], [5, 1.5], [-1, 1.5]],
    ...                     [[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> size = feature_size(tree, strip)
    >>> size[np.isfinite(size)].round(12)
    array([0.25, 0.25, 0.25, 0.25, 0.25, 0.25])
    """
    check_type("background", background, SimplexMesh, CartesianGrid, Octree)
    crease_angle = as_angle("crease_angle", crease_angle)
    corner_angle = as_angle("corner_angle", corner_angle)
    if medial is not None:
        check_type("medial", medial, MedialAxis)
        shape, own = background.nodal_shape, medial.distances.shape
        if own != shape:
            raise ValueError(f"medial must be of a background of shape {shape}, got {own}")
    with reporting(progress) as report:
        domain = _domain(background, boundary, report, corner_angle)
        axis = domain.medial_axis() if medial is None else medial
        return domain.feature_size(axis, crease_angle)


def _domain(
    background: AnyBackground,
    boundary: _Boundary,
    report: ProgressCallback,
    corner_angle: float,
    separation_angle: float = SEPARATION_ANGLE,
) -> DomainOnGrid | DomainOnMesh:
    """Return the domain inside a boundary, both checked."""
    if isinstance(background, CartesianGrid):
        phi = _distance_on(background, boundary, report)
        return DomainOnGrid(background, phi, report, corner_angle)
    mesh = background.mesh if isinstance(background, Octree) else background
    if mesh.cell_dim < mesh.dim or mesh.dim == 1:
        raise ValueError(
            f"background must have triangles in the plane or tetrahedra, got {background!r}"
        )
    closest = _closest_points(background, boundary)
    nodes = closest.from_nodes(background, report)
    return DomainOnMesh(mesh, closest, nodes, report, corner_angle, separation_angle)


def _distance_on(grid: CartesianGrid, boundary: _Boundary, report: ProgressCallback) -> FloatArray:
    """Return a signed distance at the nodes of a grid, finite, and negative somewhere."""
    if boundary is None:
        raise ValueError(f"boundary must be given, as there is none in {grid!r}")
    if isinstance(boundary, SimplexMesh) or callable(boundary):
        values = signed_distance(grid, boundary, progress=report)
    else:
        values = as_float_array("phi", boundary, grid.shape)
    counted = True if grid.active is None else grid.active
    refuse_where("phi", ~np.isfinite(values) & counted, values, "must be finite")
    if not ((values < 0.0) & counted).any():
        raise ValueError("phi must be negative at one node at least, inside the domain, got none")
    return values


def _closest_points(background: SimplexMesh | Octree, boundary: _Boundary) -> Boundary:
    """Return a boundary that provides the closest point for every point."""
    if boundary is None and isinstance(background, SimplexMesh):
        return OwnBoundary(background)
    dim = background.dim
    if isinstance(boundary, SimplexMesh):
        if boundary.dim != dim or boundary.cell_dim != dim - 1:
            kind = "segments" if dim == 2 else "triangles"
            raise ValueError(f"boundary must consist of {kind} in {dim}-D, got {boundary!r}")
        return SurfaceBoundary(boundary)
    if callable(boundary):
        return FunctionBoundary(boundary, background.diagonal)
    raise ValueError(
        "boundary must be a SimplexMesh or a function that gives distances anywhere; distances at "
        f"nodes are for a CartesianGrid, got {describe(boundary)} for {background!r}"
    )
