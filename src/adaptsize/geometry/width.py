"""The width of a domain: the length of rays from its boundary to the opposite wall."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_angle, check_type
from adaptsize._defaults import CORNER_ANGLE, CREASE_ANGLE
from adaptsize._kernels import rays as kernels
from adaptsize._kernels.distance import fill_closest
from adaptsize._progress import reporting
from adaptsize._workers import in_all_threads
from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.background.topology import components_of, pairs_of_cells
from adaptsize.geometry import tuning
from adaptsize.geometry.distance.winding import WindingNumber
from adaptsize.geometry.faces import ANGLE_SLACK, Faces
from adaptsize.geometry.walls import SLACK, WallTree
from adaptsize.typing import BoolArray, FloatArray, IndexArray, ProgressCallback


def boundary_width(
    boundary: SimplexMesh,
    *,
    crease_angle: float = CREASE_ANGLE,
    corner_angle: float = CORNER_ANGLE,
    progress: ProgressCallback | bool | None = None,
) -> FloatArray:
    r"""Return the width of the domain at the facets of its boundary.

    The width W(p) at a point p of the boundary is the distance from p along the inward normal to
    the first wall.  The wall counts unless

    * its plane is steeper than 75 degrees to that of p, or
    * the angle between the planes is ``corner_angle`` or more, and the faces of the two points
      *meet*: they have a feature edge in common, or are one face with a tip.

    Hence a wedge below ``corner_angle`` is narrow up to its edge, and above it is a corner, which
    is not narrow.  A channel that tapers without meeting walls is narrow at any angle.

    Parameters
    ----------
    boundary : SimplexMesh
        Triangles in space, or segments in the plane.  They are oriented first.
    crease_angle : float, default 40
        Angle between facets above which their edge (in the plane node) is a feature edge, degrees.
    corner_angle : float, default 30
        Smallest angle between faces that form a corner, degrees.
    progress : callable, bool or None
        As in `limit_gradient`.

    Returns
    -------
    ndarray of float64, shape (n_cells,)
        Width at the centroid of each facet; ``inf`` where no wall counts.

    Raises
    ------
    ValueError
        If the boundary is of another kind, or an angle is out of range.

    See Also
    --------
    adaptsize.size_from_feature : the size that resolves the width.
    boundary_separation : the distance between features that meet no normal.

    Notes
    -----
    The width of plates, rods, tubes, balls and tori is exact up to the error of the facets, which
    is of second order in their length.  The least distance between two smooth walls is attained
    along a common normal, so each local minimum of the thickness is seen from both sides.

    Only what is inside the domain counts.  A ray that enters another body, as where bodies overlap,
    ends where it leaves the last one.  Facets inside of another body have no width.  Walls of
    bodies that touch are walls, and so are open sheets, from both sides.

    The result does not depend on the order of nodes and facets, bit for bit, and on the position,
    orientation and unit of the boundary only by rounding.  A ray takes O(log n), 2 to 5
    microseconds.

    Examples
    --------
    A wedge of 20 degrees in the plane, and one of 60 degrees:

    >>> import numpy as np
    >>> for angle in (20.0, 60.0):
    ...     far = 3.0 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    ...     wedge = SimplexMesh([[0, 0], [3, 0], far], [[0, 1], [1, 2], [2, 0]])
    ...     print(boundary_width(wedge).round(3))
    [0.546   inf 0.546]
    [inf inf inf]
    """
    boundary = as_mesh("boundary", boundary)
    check_boundary(boundary)
    faces = Faces.of(boundary, as_angle("crease_angle", crease_angle))
    width = Width(faces, as_angle("corner_angle", corner_angle))
    with reporting(progress) as report:
        found = width.shoot(faces.corners.mean(axis=1), np.arange(faces.mesh.n_cells), report)
    return np.where(faces.rows >= 0, found[faces.rows] / faces.frame.scale, np.inf)


def check_boundary(boundary: SimplexMesh) -> None:
    """Raise a ValueError for meshes other than triangles in space and segments in the plane."""
    check_type("boundary", boundary, SimplexMesh)
    if (boundary.cell_dim, boundary.dim) not in {(1, 2), (2, 3)}:
        raise ValueError(
            f"boundary must consist of segments in 2-D or triangles in 3-D, got {boundary!r}"
        )


@dataclass(frozen=True, eq=False)
class Width:
    """Finds the width of a domain at points of its boundary, see `boundary_width`.

    Parameters
    ----------
    faces : Faces
    corner_angle : float
        Degrees.
    crosses_itself : bool
        Whether a piece of the boundary is known to intersect itself.
    """

    faces: Faces
    corner_angle: float
    crosses_itself: bool = False

    @cached_property
    def walls(self) -> WallTree:
        """The facets in a tree."""
        return WallTree.of(self.faces)

    @cached_property
    def _pieces(self) -> IndexArray:
        """The piece of the boundary of each facet, joined over edges of two facets."""
        mesh = self.faces.mesh
        links = pairs_of_cells(mesh, mesh.facet_cell_counts == 2) // (mesh.cell_dim + 1)
        return components_of(links, mesh.n_cells)

    @cached_property
    def _rule(self) -> kernels.Rule:
        """Which walls count; facets of pieces with a rim are open sheets."""
        faces, mesh, piece, order = self.faces, self.faces.mesh, self._pieces, self.walls.order
        has_rim = np.zeros(mesh.n_cells, np.bool_)
        has_rim[piece[(mesh.facet_cell_counts[mesh.cell_facets] == 1).any(axis=1)]] = True
        angles = [tuning.STEEPEST_WALL + ANGLE_SLACK, math.radians(self.corner_angle) - ANGLE_SLACK]
        limits = np.cos(np.maximum(angles, 0.0))
        meets = (faces.meets.first, faces.meets.items)
        return kernels.Rule(has_rim[piece][order], faces.face[order], meets, limits)

    def samples(self, report: ProgressCallback) -> Samples:
        """Return the width at the centroids of all facets, and near the corners of long ones."""
        corners = self.faces.corners
        m, k = corners.shape[:2]
        cells = np.arange(m)
        middles = corners.mean(axis=1)
        widths = self.shoot(middles, cells, report)
        sides = corners - np.roll(corners, 1, axis=1)
        longest = np.sqrt(np.einsum("ijk,ijk->ij", sides, sides).max(axis=1))
        long = np.flatnonzero(
            longest > tuning.LONG_FACET * np.where(np.isfinite(widths), widths, 0.0)
        )
        near = _inside(np.eye(k))
        starts = np.einsum("vi,mij->mvj", near, corners[long]).reshape(-1, 3)
        more = self.shoot(starts, np.repeat(cells[long], k), report)
        return Samples(
            np.concatenate([middles, starts]),
            np.concatenate([widths, more]),
            np.concatenate([cells, np.repeat(long, k)]),
            np.concatenate([np.full(m, -1), np.tile(np.arange(k), len(long))]),
        )

    def at_nodes(self, report: ProgressCallback) -> FloatArray:
        """Return the least width of the facets around each node, near the node.

        Inf at nodes in no facet.
        """
        return self.nodal(self.samples(report))

    def nodal(self, found: Samples) -> FloatArray:
        """Return the least of the samples around each node of the given boundary."""
        faces = self.faces
        n_cells, k = faces.mesh.cells.shape
        near = np.repeat(found.widths[:n_cells, None], k, axis=1)
        at_corner = found.corner >= 0
        near[found.cell[at_corner], found.corner[at_corner]] = found.widths[at_corner]
        nodal = np.full(faces.mesh.n_points, np.inf)
        np.minimum.at(nodal, faces.corner_nodes, near)
        return nodal[faces.targets] / faces.frame.scale

    def near(self, points: FloatArray, report: ProgressCallback) -> FloatArray:
        """Return the least width of the facets closest to each point, float64[n, dim]."""
        mesh, faces = self.faces.mesh, self.faces
        distances = mesh.locator.nearest(points)[2]
        reach = distances + SLACK / faces.frame.scale
        which, cells = mesh.locator.within(points, reach)
        weights = np.empty(faces.corner_nodes[cells].shape)
        fill_closest(
            faces.frame.of(mesh.points), faces.corner_nodes, cells,
            faces.frame.of(points[which]), weights,
        )  # fmt: skip
        starts = np.einsum("ij,ijk->ik", _inside(weights), faces.corners[cells])
        widths = np.full(len(points), np.inf)
        np.minimum.at(widths, which, self.shoot(starts, cells, report))
        return widths / faces.frame.scale

    def shoot(
        self, starts: FloatArray, cells: npt.NDArray[np.integer], report: ProgressCallback
    ) -> FloatArray:
        """Return the widths at points inside of given facets, both in the frame."""
        widths = np.full(len(starts), np.inf)
        reach = np.full(len(starts), SLACK)
        going = np.flatnonzero(~self.are_inner(starts, cells))
        # Rays that leave more bodies, one inside the next, are given up.
        for _ in range(64):
            directions = -self.faces.normals[cells[going]]
            n = len(going)
            rays = kernels.Rays(
                starts[going], directions, self.faces.face[cells[going]], reach[going],
                np.empty(n), np.empty(n, np.bool_), np.empty(n),
            )  # fmt: skip
            shoot = partial(kernels.shoot, self.walls.tree, self._rule, rays)
            in_all_threads(shoot, n, 4096, "width", report)
            leaves, stops, widths[going] = rays.leaves, rays.stops, rays.widths
            left = np.flatnonzero(np.isfinite(leaves) & ~stops)
            beyond = starts[going[left]] + leaves[left, None] * directions[left]
            left = left[self._are_inside(beyond, directions[left], cells[going[left]])]
            if len(left) == 0:
                break
            going, leaves = going[left], leaves[left]
            reach[going] = leaves + SLACK
        return widths

    def are_inner(self, places: FloatArray, cells: npt.NDArray[np.integer]) -> BoolArray:
        """Return which points in given facets, in the frame, are inside of another body."""
        return self._are_inside(places, self.faces.normals[cells], cells)

    def _are_inside(
        self, places: FloatArray, directions: FloatArray, cells: npt.NDArray[np.integer]
    ) -> BoolArray:
        """Return whether a body is beyond points of the boundary, other than one that begins there.

        Walls of bodies that touch, and both sides of a slit, are walls.  Points that are in the box
        of no other piece than that of their facet are not tested.
        """
        inside = np.zeros(len(places), np.bool_)
        near = np.flatnonzero(self._beside_others(places, cells))
        if len(near) > 0:
            enters = np.empty(len(near), np.bool_)
            two_sided = self._rule.two_sided
            kernels.find_entries(self.walls.tree, two_sided, places[near], directions[near], enters)
            # Points this far beyond a wall, in the same unit, tell whether another body is there.
            beyond = places[near] + 1e-6 * directions[near]
            turns = np.abs(self._winding(beyond[:, : self.faces.mesh.dim]))
            inside[near] = turns > 0.5 + tuning.WINDING_ERROR + enters
        return inside

    def _beside_others(self, places: FloatArray, cells: npt.NDArray[np.integer]) -> BoolArray:
        """Return which points in given facets are in the box of another piece of the boundary."""
        piece, corners = self._pieces, self.faces.corners
        n = int(piece.max()) + 1
        # Of more pieces, all points are tested; of fewer, those in the boxes of others.
        if self.crosses_itself or n > 200:
            return np.ones(len(places), np.bool_)
        found = np.zeros(len(places), np.bool_)
        if n == 1:
            return found
        lower, upper = np.full((n, 3), np.inf), np.full((n, 3), -np.inf)
        np.minimum.at(lower, piece, corners.min(axis=1))
        np.maximum.at(upper, piece, corners.max(axis=1))
        for k in range(n):
            inside = (places >= lower[k] - SLACK).all(axis=1)
            inside &= (places <= upper[k] + SLACK).all(axis=1)
            found |= inside & (piece[cells] != k)
        return found

    @cached_property
    def _winding(self) -> WindingNumber:
        faces = self.faces
        local = faces.frame.of(faces.mesh.points)[:, : faces.mesh.dim]
        return WindingNumber(SimplexMesh(local, faces.mesh.cells))


class Samples(NamedTuple):
    """Widths at points of a boundary, in the frame of its faces.

    Parameters
    ----------
    points : float64[n, 3]
    widths : float64[n]
    cell : IndexArray
        Facet of each point.
    corner : IndexArray
        Corner next to which each point lies, -1 at centroids.
    """

    points: FloatArray
    widths: FloatArray
    cell: IndexArray
    corner: IndexArray


def _inside(weights: FloatArray) -> FloatArray:
    """Return weights of points that are not on the edges of their facets."""
    inside = np.maximum(weights, tuning.BESIDE_EDGE)
    return np.asarray(inside / inside.sum(axis=1)[:, None])
