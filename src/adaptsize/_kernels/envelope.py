"""Distance of a changing surface or curve from a given one, in both directions.

The given simplices are in a tree.  Samples of the given surface are kept in lists, one for each of
the new simplices, which is the nearest one or was so before.  If a local operation replaces some
simplices, only the samples in their lists can get farther away.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.complexes import has_node
from adaptsize._kernels.distance import closest_on_cell
from adaptsize._kernels.trees import cells_of_leaf, nearest_leaf
from adaptsize._kernels.vectors import between, cross, dot, norm


class Envelope(NamedTuple):
    """A given surface or curve, and samples of it.

    Parameters
    ----------
    tree : Tree
        The given simplices.
    label : int32[m]
        The group of each.
    normal : float64[m, 3]
        Their unit normals, or zeros if the side is not to be compared.
    accepts : int32[n_labels]
        For each group of the new simplices that of the given ones, -1 for any of them.
    sample : float64[s, 3]
    sample_label : int32[s]
        The group of each sample, -1 for any.
    reach2 : float64[s]
        Square of the largest distance allowed.
    first : int32[room]
        First sample in the list of each new simplex, or -1.
    following : int32[s]
        Next sample in the same list, or -1.
    off2 : float64[room]
        Square of the largest distance of the new simplices from the given ones.
    tolerance : float
    """

    tree: tuple
    label: np.ndarray
    normal: np.ndarray
    accepts: np.ndarray
    sample: np.ndarray
    sample_label: np.ndarray
    reach2: np.ndarray
    first: np.ndarray
    following: np.ndarray
    off2: np.ndarray
    tolerance: float


@lean
def nearest_in(tree, labels, label, x, limit2, stack):
    """Return the row of the closest simplex and the squared distance; -1 if none is within a limit.

    Parameters
    ----------
    tree : Tree
    labels : int32[m]
    label : int
        Group of the simplices to consider, -1 for all.
    x : tuple of 3 float64
    limit2 : float
        Square of the largest distance.
    stack : Stack
    """
    best, found = limit2 * (1.0 + 1e-9) + 1e-300, -1
    stack.box[0], stack.bound[0] = 1, 0.0
    height = np.int64(1)
    while height > 0:
        leaf, height = nearest_leaf(tree.boxes, stack, height, best, x)
        for c in range(*cells_of_leaf(leaf, tree.boxes, tree.cells.shape[0])):
            if label >= 0 and labels[c] != label:
                continue
            distance2, _ = closest_on_cell(tree.points, tree.cells, c, x)
            if distance2 < best:
                best, found = distance2, c
    return found, best


@lean
def projected(env, label, x, limit2, stack):
    """Return whether a given simplex is within a limit, and its closest point."""
    tree, row = env.tree, -1
    row, _ = nearest_in(tree, env.label, env.accepts[label], x, limit2, stack)
    if row < 0:
        return False, x
    _, w = closest_on_cell(tree.points, tree.cells, row, x)
    y0, y1, y2 = 0.0, 0.0, 0.0
    for v in range(tree.cells.shape[1]):
        i = tree.cells[row, v]
        y0 += w[v] * tree.points[i, 0]
        y1 += w[v] * tree.points[i, 1]
        y2 += w[v] * tree.points[i, 2]
    return True, (y0, y1, y2)


@lean_kernel
def find_nearest(tree, labels, queries, wanted, stack, row, distance2, foot):
    """Find the closest simplex for each query point.

    Parameters
    ----------
    tree : Tree
    labels : int32[m]
    queries : float64[n, 3]
    wanted : int32[n]
        Group in which to look, -1 for all.
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
        row[q], distance2[q] = nearest_in(tree, labels, wanted[q], x, 1e300, stack)
        _, w = closest_on_cell(tree.points, tree.cells, row[q], x)
        for d in range(3):
            foot[q, d] = 0.0
            for v in range(tree.cells.shape[1]):
                foot[q, d] += w[v] * tree.points[tree.cells[row[q], v], d]


@lean_kernel
def list_samples(env, owner):
    """Enter each sample into the list of its owner, int64[s]."""
    for s in range(owner.shape[0]):
        env.following[s] = env.first[owner[s]]
        env.first[owner[s]] = s


@lean
def normal_of(points, a, b, c):
    """Return the normal of a triangle, of twice the length of its area."""
    return cross(between(points, a, b), between(points, a, c))


@lean
def middle(points, a, b):
    """Return the middle of an edge."""
    return (
        0.5 * (points[a, 0] + points[b, 0]),
        0.5 * (points[a, 1] + points[b, 1]),
        0.5 * (points[a, 2] + points[b, 2]),
    )


@lean
def centre(points, a, b, c):
    """Return the centroid of a triangle."""
    return (
        (points[a, 0] + points[b, 0] + points[c, 0]) / 3.0,
        (points[a, 1] + points[b, 1] + points[c, 1]) / 3.0,
        (points[a, 2] + points[b, 2] + points[c, 2]) / 3.0,
    )


#: Least cosine of the angle between a triangle and the given one that is nearest to its centroid.
#: The opposite side of a thin gap or wall has the cosine -1.
_SAME_SIDE = -0.3


@lean
def is_within(env, label, x, limit2, normal, stack):
    """Return whether a point is near the given surface, and on the same side of it.

    ``normal`` is that of the new triangle at x, or zero if the side does not matter.
    """
    row, _ = nearest_in(env.tree, env.label, env.accepts[label], x, limit2, stack)
    if row < 0:
        return False
    n = (env.normal[row, 0], env.normal[row, 1], env.normal[row, 2])
    return dot(n, normal) >= _SAME_SIDE * norm(n) * norm(normal)


@lean
def is_triangle_within(env, points, nodes, label, limit2, stack):
    """Return whether the centroid and the middles of the edges of a new triangle are near."""
    a, b, c = nodes
    none = (0.0, 0.0, 0.0)
    normal = normal_of(points, a, b, c)
    return (
        is_within(env, label, centre(points, a, b, c), limit2, normal, stack)
        and is_within(env, label, middle(points, a, b), limit2, none, stack)
        and is_within(env, label, middle(points, b, c), limit2, none, stack)
        and is_within(env, label, middle(points, c, a), limit2, none, stack)
    )


@lean
def is_row_within(env, cx, points, row, limit2, stack):
    """Return whether the middles and the centroid of a new simplex are near."""
    a, b, label = cx.nodes[row, 0], cx.nodes[row, 1], cx.label[row]
    if cx.nodes.shape[1] == 3:
        nodes = (a, b, cx.nodes[row, 2])
        return is_triangle_within(env, points, nodes, label, limit2, stack)
    none = (0.0, 0.0, 0.0)
    near = is_within(env, label, middle(points, a, b), limit2, none, stack)
    for end in range(2):  # a quarter of the edge from each end
        j, k = cx.nodes[row, end], cx.nodes[row, 1 - end]
        quarter = (
            0.75 * points[j, 0] + 0.25 * points[k, 0],
            0.75 * points[j, 1] + 0.25 * points[k, 1],
            0.75 * points[j, 2] + 0.25 * points[k, 2],
        )
        near = near and is_within(env, label, quarter, limit2, none, stack)
    return near


@lean
def measure_row(env, cx, points, row, stack):
    """Measure how far a new simplex is from the given ones: corners, middles, centroid."""
    k, label, off2 = cx.nodes.shape[1], env.accepts[cx.label[row]], 0.0
    for v in range(k):
        a, b = cx.nodes[row, v], cx.nodes[row, (v + 1) % k]
        x = (points[a, 0], points[a, 1], points[a, 2])
        off2 = max(off2, nearest_in(env.tree, env.label, label, x, 1e300, stack)[1])
        x = middle(points, a, b)
        off2 = max(off2, nearest_in(env.tree, env.label, label, x, 1e300, stack)[1])
    if k == 3:
        x = centre(points, cx.nodes[row, 0], cx.nodes[row, 1], cx.nodes[row, 2])
        off2 = max(off2, nearest_in(env.tree, env.label, label, x, 1e300, stack)[1])
    env.off2[row] = off2


@lean_kernel
def measure_rows(env, cx, points, m, stack):
    """Measure how far the first m new simplices are from the given ones."""
    for row in range(m):
        measure_row(env, cx, points, row, stack)


@lean
def allowed_at(env, cx, i):
    """Return the square of the distance allowed to what replaces the simplices at node i."""
    limit2 = env.tolerance * env.tolerance
    corner = np.int64(cx.head[i])
    while corner >= 0:
        limit2 = max(limit2, env.off2[corner // cx.nodes.shape[1]])
        corner = np.int64(cx.after[corner])
    return limit2


@lean
def closest_at(cx, points, a, label, x, gone, enough2):
    """Return the simplex at node a closest to x and the squared distance; -1 if there is none.

    Simplices of other groups do not count, nor those that contain both of the nodes ``gone``.  Ends
    at a distance that is enough.
    """
    k, best, found = cx.nodes.shape[1], math.inf, np.int64(-1)
    corner = np.int64(cx.head[a])
    while corner >= 0 and best > enough2:
        row = corner // k
        corner = np.int64(cx.after[corner])
        if label >= 0 and cx.label[row] != label:
            continue
        if has_node(cx, row, gone[0]) and has_node(cx, row, gone[1]):
            continue
        distance2, _ = closest_on_cell(points, cx.nodes, row, x)
        if distance2 < best:
            best, found = distance2, row
    return found, best


@lean
def are_samples_kept(env, cx, points, i, skip, around, n_around):
    """Return whether the samples of the simplices at node i are near those that replace them.

    Parameters
    ----------
    env : Envelope
    cx : Complex
        Simplices with both i and ``skip`` vanish.
    points : float64[n, 3]
        With node i at its new place.
    i, skip : int
        ``skip`` is negative if node i is only moved.
    around : int64[n_around]
        The nodes of these simplices.
    n_around : int
    """
    k = cx.nodes.shape[1]
    corner = np.int64(cx.head[i])
    while corner >= 0:
        s = np.int64(env.first[corner // k])
        corner = np.int64(cx.after[corner])
        while s >= 0:
            x = (env.sample[s, 0], env.sample[s, 1], env.sample[s, 2])
            reach2, label = env.reach2[s], env.sample_label[s]
            best = closest_at(cx, points, i, label, x, (i, skip), reach2)[1]
            for other in range(n_around):
                if best <= reach2:
                    break
                a = around[other]
                best = closest_at(cx, points, a, label, x, (i, skip), reach2)[1]
            if best > reach2:
                return False
            s = np.int64(env.following[s])
    return True


@lean
def detach_samples(env, row, chain):
    """Put the samples of a simplex before a chain; return its new first one."""
    s = np.int64(env.first[row])
    env.first[row] = -1
    while s >= 0:
        later = np.int64(env.following[s])
        env.following[s] = chain
        chain = s
        s = later
    return chain


@lean
def attach_samples(env, cx, points, around, n_around, chain):
    """Put each sample of a chain into the list of the closest simplex at some nodes."""
    while chain >= 0:
        s = chain
        chain = np.int64(env.following[s])
        x = (env.sample[s, 0], env.sample[s, 1], env.sample[s, 2])
        best, owner = math.inf, np.int64(-1)
        for other in range(n_around):
            a, label = around[other], env.sample_label[s]
            row, distance2 = closest_at(cx, points, a, label, x, (-1, -1), -1.0)
            if distance2 < best:
                best, owner = distance2, row
        if owner >= 0:
            env.following[s] = env.first[owner]
            env.first[owner] = s
