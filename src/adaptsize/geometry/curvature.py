"""Curvature of triangulated surfaces and of polylines at their nodes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptsize._checks import as_angle, as_whole_number, check_type
from adaptsize._defaults import CREASE_ANGLE
from adaptsize._kernels import curvature as kernels
from adaptsize._kernels import normals as normal_kernels
from adaptsize._kernels import sectors as sector_kernels
from adaptsize.background import SimplexMesh
from adaptsize.geometry.faces import (
    Normals,
    crease_edges,
    feature_facets,
    normals_of,
    refuse_other_than_surface,
)
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: Largest number of averages; each spreads a value by one layer of neighbours.
MOST_TURNS = 1000
#: Curvatures below this, in units of one over the diagonal, are noise.
FLAT = 1e-7


class _Sectors(NamedTuple):
    sector: IntArray  # of corner 3 c + v
    sign: FloatArray  # -1: triangle runs against the first one of its sector
    fan: IntArray
    fan_ptr: IntArray
    ends: IntArray


def surface_curvature(
    surface: SimplexMesh, *, crease_angle: float = CREASE_ANGLE, smoothing: int = 0
) -> FloatArray:
    r"""Return the principal curvature of larger absolute value at the nodes of a surface.

    Each triangle gets the symmetric tensor that maps its edges to the differences of the
    normals at its corners [1]_.  Each node gets the area-weighted mean of these tensors.
    At a node on feature edges (creases), every sector between them has its own normal [2]_ and
    its own tensor, and the largest curvature is returned.  Neither feature edges nor tips of
    cones count as curvature of the surface; see `crease_curvature` for the curvature of the
    feature edges as curves.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space, in any orientation.  Open, non-manifold or non-orientable
        surfaces and degenerate triangles are allowed.
    crease_angle : float, default 40
        Edges where the normals of the two triangles differ by more than this angle are feature
        edges; so are edges of one, three or more triangles, and tagged edges (``tagged_facets``
        with another tag than 0).  In degrees, from 0 to 180.  The angle must exceed that between
        the facets of a tessellated smooth surface.
    smoothing : int, default 0
        How often the tensors are averaged over the triangles of each node.  Use 1 or 2 for
        scanned, noisy surfaces.

    Returns
    -------
    ndarray of float64, shape (n_points,)
        Curvature, 1 / length, >= 0; 0 where flat and at nodes in no triangle.

    Raises
    ------
    ValueError
        If the cells are not triangles in space, or an option is out of range.

    Notes
    -----
    Time and memory are O(n).  The result is exact to rounding on spheres and on circular
    cylinders cut into strips of any aspect ratio.  On other irregular triangulations it is
    accurate to a few per cent; on images of regular triangulations it is of second order.
    Where a smooth blend ends in a flat facet, the node on the seam gets a mean of the
    curvatures on both sides; the next node is affected in part.

    References
    ----------
    .. [1] S. Rusinkiewicz, "Estimating curvatures and their derivatives on triangle
       meshes", 3DPVT 2004, 486-493.
    .. [2] N. Max, "Weights for computing vertex normals from facet normals", Journal
       of Graphics Tools 4 (1999) 1-6.

    Examples
    --------
    The regular octahedron has its nodes on the unit sphere (its facets meet at 70.5 degrees):

    >>> points = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]]
    >>> cells = [[a, b, c] for a in (0, 3) for b in (1, 4) for c in (2, 5)]
    >>> surface_curvature(SimplexMesh(points, cells), crease_angle=80.0).round(12)
    array([1., 1., 1., 1., 1., 1.])
    >>> surface_curvature(SimplexMesh(points, cells))
    array([0., 0., 0., 0., 0., 0.])
    """
    corners = corner_curvature(surface, crease_angle=crease_angle, smoothing=smoothing)
    kappa = np.zeros(surface.n_points)
    np.maximum.at(kappa, surface.cells, corners)
    return kappa


def corner_curvature(
    surface: SimplexMesh, *, crease_angle: float = CREASE_ANGLE, smoothing: int = 0
) -> FloatArray:
    """Return the principal curvature of larger absolute value at each corner of each triangle.

    The corners at a node differ only across feature edges.  At the rim of a cylinder, for
    example, the corners of the flat cap have curvature 0.

    Parameters
    ----------
    surface, crease_angle, smoothing
        As for `surface_curvature`.

    Returns
    -------
    ndarray of float64, shape (n_cells, 3)
        Curvature at ``surface.cells``, 1 / length, >= 0.

    Raises
    ------
    ValueError
        If the cells are not triangles in space, or an option is out of range.
    """
    sectors, normals, tensors = tensors_of(surface, crease_angle, smoothing)
    kappa = np.empty(len(normals))
    kernels.fill_largest_curvature(normals, tensors, kappa)
    return _without_rounding(kappa, surface)[sectors.sector].reshape(-1, 3)


def tensors_of(
    surface: SimplexMesh, crease_angle: float, smoothing: int
) -> tuple[_Sectors, FloatArray, FloatArray]:
    """Return the sectors of a surface, their normals and their curvature tensors."""
    refuse_other_than_surface(surface)
    turns = as_whole_number("smoothing", smoothing, lower=0, upper=MOST_TURNS)
    angle = math.radians(as_angle("crease_angle", crease_angle))
    faces = normals_of(surface)
    sectors = _sectors_of(surface, faces, feature_facets(surface, faces, angle))
    normals = _normals_of(surface, faces, sectors, angle)
    tensors = np.zeros((len(normals), 6))
    kernels.fill_tensors(
        surface.points, surface.cells, faces.areas, faces.normals, sectors.sector,
        sectors.sign, normals, tensors,
    )  # fmt: skip
    for _ in range(turns):
        smoothed = np.empty_like(tensors)
        kernels.smooth_tensors(
            faces.areas, sectors.fan, sectors.fan_ptr, sectors.sector, sectors.sign,
            normals, tensors, smoothed,
        )  # fmt: skip
        tensors = smoothed
    return sectors, normals, tensors


def crease_curvature(surface: SimplexMesh, *, crease_angle: float = CREASE_ANGLE) -> FloatArray:
    """Return the curvature of the feature edges of a surface, as curves, at its nodes.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space, in any orientation.
    crease_angle : float, default 40
        As for `crease_edges`; also used for the corners of the curves.

    Returns
    -------
    ndarray of float64, shape (n_points,)
        Curvature, 1 / length, >= 0.  It is 0 at nodes on no feature edge and where
        `polyline_curvature` is 0.

    Raises
    ------
    ValueError
        If the cells are not triangles in space, or the angle is out of range.
    """
    edges = crease_edges(surface, crease_angle=crease_angle)
    if len(edges) == 0:
        return np.zeros(surface.n_points)
    return polyline_curvature(SimplexMesh(surface.points, edges), crease_angle=crease_angle)


def polyline_curvature(line: SimplexMesh, *, crease_angle: float = CREASE_ANGLE) -> FloatArray:
    r"""Return the curvature of polylines at their nodes.

    This is the curvature of the circle through a node and its two neighbours [1]_,

    .. math:: \kappa = 2 \sin\theta / |a - c|,

    with the turning angle :math:`\theta` at the node and its neighbours a and c.  It is exact
    for circles with any spacing.  The turning angle divided by the mean length would have an
    error of second order in the spacing.

    Parameters
    ----------
    line : SimplexMesh
        Segments in the plane or in space, in any orientation.
    crease_angle : float, default 40
        Nodes where the line turns by more than this angle are corners.  In degrees, from 0 to
        180.

    Returns
    -------
    ndarray of float64, shape (n_points,)
        Curvature, 1 / length, >= 0.  It is 0 at corners, at ends, where three or more segments
        meet, next to a segment of length zero, and at nodes in no segment.

    Raises
    ------
    ValueError
        If the cells are not segments in the plane or in space, or the angle is out of
        range.

    References
    ----------
    .. [1] J. C. Leger, "Menger curvature and rectifiability", Annals of Mathematics
       149 (1999) 831-869.

    Examples
    --------
    Four points of a circle of radius 5, and a corner:

    >>> points = [[5, 0], [4, 3], [3, 4], [0, 5], [0, 9]]
    >>> line = SimplexMesh(points, [[0, 1], [2, 1], [2, 3], [3, 4]])
    >>> polyline_curvature(line).round(12)
    array([0. , 0.2, 0.2, 0. , 0. ])
    """
    check_type("line", line, SimplexMesh)
    if line.cell_dim != 1 or line.dim == 1:
        raise ValueError(f"line must consist of segments in 2-D or 3-D, got {line!r}")
    angle = math.radians(as_angle("crease_angle", crease_angle))
    ring_ptr, ring = line.rings
    passed = np.flatnonzero(np.diff(ring_ptr) == 2)
    around = line.cells[ring[ring_ptr[passed][:, None] + np.arange(2)]]
    # Of the two nodes of a segment at node i, the sum less i is the other one.
    before, after = (around.sum(axis=2) - passed[:, None]).T
    arriving = line.points[passed] - line.points[before]
    leaving = line.points[after] - line.points[passed]
    chord = np.linalg.norm(arriving + leaving, axis=1)
    lengths = np.linalg.norm(arriving, axis=1) * np.linalg.norm(leaving, axis=1)
    across = _twice_area(arriving, leaving)
    turn = np.arctan2(across, (arriving * leaving).sum(axis=1))
    smooth = (turn <= angle) & (lengths > 0.0) & (chord > 0.0)
    kappa = np.zeros(line.n_points)
    kappa[passed[smooth]] = 2.0 * across[smooth] / (lengths[smooth] * chord[smooth])
    return _without_rounding(kappa, line)


def _twice_area(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the areas of the parallelograms on pairs of vectors in 2-D or 3-D."""
    if a.shape[1] == 2:
        return np.asarray(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
    return np.asarray(np.linalg.norm(np.cross(a, b), axis=1))


def _without_rounding(kappa: FloatArray, mesh: SimplexMesh) -> FloatArray:
    """Set curvatures of radius above 10^7 diagonals, which are noise, to zero (In/Out)."""
    kappa[kappa * mesh.diagonal < FLAT] = 0.0
    return kappa


def _sectors_of(surface: SimplexMesh, faces: Normals, creases: BoolArray) -> _Sectors:
    n = surface.cells.size
    sector, sign = np.empty(n, np.int32), np.empty(n)
    fan, fan_ptr = np.empty(n, np.int32), np.empty(n + 1, np.int32)
    ends = np.empty((n, 2), np.int32)
    count = sector_kernels.fill_sectors(
        surface.cells, surface.cell_facets, faces.facet_cells, creases,
        sector, sign, fan, fan_ptr, ends,
    )  # fmt: skip
    return _Sectors(sector, sign, fan, fan_ptr[: count + 1], ends[:count])


def _normals_of(
    surface: SimplexMesh, faces: Normals, sectors: _Sectors, angle: float
) -> FloatArray:
    """Return the unit normal of each sector, those of open fans corrected; zero at cone tips."""
    n_sectors = len(sectors.ends)
    normals, angles = np.empty((n_sectors, 3)), np.empty(n_sectors)
    normal_kernels.fill_sector_normals(
        surface.points, surface.cells, faces.areas, faces.normals, sectors.sign,
        sectors.fan, sectors.fan_ptr, normals,
    )  # fmt: skip
    normal_kernels.drop_conical_normals(
        faces.areas, faces.normals, sectors.sign, sectors.fan, sectors.fan_ptr,
        math.cos(angle), normals,
    )  # fmt: skip
    normal_kernels.fill_fan_angles(
        surface.points, surface.cells, sectors.fan, sectors.fan_ptr, angles
    )
    # Facets of a smooth surface turn by less than the crease angle, and the error of the
    # normal of a fan is at most half of that.  Fans at corners and along feature edges depend
    # on each other; hence they are corrected alternately.
    limit = math.tan(0.5 * min(angle, 0.5 * math.pi))
    for corners in (True, False, True, False):
        corrected = normals.copy()
        normal_kernels.correct_open_normals(
            surface.points, surface.cells, sectors.fan, sectors.fan_ptr, sectors.ends,
            sectors.sector, sectors.sign, angles, corners, limit, normals, corrected,
        )  # fmt: skip
        normals = corrected
    return normals
