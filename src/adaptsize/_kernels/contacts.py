"""Where the triangles of a surface meet others, and the pieces into which these divide them.

The plane of a triangle and another triangle have a segment in common, or the other one lies in that
plane, and has three edges there.  The parts of these segments in the triangle divide it: between
them, the winding numbers on both sides of it do not change.  They may also change across an edge of
the triangle on which there is a segment.  Distances up to a slack count as zero.
"""

from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel
from adaptsize._kernels.crossings import _common_nodes, _normal, _segment
from adaptsize._kernels.trees import box_of_cell, cells_of_leaf, leaf_within
from adaptsize._kernels.vectors import between, cross, dot, minus, norm, triple, unit, without

#: Corners of a piece; those with more are halved.
CORNERS = 24


class Contacts(NamedTuple):
    """Triangles that meet others, each with one part of a segment in which it does.

    Parameters
    ----------
    owner, partner : int32[room]
        Rows of the tree.
    is_flat : bool[room]
        Whether both lie in one plane and overlap.  The first record of such a pair has a segment of
        length 0.
    ends : float64[room, 6]
        Both ends of the segment, which has the length 0 if it is on an edge of the owner.
    stack : int64[DEPTH]
        Scratch.
    """

    owner: np.ndarray
    partner: np.ndarray
    is_flat: np.ndarray
    ends: np.ndarray
    stack: np.ndarray


@lean
def _corner(tree, t, v):
    """Return a corner of a triangle."""
    return triple(tree.points, tree.cells[t, v % 3], 0)


@lean
def _inward(tree, t, v, normal):
    """Return the unit vector in a plane that points from an edge of triangle t to its corner v."""
    a, b = _corner(tree, t, v + 1), _corner(tree, t, v + 2)
    m = unit(cross(normal, minus(b, a)))
    if dot(m, minus(_corner(tree, t, v), a)) < 0.0:
        return -m[0], -m[1], -m[2]
    return m


@lean
def _are_apart(tree, s, t, normal, slack):
    """Return whether an edge of triangle s separates it from t, up to the slack."""
    for v in range(3):
        m, a = _inward(tree, s, v, normal), _corner(tree, s, v + 1)
        highest = -np.inf
        for w in range(3):
            highest = max(highest, dot(m, minus(_corner(tree, t, w), a)))
        if highest <= slack:
            return True
    return False


@lean
def _part_inside(tree, s, p, q, normal, slack):
    """Return the ends of the part of a segment in triangle s, and whether there is one.

    If it is on an edge of the triangle, both ends are the same.
    """
    first, last, step = 0.0, 1.0, minus(q, p)
    for v in range(3):
        m, a = _inward(tree, s, v, normal), _corner(tree, s, v + 1)
        at_p, rate = dot(m, minus(p, a)), dot(m, step)
        if abs(rate) <= 1e-14 * norm(step):
            if at_p < 0.0:
                return p, p, False
        elif rate > 0.0:
            first = max(first, -at_p / rate)
        else:
            last = min(last, -at_p / rate)
    begin, end = without(p, -first, step), without(p, -last, step)
    if not (last - first) * norm(step) > slack:
        return begin, end, False
    middle = without(p, -0.5 * (first + last), step)
    for v in range(3):
        m, a = _inward(tree, s, v, normal), _corner(tree, s, v + 1)
        if dot(m, minus(middle, a)) <= slack:
            return middle, middle, True
    return begin, end, True


@lean
def _heights(tree, t, other, normal, slack):
    """Return the distances of the corners of triangle t from a plane, 0 within the slack."""
    base = tree.cells[other, 0]
    a = dot(normal, between(tree.points, base, tree.cells[t, 0]))
    b = dot(normal, between(tree.points, base, tree.cells[t, 1]))
    c = dot(normal, between(tree.points, base, tree.cells[t, 2]))
    return (
        0.0 if abs(a) <= slack else a,
        0.0 if abs(b) <= slack else b,
        0.0 if abs(c) <= slack else c,
    )


@lean
def _record(found, n, s, t, is_flat, p, q):
    """Add a contact, if there is room; return the new number."""
    if n < found.owner.shape[0]:
        found.owner[n], found.partner[n], found.is_flat[n] = s, t, is_flat
        for d in range(3):
            found.ends[n, d], found.ends[n, 3 + d] = p[d], q[d]
    return n + 1


@lean
def _add_contacts(tree, s, t, normal, slack, found, n):
    """Add the contacts of two triangles to those of the first one; return the new number."""
    heights = _heights(tree, t, s, normal, slack)
    low, high = min(heights[0], heights[1], heights[2]), max(heights[0], heights[1], heights[2])
    zeros = (heights[0] == 0.0) + (heights[1] == 0.0) + (heights[2] == 0.0)
    if low > 0.0 or high < 0.0 or (zeros == 1 and low * high == 0.0):
        return n
    if zeros == 3:
        if _are_apart(tree, s, t, normal, slack) or _are_apart(tree, t, s, normal, slack):
            return n
        a = _corner(tree, t, 0)
        n = _record(found, n, s, t, True, a, a)
        for v in range(3):
            p, q = _corner(tree, t, v), _corner(tree, t, v + 1)
            p, q, is_inside = _part_inside(tree, s, p, q, normal, slack)
            if is_inside:
                n = _record(found, n, s, t, True, p, q)
        return n
    if _common_nodes(tree.cells, s, t) > 1:
        return n
    p, q = _segment(tree, t, heights)
    p, q, is_inside = _part_inside(tree, s, p, q, normal, slack)
    return _record(found, n, s, t, False, p, q) if is_inside else n


@lean_kernel
def list_contacts(tree, slack, first, last, found):
    """List the contacts of the triangles ``first:last`` with all others.

    Parameters
    ----------
    tree : Tree
        Of triangles.
    slack : float64
    first, last : int
    found : Contacts
        Out.

    Returns
    -------
    int
        Number of contacts; if there is less room, only as many as fit are recorded.
    """
    n, stack = np.int64(0), found.stack
    for s in range(first, last):
        normal = _normal(tree, s)
        if not norm(normal) > 0.0:
            continue
        box = box_of_cell(tree.points, tree.cells, s)
        stack[0], height = 1, np.int64(1)
        while height > 0:
            leaf, height = leaf_within(tree.boxes, stack, height, (box, slack * slack))
            for t in range(*cells_of_leaf(leaf, tree.boxes, tree.cells.shape[0])):
                if t != s:
                    n = _add_contacts(tree, s, t, normal, slack, found, n)
    return n


class Pieces(NamedTuple):
    """Convex parts of triangles, and triangles that make up these.

    Parameters
    ----------
    owner : int32[room]
        Row of each part.
    centre : float64[room, 3]
        A point in it.
    corners : float64[room_2, 3, 3]
        The triangles.
    part : int32[room_2]
        The part that each belongs to.
    polygons : float64[room_3, CORNERS, 2]
        Scratch.
    counts : int64[room_3]
        Scratch.
    """

    owner: np.ndarray
    centre: np.ndarray
    corners: np.ndarray
    part: np.ndarray
    polygons: np.ndarray
    counts: np.ndarray


@lean
def _side(polygons, i, k, a, d, slack):
    """Return the distance of corner k of polygon i from the line through a in the direction d.

    It is 0 within the slack.
    """
    side = d[0] * (polygons[i, k, 1] - a[1]) - d[1] * (polygons[i, k, 0] - a[0])
    return 0.0 if abs(side) <= slack else side


@lean
def _length_inside(polygons, i, n, a, b):
    """Return the length of the part of a segment in polygon i, which has n corners."""
    first, last = 0.0, 1.0
    step = (b[0] - a[0], b[1] - a[1])
    for k in range(n):
        j = (k + 1) % n
        x, y = polygons[i, k, 0], polygons[i, k, 1]
        e = (polygons[i, j, 0] - x, polygons[i, j, 1] - y)
        at_a = e[0] * (a[1] - y) - e[1] * (a[0] - x)
        rate = e[0] * step[1] - e[1] * step[0]
        if rate == 0.0:
            if at_a < 0.0:
                return 0.0
        elif rate > 0.0:
            first = max(first, -at_a / rate)
        else:
            last = min(last, -at_a / rate)
    return max(last - first, 0.0) * np.sqrt(step[0] ** 2 + step[1] ** 2)


@lean
def _halve(polygons, counts, i, n):
    """Divide polygon i between two of its corners; the other part gets number n."""
    k, m = counts[i] // 2, counts[i]
    for c in range(k, m):
        polygons[n, c - k, 0], polygons[n, c - k, 1] = polygons[i, c, 0], polygons[i, c, 1]
    polygons[n, m - k, 0], polygons[n, m - k, 1] = polygons[i, 0, 0], polygons[i, 0, 1]
    counts[i], counts[n] = k + 1, m - k + 1


@lean
def _cut(polygons, counts, i, n, a, d, slack):
    """Divide polygon i along a line if it extends to both sides; return whether it does.

    The other part gets number n; polygon n + 1 is scratch.
    """
    m, low, high = counts[i], np.inf, -np.inf
    for k in range(m):
        side = _side(polygons, i, k, a, d, slack)
        low, high = min(low, side), max(high, side)
    if low >= 0.0 or high <= 0.0:
        return False
    one = two = 0
    for k in range(m):
        j = (k + 1) % m
        here, there = _side(polygons, i, k, a, d, slack), _side(polygons, i, j, a, d, slack)
        x, y = polygons[i, k, 0], polygons[i, k, 1]
        if here >= 0.0:
            polygons[n + 1, one, 0], polygons[n + 1, one, 1] = x, y
            one += 1
        if here <= 0.0:
            polygons[n, two, 0], polygons[n, two, 1] = x, y
            two += 1
        if (here > 0.0 and there < 0.0) or (here < 0.0 and there > 0.0):
            share = here / (here - there)
            x += share * (polygons[i, j, 0] - x)
            y += share * (polygons[i, j, 1] - y)
            polygons[n + 1, one, 0], polygons[n + 1, one, 1] = x, y
            polygons[n, two, 0], polygons[n, two, 1] = x, y
            one += 1
            two += 1
    for k in range(one):
        polygons[i, k, 0], polygons[i, k, 1] = polygons[n + 1, k, 0], polygons[n + 1, k, 1]
    counts[i], counts[n] = one, two
    return True


@lean
def _divide(ends, begin, end, frame, slack, pieces):
    """Divide the first polygon by segments; return the number of polygons."""
    origin, u, v = frame
    polygons, counts, n = pieces.polygons, pieces.counts, 1
    for r in range(begin, end):
        p, q = minus(triple(ends, r, 0), origin), minus(triple(ends, r, 3), origin)
        a, b = (dot(p, u), dot(p, v)), (dot(q, u), dot(q, v))
        d = (b[0] - a[0], b[1] - a[1])
        length = np.sqrt(d[0] ** 2 + d[1] ** 2)
        if length <= slack:
            continue
        d = (d[0] / length, d[1] / length)
        i = 0
        while i < n and n + 2 < counts.shape[0]:
            if counts[i] > CORNERS - 3:
                _halve(polygons, counts, i, n)
                n += 1
            inside = _length_inside(polygons, i, counts[i], a, b)
            if inside > slack and _cut(polygons, counts, i, n, a, d, slack):
                n += 1
            i += 1
    return n


@lean
def _place(frame, x, y):
    origin, u, v = frame
    return (
        origin[0] + x * u[0] + y * v[0],
        origin[1] + x * u[1] + y * v[1],
        origin[2] + x * u[2] + y * v[2],
    )


@lean_kernel
def divide_facets(tree, which, start, ends, slack, pieces):
    """Divide triangles by segments in them.

    Parameters
    ----------
    tree : Tree
        Of triangles.
    which : int64[k]
        Rows of the triangles to divide.
    start : int64[k + 1]
        Triangle i has the segments ``start[i]:start[i + 1]``.
    ends : float64[n, 6]
        The ends of the segments, in any order.
    slack : float64
        Parts narrower than this are not separated.
    pieces : Pieces
        Out.

    Returns
    -------
    int
        Number of triangles that were divided: less than k if there is no room for more.
    int
        Number of parts.
    int
        Number of triangles that make them up.
    """
    n_parts = n_triangles = 0
    polygons, counts = pieces.polygons, pieces.counts
    for i in range(which.shape[0]):
        s = which[i]
        origin, normal = _corner(tree, s, 0), _normal(tree, s)
        u = unit(minus(_corner(tree, s, 1), origin))
        frame = origin, u, cross(normal, u)
        counts[0] = 3
        for k in range(3):
            r = minus(_corner(tree, s, k), origin)
            polygons[0, k, 0], polygons[0, k, 1] = dot(r, frame[1]), dot(r, frame[2])
        n = _divide(ends, start[i], start[i + 1], frame, slack, pieces)
        total = 0
        for j in range(n):
            total += counts[j] - 2
        if n_parts + n > pieces.owner.shape[0] or n_triangles + total > pieces.part.shape[0]:
            return i, n_parts, n_triangles
        for j in range(n):
            x = y = 0.0
            for k in range(counts[j]):
                x += polygons[j, k, 0] / counts[j]
                y += polygons[j, k, 1] / counts[j]
            middle = _place(frame, x, y)
            pieces.owner[n_parts] = s
            for d in range(3):
                pieces.centre[n_parts, d] = middle[d]
            for k in range(1, counts[j] - 1):
                pieces.part[n_triangles] = n_parts
                for c in range(3):
                    row = 0 if c == 0 else k + c - 1
                    place = _place(frame, polygons[j, row, 0], polygons[j, row, 1])
                    for d in range(3):
                        pieces.corners[n_triangles, c, d] = place[d]
                n_triangles += 1
            n_parts += 1
    return which.shape[0], n_parts, n_triangles
