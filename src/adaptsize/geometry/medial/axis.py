"""The medial axis of a boundary, on grids, octrees and meshes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_number, refuse_where
from adaptsize._progress import reporting
from adaptsize.background import CartesianGrid, SimplexMesh
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
    r"""Return where the fronts of a distance function meet inside the domain.

    *On a CartesianGrid* Algorithm 1 of [1]_.  Along each edge of the grid one parabola is laid
    through the distance at three nodes on either side; a point is where they cross, if the
    second one is steeper throughout, and the gradients on both sides differ by more than the
    curvature of the fronts explains,

    .. math:: \nabla\phi_i \cdot \nabla\phi_{i+1}
              < 1 - \tfrac12 \gamma^2 \max(\kappa_{i-1}, \kappa_{i+2}, \kappa_{tol})^2 \Delta x^2 .

    *On an Octree or a SimplexMesh* there is no such stencil, but the boundary tells for any point
    where the closest one on it is.  Edges of the mesh (of the conforming one of the octree) whose
    ends see it in directions that differ by the separation angle are halved eight times; where
    the directions still do, they jump, and the point is where both fronts are equally
    far.  Where they only turn fast, around a curve or a point of the axis, it is looked for on the
    way inward from there; and the rim of the axis on the way inward from corners.

    Points between two pieces of the boundary that meet at a corner are left out: there the
    medial axis reaches the boundary, and a feature size from it would vanish.

    Parameters
    ----------
    background : CartesianGrid, Octree or SimplexMesh
        Inactive nodes of a grid count as missing.  Meshes of triangles in the plane or
        tetrahedra.
    boundary : SimplexMesh, callable or array_like of float
        *SimplexMesh*: triangles in space, segments in the plane, as `signed_distance` takes them.

        *array of float*, on a CartesianGrid only: signed distance at the nodes, negative inside;
        exact to well below a spacing at three nodes on either side of the medial axis.

        *callable*: takes points, float64[n, dim], and gives n signed distances, negative inside;
        on octrees and meshes exact ones, asked for anywhere; on grids as for `signed_distance`.

        *None*, for a SimplexMesh: its own boundary.
    corner_angle : float, optional
        Least angle between two pieces inside the domain, in degrees, 0 to 180, from which on
        they form a corner; a smaller one is a narrow place.
    separation_angle : float, optional
        On octrees and meshes: least angle between the directions to the boundary at a point,
        degrees, above 0, at most 180; 40 by default.  What turns by less is curved, or
        noise, or facets of a curved boundary.
    curvature_tolerance : float, optional
        On grids: smallest curvature that is resolved, 1 / length, >= 0.  Flatter angles between
        fronts than ``gamma * curvature_tolerance * spacing`` (in radians) are not
        found.  By default 4 over the diameter of the part.
    gamma : float, optional
        On grids: factor on curvatures, > 0, 2 by default, which makes up for their being taken a
        node away, and for one-sided gradients being as of nodes two spacings apart; below 2
        smooth fronts are taken for crossings, above it more points are missing.
    patches : array_like of int, of the shape of the grid, optional
        On grids: which smooth piece of the boundary is next to each node.  Only pieces that meet
        have corners then, and they may be rounded off by more.  Without it corners are found
        from the distance alone.
    progress : callable or bool, optional
        Called with a text and the share done; True shows a bar on a terminal.
        Raising in it (or Ctrl-C) stops the work.

    Returns
    -------
    MedialAxis
        Points, normals, radii and angles; and the distances at the nodes next to them.

    Raises
    ------
    ValueError
        If a shape is wrong, a distance is not finite at an active node or nowhere negative, an
        option is out of its range or for another background, or the boundary is none for the
        background: nodal distances do not tell an octree where fronts come from.

    See Also
    --------
    feature_size : the local feature size from it.
    adaptsize.geometry.inscribed_spheres : without a background.

    Notes
    -----
    *On grids* points lie within 0.001 to 0.3 spacings of surfaces of the medial axis (third order
    between smooth fronts), within 1.2 of curves in space and points in the plane.  Some are
    missing, most of all where two surfaces of the axis meet, at its rim, and where it is as steep
    as an edge is long; no attempt is made to link them up.  The centre of a ball, a single
    point, may fall between the edges; `feature_size` knows it by its depth.

    Gradients are one-sided differences, on the side with the smaller second difference, since
    the upwind side crosses the axis.  The directions of both fronts are then looked up again half
    way to the boundary.  Two pieces form a corner if the boundary follows their tangents up to
    where these meet.  Less than three spacings from the boundary no corner is resolved: there
    points count only between walls that form no corner at all.

    O(n) time: two seconds for 256^3 nodes; 16 bytes per node besides phi.

    *On octrees and meshes* points on surfaces of the axis are exact to rounding between plane
    pieces, else to 1/256 of an edge, squared, over the radius.  One edge across a narrow place is
    enough, even if both of its ends are outside.  O(n log n) time, most of it for closest points:
    one for each node and ten to thirty for each edge that may carry a point.

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
    as_number("corner_angle", corner_angle, lower=0.0)
    if corner_angle > 180.0:
        raise ValueError(f"corner_angle must be 0 to 180 degrees, got {corner_angle:g}")
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
                corner_angle=float(corner_angle),
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
        return medial_axis_on_mesh(mesh, found, nodes, angle, float(corner_angle), report)


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
    raw = np.asarray(patches)
    if raw.dtype.kind not in "iu" or raw.shape != grid.shape:
        raise ValueError(
            f"patches must be integers of shape {grid.shape}, got {raw.dtype} of {raw.shape}"
        )
    return raw.astype(np.int64)
