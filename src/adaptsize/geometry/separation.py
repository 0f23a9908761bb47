"""The separation of the features of a boundary: distances between those that do not meet."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from adaptsize._checks import as_angle
from adaptsize._defaults import CORNER_ANGLE, CREASE_ANGLE, TOLERANCE
from adaptsize._kernels import separation as kernels
from adaptsize._kernels.trees import Tree
from adaptsize._progress import reporting
from adaptsize._workers import Workers
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import tree_over
from adaptsize.background.topology import rows_among
from adaptsize.geometry.faces import ANGLE_SLACK, Faces, Lists, sorted_by_place
from adaptsize.geometry.walls import WallTree
from adaptsize.geometry.width import check_boundary
from adaptsize.typing import FloatArray, IndexArray, IntArray, ProgressCallback

# Points per chunk of a thread.  A compiled loop cannot be interrupted.
_POINTS_PER_CALL = 2048


class FeaturePoints(NamedTuple):
    """Points on feature edges (in the plane at corners), given in the frame of the faces.

    Parameters
    ----------
    places : float64[n, 3]
    node : IndexArray
        Node of the boundary, -1 inside an edge.
    edge : IndexArray
        Row of ``faces.features``: one with the node, or that with the point.
    """

    places: FloatArray
    node: IndexArray
    edge: IndexArray


class BoundarySeparation(NamedTuple):
    """Separations at points on the features of a boundary, see `boundary_separation`.

    Parameters
    ----------
    points : float64[n, dim]
    distances : float64[n]
        Inf where no other feature is seen.
    """

    points: FloatArray
    distances: FloatArray


def boundary_separation(
    boundary: SimplexMesh,
    *,
    crease_angle: float = CREASE_ANGLE,
    corner_angle: float = CORNER_ANGLE,
    progress: ProgressCallback | bool | None = None,
) -> BoundarySeparation:
    r"""Return the distances between the features of a boundary, through the domain.

    The separation F(p) of a point p on a curve or at a corner is the distance to the nearest
    corner, curve or face that is not incident to the one of p.  It is the local feature size of
    [1]_, restricted to the domain: the segment between the two points must lie in the domain or
    along its boundary.  Features that meet at a corner v count only where their distance is below
    :math:`\sin(\text{corner_angle}) |p - v|`.  Two corners at the ends of one curve count.

    So it detects short edges, the ends of slits, narrow faces and steps, corners opposite a wall,
    and edges that come close to each other: places where no normal meets an opposite wall, and
    which `boundary_width` does not detect.

    Parameters
    ----------
    boundary : SimplexMesh
        Triangles in space, or segments in the plane.  They are oriented first.
    crease_angle : float, default 40
        Angle between facets above which their edge (in the plane node) is a feature edge, degrees.
        Feature edges with a loose end are not features.
    corner_angle : float, default 30
        Smallest angle between features that form a corner, degrees.
    progress : callable, bool or None
        As in `limit_gradient`.

    Returns
    -------
    BoundarySeparation
        ``points``, float64[n, dim]: all nodes on feature edges, and points between them where
        features are closer than the edges are long; in the plane, the corners.  ``distances``,
        float64[n]: separations, ``inf`` where no other feature is seen.

    Raises
    ------
    ValueError
        If the boundary is of another kind, or an angle is out of range.

    See Also
    --------
    adaptsize.size_from_separation : the size that resolves the separation.

    References
    ----------
    .. [1] J. Ruppert, "A Delaunay refinement algorithm for quality 2-dimensional mesh
       generation", J. Algorithms 18 (1995) 548-585.

    Examples
    --------
    The corners of a rectangle with a step of 0.1:

    >>> points = [[0, 0], [3, 0], [3, 1], [1, 1], [1, 0.9], [0, 0.9]]
    >>> step = SimplexMesh(points, [[i, (i + 1) % 6] for i in range(6)])
    >>> boundary_separation(step).distances.round(3)
    array([0.9, 1. , 1. , 0.1, 0.1, 0.9])
    """
    check_boundary(boundary)
    faces = Faces.of(boundary, as_angle("crease_angle", crease_angle))
    separation = Separation(faces, as_angle("corner_angle", corner_angle), WallTree.of(faces))
    with reporting(progress) as report:
        return separation.sampled(report)


@dataclass(frozen=True, eq=False)
class Separation:
    """Finds the separation of features at points on them, see `boundary_separation`.

    Parameters
    ----------
    faces : Faces
    corner_angle : float
        Degrees.
    walls : WallTree
    """

    faces: Faces
    corner_angle: float
    walls: WallTree

    def at_nodes(self, report: ProgressCallback) -> BoundarySeparation:
        """Return the nodes of all features, and the separations there."""
        nodes = self.nodes
        return self._given(nodes.places, self.at(nodes, report))

    def sampled(self, report: ProgressCallback) -> BoundarySeparation:
        """Return points at the nodes of all features and between them, and the separations.

        Edges are not halved for separations below the tolerance to which boundaries are kept by
        default.
        """
        faces = self.faces
        nodes = self.nodes
        every = [(nodes.places, self.at(nodes, report))]
        if faces.features.shape[1] == 1:
            return self._given(*every[0])
        ends = faces.frame.of(faces.mesh.points)[faces.features]
        edge = np.arange(len(ends))
        # Feature edges are halved where the separation at their middles is below their length, so
        # often.
        for _ in range(12):
            middles = 0.5 * (ends[:, 0] + ends[:, 1])
            found = self.at(FeaturePoints(middles, np.full(len(edge), -1), edge), report)
            every.append((middles, found))
            lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
            # Lengths that differ by a smaller share are equal.
            long = (found < (1.0 - 1e-6) * lengths) & (found > TOLERANCE)
            if not long.any():
                break
            halves = [np.stack([ends[long, e], middles[long]], axis=1) for e in (0, 1)]
            ends, edge = np.concatenate(halves), np.tile(edge[long], 2)
        places, distances = zip(*every, strict=True)
        return self._given(np.concatenate(places), np.concatenate(distances))

    def _given(self, places: FloatArray, distances: FloatArray) -> BoundarySeparation:
        """Return points and distances in the coordinates of the boundary."""
        frame, dim = self.faces.frame, self.faces.mesh.dim
        points = places[:, :dim] / frame.scale + frame.origin
        return BoundarySeparation(points, distances / frame.scale)

    @cached_property
    def nodes(self) -> FeaturePoints:
        """The nodes on feature edges."""
        features = self.faces.features
        node, place = np.unique(features, return_index=True)
        edge = place // features.shape[1]
        return FeaturePoints(self._places[node], node.astype(np.intp), edge)

    def at(self, which: FeaturePoints, report: ProgressCallback) -> FloatArray:
        """Return the separations at points on features, in the unit of the frame."""
        n, faces = len(which.places), self.faces
        distances = np.full(n, np.inf)
        if n == 0:
            return distances
        is_corner = (which.node >= 0) & faces.is_corner[np.maximum(which.node, 0)]
        curve = np.where(is_corner, -1, faces.curve[which.edge])
        ends = np.where(is_corner[:, None], -1, self._ends[curve])
        end_places = self._places[np.maximum(ends, 0)]
        sectors = self._sectors(which)
        sine = math.sin(math.radians(self.corner_angle) - ANGLE_SLACK)
        for number, (elements, at_corner, on_curve) in enumerate(self._kinds):
            if len(elements.tree.cells) == 0:
                continue
            first_item, items = _chosen(at_corner, on_curve, which.node, curve)
            queries = kernels.Queries(
                which.places, (first_item, items), ends.astype(np.int32), end_places, sine, *sectors
            )
            given = (elements, queries, self.walls.tree)
            task = partial(_lower, given, distances)
            workers = Workers.of(None, report).part(number / 3.0, (number + 1.0) / 3.0)
            workers.in_chunks(task, n, _POINTS_PER_CALL, "separation")
        return distances

    @cached_property
    def _places(self) -> FloatArray:
        return self.faces.frame.of(self.faces.mesh.points)

    @cached_property
    def _n_curves(self) -> int:
        return int(self.faces.curve.max(initial=-1)) + 1

    @cached_property
    def _ends(self) -> IntArray:
        """Corners at the ends of each curve, -1 for none, int32[n_curves + 1, 2]."""
        first, corners = self._curve_corners
        ends = np.full((self._n_curves + 1, 2), -1, np.int32)
        for e in (0, 1):
            has = np.flatnonzero(np.diff(first) > e)
            ends[has, e] = corners[first[has] + e]
        return ends

    @cached_property
    def _curve_corners(self) -> Lists:
        faces = self.faces
        row, column = np.nonzero(faces.is_corner[faces.features])
        if faces.features.shape[1] == 1:
            row = column = np.empty(0, np.int64)  # in the plane, there are no curves
        return Lists.of(faces.curve[row], faces.features[row, column], self._n_curves)

    @cached_property
    def _cells_of_features(self) -> Lists:
        """The facets beside each feature edge; none in the plane."""
        faces, mesh = self.faces, self.faces.mesh
        if faces.features.shape[1] == 1:
            return Lists.of(np.empty(0, np.int64), np.empty(0, np.int64), len(faces.features))
        of_cells = rows_among(mesh.edges, faces.features)[mesh.cell_facets]
        cell, column = np.nonzero(of_cells >= 0)
        return Lists.of(of_cells[cell, column], cell, len(faces.features))

    @cached_property
    def _kinds(self) -> list[tuple[kernels.Elements, Lists, Lists]]:
        """Corners, curves and faces: elements in a tree, those at each corner, on each curve."""
        faces, cells, n = self.faces, self.faces.mesh.cells, self.faces.mesh.n_points
        corners = np.flatnonzero(faces.is_corner).astype(np.int32)
        curves = np.arange(self._n_curves)
        none, segments = np.empty(0, np.int64), np.empty((0, 2), np.int32)
        if faces.features.shape[1] == 2:
            segments = sorted_by_place(self._places, faces.features)
        row, column = np.nonzero(faces.is_corner[cells])
        of_faces = Lists.of(faces.face[row], cells[row, column], faces.n_faces)
        feature, beside = self._cells_of_features.of_each(np.arange(len(faces.features)))
        return [
            (
                self._in_tree(corners[:, None], corners, Lists.of(none, none, n)),
                Lists.of(corners, corners, n),
                self._curve_corners,
            ),
            (
                self._in_tree(segments, faces.curve, self._curve_corners),
                self._curve_corners.inverse(n),
                Lists.of(curves, curves, len(curves)),
            ),
            (
                self._in_tree(faces.corner_nodes, faces.face, of_faces),
                of_faces.inverse(n),
                Lists.of(faces.curve[feature], faces.face[beside], len(curves)),
            ),
        ]

    def _in_tree(self, cells: IntArray, owner: IntArray, touched: Lists) -> kernels.Elements:
        if len(cells) == 0:
            return kernels.Elements(Tree(self._places, cells, cells), owner, touched)
        tree, order = tree_over(self._places, cells)
        return kernels.Elements(tree, owner[order], (touched.first, touched.items))

    def _sectors(self, which: FeaturePoints) -> tuple[IntArray, FloatArray]:
        """Return the sectors of the facets around points, see separation.py in _kernels."""
        mesh, k = self.faces.mesh, self.faces.mesh.cells.shape[1]
        at_node = np.flatnonzero(which.node >= 0)
        row, cell = Lists(*mesh.rings).of_each(which.node[at_node])
        query = at_node[row]
        apex = np.argmax(mesh.cells[cell] == which.node[query, None], axis=1)
        sides = [mesh.cells[cell, (apex + v) % k] for v in (1, k - 1)]
        rows = [(query, cell, *(self._places[side] for side in sides))]
        if k == 3:
            on_edge = np.flatnonzero(which.node < 0)
            row, cell = self._cells_of_features.of_each(which.edge[on_edge])
            query = on_edge[row]
            edge = self.faces.features[which.edge[query]]
            third = mesh.cells[cell].sum(axis=1) - edge.sum(axis=1)
            rows += [(query, cell, self._places[end], self._places[third]) for end in edge.T]
        queries, cells, a, b = (np.concatenate(column) for column in zip(*rows, strict=True))
        order = np.argsort(queries, kind="stable")
        queries, cells = queries[order], cells[order]
        sectors = np.empty((len(order), kernels.SECTOR))
        for column, ends in ((0, a[order]), (3, b[order])):
            vectors = ends - which.places[queries]
            length = np.linalg.norm(vectors, axis=1)
            length[length == 0.0] = 1.0  # of degenerate facets
            sectors[:, column : column + 3] = vectors / length[:, None]
        sectors[:, 6:9] = self.faces.normals[cells]
        cosine = np.einsum("ij,ij->i", sectors[:, :3], sectors[:, 3:6])
        sectors[:, 9] = np.arccos(np.clip(cosine, -1.0, 1.0)) if k == 3 else 1.0
        first = np.searchsorted(queries, np.arange(len(which.places) + 1))
        return first.astype(np.int32), sectors


def _chosen(at_corner: Lists, on_curve: Lists, node: IndexArray, curve: IndexArray) -> Lists:
    """Return for each point the list of its corner, or of its curve if that is not -1."""
    corners, curves = np.flatnonzero(curve < 0), np.flatnonzero(curve >= 0)
    k, items = at_corner.of_each(node[corners])
    m, more = on_curve.of_each(curve[curves])
    owners = np.concatenate([corners[k], curves[m]])
    return Lists.of(owners, np.concatenate([items, more]), len(node))


def _lower(given: tuple[Any, ...], distances: FloatArray, first: int, last: int) -> None:
    kernels.lower_separations(*given, (first, last), distances)
