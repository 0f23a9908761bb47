"""The medial axis of a boundary, on grids, octrees and meshes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    as_angle,
    as_float_array,
    as_number,
    as_plain_array,
    check_type,
    refuse_where,
)
from adaptsize._progress import reporting
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.geometry.distance.api import signed_distance
from adaptsize.geometry.distance.closest_points import DistanceFunction
from adaptsize.geometry.distance.propagation import AnyBackground
from adaptsize.geometry.medial.axis_on_grid import medial_axis_on_grid
from adaptsize.geometry.medial.axis_on_octree import (
    SEPARATION_ANGLE,
    boundary_on,
    medial_axis_on_mesh,
)
from adaptsize.geometry.medial.points import MedialAxis
from adaptsize.typing import FloatArray, ProgressCallback

__all__ = ["MedialAxis", "medial_axis"]

_GAMMA = 2.0


def medial_axis(
    background: AnyBackground,
    boundary: SimplexMesh | DistanceFunction | npt.ArrayLike | None = None,
    *,
    corner_angle: float = 30.0,
    separation_angle: float | None = None,
    curvature_tolerance: float | None = None,
    gamma: float | None = None,
    patches: npt.ArrayLike | None = None,
    progress: ProgressCallback | bool | None = None,
) -> MedialAxis:
    r"""Return points of the medial axis, where the fronts of a distance function meet.

    *On a CartesianGrid* this is Algorithm 1 of [1]_.  For each edge of the grid, one parabola is
    fitted to the distance at three nodes on either side.  The point where the parabolas cross is
    accepted if the second one is steeper throughout, and if the gradients on both sides differ by
    more than the curvature of the fronts explains,

    .. math:: \nabla\phi_i \cdot \nabla\phi_{i+1}
              < 1 - \tfrac12 \gamma^2 \max(\kappa_{i-1}, \kappa_{i+2}, \kappa_{tol})^2 \Delta x^2 .

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
        the axis, in degrees, above 0, at most 180; the default is 40.  Smaller angles are
        attributed to curvature, noise, or the facets of a curved boundary.
    curvature_tolerance : float, optional
        On grids: smallest curvature that is resolved, 1 / length, >= 0.  Angles between fronts
        smaller than ``gamma * curvature_tolerance * spacing`` (in radians) are not detected.  The
        default is 4 over the diameter of the part.
    gamma : float, optional
        On grids: factor on curvatures, > 0; the default is 2.  It compensates for the curvatures
        being evaluated one node away, and for the one-sided gradients corresponding to nodes two
        spacings apart.  Below 2, smooth fronts are mistaken for crossings; above 2, more points
        are missed.
    patches : array_like of int, of the shape of the grid, optional
        On grids: number of the smooth piece of the boundary next to each node.  Corners are then
        only searched for between pieces that meet, and they may be rounded off more.  Without it,
        corners are detected from the distance alone.
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
    adaptsize.geometry.inscribed_spheres : Local feature size without a background.

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

    The time is O(n), two seconds for 256^3 nodes.  Memory is 16 bytes per node besides the
    distances.

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
    with reporting(progress) as report:
        if isinstance(background, CartesianGrid):
            if separation_angle is not None:
                raise ValueError("separation_angle is for octrees and meshes, got it with a grid")
            values = distance_on(background, boundary, report)
            tolerance, factor = curvature_tolerance, _GAMMA if gamma is None else gamma
            if tolerance is not None:
                tolerance = as_number("curvature_tolerance", tolerance, lower=0.0)
            return medial_axis_on_grid(
                background,
                values,
                tolerance=tolerance,
                gamma=as_number("gamma", factor, lower=0.0, strict=True),
                patches=None if patches is None else _checked_patches(background, patches),
                corner_angle=corner_angle,
                report=report,
            )
        given = {"curvature_tolerance": curvature_tolerance, "gamma": gamma, "patches": patches}
        for name, value in given.items():
            if value is not None:
                raise ValueError(f"{name} is for a CartesianGrid, got it with {background!r}")
        angle = as_number(
            "separation_angle",
            SEPARATION_ANGLE if separation_angle is None else separation_angle,
            lower=0.0,
            strict=True,
        )
        if angle > 180.0:
            raise ValueError(f"separation_angle must be at most 180 degrees, got {angle:g}")
        mesh, found = boundary_on(background, boundary)
        nodes = found.from_nodes(background, report)
        return medial_axis_on_mesh(mesh, found, nodes, angle, corner_angle, report)


def distance_on(
    grid: CartesianGrid,
    boundary: SimplexMesh | DistanceFunction | npt.ArrayLike | None,
    report: ProgressCallback,
) -> FloatArray:
    """Return a signed distance at the nodes of a grid, finite, and negative somewhere."""
    if isinstance(boundary, SimplexMesh) or callable(boundary):
        values = signed_distance(grid, boundary, progress=report)
    else:
        if boundary is None:
            raise ValueError(f"boundary must be given, as there is none in {grid!r}")
        values = as_float_array("phi", boundary, grid.shape)
    counted = True if grid.active is None else grid.active
    refuse_where("phi", ~np.isfinite(values) & counted, values, "must be finite")
    if not ((values < 0.0) & counted).any():
        raise ValueError("phi must be negative at one node at least, inside the domain, got none")
    return values


def _checked_patches(grid: CartesianGrid, patches: npt.ArrayLike) -> npt.NDArray[np.int64]:
    raw = as_plain_array("patches", patches)
    if raw.dtype.kind not in "iu" or raw.shape != grid.shape:
        raise ValueError(
            f"patches must be integers of shape {grid.shape}, got {raw.dtype} of {raw.shape}"
        )
    return raw.astype(np.int64)
