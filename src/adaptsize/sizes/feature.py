"""Sizes from the local width of the domain."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from adaptsize._calls import recorded
from adaptsize._checks import describe
from adaptsize._defaults import CORNER_ANGLE, CREASE_ANGLE
from adaptsize._progress import reporting
from adaptsize.background import (
    AnyBackground,
    AnyMesh,
    CartesianGrid,
    Octree,
    PartitionedMesh,
    SimplexMesh,
)
from adaptsize.background.interfaces import skin_of
from adaptsize.background.migration import whole_boundary
from adaptsize.background.simplex import as_mesh, cut_out
from adaptsize.background.topology import marked, places_among
from adaptsize.geometry.distance.closest_points import DistanceFunction
from adaptsize.geometry.distance.signed_distance import signed_distance
from adaptsize.geometry.faces import Faces
from adaptsize.geometry.medial.feature_size import feature_size
from adaptsize.geometry.width import Width
from adaptsize.options import FeatureOptions, checked, with_options
from adaptsize.sizes.combine import SMALLEST_SHARE, minimum
from adaptsize.sizes.touched import nodes_beside
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback, Unpack


@recorded("size_from_feature")
@with_options(FeatureOptions)
def size_from_feature(
    background: AnyMesh | CartesianGrid | Octree,
    boundary: SimplexMesh | DistanceFunction | npt.ArrayLike | None = None,
    *,
    progress: ProgressCallback | bool | None = None,
    **options: Unpack[FeatureOptions],
) -> FloatArray:
    r"""Return the size that puts a given number of elements across narrow regions.

    .. math:: h_0(x) = W(x) / n, \qquad n = \mathrm{elements\_across},

    at nodes inside and on the boundary.  W(x) is the width of the domain at the boundary facet
    closest to x: the length of a ray from there to the opposite wall
    (`adaptsize.geometry.boundary_width`).  The size is therefore constant across a plate, and each
    node is computed independently.

    Where only distances on a grid are given, W is twice the local feature size, the distance to
    the boundary plus the distance to the medial axis, equation (6) of [1]_
    (`adaptsize.feature_size`), and n is 2 R.

    Parameters
    ----------
    background : SimplexMesh, PartitionedMesh, CartesianGrid or Octree
        A mesh of full dimension, the boundary of a domain (triangles in space or
        segments in the plane), or a grid or an octree around a domain.
    boundary : SimplexMesh, callable or array_like of float, optional
        Triangles in space or segments in the plane, as for `boundary_width`.  By
        default the boundary of the background, or the background itself.  On a CartesianGrid it
        may also be the signed distance, negative inside: a function of points, or an array.
    progress : callable, bool or None
        As in `limit_gradient`.
    **options

    Returns
    -------
    ndarray of float64, of ``background.nodal_shape``
        Sizes; ``inf`` outside, and where no opposite wall counts (corners, open boundaries), unless
        ``hmax`` is given.  At least 1e-6 of the diameter of the boundary.

    Raises
    ------
    ValueError
        If an option is out of range, the background is 1-D or a line in space, or ``boundary``
        is of another kind, missing on a grid or octree, or has no nodes in it or near it.

    See Also
    --------
    size_from_separation : for places where features are close and no normal meets a wall.
    limit_gradient : the next step.  Where the domain widens fast, so does the size.

    Notes
    -----
    Rays start on the facets around each boundary node and at the point closest to each inner node.
    A region that is narrow only between these is missed.  The background must resolve the length
    of narrow regions, but not their width.  For a thin plate, nodes at the corners are sufficient.
    On a surface, sizes that grow from there into the volume give fewer elements across than
    requested: at least 2 / g log(1 + n g / 2) for n.

    The size does not tend to zero at corners, but it does at the edges of wedges below
    ``corner_angle``.  The cost is O(n log n), a few microseconds per ray.  Regions of a mesh
    (``cell_tags``) have no effect.  Of a mesh in parts, the nodes are collected on rank 0, which
    shoots all rays; surfaces, and meshes with ``boundary``, are collected as a whole.

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
    background = as_mesh("background", background, PartitionedMesh, CartesianGrid, Octree)
    if isinstance(background, PartitionedMesh):
        return _in_parts(background, boundary, progress, options)
    given = checked(FeatureOptions, options)
    tolerance, angles = given["tolerance"], (given["crease_angle"], given["corner_angle"])
    if tolerance is not None and not isinstance(boundary, SimplexMesh):
        raise ValueError(
            "tolerance is for a SimplexMesh as boundary, "
            f"got {describe(tolerance)} for {describe(boundary)}"
        )
    with reporting(progress) as report:
        if isinstance(boundary, SimplexMesh):
            widths = _near_boundary(background, boundary, tolerance, angles, report)
            smallest = SMALLEST_SHARE * boundary.diameter
        elif boundary is None:
            if not isinstance(background, SimplexMesh):
                raise ValueError(f"boundary must be given, as there is none in {background!r}")
            widths, source = _at_own_nodes(background, angles, report)
            smallest = SMALLEST_SHARE * source.diameter
        elif not isinstance(background, CartesianGrid):
            raise ValueError(
                "boundary must be a SimplexMesh, or distances on a CartesianGrid, "
                f"got {describe(boundary)} on {background!r}"
            )
        elif angles[0] != CREASE_ANGLE:
            raise ValueError(f"crease_angle has no effect on distances, got {angles[0]!r}")
        else:
            widths = 2.0 * feature_size(
                background, boundary, corner_angle=angles[1], progress=report
            )
            smallest = 0.0
    h0 = np.maximum(widths / given["elements_across"], smallest)
    return minimum(h0.reshape(background.nodal_shape), hmin=given["hmin"], hmax=given["hmax"])


def _in_parts(
    part: PartitionedMesh,
    boundary: SimplexMesh | DistanceFunction | npt.ArrayLike | None,
    progress: ProgressCallback | bool | None,
    options: FeatureOptions,
) -> FloatArray:
    """Return the sizes on a mesh in parts; collective."""
    given = part.ranks.agree(lambda: checked(FeatureOptions, options))
    wants_rays = boundary is None and given["tolerance"] is None
    if not wants_rays or part.cell_dim < part.dim or part.dim == 1:
        return part.on_whole(
            lambda whole: size_from_feature(whole, boundary, progress=progress, **options)
        )
    outer = whole_boundary(part)
    in_cell = part.maximum(part.in_a_cell.astype(np.float64))
    points, used = part.gather_nodal(part.points), part.gather_nodal(in_cell)

    def solve() -> FloatArray | None:
        if points is None or used is None:
            return None
        row = places_among(outer.ids, len(points))
        width = Width(Faces.of(outer.mesh, given["crease_angle"]), given["corner_angle"])
        with reporting(progress) as report:
            widths = _widths_in(width, points, row, used > 0.0, report)
        h0 = np.maximum(widths / given["elements_across"], SMALLEST_SHARE * outer.mesh.diameter)
        return minimum(h0, hmin=given["hmin"], hmax=given["hmax"])

    return part.scatter_nodal(part.ranks.agree(solve))


def _at_own_nodes(
    background: SimplexMesh, angles: tuple[float, float], report: ProgressCallback
) -> tuple[FloatArray, SimplexMesh]:
    """Return the width at each node of a mesh, and the boundary of the mesh."""
    boundary, nodes = own_boundary(background)
    width = Width(Faces.of(boundary, angles[0]), angles[1])
    if boundary is background:
        return width.at_nodes(report), boundary
    row = places_among(nodes, background.n_points)
    return _widths_in(width, background.points, row, background.in_a_cell, report), boundary


def own_boundary(background: SimplexMesh) -> tuple[SimplexMesh, IntArray]:
    """Return the boundary of a volume, or the boundary itself, and its nodes in the background."""
    if background.dim == 1 or background.cell_dim < background.dim - 1:
        raise ValueError(
            "background must be a volume, or the boundary of one, in 2-D or 3-D, "
            f"got {background!r}"
        )
    return skin_of(background)


def _widths_in(
    width: Width, points: FloatArray, row: IntArray, used: BoolArray, report: ProgressCallback
) -> FloatArray:
    """Return the width at each node of a domain, inf at nodes that are not used.

    ``row`` is the node of the boundary at each of them, -1 inside.
    """
    widths = np.full(len(points), np.inf)
    inner, at_boundary = np.flatnonzero(used & (row < 0)), np.flatnonzero(row >= 0)
    widths[inner] = width.near(points[inner], report)
    widths[at_boundary] = width.at_nodes(report)[row[at_boundary]]
    return widths


def width_in_regions(
    mesh: SimplexMesh, crease_angle: float, report: ProgressCallback
) -> FloatArray:
    """Return the least width at each node of the regions around it, each within its own boundary.

    Regions whose boundaries follow voxels have none: their steps are as wide as they are high, and
    the sizes of half a voxel made six times as many elements of two organs.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in the plane or tetrahedra, with regions (``cell_tags``).
    crease_angle : float
        As for `boundary_width`.
    report : callable

    Returns
    -------
    float64[n_points]
        Inf if the mesh has a single region.
    """
    widths = np.full(mesh.n_points, np.inf)
    if mesh.cell_tags is None or mesh.cell_tags.min() == mesh.cell_tags.max():
        return widths
    order = np.argsort(mesh.cell_tags, kind="stable")
    for cells in np.split(order, np.flatnonzero(np.diff(mesh.cell_tags[order])) + 1):
        region, nodes = cut_out(mesh.points, mesh.cells[cells])
        if region.is_closed:  # only if cells overlap
            continue
        if _is_staircase(Faces.of(region.boundary().mesh, crease_angle)):
            continue
        found = _at_own_nodes(region, (crease_angle, CORNER_ANGLE), report)[0]
        widths[nodes] = np.minimum(widths[nodes], found)
    return widths


def _is_staircase(faces: Faces) -> bool:
    """Return whether most faces are sides of single voxels, which have equal areas."""
    dim = faces.mesh.dim
    small = np.bincount(faces.face) <= dim - 1
    areas = np.bincount(faces.face, faces.mesh.measures)[small]
    # A boundary of fewer faces is no staircase of voxels.
    if 2 * len(areas) <= faces.n_faces or faces.n_faces < 24:
        return False
    kinds = np.unique(np.round(areas / areas.max(), 4))
    return len(kinds) <= dim  # one for each direction of the axes


def _near_boundary(
    background: AnyBackground,
    boundary: SimplexMesh,
    tolerance: float | None,
    angles: tuple[float, float],
    report: ProgressCallback,
) -> FloatArray:
    """Return the width closest to each node in the domain or within a tolerance of it, else inf."""
    if boundary.dim != background.dim or boundary.cell_dim != background.dim - 1:
        kind = "segments" if background.dim == 2 else "triangles"
        raise ValueError(f"boundary must consist of {kind} in {background.dim}-D, got {boundary!r}")
    wanted = marked(nodes_beside(background, boundary, tolerance)[0], background.n_points)
    if not isinstance(background, SimplexMesh) or background.cell_dim == background.dim:
        wanted |= signed_distance(background, boundary, progress=report).ravel() <= 0.0
    if isinstance(background, CartesianGrid) and background.active is not None:
        wanted &= background.active.ravel()
    if not wanted.any():
        raise ValueError("boundary must have nodes of the background in it or near it, got none")
    widths = np.full(background.n_points, np.inf)
    width = Width(Faces.of(boundary, angles[0]), angles[1])
    widths[wanted] = width.near(background.points[wanted], report)
    return widths
