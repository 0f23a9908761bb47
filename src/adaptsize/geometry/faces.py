"""Faces, curves, corners and tips of a boundary."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._defaults import CREASE_ANGLE
from adaptsize.background import SimplexMesh
from adaptsize.background.location import in_space
from adaptsize.background.merging import first_at_place
from adaptsize.background.topology import (
    components_of,
    have_different_nodes,
    pairs_of_cells,
    unique_rows,
)
from adaptsize.geometry.creases import (
    FLAT_SHARE,
    angles_around,
    feature_facets,
    normals_of,
    sharp_facets,
)
from adaptsize.geometry.distance.orientation import MERGE_SHARE, merged_cells, oriented
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray

# Angles are compared with limits to this precision, radians, so that rounding decides nothing.
ANGLE_SLACK = 1e-7


class Lists(NamedTuple):
    """Sorted lists of numbers, one after the other.

    Parameters
    ----------
    first : int32[n + 1]
        List i is ``items[first[i] : first[i + 1]]``.
    items : IntArray
    """

    first: IntArray
    items: IntArray

    @classmethod
    def of(cls, owners: npt.NDArray[np.integer], items: npt.NDArray[np.integer], n: int) -> Lists:
        """Return n lists without repetitions from pairs of an owner and an item."""
        span = int(items.max(initial=0)) + 1
        keys = np.unique(owners.astype(np.int64) * span + items)
        first = np.searchsorted(keys // span, np.arange(n + 1))
        return cls(first.astype(np.int32), (keys % span).astype(np.int32))

    def of_each(self, chosen: npt.NDArray[np.integer]) -> tuple[IndexArray, IntArray]:
        """Return the items of chosen lists, one list after the other, and whose they are.

        ``chosen[k]`` is the list of an item, with the k that is returned for it.
        """
        count = np.diff(self.first)[chosen]
        k = np.repeat(np.arange(len(chosen)), count)
        start = self.first[chosen] - np.cumsum(count) + count
        return k, self.items[np.arange(len(k)) + start[k]]

    def inverse(self, n: int) -> Lists:
        """Return for each of n items the lists that hold it."""
        return Lists.of(self.items, self.of_each(np.arange(len(self.first) - 1))[0], n)


class BoundaryFrame(NamedTuple):
    """Coordinates of a boundary's own, so that neither its place nor its unit matters.

    Parameters
    ----------
    origin : FloatArray
    scale : float
        A power of two, by which multiplication is exact.
    """

    origin: FloatArray
    scale: float

    def of(self, points: FloatArray) -> FloatArray:
        """Return the coordinates of points in the frame, float64[n, 3]."""
        return in_space((points - self.origin) * self.scale)


@dataclass(frozen=True, eq=False)
class Faces:
    r"""The faces of a boundary, separated by feature edges, with their curves, corners and tips.

    Feature edges are edges between facets that turn by more than ``crease_angle``, edges of one
    facet or of more than two, and tagged edges.  Sharp edges with a loose end, a node with no other
    feature edge, are removed repeatedly: noise makes such edges, and they divide no face.  *Faces*
    consist of facets that are joined over other edges, *curves* of feature edges, and *corners* are
    the ends of curves: nodes with a number of feature edges other than two, or where the curve
    turns by more than ``crease_angle``.  In the plane, faces are the chains of segments between
    corners.

    Two faces *meet* if they have a feature edge (in the plane a corner) in common.  A face meets
    itself if it has a *tip*, a node whose angles sum up to less than :math:`2 \pi - 0.5`, or if a
    feature edge inside it was removed.

    The boundary is oriented first.  Coincident nodes are merged, and repeated facets and those that
    have become degenerate are left out.

    Parameters
    ----------
    mesh : SimplexMesh
        Oriented: normals outward.  The nodes are those of the given boundary.
    targets : IndexArray
        Node into which each node was merged.
    rows : IndexArray
        The cell of ``mesh`` for each cell of the given boundary; -1 if it has become
        degenerate.
    face : int32[n_cells]
        The face of each cell, numbered from 0.
    features : IntArray
        Feature edges, int32[k, 2], or in the plane corners, int32[k, 1].
    curve : int32[k]
        The curve of each feature edge.
    is_corner : bool[n_points]
    meets : Lists
        The faces that meet each face.
    """

    mesh: SimplexMesh
    targets: IndexArray
    rows: IndexArray
    face: IntArray
    features: IntArray
    curve: IntArray
    is_corner: BoolArray
    meets: Lists

    @classmethod
    def of(cls, boundary: SimplexMesh, crease_angle: float = CREASE_ANGLE) -> Faces:
        """Return the faces of triangles in space or segments in the plane; the angle in degrees."""
        mesh, targets, rows = _clean(boundary)
        split = _split_line if mesh.cell_dim == 1 else _split_surface
        return split(mesh, targets, rows, math.radians(crease_angle) + ANGLE_SLACK)

    @property
    def n_faces(self) -> int:
        """Number of faces."""
        return len(self.meets.first) - 1

    @property
    def is_rough(self) -> bool:
        """Whether most faces are single facets, as on surfaces with noise; never in the plane.

        There, faces are the lines between corners, and a polygon has one segment on each.
        """
        return (
            self.mesh.dim == 3
            and 2 * int(np.count_nonzero(np.bincount(self.face) == 1)) > self.n_faces
        )

    @cached_property
    def frame(self) -> BoundaryFrame:
        """The frame in which the boundary has its lower corner at 0 and a size of about 1."""
        used = self.mesh.points[self.mesh.cells].reshape(-1, self.mesh.dim)
        lower = used.min(axis=0)
        largest = float((used - lower).max())
        scale = math.ldexp(1.0, -math.frexp(largest)[1]) if largest > 0.0 else 1.0
        return BoundaryFrame(lower, scale)

    @cached_property
    def corner_nodes(self) -> IntArray:
        """Nodes of the facets, int32[n_cells, cell_dim + 1], sorted by their coordinates.

        What is computed from them in this order depends on no order of nodes and facets.
        """
        return sorted_by_place(self.frame.of(self.mesh.points), self.mesh.cells)

    @cached_property
    def corners(self) -> FloatArray:
        """Places of `corner_nodes` in the frame, float64[n_cells, cell_dim + 1, 3]."""
        return self.frame.of(self.mesh.points)[self.corner_nodes]

    @cached_property
    def normals(self) -> FloatArray:
        """Outward unit normals of the facets, float64[n_cells, 3]; zero where degenerate."""
        as_given = self.frame.of(self.mesh.points)[self.mesh.cells]
        given, ordered = (_normals_of(corners) for corners in (as_given, self.corners))
        length = np.linalg.norm(ordered, axis=1)
        edges = self.corners - np.roll(self.corners, 1, axis=1)
        longest = np.einsum("ijk,ijk->ij", edges, edges).max(axis=1)
        if self.mesh.cell_dim == 1:
            longest = np.sqrt(longest)
        length[length <= 2.0 * FLAT_SHARE * longest] = np.inf
        sign = np.where(np.einsum("ij,ij->i", given, ordered) < 0.0, -1.0, 1.0)
        return np.asarray(ordered * (sign / length)[:, None])


def sorted_by_place(points: FloatArray, cells: IntArray) -> IntArray:
    """Return cells with the nodes of each sorted by their coordinates, float64[n, 3]."""
    x, y, z = points.T
    order = np.lexsort((z[cells], y[cells], x[cells]), axis=-1)
    return np.take_along_axis(cells, order, axis=1)


def _normals_of(corners: FloatArray) -> FloatArray:
    """Return the normals of triangles, or of segments in the plane, not of unit length."""
    edges = corners[:, 1:] - corners[:, :1]
    if edges.shape[1] == 2:
        return np.cross(edges[:, 0], edges[:, 1])
    return edges[:, 0, [1, 0, 2]] * [1.0, -1.0, 0.0]


def _clean(boundary: SimplexMesh) -> tuple[SimplexMesh, IndexArray, IndexArray]:
    """Return the oriented boundary, the merged nodes, and its cell for each given one."""
    targets = first_at_place(boundary.points, MERGE_SHARE * boundary.diagonal)
    cells = targets[boundary.cells].astype(np.int32)
    whole = have_different_nodes(cells)
    if not whole.any():
        targets = np.arange(boundary.n_points)
        cells, whole = boundary.cells, np.ones(len(cells), np.bool_)
    kept = np.flatnonzero(whole)
    cells = cells[kept]
    copy_of = np.arange(len(cells))
    if len(unique_rows(cells, boundary.n_points)[0]) < len(cells):
        # Facets of touching bodies run in opposite directions; these are not repeated.
        start = cells.argmin(axis=1)[:, None]
        turned = np.take_along_axis(cells, (start + np.arange(cells.shape[1])) % cells.shape[1], 1)
        rows = turned if cells.shape[1] == 3 else cells
        _, first, number = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        order = np.argsort(first)  # keep the cells in their order
        copy_of = np.argsort(order)[number.reshape(-1)]
        cells, kept = cells[first[order]], kept[first[order]]
    tagged = boundary.tagged_facets
    of_given = np.full(boundary.n_cells, -1)
    of_given[whole] = copy_of
    mesh = replace(
        boundary,
        cells=cells,
        cell_tags=None if boundary.cell_tags is None else boundary.cell_tags[kept],
        tagged_facets=None if tagged is None else merged_cells(tagged, targets),
        cell_data={},
    )
    return replace(mesh, cells=oriented(mesh).cells), targets, of_given


def _split_line(mesh: SimplexMesh, targets: IndexArray, rows: IndexArray, angle: float) -> Faces:
    """Return the faces of segments in the plane; the angle in radians."""
    is_corner, face = _curves_of(mesh.points, mesh.cells, angle)
    corners = np.flatnonzero(is_corner).astype(np.int32)
    at = is_corner[mesh.cells]
    pairs = Lists.of(mesh.cells[at], np.repeat(face, 2).reshape(-1, 2)[at], mesh.n_points)
    meets = _all_pairs(pairs, corners, int(face.max()) + 1)
    curve = np.arange(len(corners), dtype=np.int32)
    return Faces(mesh, targets, rows, face, corners[:, None], curve, is_corner, meets)


def _split_surface(mesh: SimplexMesh, targets: IndexArray, rows: IndexArray, angle: float) -> Faces:
    """Return the faces of triangles in space; the angle in radians."""
    normals = normals_of(mesh)
    sharp, is_feature = (f(mesh, normals, angle) for f in (sharp_facets, feature_facets))
    on_feature = np.zeros(mesh.n_points, np.bool_)
    on_feature[mesh.edges[is_feature]] = True
    face = components_of(pairs_of_cells(mesh, ~is_feature) // 3, mesh.n_cells)
    edges = mesh.edges[is_feature]
    is_corner, curve = _curves_of(mesh.points, edges, angle)
    corner = np.flatnonzero(is_feature[mesh.cell_facets])
    beside = Lists.of(mesh.cell_facets.ravel()[corner], face[corner // 3], len(mesh.facets))
    meets = _all_pairs(beside, np.flatnonzero(is_feature), int(face.max()) + 1)
    closed = face[pairs_of_cells(mesh, sharp & ~is_feature)[:, 0] // 3]
    own = np.unique(np.concatenate([closed, face[_cells_at_tips(mesh, on_feature)]]))
    n_faces = len(meets.first) - 1
    owners, others = meets.of_each(np.arange(n_faces))
    meets = Lists.of(np.append(owners, own), np.append(others, own), n_faces)
    return Faces(mesh, targets, rows, face.astype(np.int32), edges, curve, is_corner, meets)


def _all_pairs(around: Lists, which: npt.NDArray[np.integer], n: int) -> Lists:
    """Return which of n faces are together in some of the lists; alone in one, with itself."""
    k, faces = around.of_each(which)
    row, other = around.of_each(which[k])
    own, is_alone = faces[row], np.diff(around.first)[which[k[row]]] == 1
    kept = is_alone | (own != other)
    return Lists.of(own[kept], other[kept], n)


def _cells_at_tips(mesh: SimplexMesh, on_feature: BoolArray) -> IndexArray:
    """Return a cell at each tip: a node on no feature edge, with too small a sum of angles."""
    # A node inside a face is a tip if the angles around it are less than a full turn by more,
    # radians.
    is_tip = ~on_feature & (angles_around(mesh.points, mesh.cells) < 2.0 * math.pi - 0.5)
    return np.flatnonzero(is_tip[mesh.cells].any(axis=1))


def _curves_of(points: FloatArray, edges: IntArray, angle: float) -> tuple[BoolArray, IntArray]:
    """Return which nodes are corners of curves, and the curve of each edge."""
    is_corner = np.zeros(len(points), np.bool_)
    if len(edges) == 0:
        return is_corner, np.empty(0, np.int32)
    passages = Passages.of(SimplexMesh(points, edges))
    is_smooth = passages.turn <= angle
    is_corner[edges] = True
    is_corner[passages.nodes[is_smooth]] = False
    curve = components_of(passages.segments[:, is_smooth].T, len(edges))
    return is_corner, curve.astype(np.int32)


class Passages(NamedTuple):
    """The nodes of a line where two segments meet.

    Parameters
    ----------
    nodes : intp[n]
    segments : int32[2, n]
    arriving, leaving : float64[n, dim]
        The vectors along the two segments.
    turn : float64[n]
        The angle between them, in radians.
    """

    nodes: IndexArray
    segments: IntArray
    arriving: FloatArray
    leaving: FloatArray
    turn: FloatArray

    @classmethod
    def of(cls, line: SimplexMesh) -> Passages:
        """Return the passages of segments in the plane or in space."""
        ring_ptr, ring = line.rings
        nodes = np.flatnonzero(np.diff(ring_ptr) == 2)
        segments = ring[ring_ptr[nodes] + np.arange(2)[:, None]]
        # Of the two nodes of a segment at node i, the sum less i is the other one.
        before, after = (line.cells[cells].sum(axis=1) - nodes for cells in segments)
        arriving = line.points[nodes] - line.points[before]
        leaving = line.points[after] - line.points[nodes]
        along = np.einsum("ij,ij->i", arriving, leaving)
        turn = np.arctan2(twice_area(arriving, leaving), along)
        return cls(nodes, segments, arriving, leaving, turn)


def twice_area(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the areas of the parallelograms on pairs of vectors in 2-D or 3-D."""
    if a.shape[1] == 2:
        return np.asarray(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
    return np.asarray(np.linalg.norm(np.cross(a, b), axis=1))
