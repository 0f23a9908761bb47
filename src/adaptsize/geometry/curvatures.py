"""Curvature of triangulated surfaces and of polylines at their nodes."""

from __future__ import annotations

import math
from typing import Literal, TypeAlias, get_args

import numpy as np

from adaptsize._checks import as_angle, as_whole_number, one_of
from adaptsize._defaults import CREASE_ANGLE
from adaptsize._kernels import curvature as kernels
from adaptsize._kernels.sectors import Sectors, Surface, fill_sectors
from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.geometry.creases import corner_angles, crease_edges, feature_facets, normals_of
from adaptsize.geometry.faces import Passages, twice_area
from adaptsize.typing import FloatArray, IntArray

#: What the curvature is returned for.
Places: TypeAlias = Literal["nodes", "corners", "creases"]

#: Largest number of averages; each spreads a value by one layer of neighbours.
MOST_TURNS = 1000
#: Curvatures below this, in units of one over the diagonal, are noise.
FLAT = 1e-7


def curvature(
    boundary: SimplexMesh,
    *,
    of: Places = "nodes",
    crease_angle: float = CREASE_ANGLE,
    smoothing: int = 0,
) -> FloatArray:
    r"""Return the curvature of a triangulated surface, or of polylines.

    *Triangles in space.*  Each triangle gets the symmetric tensor that maps its edges to the
    differences of the normals at its corners [1]_.  Each node gets the area-weighted mean of these
    tensors, and the result is the principal curvature of larger absolute value.  At a node on
    feature edges (creases), every sector between them has its own normal [2]_ and its own tensor.
    Neither feature edges nor tips of cones count as curvature of the surface.

    *Segments*, and the feature edges of a surface.  This is the curvature of the circle through a
    node and its two neighbours a and c [3]_,

    .. math:: \kappa = 2 \sin\theta / |a - c|,

    with the turning angle :math:`\theta` at the node.  It is exact for circles with any spacing.
    The turning angle divided by the mean length would have an error of second order in the spacing.

    Parameters
    ----------
    boundary : SimplexMesh
        Triangles in space, or segments in the plane or in space, in any orientation.  Open,
        non-manifold or non-orientable surfaces and degenerate triangles are allowed.
    of : {"nodes", "corners", "creases"}
        Of the nodes, the largest of the sectors at each; of the corners of the triangles, which
        differ at a node only across feature edges (at the rim of a cylinder, the corners of the
        flat cap have curvature 0); or of the feature edges as curves, at the nodes.
    crease_angle : float, default 40
        Edges where the normals of the two triangles differ by more than this angle are feature
        edges; so are edges of one, three or more triangles, and tagged edges (``tagged_facets``
        with another tag than 0).  Nodes where a line turns by more are corners.  In degrees, from
        0 to 180.  The angle must exceed that between the facets of a tessellated smooth surface.
    smoothing : int, default 0
        How often the tensors are averaged over the triangles of each node.  Use 1 or 2 for
        scanned, noisy surfaces.  0 for lines.

    Returns
    -------
    ndarray of float64, shape (n_points,), or of corners (n_cells, 3)
        Curvature, 1 / length, >= 0; 0 where flat and at nodes in no cell.  Of lines, 0 at corners,
        at ends, where three or more segments meet, and next to a segment of length zero.

    Raises
    ------
    ValueError
        If the cells are neither triangles in space nor segments in the plane or in space, or an
        option is out of range or not for segments.

    See Also
    --------
    level_set_curvature : The same for signed distances on a grid.

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
    .. [3] J. C. Leger, "Menger curvature and rectifiability", Annals of Mathematics
       149 (1999) 831-869.

    Examples
    --------
    The regular octahedron has its nodes on the unit sphere (its facets meet at 70.5 degrees):

    >>> points = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]]
    >>> cells = [[a, b, c] for a in (0, 3) for b in (1, 4) for c in (2, 5)]
    >>> curvature(SimplexMesh(points, cells), crease_angle=80.0).round(12)
    array([1., 1., 1., 1., 1., 1.])
    >>> curvature(SimplexMesh(points, cells))
    array([0., 0., 0., 0., 0., 0.])

    Four points of a circle of radius 5, and a corner:

    >>> points = [[5, 0], [4, 3], [3, 4], [0, 5], [0, 9]]
    >>> line = SimplexMesh(points, [[0, 1], [2, 1], [2, 3], [3, 4]])
    >>> curvature(line).round(12)
    array([0. , 0.2, 0.2, 0. , 0. ])
    """
    boundary = as_mesh("boundary", boundary)
    one_of("of", of, get_args(Places))
    if (boundary.cell_dim, boundary.dim) not in {(1, 2), (1, 3), (2, 3)}:
        raise ValueError(
            "boundary must consist of triangles in 3-D, or of segments in 2-D or 3-D, "
            f"got {boundary!r}"
        )
    if boundary.cell_dim == 1:
        if of != "nodes":
            raise ValueError(f"of must be 'nodes' for segments, got {of!r} for {boundary!r}")
        if smoothing != 0:
            raise ValueError(
                "smoothing must be 0 for segments (curvature is not averaged), "
                f"got {smoothing!r} for {boundary!r}"
            )
        return _of_lines(boundary, crease_angle)
    if of == "creases":
        edges = crease_edges(boundary, crease_angle=crease_angle)
        kappa = np.zeros(boundary.n_points)
        return _of_lines(SimplexMesh(boundary.points, edges), crease_angle) if len(edges) else kappa
    sectors, normals, tensors = tensors_of(boundary, crease_angle, smoothing)
    largest = np.abs(_principal(normals, tensors)[1]).max(axis=1)
    corners: FloatArray = _without_rounding(largest, boundary)[sectors.sector].reshape(-1, 3)
    if of == "corners":
        return corners
    kappa = np.zeros(boundary.n_points)
    np.maximum.at(kappa, boundary.cells, corners)
    return kappa


def _of_lines(line: SimplexMesh, crease_angle: float) -> FloatArray:
    """Return the curvature of segments at their nodes."""
    angle = math.radians(as_angle("crease_angle", crease_angle))
    passed, _, arriving, leaving, turn = Passages.of(line)
    chord = np.linalg.norm(arriving + leaving, axis=1)
    lengths = np.linalg.norm(arriving, axis=1) * np.linalg.norm(leaving, axis=1)
    across = twice_area(arriving, leaving)
    smooth = (turn <= angle) & (lengths > 0.0) & (chord > 0.0)
    kappa = np.zeros(line.n_points)
    kappa[passed[smooth]] = 2.0 * across[smooth] / (lengths[smooth] * chord[smooth])
    return _without_rounding(kappa, line)


def tensors_of(
    surface: SimplexMesh, crease_angle: float, smoothing: int
) -> tuple[Sectors, FloatArray, FloatArray]:
    """Return the sectors of a surface, their normals and their curvature tensors."""
    turns = as_whole_number("smoothing", smoothing, lower=0, upper=MOST_TURNS)
    angle = math.radians(as_angle("crease_angle", crease_angle))
    faces = normals_of(surface)
    n = surface.cells.size
    fans = np.empty(n, np.int32), np.empty(n + 1, np.int32), np.empty((n, 2), np.int32)
    sectors = Sectors(np.empty(n, np.int32), np.empty(n), *fans)
    count = fill_sectors(faces, feature_facets(surface, faces, angle), sectors)
    sectors = sectors._replace(fan_ptr=fans[1][: count + 1], ends=fans[2][:count])
    normals = _normals_of(faces, sectors, angle)
    tensors = np.zeros((len(normals), 6))
    kernels.fill_tensors(faces, sectors, normals, tensors)
    for _ in range(turns):
        smoothed = np.empty_like(tensors)
        kernels.smooth_tensors(faces, sectors, normals, tensors, smoothed)
        tensors = smoothed
    return sectors, normals, tensors


def _without_rounding(kappa: FloatArray, mesh: SimplexMesh) -> FloatArray:
    """Set curvatures of radius above 10^7 diagonals, which are noise, to zero (In/Out)."""
    kappa[kappa * mesh.diagonal < FLAT] = 0.0
    return kappa


def _normals_of(surface: Surface, sectors: Sectors, angle: float) -> FloatArray:
    """Return the unit normal of each sector, those of open fans corrected; zero at cone tips."""
    normals = np.empty((len(sectors.ends), 3))
    kernels.fill_sector_normals(surface, sectors, normals)
    # A sector with a triangle too oblique to its normal is the tip of a cone, whose triangles meet
    # at small angles: it has no normal and no curvature.
    own = np.repeat(surface.normals, 3, axis=0)
    cosines = sectors.sign * np.einsum("ij,ij->i", normals[sectors.sector], own)
    oblique = (cosines < math.cos(angle)) & (np.repeat(surface.areas, 3) > 0.0)
    normals[sectors.sector[oblique]] = 0.0
    at_corners = corner_angles(surface.points[surface.cells])
    angles = np.bincount(sectors.sector, at_corners.ravel())
    # Facets of a smooth surface turn by less than the crease angle, and the error of the
    # normal of a fan is at most half of that.  Fans at corners and along feature edges depend
    # on each other; hence they are corrected alternately.
    limit = math.tan(0.5 * min(angle, 0.5 * math.pi))
    for corners in (True, False, True, False):
        corrected = normals.copy()
        kernels.correct_open_normals(surface, sectors, angles, (corners, limit), normals, corrected)
        normals = corrected
    return normals


def sector_curvatures(
    surface: SimplexMesh, *, crease_angle: float = CREASE_ANGLE, smoothing: int = 0
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Return the principal curvatures and directions of the smooth parts at each node.

    A sector consists of the triangles at a node between two feature edges.

    Parameters
    ----------
    surface, crease_angle, smoothing
        As for `curvature`.

    Returns
    -------
    nodes : int32[n_sectors]
        The node of each sector.
    normals : float64[n_sectors, 3]
        Unit vectors.
    curvatures : float64[n_sectors, 2]
        In the order of size, with signs; 0 where there is no normal, as at the tip of a cone.
    directions : float64[n_sectors, 3, 2]
        Unit tangents, in columns.
    """
    sectors, normals, tensors = tensors_of(surface, crease_angle, smoothing)
    nodes = np.empty(len(normals), np.int32)
    nodes[sectors.sector] = surface.cells.ravel()
    known = np.linalg.norm(normals, axis=1) > 0.5
    unit = np.where(known[:, None], normals, [0.0, 0.0, 1.0])
    frame, curvatures, along = _principal(unit, tensors)
    curvatures[~known | (np.abs(curvatures).max(axis=1) * surface.diagonal < FLAT)] = 0.0
    return nodes, unit, curvatures, np.asarray(frame @ along)


def _principal(
    normals: FloatArray, tensors: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return tangents in columns, and the eigenvalues and eigenvectors of tensors in these."""
    least = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    u = np.cross(normals, least)
    u /= np.maximum(np.linalg.norm(u, axis=1), 1e-300)[:, None]
    frame = np.dstack([u, np.cross(normals, u)])
    xx, yy, zz, yz, xz, xy = tensors.T
    full = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3)
    return frame, *np.linalg.eigh(frame.swapaxes(1, 2) @ full @ frame)
