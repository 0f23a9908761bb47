"""The medial axis of a boundary and the local feature size, on Cartesian grids."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_angle, as_float_array, check_type, refuse_where
from adaptsize._defaults import CORNER_ANGLE
from adaptsize._progress import reporting
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.geometry.distance.closest_points import DistanceFunction
from adaptsize.geometry.distance.signed_distance import signed_distance
from adaptsize.geometry.medial.fronts import MedialAxis
from adaptsize.geometry.medial.on_grids import feature_size_on_grid, medial_axis_on_grid
from adaptsize.typing import FloatArray, ProgressCallback

__all__ = ["MedialAxis", "feature_size", "medial_axis"]

_Boundary: TypeAlias = SimplexMesh | DistanceFunction | npt.ArrayLike


def medial_axis(
    background: CartesianGrid,
    boundary: SimplexMesh | DistanceFunction | npt.ArrayLike,
    *,
    corner_angle: float = CORNER_ANGLE,
    progress: ProgressCallback | bool | None = None,
) -> MedialAxis:
    r"""Return points of the medial axis, where the fronts of a distance function meet.

    This is Algorithm 1 of [1]_.  For each edge of the grid, one parabola is
    fitted to the distance at three nodes on either side.  The point where the parabolas cross is
    accepted if the second one is steeper throughout, and if the gradients on both sides differ by
    more than the curvature of the fronts explains,

    .. math:: \nabla\phi_i \cdot \nabla\phi_{i+1}
              < 1 - \tfrac12 \gamma^2 \max(\kappa_{i-1}, \kappa_{i+2}, \kappa_{tol})^2 \Delta x^2

    with the curvature kappa, a factor gamma of 2, and kappa_tol of 4 over the diameter.

    Points between two pieces of the boundary that meet at a corner are omitted.  The medial axis
    reaches the boundary there, and the feature size would vanish.

    Parameters
    ----------
    background : CartesianGrid
        Inactive nodes are treated as missing.
    boundary : SimplexMesh, callable or array_like of float
        *SimplexMesh* or *callable*: as for `signed_distance`.

        *array of float*: signed distance at the nodes, negative inside.  Its error must be well
        below a spacing at three nodes on either side of the medial axis.
    corner_angle : float, optional
        Smallest angle inside the domain between two pieces that form a corner, in degrees, 0 to
        180.  Two pieces at a smaller angle form a narrow region.
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
        an option is out of range.

    See Also
    --------
    feature_size : Local feature size from the medial axis.
    adaptsize.geometry.boundary_width : Local width without a background.

    Notes
    -----
    Points lie within 0.001 to 0.3 spacings of surfaces of the medial axis (third order
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
    """
    check_type("background", background, CartesianGrid)
    corner_angle = as_angle("corner_angle", corner_angle)
    with reporting(progress) as report:
        phi = _distance_on(background, boundary, report)
        return medial_axis_on_grid(background, phi, corner_angle, report)


def feature_size(
    background: CartesianGrid,
    boundary: SimplexMesh | DistanceFunction | npt.ArrayLike,
    medial: MedialAxis | None = None,
    *,
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
    background : CartesianGrid
        Inactive nodes are outside.
    boundary : SimplexMesh, callable or array_like of float
        Boundary as for `medial_axis`.
    medial : MedialAxis, optional
        Result of `medial_axis`, for other options than its defaults.
    corner_angle : float, optional
        As for `medial_axis`, if ``medial`` is not given.
    progress : callable or bool, optional
        Called with a text and the fraction completed; True shows a progress bar on a terminal.
        An exception raised in it (or Ctrl-C) stops the computation.

    Returns
    -------
    ndarray of float64, of the nodal shape
        inf outside and at inactive nodes, finite at all others: each component of the domain has
        a deepest node, which is used as a point of the medial axis if no other point is near.

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
    edge; away from the edge, the bound grows with the distance.

    The error is that of the medial axis (up to a spacing) plus that of marching at
    first order.  The time is O(n), 4 seconds for 256^3 nodes of which half are inside.  Memory is
    50 bytes per node besides the distances.

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
    """
    check_type("background", background, CartesianGrid)
    corner_angle = as_angle("corner_angle", corner_angle)
    if medial is not None:
        check_type("medial", medial, MedialAxis)
        shape, own = background.nodal_shape, medial.distances.shape
        if own != shape:
            raise ValueError(f"medial must be of a background of shape {shape}, got {own}")
    with reporting(progress) as report:
        phi = _distance_on(background, boundary, report)
        if medial is None:
            medial = medial_axis_on_grid(background, phi, corner_angle, report)
        return feature_size_on_grid(background, phi, medial, report)


def _distance_on(grid: CartesianGrid, boundary: _Boundary, report: ProgressCallback) -> FloatArray:
    """Return a signed distance at the nodes of a grid, finite, and negative somewhere."""
    if isinstance(boundary, SimplexMesh) or callable(boundary):
        values = signed_distance(grid, boundary, progress=report)
    else:
        values = as_float_array("boundary", boundary, grid.shape)
    counted = True if grid.active is None else grid.active
    refuse_where("boundary", ~np.isfinite(values) & counted, values, "must be finite")
    if not ((values < 0.0) & counted).any():
        raise ValueError("boundary must be negative at one node at least, inside, got none")
    return values
