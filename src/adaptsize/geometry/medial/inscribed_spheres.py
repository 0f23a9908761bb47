"""Local feature size without a grid: the largest spheres inside a boundary."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_angle, as_near_points, check_type
from adaptsize._defaults import CREASE_ANGLE
from adaptsize._kernels import inscribed_spheres as kernels
from adaptsize._kernels import interpolate as tree_kernels
from adaptsize._progress import reporting
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.geometry.medial.solid import Probes, Solid
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

# A compiled loop cannot be interrupted; one call should take about this long.
_SECONDS_PER_CALL = 0.3
# Two planes meet at an edge if the distance of the edge from their common line is below this
# share of the distance between the points where the ball touches the planes.
_AT_EDGE = 0.5
# Likewise for tips, relative to a cone whose opening is the corner angle.
_AT_TIP = 1.1


@dataclass(frozen=True, eq=False)
class InscribedSpheres:
    """Largest spheres that touch a boundary from inside."""

    points: FloatArray
    """Points where the spheres touch the boundary, float64[n, dim]."""
    normals: FloatArray
    """Unit normals at these points, into the domain, float64[n, dim]."""
    radii: FloatArray
    """Radii, float64[n]; inf if there is no opposite boundary."""
    contacts: FloatArray
    """Second contact points with the boundary, float64[n, dim]; nan if there is none."""
    owners: IntArray
    """Boundary node, or number of the given point, int32[n]; may repeat at feature edges."""
    n_owners: int
    """Number of nodes, or of given points."""

    def __repr__(self) -> str:
        """Return the number of spheres and the range of their radii."""
        finite = self.radii[np.isfinite(self.radii)]
        radii = f", radii {finite.min():.4g} to {finite.max():.4g}" if len(finite) else ""
        return f"InscribedSpheres({len(self.radii)} spheres at {self.n_owners} points{radii})"

    @property
    def centres(self) -> FloatArray:
        """Centres, float64[n, dim]: points of the medial axis; nan where the radius is inf."""
        radii = np.where(np.isfinite(self.radii), self.radii, np.nan)
        return self.points + radii[:, None] * self.normals

    def smallest(self) -> FloatArray:
        """Return the smallest radius of each owner, float64[n_owners]; inf where it has none."""
        radii = np.full(self.n_owners, np.inf)
        np.minimum.at(radii, self.owners, self.radii)
        return radii


def inscribed_spheres(
    boundary: SimplexMesh,
    points: npt.ArrayLike | None = None,
    *,
    crease_angle: float = CREASE_ANGLE,
    separation_angle: float = 40.0,
    corner_angle: float = 30.0,
    progress: ProgressCallback | bool | None = None,
) -> InscribedSpheres:
    r"""Return the largest spheres inside a boundary that touch it at given points.

    Consider the spheres on the inner side that are tangent to the boundary at a point p with
    inward normal n.  The sphere through another point q has the radius

    .. math:: r(q) = |q - p|^2 / (2 n \cdot (q - p)).

    The smallest of these spheres contains no part of the boundary.  Its centre is a point of the
    medial axis, and its radius is the local feature size at p.  The ball is shrunk [1]_ in one
    descent of a tree of boxes.

    Parameters
    ----------
    boundary : SimplexMesh
        Triangles in space or segments in the plane.  Coincident nodes, inconsistent
        orientations, small holes, and degenerate or duplicate cells are allowed.  The orientation
        defines the inner side; it is repaired where neighbours contradict each other.  If the
        boundary encloses a negative volume, all of it is flipped.
    points : array_like of float, shape (n, dim), optional
        Points near the boundary; spheres are returned at the closest points of the boundary.  By
        default, spheres are returned at the nodes of the boundary.
    crease_angle : float, default 40
        Edges where the facets turn by more, and nodes where a line turns by more, are feature
        edges (creases); in degrees.  Each side of a feature edge gets its own sphere.
    separation_angle : float, default 40
        A point q is considered if the angle between p and q, seen from the centre, is larger;
        in degrees, from 0 to 180.  Smaller angles are attributed to curvature or noise.  At
        feature edges, whose sides have separate normals, the angle is 120 degrees.
    corner_angle : float, default 30
        Two facets that meet at a feature edge form a corner if the angle inside is larger, in
        degrees, and a narrow region otherwise.  In a corner, the facet across the feature edge
        does not bound the sphere, unless there are such facets on all sides.  Hence the radius
        does not tend to zero at a corner, and is not larger than the width of a face or of an
        edge between corners.
    progress : callable, bool or None
        As in `limit_gradient`.

    Returns
    -------
    InscribedSpheres
        For each of `points`, one sphere where the boundary is smooth, one for each side on feature
        edges, and none if all facets there have zero area.  Radii are inf where there is no
        opposite boundary.

    Raises
    ------
    ValueError
        If the boundary is of another kind, the points have another shape, or an angle is out
        of range.

    See Also
    --------
    adaptsize.size_from_feature : Sizes from the radii, on every background.

    Notes
    -----
    Distances to facets are exact, and radii are at most 1 % larger than the smallest one.  If the
    facets of a curved boundary lie inside it by a distance s, radii are too small by
    :math:`s / (2 \sin^2(\sigma / 2))`.  This is 4.3 s with a separation angle :math:`\sigma` of 40,
    and a few per cent where facets turn by 10 degrees.  Where the end of a body is too sharp to be
    resolved with :math:`\sigma`, as at the tip of an ellipse of 2:1, radii are up to 10 % too
    large.

    Random displacements of the nodes by 5 % of an edge reduce the radius by 6 % in the mean, and
    by more than half at one node in two hundred.  From 20 % on, the bumps themselves are the
    features.

    The time is O(n log n), except if the boundary is a sphere, which the ball touches everywhere.
    Facets across feature edges do not bound the sphere, but those inside it are all examined: on a
    surface with many feature edges, the time of each sphere grows with the number of facets.

    The order of nodes, facets and points has no influence on the radii, the other points may have,
    by 1 % as a rule.

    References
    ----------
    .. [1] J. Ma, S. W. Bae, S. Choi, "3D medial axis point approximation using nearest
       neighbors and the normal field", The Visual Computer 28 (2012) 7-19.

    Examples
    --------
    A plate 10 x 1 in the plane with nodes at the corners:

    >>> plate = SimplexMesh([[0, 0], [10, 0], [10, 1], [0, 1]], [[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> inscribed_spheres(plate).smallest()
    array([0.5, 0.5, 0.5, 0.5])
    >>> spheres = inscribed_spheres(plate, [[3, -1]])
    >>> spheres.centres, spheres.contacts
    (array([[3. , 0.5]]), array([[3., 1.]]))
    """
    finder = SphereFinder(
        boundary,
        crease_angle=crease_angle,
        separation_angle=separation_angle,
        corner_angle=corner_angle,
    )
    return finder.at_nodes(progress) if points is None else finder.near(points, progress)


class SphereFinder:
    """A boundary prepared for repeated computations of `inscribed_spheres`.

    Parameters
    ----------
    boundary, crease_angle, separation_angle, corner_angle
        As for `inscribed_spheres`.

    Raises
    ------
    ValueError
        If the boundary is of another kind or an angle is out of range.

    Examples
    --------
    >>> square = SimplexMesh([[0, 0], [2, 0], [2, 2], [0, 2]], [[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> finder = SphereFinder(square)
    >>> finder.near([[1, 0], [1, 0.5]]).smallest(), finder.at_nodes().smallest()
    (array([1., 1.]), array([1., 1., 1., 1.]))
    """

    def __init__(
        self,
        boundary: SimplexMesh,
        *,
        crease_angle: float = CREASE_ANGLE,
        separation_angle: float = 40.0,
        corner_angle: float = 30.0,
    ) -> None:
        check_type("boundary", boundary, SimplexMesh)
        if (boundary.cell_dim, boundary.dim) not in {(1, 2), (2, 3)}:
            raise ValueError(
                f"boundary must consist of segments in 2-D or triangles in 3-D, got {boundary!r}"
            )
        self._crease = as_angle("crease_angle", crease_angle)
        self._separation = as_angle("separation_angle", separation_angle)
        self._corner = as_angle("corner_angle", corner_angle)
        self._boundary = boundary
        self._solid = Solid.of(boundary, self._crease)

    def at_nodes(self, progress: ProgressCallback | bool | None = None) -> InscribedSpheres:
        """Return the spheres at the nodes of the boundary, one for each side of a feature edge."""
        return self._spheres(self._solid.probes_at_nodes(), self._boundary.n_points, progress)

    def near(
        self, points: npt.ArrayLike, progress: ProgressCallback | bool | None = None
    ) -> InscribedSpheres:
        """Return the spheres at the points of the boundary closest to given ones, float[n, dim]."""
        given = as_near_points("points", points, self._boundary.dim)
        return self._spheres(self._solid.probes_near(given), len(given), progress)

    def _spheres(
        self, probes: Probes, n_owners: int, progress: ProgressCallback | bool | None
    ) -> InscribedSpheres:
        with reporting(progress) as report:
            radii, contacts = _shrink(
                self._solid, probes, self._separation, self._corner, self._crease, report
            )
        dim = self._boundary.dim
        contacts = np.where(np.isfinite(radii)[:, None], contacts, np.nan)
        return InscribedSpheres(
            probes.points[:, :dim],
            probes.normals[:, :dim],
            radii,
            contacts[:, :dim],
            probes.owners.astype(np.int32),
            n_owners,
        )


def _shrink(
    solid: Solid,
    probes: Probes,
    separation: float,
    corner: float,
    crease: float,
    report: ProgressCallback,
) -> tuple[FloatArray, FloatArray]:
    """Return the radius at each probe, and the second contact point of the sphere."""
    n = len(probes.points)
    # Not by their numbers, since a search starts from what the one before it has found.
    order = np.lexsort((*probes.normals.T, *probes.starts.T))
    order = order[along_curve(probes.starts[order])]
    sine = max(math.sin(0.5 * math.radians(separation)), 0.01)
    opening = math.radians(corner)
    angles = np.array([
        sine, math.cos(opening), _AT_EDGE, _AT_TIP / max(math.tan(0.5 * opening), 1e-3),
        math.pi + opening + 1e-6, math.cos(math.radians(crease)),
    ])  # fmt: skip
    tree, bends = solid.tree, solid.bends
    # Distances are at most the diagonal; the angle bounds the height above the tangent plane.
    largest = 1.01 * solid.boundary.diagonal / (2.0 * sine)
    cells = (tree.points, tree.cells, solid.inward, tree.boxes, solid.slabs)
    corners = (bends.points, bends.cells, bends.boxes, solid.tips)
    near = _corners_near(solid, probes, order)
    where = (probes.starts, probes.points, probes.normals, probes.cells, *near)
    radii, contacts, touched = np.empty(n), np.empty((n, 3)), np.empty(n, np.int32)
    first, step = 0, 1024
    while first < n:
        last = min(first + step, n)
        start = time.perf_counter()
        kernels.shrink_balls(
            *cells, *corners, *where, angles, largest, order, first, last,
            radii, contacts, touched,
        )  # fmt: skip
        seconds = time.perf_counter() - start
        step = 2 * step if seconds < 0.5 * _SECONDS_PER_CALL else max(step // 2, 1)
        first = last
        report("inscribed spheres", first / n)
    return radii, contacts


def _corners_near(
    solid: Solid, probes: Probes, order: npt.NDArray[np.intp]
) -> tuple[FloatArray, IntArray]:
    """Return the distance of each probe to the edges, and its nearest tip (-1: none)."""
    from scipy.spatial import cKDTree

    n, bends = len(probes.points), solid.bends
    reaches, nearest_tip = np.full(n, np.inf), np.full(n, -1, np.int32)
    if len(bends.cells) > 0:
        found, weights = np.empty(n, np.int32), np.empty((n, 2))
        tree = (bends.points, bends.cells, bends.boxes, False)
        tree_kernels.locate(*tree, probes.starts, order, 0, n, found, weights, reaches)
    if len(solid.tips) > 0:
        nearest_tip = cKDTree(solid.tips).query(probes.starts)[1].astype(np.int32)
    return reaches, nearest_tip
