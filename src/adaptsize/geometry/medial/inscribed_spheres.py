"""Local feature size without a grid: the largest spheres inside a boundary."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_number, as_points, check_type
from adaptsize._kernels import inscribed_spheres as kernels
from adaptsize._kernels import interpolate as tree_kernels
from adaptsize._progress import reporting
from adaptsize.background import SimplexMesh
from adaptsize.geometry.medial.solid import Probes, Solid, along_curve
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

# A compiled loop cannot be interrupted; one call of it should last about this long.
_SECONDS_PER_CALL = 0.3
# Two planes meet at an edge if it comes as near to their line as this, over the distance of
# the points where the ball touches them.
_AT_EDGE = 0.5
# Likewise for tips, over what a cone as sharp as the corner angle has.
_AT_TIP = 1.1


@dataclass(frozen=True, eq=False)
class InscribedSpheres:
    """Spheres that touch a boundary from inside, as large as they can be."""

    points: FloatArray
    """Where each touches the boundary, float64[n, dim]."""
    normals: FloatArray
    """Unit normals there, into the domain, float64[n, dim]."""
    radii: FloatArray
    """float64[n]; inf where nothing is opposite."""
    contacts: FloatArray
    """Where each touches the boundary again, float64[n, dim]; nan where it does not."""
    owners: IntArray
    """Node of the boundary, or number of the given point, int32[n]; may repeat at creases."""
    n_owners: int
    """Number of nodes, or of given points."""

    def __repr__(self) -> str:
        """Say how many of which radii."""
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
    crease_angle: float = 40.0,
    separation_angle: float = 40.0,
    corner_angle: float = 30.0,
    progress: ProgressCallback | bool | None = None,
) -> InscribedSpheres:
    r"""Return the largest spheres inside a boundary that touch it at given points.

    Of the spheres on the inner side that are tangent to the boundary at a point p with
    inward normal n, the one through another point q has the radius

    .. math:: r(q) = |q - p|^2 / (2 n \cdot (q - p)),

    and the least one holds nothing of the boundary.  Its centre is a point of the medial axis, its
    radius the local feature size at p; the ball is shrunk [1]_ in one descent of a tree of boxes.

    Parameters
    ----------
    boundary : SimplexMesh
        Triangles in space or segments in the plane.  Nodes at one place, contradicting
        orientations, small holes, degenerate and doubled cells are allowed.  Which side is the
        inner one is told by the orientation, mended where neighbours contradict each other;
        if the whole encloses a negative volume it is turned.
    points : array_like of float, shape (n, dim), optional
        Spheres at the points of the boundary that are closest to these.  By default spheres at
        the nodes of the boundary.
    crease_angle : float, default 40
        Edges where the facets, and nodes where a line, turn by more are sharp; degrees.
        Each side of a crease gets its own sphere.
    separation_angle : float, default 40
        A point q counts if p and q are seen from the centre under a larger angle, in
        degrees, from 0 to 180: what turns by less is not narrow but curved, or noise.  At
        creases, whose sides have a normal each, the angle is 120 degrees.
    corner_angle : float, default 30
        Two facets that meet at a crease are a corner if the angle inside is larger, degrees,
        and a narrow place otherwise.  In a corner the facet across the crease does not bound
        the sphere, unless there are such facets on all sides: the radius does not go to
        zero at a corner, and is not larger than a face or an edge between corners is wide.
    progress : callable, bool or None
        As in `limit_gradient`.

    Returns
    -------
    InscribedSpheres
        Of `points`, one where the boundary is smooth, on creases one for each side; none
        where facets without area are all there is.  Radii are inf where nothing is opposite.

    Raises
    ------
    ValueError
        If the boundary is of another kind, the points have another shape, or an angle is out
        of range.

    See Also
    --------
    adaptsize.size_from_feature : sizes from the radii, on every background.

    Notes
    -----
    Distances to facets are exact, and radii no more than 1 % larger than the least one.  Facets
    of a curved boundary lie inside it, by s, say: radii are too small by
    :math:`s / (2 \sin^2(\sigma / 2))`, 4.3 s with a separation angle :math:`\sigma` of 40, a
    few per cent where facets turn by 10 degrees.  Where the end of a body is sharper than
    :math:`\sigma` shows, as at the tip of an ellipse of 2:1, radii are up to 10 % too large.

    Random displacements of the nodes by 5 % of an edge make the radius 6 % smaller in the mean
    and less than half as large at one node in two hundred; from 20 % on the bumps themselves are
    the features.

    O(n log n) time, but where the boundary is a sphere, which is touched everywhere.

    References
    ----------
    .. [1] J. Ma, S. W. Bae, S. Choi, "3D medial axis point approximation using nearest
       neighbors and the normal field", The Visual Computer 28 (2012) 7-19.

    Examples
    --------
    A plate 10 x 1 in the plane, its nodes at the corners:

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
    """A boundary prepared for `inscribed_spheres`, to be asked several times.

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
        crease_angle: float = 40.0,
        separation_angle: float = 40.0,
        corner_angle: float = 30.0,
    ) -> None:
        check_type("boundary", boundary, SimplexMesh)
        if (boundary.cell_dim, boundary.dim) not in {(1, 2), (2, 3)}:
            raise ValueError(
                f"boundary must consist of segments in 2-D or triangles in 3-D, got {boundary!r}"
            )
        self._crease = _as_angle("crease_angle", crease_angle)
        self._separation = _as_angle("separation_angle", separation_angle)
        self._corner = _as_angle("corner_angle", corner_angle)
        self._boundary = boundary
        self._solid = Solid.of(boundary, self._crease)

    def at_nodes(self, progress: ProgressCallback | bool | None = None) -> InscribedSpheres:
        """Return the spheres at the nodes of the boundary: one for each side of a crease."""
        return self._spheres(self._solid.probes_at_nodes(), self._boundary.n_points, progress)

    def near(
        self, points: npt.ArrayLike, progress: ProgressCallback | bool | None = None
    ) -> InscribedSpheres:
        """Return the spheres at the points of the boundary closest to given ones, float[n, dim]."""
        given = as_points("points", points, self._boundary.dim)
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
    """Return the radius at each probe, and where the sphere touches the boundary again."""
    n = len(probes.points)
    order = along_curve(probes.points)
    sine = max(math.sin(0.5 * math.radians(separation)), 0.01)
    opening = math.radians(corner)
    angles = np.array([
        sine, math.cos(opening), _AT_EDGE, _AT_TIP / max(math.tan(0.5 * opening), 1e-3),
        math.pi + opening + 1e-6, math.cos(math.radians(crease)),
    ])  # fmt: skip
    tree, bends = solid.tree, solid.bends
    # No point is farther than the diagonal, nor lower over the tangent plane than the angle.
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


def _as_angle(name: str, value: float) -> float:
    angle = as_number(name, value, lower=0.0)
    if angle > 180.0:
        raise ValueError(f"{name} must be at most 180 degrees, got {angle:g}")
    return angle
