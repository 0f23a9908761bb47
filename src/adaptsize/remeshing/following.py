"""New simplices that follow given ones: samples of these, and the distances of those."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from adaptsize._kernels.envelope import Given, Samples, find_nearest, list_samples
from adaptsize._kernels.trees import new_stack
from adaptsize.background._curve import tree_over
from adaptsize.background.topology import any_of
from adaptsize.geometry.boundary import facet_normals
from adaptsize.remeshing import tuning
from adaptsize.remeshing.skins import numbers_of
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray, LongArray


class Groups(NamedTuple):
    """Groups of new and of given simplices.

    Groups of new simplices of which there are no given ones have negative numbers.
    """

    new: IntArray
    given: IntArray

    @classmethod
    def of(cls, new: LongArray, given: LongArray) -> "Groups":
        """Return the groups from rows that describe the simplices."""
        numbers = numbers_of(np.concatenate([new, given]))
        one, other = numbers[: len(new)], numbers[len(new) :]
        return cls(np.where(np.isin(one, other), one, -2 - one).astype(np.int32), other)

    @classmethod
    def unknown(cls, new: npt.NDArray[np.integer], n_given: int) -> "Groups":
        """Return groups that are all compared with all given simplices."""
        return cls((-2 - new).astype(np.int32), np.zeros(n_given, np.int32))


class Sampled(NamedTuple):
    """Samples of given simplices.

    Parameters
    ----------
    at : float64[s, 5]
        As those of `Samples`.
    owner : int64[s]
        Rows of the nearest new simplices.
    first : int
        The first row of new simplices.
    off2 : float64[n]
        Square of the distance of each new simplex from the given ones.
    """

    at: FloatArray
    owner: LongArray
    first: int
    off2: FloatArray


class _Around(NamedTuple):
    """What is around simplices: within ``reach`` of one of their centroids."""

    tree: cKDTree
    reach: float

    @classmethod
    def of(cls, corners: FloatArray, tolerance: float) -> "_Around":
        """Return where the points are that are nearest to simplices, given by their corners.

        Points so far away that they are lost for good are left out.
        """
        middles = corners.mean(axis=1)
        radius = float(np.linalg.norm(corners - middles[:, None], axis=2).max())
        return cls(cKDTree(middles), radius + tuning.LOST_FOR_GOOD * tolerance)

    def have(self, points: FloatArray, radius: FloatArray | float = 0.0) -> BoolArray:
        """Return which points are there, or which balls of given radii around them reach there."""
        return np.asarray(self.tree.query(points)[0] <= self.reach + radius)


class Follower(NamedTuple):
    """Makes new simplices follow given ones.

    Parameters
    ----------
    given_points : float64[n, 3]
    points : float64[m, 3]
    tolerance : float
    near : bool[m]
        The nodes of new simplices that may be changed.  Others have no samples.
    """

    given_points: FloatArray
    points: FloatArray
    tolerance: float
    near: BoolArray

    def sampled(
        self, given: IntArray, groups: Groups, new: IntArray, first: int
    ) -> tuple[Given, Sampled]:
        """Return given simplices in a tree, and samples for new ones, from a first row on."""
        k, given_points = new.shape[1], self.given_points
        rows = np.flatnonzero(any_of(self.near, new))
        if len(given) == 0 or len(rows) == 0:  # no operation will look at it
            given_points, given = np.zeros((k, 3)), np.arange(k, dtype=np.int32)[None]
            none = Sampled(np.empty((0, 5)), np.empty(0, np.int64), first, np.zeros(len(new)))
            return _tree_of(given_points, given, np.zeros(1, np.int32))[0], none
        tree, _ = _tree_of(given_points, given, groups.given)
        queries, wanted, of_new = _samples_of(self.points, new[rows], groups.new[rows])
        row, away2, feet = _nearest(tree, queries, wanted)
        label = np.where(np.isin(groups.given, groups.new), groups.given, -1).astype(np.int32)
        around = _Around.of(self.points[new[rows]], self.tolerance)
        places, labels, _ = _samples_of(given_points, given, label)
        is_near = around.have(places)
        places = np.concatenate([places[is_near], feet])
        labels = np.append(labels[is_near], wanted)
        own, own_order = _tree_of(self.points, new, groups.new)
        more, more_labels = _along_edges(given_points, given, label, own, self.tolerance, around)
        places, labels = np.concatenate([places, more]), np.append(labels, more_labels)
        found, distance2, _ = _nearest(own, places, labels)
        reach2 = np.maximum(distance2, self.tolerance**2) * (1.0 + 1e-9)
        at = np.column_stack([places, np.maximum(labels, -1), reach2])
        if k == 3:
            corners = self.points[new[rows]]
            tree.about[:, 1:] = _compared_normals(tree, corners, row[-len(rows) :])
        off2 = np.zeros(len(new))
        off2[rows] = away2[of_new].max(axis=1)
        return tree, Sampled(at, first + own_order[found], first, off2)


def samples_of_parts(parts: list[Sampled], room: int, tolerance: float) -> Samples:
    """Return samples in the lists of the new simplices."""
    at = np.concatenate([part.at for part in parts])
    chain = np.full((max(room, len(at)), 2), -1, np.int32)
    off2 = np.zeros(room)
    for part in parts:
        off2[part.first : part.first + len(part.off2)] = part.off2
    found = Samples(at, chain, off2, tolerance)
    list_samples(found, np.concatenate([part.owner for part in parts]))
    return found


def _tree_of(points: FloatArray, cells: IntArray, label: IntArray) -> tuple[Given, LongArray]:
    """Return simplices in a tree, without normals, and the simplex in each of its rows."""
    tree, order = tree_over(points, cells)
    about = np.zeros((len(cells), 4))
    about[:, 0] = label[order]
    return Given(tree.points, tree.cells, tree.boxes, about), order


def _samples_of(
    points: FloatArray, cells: IntArray, label: IntArray
) -> tuple[FloatArray, IntArray, LongArray]:
    """Return nodes, middles of edges and, last, centroids of simplices; labels; rows of each cell.

    Nodes and edges between groups are repeated for each group.
    """
    m, k = cells.shape
    n, group = len(points), numbers_of(label[:, None].astype(np.int64)).astype(np.int64)
    keys = (group[:, None] * n + cells).ravel()
    _, first, node = np.unique(keys, return_index=True, return_inverse=True)
    pairs = np.concatenate([cells[:, [v, (v + 1) % k]] for v in range(k if k > 2 else 1)])
    low, high = pairs.min(axis=1).astype(np.int64), pairs.max(axis=1)
    keys = (np.tile(group, len(pairs) // m) * n + low) * n + high
    _, at, edge = np.unique(keys, return_index=True, return_inverse=True)
    places = [points[cells.ravel()[first]], points[pairs[at]].mean(axis=1)]
    labels = [np.repeat(label, k)[first], np.tile(label, len(pairs) // m)[at], label]
    rows = np.column_stack([
        node.reshape(m, k),
        len(first) + edge.reshape(-1, m).T,
        len(first) + len(at) + np.arange(m),
    ])  # fmt: skip
    found = np.concatenate([*places, points[cells].mean(axis=1)])
    return found, np.concatenate(labels).astype(np.int32), rows


def _along_edges(
    points: FloatArray,
    cells: IntArray,
    label: IntArray,
    own: Given,
    tolerance: float,
    around: _Around,
) -> tuple[FloatArray, IntArray]:
    """Return samples on long edges of given simplices, and their labels.

    The nodes and the middle of a sharp edge that is much longer than new simplices do not show what
    is lost between them.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, 2 or 3]
        The given segments or triangles.
    label : int32[m]
        The group of each of them.
    own : Given
        The new simplices in a tree.
    tolerance : float
    around : _Around
        Where samples are wanted.

    Returns
    -------
    float64[s, 3]
        Points whose distances along an edge are at most half of the shortest edge of the new
        simplex nearest to the middle between them, or of the tolerance.
    int32[s]
    """
    k = cells.shape[1]
    pairs = np.concatenate([cells[:, [v, (v + 1) % k]] for v in range(k if k > 2 else 1)])
    rows = np.column_stack([np.tile(label, len(pairs) // len(cells)), np.sort(pairs, axis=1)])
    rows = np.unique(rows, axis=0)
    label, start, end = rows[:, 0].astype(np.int32), points[rows[:, 1]], points[rows[:, 2]]
    corners = own.points[own.cells]
    size = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).min(axis=1)
    size = np.maximum(size, tolerance)
    places, labels = [np.empty((0, 3))], [np.empty(0, np.int32)]
    for _ in range(tuning.MOST_HALVINGS):
        is_near = around.have(0.5 * (start + end), 0.5 * np.linalg.norm(end - start, axis=1))
        start, end, label = (x[is_near] for x in (start, end, label))
        middle = 0.5 * (start + end)
        row = _nearest(own, middle, label)[0]
        is_long = np.linalg.norm(end - start, axis=1) > tuning.SPACING_ON_EDGE * size[row]
        if not is_long.any():
            break
        start, middle, end, label = (x[is_long] for x in (start, middle, end, label))
        is_near = around.have(middle)
        places.append(middle[is_near])
        labels.append(label[is_near])
        start, end = np.concatenate([start, middle]), np.concatenate([middle, end])
        label = np.tile(label, 2)
    return np.concatenate(places), np.concatenate(labels)


def _nearest(
    given: Given, queries: FloatArray, wanted: IntArray
) -> tuple[IndexArray, FloatArray, FloatArray]:
    """Return the rows of the closest simplices, squared distances and closest points."""
    row, distance2 = np.empty(len(queries), np.int64), np.empty(len(queries))
    foot = np.empty((len(queries), 3))
    find_nearest(given, queries, wanted, new_stack(), row, distance2, foot)
    return row, distance2, foot


def _compared_normals(given: Given, corners: FloatArray, nearest: IndexArray) -> FloatArray:
    """Return unit normals of given triangles in the direction of the new ones.

    They are zero in groups where the directions do not agree, as in a surface that is not oriented.
    """
    normal, new = (_unit(facet_normals(x)) for x in (given.points[given.cells], corners))
    cosine = np.einsum("ij,ij->i", new, normal[nearest])
    label = given.about[:, 0].astype(np.int64)
    group, n_groups = label[nearest], int(label.max()) + 1
    clear = np.abs(cosine) > tuning.CLEAR_COSINE
    same = np.bincount(group[clear & (cosine > 0.0)], minlength=n_groups)
    opposite = np.bincount(group[clear & (cosine < 0.0)], minlength=n_groups)
    total = np.maximum(same + opposite, 1)
    least = tuning.AGREEING * total
    sign = np.where(same > least, 1.0, np.where(opposite > least, -1.0, 0.0))
    return np.asarray(normal * sign[label][:, None])


def _unit(vectors: FloatArray) -> FloatArray:
    lengths = np.maximum(np.linalg.norm(vectors, axis=1), np.finfo(float).tiny)
    return np.asarray(vectors / lengths[:, None])
