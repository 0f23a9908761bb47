"""Sizes from the local feature size, a measure of the local width of the domain."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_angle, as_number, check_type, describe, one_of
from adaptsize._defaults import CREASE_ANGLE, TOLERANCE
from adaptsize._progress import reporting
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.geometry.distance.api import signed_distance
from adaptsize.geometry.distance.closest_points import DistanceFunction
from adaptsize.geometry.medial.axis import distance_on, medial_axis
from adaptsize.geometry.medial.feature_size import feature_size, feature_size_with
from adaptsize.geometry.medial.inscribed_spheres import SphereFinder
from adaptsize.sizes.combine import minimum
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

Method: TypeAlias = Literal["auto", "spheres", "medial-axis"]
METHODS = get_args(Method)

# Sizes must not require more than 10^6 elements along the part where a part tapers to nothing.
SMALLEST_SHARE = 1e-6


def size_from_feature(
    background: SimplexMesh | CartesianGrid | Octree,
    boundary: SimplexMesh | DistanceFunction | npt.ArrayLike | None = None,
    *,
    method: Method = "auto",
    elements_across: float = 4.0,
    crease_angle: float = CREASE_ANGLE,
    corner_angle: float = 30.0,
    tolerance: float | None = None,
    hmin: float | None = None,
    hmax: float | None = None,
    progress: ProgressCallback | bool | None = None,
) -> FloatArray:
    r"""Return the size that puts a given number of elements across narrow regions.

    .. math:: h_0(x) = \mathrm{lfs}(x) / R, \qquad R = \mathrm{elements\_across} / 2,

    at nodes inside and on the boundary.  With ``"spheres"``, lfs(x) is the radius of the largest
    inscribed sphere that touches the boundary at the point closest to x (`inscribed_spheres`).
    It is half the width of the domain there.  The size is therefore constant from that point to
    the centre of the sphere, and each node is computed independently.  With ``"medial-axis"``,
    lfs is the distance to the boundary plus the distance to the medial axis, equation (6) of [1]_
    (`adaptsize.feature_size`).  This is never larger than the radius, and equal to it where the
    width of the domain is constant.  Where the domain widens, it grows more slowly.

    Parameters
    ----------
    background : SimplexMesh, CartesianGrid or Octree
        A mesh of full dimension, the boundary of a domain (triangles in space or
        segments in the plane), or a grid or an octree around a domain.
    boundary : SimplexMesh, callable or array_like of float, optional
        Triangles in space or segments in the plane, as for `inscribed_spheres`.  By
        default the boundary of the background, or the background itself.  For the medial axis it
        may also be the signed distance, negative inside: a function of points, or on a
        CartesianGrid an array.
    method : {"auto", "spheres", "medial-axis"}
        Definition of the local feature size.  By default the medial axis for distances,
        otherwise spheres.
    elements_across : float, default 4
        Twice R of [1]_, > 0.
    crease_angle, corner_angle : float
        As for `inscribed_spheres`, degrees.  The medial axis on grids has no ``crease_angle``.
    tolerance : float, optional
        Nodes up to this distance outside ``boundary`` get a size too.  On a background of lower
        dimension, only nodes within this distance of ``boundary`` get one.  On a grid or an
        octree the default is the diagonal of the largest box at a node, so that all corners of
        the boxes that the boundary passes have a size.  Otherwise it is 0.001 of the
        diagonal of the boundary.  Only for spheres, with ``boundary``.
    hmin, hmax : float, optional
        Limits of the size; ``hmin`` overrides the bound.
    progress : callable, bool or None
        As in `limit_gradient`.

    Returns
    -------
    ndarray of float64, of ``background.nodal_shape``
        Sizes; ``inf`` outside, and where there is no opposite boundary (open boundaries), unless
        ``hmax`` is given.  At least 1e-6 of the diagonal of the boundary.

    Raises
    ------
    ValueError
        If an option is out of range, the background is 1-D or a line in space, or ``boundary``
        is of another kind, missing on a grid or octree, or has no nodes in it or near it.

    See Also
    --------
    limit_gradient : the next step.  Where the domain widens fast, so does the size.

    Notes
    -----
    The size is computed at each node separately, so a region that is narrow only between the nodes
    is missed.  The background must resolve the length of narrow regions, but not their width.  For
    a thin plate, nodes at the corners are sufficient.  On a surface, sizes that grow from there
    into the volume give fewer elements across than requested: at least
    2 / g log(1 + n g / 2) for n.

    The size does not tend to zero at corners, but it does at the tips of wedges below
    ``corner_angle``.  The cost is usually O(n log n).  See `inscribed_spheres` for the accuracy.

    References
    ----------
    .. [1] P.-O. Persson, "Mesh size functions for implicit geometries and
       PDE-based gradient limiting", Engineering with Computers 22 (2006) 95-109.

    Examples
    --------
    A plate of size 10 x 1, made of two triangles:

    >>> plate = SimplexMesh([[0, 0], [10, 0], [10, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> size_from_feature(plate, elements_across=5)
    array([0.2, 0.2, 0.2, 0.2])

    The same on a grid whose spacing exceeds the thickness of the plate:

    >>> grid = CartesianGrid([-2, -2], spacing=2.0, shape=(8, 3))
    >>> size_from_feature(grid, plate.boundary().mesh, elements_across=5)[2]
    array([0.2, 0.2, 0.2])
    """
    check_type("background", background, SimplexMesh, CartesianGrid, Octree)
    crease_angle = as_angle("crease_angle", crease_angle)
    corner_angle = as_angle("corner_angle", corner_angle)
    across = as_number("elements_across", elements_across, lower=0.0, strict=True)
    one_of("method", method, METHODS)
    by_distance = boundary is not None and not isinstance(boundary, SimplexMesh)
    if method == "spheres" and by_distance:
        raise ValueError(f"method='spheres' needs a SimplexMesh, got {describe(boundary)}")
    by_medial_axis = method == "medial-axis" or by_distance
    if tolerance is not None and (by_medial_axis or boundary is None):
        raise ValueError(
            "tolerance is for method='spheres' with a SimplexMesh as boundary, "
            f"got {describe(tolerance)} for method={method!r} and {describe(boundary)}"
        )
    if by_medial_axis and isinstance(background, CartesianGrid) and crease_angle != CREASE_ANGLE:
        raise ValueError(
            "crease_angle has no effect on the medial axis on a CartesianGrid, "
            f"got {crease_angle!r}"
        )
    options = {"crease_angle": crease_angle, "corner_angle": corner_angle}
    with reporting(progress) as report:
        if by_medial_axis:
            lfs = _by_medial_axis(background, boundary, **options, report=report)
            is_grid = isinstance(background, CartesianGrid)
            smallest = 0.0 if is_grid else SMALLEST_SHARE * background.diagonal
        else:
            if boundary is None:
                lfs, source = _at_own_nodes(background, options, report)
            else:
                assert isinstance(boundary, SimplexMesh)
                source = boundary
                lfs = _near_boundary(background, boundary, tolerance, options, report)
            smallest = SMALLEST_SHARE * source.diagonal
    h0 = np.maximum(2.0 * lfs / across, smallest)
    return minimum(h0.reshape(background.nodal_shape), hmin=hmin, hmax=hmax)


def _by_medial_axis(
    background: SimplexMesh | CartesianGrid | Octree,
    boundary: SimplexMesh | DistanceFunction | npt.ArrayLike | None,
    *,
    crease_angle: float,
    corner_angle: float,
    report: ProgressCallback,
) -> FloatArray:
    """Return the sum of the distances from the boundary and from the medial axis."""
    if boundary is None and not isinstance(background, SimplexMesh):
        raise ValueError(f"boundary must be given, as there is none in {background!r}")
    if isinstance(background, CartesianGrid):
        boundary = distance_on(background, boundary, report)
        medial = medial_axis(background, boundary, corner_angle=corner_angle, progress=report)
        return feature_size(background, boundary, medial, progress=report)
    return feature_size_with(
        background, boundary, crease_angle=crease_angle, corner_angle=corner_angle, report=report
    )


def _at_own_nodes(
    background: SimplexMesh | CartesianGrid | Octree,
    options: dict[str, float],
    report: ProgressCallback,
) -> tuple[FloatArray, SimplexMesh]:
    """Return the radius of the sphere at each node of a mesh, and the boundary of the mesh."""
    if not isinstance(background, SimplexMesh):
        raise ValueError(f"boundary must be given, as there is none in {background!r}")
    if background.dim == 1 or background.cell_dim < background.dim - 1:
        raise ValueError(
            "background must be a volume, or the boundary of one, in 2-D or 3-D, "
            f"got {background!r}"
        )
    if background.cell_dim < background.dim:
        return SphereFinder(background, **options).at_nodes(report).smallest(), background
    boundary = background.boundary()
    row = np.full(background.n_points, -1, np.int32)
    row[boundary.nodes] = np.arange(len(boundary.nodes))
    used = np.zeros(background.n_points, np.bool_)
    used[background.cells] = True
    return radii_in(boundary.mesh, background.points, row, used, options, report), boundary.mesh


def radii_in(
    boundary: SimplexMesh,
    points: FloatArray,
    row: IntArray,
    used: BoolArray,
    options: dict[str, float],
    report: ProgressCallback,
) -> FloatArray:
    """Return the radius of the sphere at each node of a domain, inf at nodes in no cell.

    Parameters
    ----------
    boundary : SimplexMesh
        That of the domain.
    points : float64[n, dim]
        Nodes of the domain.
    row : int32[n]
        The node of ``boundary`` at each of them, -1 inside.
    used : bool[n]
        Whether each is in a cell.
    options : dict
        Angles, as for `SphereFinder`.
    report : callable
    """
    finder = SphereFinder(boundary, **options)
    lfs = np.full(len(points), np.inf)
    inner, at_boundary = np.flatnonzero(used & (row < 0)), np.flatnonzero(row >= 0)
    lfs[inner] = finder.near(points[inner], report).smallest()
    lfs[at_boundary] = finder.at_nodes(report).smallest()[row[at_boundary]]
    return lfs


def _near_boundary(
    background: SimplexMesh | CartesianGrid | Octree,
    boundary: SimplexMesh,
    tolerance: float | None,
    options: dict[str, float],
    report: ProgressCallback,
) -> FloatArray:
    """Return the radius of the sphere closest to each node that is not outside, else inf."""
    points = background.points
    wanted = _not_outside(background, boundary, points, tolerance, report)
    if not wanted.any():
        raise ValueError("boundary must have nodes of the background in it or near it, got none")
    lfs = np.full(background.n_points, np.inf)
    lfs[wanted] = SphereFinder(boundary, **options).near(points[wanted], report).smallest()
    return lfs


def _not_outside(
    background: SimplexMesh | CartesianGrid | Octree,
    boundary: SimplexMesh,
    points: FloatArray,
    tolerance: float | None,
    report: ProgressCallback,
) -> BoolArray:
    """Return which nodes lie in the domain or within a tolerance of it."""
    if boundary.dim != background.dim or boundary.cell_dim != background.dim - 1:
        kind = "segments" if background.dim == 2 else "triangles"
        raise ValueError(f"boundary must consist of {kind} in {background.dim}-D, got {boundary!r}")
    if tolerance is not None:
        tolerance = as_number("tolerance", tolerance, lower=0.0)
    if isinstance(background, SimplexMesh) and background.cell_dim < background.dim:
        within = TOLERANCE * boundary.diagonal if tolerance is None else tolerance
        return np.asarray(boundary.locator.nearest(points)[2] <= within)
    phi = signed_distance(background, boundary, progress=report).ravel()
    wanted = phi <= (_reach(background, boundary) if tolerance is None else tolerance)
    if isinstance(background, CartesianGrid) and background.active is not None:
        wanted &= background.active.ravel()
    return np.asarray(wanted)


def _reach(
    background: SimplexMesh | CartesianGrid | Octree, boundary: SimplexMesh
) -> float | FloatArray:
    """Return the largest distance outside of a node of a cell that the boundary passes."""
    if isinstance(background, CartesianGrid):
        return float(np.linalg.norm(background.spacing))
    if isinstance(background, SimplexMesh):
        return TOLERANCE * boundary.diagonal
    reach = np.zeros(background.n_points)
    diagonals = np.linalg.norm(background.leaf_sizes, axis=1)
    np.maximum.at(reach, background.leaf_corners, diagonals[:, None])
    return reach
