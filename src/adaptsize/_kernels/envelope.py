"""Distance of a changing surface or curve from a given one, in both directions.

The given simplices are in trees.  Samples of the given surface are kept in lists, one for each of
the new simplices, which is the nearest one or was so before.  If a local operation replaces some
simplices, only the samples in their lists can get farther away.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.complexes import NONE, first_corner, has_node, next_corner, nodes_of
from adaptsize._kernels.distance import closest_on_segment, closest_on_triangle
from adaptsize._kernels.trees import cells_of_leaf, nearest_leaf
from adaptsize._kernels.vectors import between, cross, dot, norm


class Given(NamedTuple):
    """Given triangles or segments in a tree.

    Parameters
    ----------
    points : float64[n, 3]
    cells : int32[m, k]
        In the order of the tree.
    boxes : float64[2 * n_leaves, 6]
    about : float64[m, 4]
        The group of each simplex, and its unit normal, or zeros if its side does not matter.
    """

    points: npt.NDArray[np.float64]
    cells: npt.NDArray[np.int32]
    boxes: npt.NDArray[np.float64]
    about: npt.NDArray[np.float64]


class Samples(NamedTuple):
    """Samples of the given surface and lines.

    Parameters
    ----------
    at : float64[s, 5]
        Place of each sample; its group, -1 for any; and the square of the largest distance allowed.
    chain : int32[max(room, s), 2]
        The first sample in the list of each new simplex, and the next one in the list of each
        sample; or -1.
    off2 : float64[room]
        Square of the largest distance of each new simplex from the given ones.
    tolerance : float
    """

    at: npt.NDArray[np.float64]
    chain: npt.NDArray[np.int32]
    off2: npt.NDArray[np.float64]
    tolerance: float


@lean
def closest_of(points, nodes, x):
    """Return the squared distance of x to a triangle, or a segment if the third node is -1."""
    a, b, c = nodes
    if c < 0:
        distance2, s, t = closest_on_segment(points, a, b, x)
        return distance2, s, t, 0.0
    return closest_on_triangle(points, a, b, c, x)


@lean
def _given_nodes(given, row):
    cells = given.cells
    third = np.int64(cells[row, 2]) if cells.shape[1] == 3 else NONE
    return np.int64(cells[row, 0]), np.int64(cells[row, 1]), third


@lean
def nearest_in(given, label, x, limit2, stack):
    """Return the row of the closest given simplex, the squared distance and its weights there.

    The row is -1 if none is within the limit.

    Parameters
    ----------
    given : Given
    label : int
        Group of the simplices to consider, negative for all.
    x : tuple of 3 float64
    limit2 : float
        Square of the largest distance.
    stack : Stack
    """
    best, found, weights = limit2 * (1.0 + 1e-9) + 1e-300, np.int64(-1), (1.0, 0.0, 0.0)
    stack.box[0], stack.bound[0] = 1, 0.0
    height = np.int64(1)
    while height > 0:
        leaf, height = nearest_leaf(given.boxes, stack, height, best, x)
        for c in range(*cells_of_leaf(leaf, given.boxes, given.cells.shape[0])):
            if label >= 0 and given.about[c, 0] != label:
                continue
            distance2, s, t, u = closest_of(given.points, _given_nodes(given, c), x)
            if distance2 < best:
                best, found, weights = distance2, np.int64(c), (s, t, u)
    return found, best, weights


@lean
def projected(given, label, x, limit2, stack):
    """Return whether a given simplex is within a limit, and its closest point."""
    row, _, (s, t, u) = nearest_in(given, label, x, limit2, stack)
    if row < 0:
        return False, x
    a, b, c = _given_nodes(given, row)
    c, points = max(c, 0), given.points
    return True, (
        s * points[a, 0] + t * points[b, 0] + u * points[c, 0],
        s * points[a, 1] + t * points[b, 1] + u * points[c, 1],
        s * points[a, 2] + t * points[b, 2] + u * points[c, 2],
    )


@lean_kernel
def find_nearest(given, queries, wanted, stack, row, distance2, foot):
    """Find the closest given simplex for each query point.

    Parameters
    ----------
    given : Given
    queries : float64[n, 3]
    wanted : int32[n]
        Group in which to look, negative for all.
    stack : Stack
    row : int64[n]
        Out: row of the tree.
    distance2 : float64[n]
        Out.
    foot : float64[n, 3]
        Out: the closest points.
    """
    for q in range(queries.shape[0]):
        x = (queries[q, 0], queries[q, 1], queries[q, 2])
        row[q], distance2[q], (s, t, u) = nearest_in(given, wanted[q], x, 1e300, stack)
        a, b, c = _given_nodes(given, row[q])
        for d in range(3):
            points = given.points
            foot[q, d] = s * points[a, d] + t * points[b, d] + u * points[max(c, 0), d]


@lean_kernel
def list_samples(samples, owner):
    """Enter each sample into the list of its owner, int64[s]."""
    chain = samples.chain
    for s in range(owner.shape[0]):
        chain[s, 1] = chain[owner[s], 0]
        chain[owner[s], 0] = s


@lean
def normal_of(points, a, b, c):
    """Return the normal of a triangle, of twice the length of its area."""
    return cross(between(points, a, b), between(points, a, c))


@lean
def _mixed(points, nodes, s, t, u):
    """Return the weighted mean of the corners of a triangle or a segment."""
    a, b, c = nodes
    c = max(c, 0)
    return (
        s * points[a, 0] + t * points[b, 0] + u * points[c, 0],
        s * points[a, 1] + t * points[b, 1] + u * points[c, 1],
        s * points[a, 2] + t * points[b, 2] + u * points[c, 2],
    )


#: Least cosine of the angle between a triangle and the given one that is nearest to its centroid.
#: The opposite side of a thin gap or wall has the cosine -1.
_SAME_SIDE = -0.3
#: Places of the samples of new simplices, as weights of the corners: for triangles the centroid,
#: then quarters of the edges and between these, for segments the middle first; and the corners.
#: The repair of a lattice left 42 facets beyond the tolerance with halves, and 14 with quarters.
_LATTICE = [(0.25 * i, 0.25 * j, 1.0 - 0.25 * (i + j)) for i in range(5) for j in range(5 - i)]
_IN_TRIANGLE = ((1.0 / 3.0,) * 3, *(one for one in _LATTICE if max(one) < 1.0))
#: Numbers of the places: without the corners and with these.
INNER, _ALL = np.int64(len(_IN_TRIANGLE)), np.int64(len(_IN_TRIANGLE) + 3)
_SHARES = [k / (len(_IN_TRIANGLE) + 1.0) for k in range(1, len(_IN_TRIANGLE) + 1)]
_IN_SEGMENT = tuple(sorted(((s, 1.0 - s, 0.0) for s in _SHARES), key=lambda one: abs(one[0] - 0.5)))
_PLACES = (
    (*_IN_TRIANGLE, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    (*_IN_SEGMENT, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0)),
)


@lean
def distance_of(given, points, nodes, label, n_places, limit2, stack):
    """Return the square of the largest distance of a new simplex, inf if it is beyond a limit.

    Parameters
    ----------
    given : Given
    points : float64[n, 3]
    nodes : tuple of 3 int64
        The third one is -1 for segments.
    label : int
    n_places : int64
        `INNER`, or `_ALL` with the corners.
    limit2 : float
        It is beyond the limit, too, if it is on the other side of the given surface.
    stack : Stack
    """
    places, off2 = _PLACES[1 if nodes[2] < 0 else 0], 0.0
    for place in range(n_places):
        s, t, u = places[place]
        x = _mixed(points, nodes, s, t, u)
        row, distance2, _ = nearest_in(given, label, x, limit2, stack)
        if row < 0:
            return math.inf
        off2 = max(off2, distance2)
        if place == 0 and nodes[2] >= 0:
            n = (given.about[row, 1], given.about[row, 2], given.about[row, 3])
            normal = normal_of(points, nodes[0], nodes[1], nodes[2])
            if n_places == INNER and dot(n, normal) < _SAME_SIDE * norm(n) * norm(normal):
                return math.inf
    return off2


@lean
def is_row_within(given, cx, points, row, limit2, stack):
    """Return whether a new simplex is near the given ones."""
    a, b, c, _ = nodes_of(cx, row)
    return distance_of(given, points, (a, b, c), cx.about[row, 0], INNER, limit2, stack) < math.inf


@lean
def measure_row(given, samples, cx, points, row, stack):
    """Measure how far a new simplex is from the given ones."""
    a, b, c, _ = nodes_of(cx, row)
    label = cx.about[row, 0]
    samples.off2[row] = distance_of(given, points, (a, b, c), label, _ALL, 1e300, stack)


@lean
def allowed_at(samples, cx, level, i):
    """Return the square of the distance allowed to what replaces the simplices at node i."""
    limit2 = samples.tolerance * samples.tolerance
    corner = first_corner(cx, level, i)
    while corner >= 0:
        limit2 = max(limit2, samples.off2[corner // 4])
        corner = next_corner(cx, corner)
    return limit2


@lean
def closest_at(cx, level, points, a, label, x, gone, enough2):
    """Return the simplex at node a closest to x and the squared distance; -1 if there is none.

    Simplices of other groups do not count, nor those that contain all nodes ``gone``, see
    `are_samples_kept`.  Ends at a distance that is enough.
    """
    best, found = math.inf, np.int64(-1)
    corner = first_corner(cx, level, a)
    while corner >= 0 and best > enough2:
        row = corner // 4
        corner = next_corner(cx, corner)
        if label >= 0 and cx.about[row, 0] != label:
            continue
        i, j, k = gone
        if has_node(cx, row, i) and has_node(cx, row, j) and (k < 0 or has_node(cx, row, k)):
            continue
        p, q, r, _ = nodes_of(cx, row)
        distance2 = closest_of(points, (p, q, r), x)[0]
        if distance2 < best:
            best, found = distance2, row
    return found, best


@lean
def are_samples_kept(samples, cx, level, points, row, gone, around, n_around):
    """Return whether the samples of a simplex are near those that replace it.

    Parameters
    ----------
    samples : Samples
    cx : Complex
    level : int
    points : float64[n, 3]
    row : int
    gone : tuple of 3 int64
        Simplices with all three nodes vanish, or with the first two if the third one is -1; none if
        another one is.
    around : int64[n_around]
        Nodes at whose simplices to look.
    n_around : int
    """
    s = np.int64(samples.chain[row, 0])
    while s >= 0:
        x = (samples.at[s, 0], samples.at[s, 1], samples.at[s, 2])
        label, reach2, best = int(samples.at[s, 3]), samples.at[s, 4], math.inf
        for other in range(n_around):
            if best <= reach2:
                break
            best = closest_at(cx, level, points, around[other], label, x, gone, reach2)[1]
        if best > reach2:
            return False
        s = np.int64(samples.chain[s, 1])
    return True


@lean
def detach_samples(samples, row, chain):
    """Put the samples of a simplex before a chain; return its new first one."""
    s = np.int64(samples.chain[row, 0])
    samples.chain[row, 0] = -1
    while s >= 0:
        later = np.int64(samples.chain[s, 1])
        samples.chain[s, 1] = chain
        chain = s
        s = later
    return chain


@lean
def attach_samples(samples, cx, level, points, around, n_around, chain):
    """Put each sample of a chain into the list of the closest simplex at some nodes."""
    while chain >= 0:
        s = chain
        chain = np.int64(samples.chain[s, 1])
        x = (samples.at[s, 0], samples.at[s, 1], samples.at[s, 2])
        best, owner, label = math.inf, np.int64(-1), int(samples.at[s, 3])
        for other in range(n_around):
            row, distance2 = closest_at(
                cx, level, points, around[other], label, x, (NONE, NONE, NONE), -1.0
            )
            if distance2 < best:
                best, owner = distance2, row
        if owner >= 0:
            samples.chain[s, 1] = samples.chain[owner, 0]
            samples.chain[owner, 0] = s
