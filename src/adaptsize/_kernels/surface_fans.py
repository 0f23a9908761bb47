"""Triangles in space as one piece after another unfolds: sides, lengths, angles, kinds of nodes.

The nodes of each triangle ascend.  Side ``3 t + v`` of triangle t is opposite to its node v, and
corner ``3 t + v`` is at this node.  A side is described in the frame of its edge: the first
coordinate runs along the edge from the node of the smaller number, the second one is the distance
from the edge.  So all triangles at an edge share its first axis, and none needs an orientation.
"""

import math
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean, lean_kernel

#: Shortest paths do not bend at a flat node.  They bend at saddles, with more than 360 degrees; at
#: reflex nodes of the boundary, with more than 180; and at nodes where triangles form several fans
#: or meet at an edge by more than two.
FLAT, SADDLE, REFLEX, COMPLEX = range(4)

#: Angle (radians) by which saddles and reflex nodes exceed flat ones.  What a smaller one hides is
#: reached by a path whose length differs by its square.
_EXCESS = 1e-9

#: Least height of a triangle over an edge, relative to the edge.  So paths also pass through
#: triangles without area, as at T-junctions.
_FLAT = 1e-14


class Surface(NamedTuple):
    """Triangles in space, of which nothing but lengths and angles is used.

    Parameters
    ----------
    cells : int32[m, 3]
        Ascending in each row.
    beyond : int32[3 * m]
        For each side, the next one at the same edge; they form a ring.
    length : float64[3 * m]
        Of the edge.
    apex : float64[3 * m, 2]
        The opposite node in the frame of the edge.
    angle : float64[3 * m]
        Of the corner.
    ring_ptr, ring : int32[n + 1], int32[3 * m]
        Triangles around each node, as from `topology.fill_rings`.
    kind : int8[n]
        FLAT, SADDLE, REFLEX or COMPLEX.
    total : float64[n]
        Sum of the angles around a node of a single fan.
    """

    cells: np.ndarray
    beyond: np.ndarray
    length: np.ndarray
    apex: np.ndarray
    angle: np.ndarray
    ring_ptr: np.ndarray
    ring: np.ndarray
    kind: np.ndarray
    total: np.ndarray


@lean
def others_of(k):
    """Return the two other local nodes of a triangle, ascending."""
    return (1 if k == 0 else 0), (1 if k == 2 else 2)


@lean
def place_in(cells, t, node):
    """Return the place of a node in triangle t."""
    k = 0
    while cells[t, k] != node:
        k += 1
    return k


@lean_kernel
def connect_sides(cells, beyond, first, after):
    """Connect the sides at each edge in a ring.

    Parameters
    ----------
    cells : int32[m, 3]
        Ascending in each row.
    beyond : int32[3 * m]
        Out.
    first, after : int32[n], int32[3 * m]
        Scratch: for each node a side of which it is the smaller node, and for each such side the
        next one.

    Returns
    -------
    int
        The largest number of sides at an edge.
    """
    most = 1
    first[:] = -1
    for here in range(3 * cells.shape[0]):
        t = here // 3
        low, high = others_of(here % 3)
        i, j = cells[t, low], cells[t, high]
        e = first[i]
        while e >= 0 and cells[e // 3, others_of(e % 3)[1]] != j:
            e = after[e]
        if e < 0:
            after[here], first[i], beyond[here] = first[i], here, here
        else:
            beyond[here], beyond[e] = beyond[e], here
            count, other = 2, beyond[here]
            while beyond[other] != here:
                count, other = count + 1, beyond[other]
            most = max(most, count)
    return most


@lean_kernel
def measure(points, factor, surface):
    """Fill lengths and angles (In/Out: surface); lengths are multiplied by a factor.

    Parameters
    ----------
    points : float64[n, 3]
        Of a size of about 1.
    factor : float64
    surface : Surface
    """
    cells, length, apex, angle = surface.cells, surface.length, surface.apex, surface.angle
    for t in range(cells.shape[0]):
        for v in range(3):
            low, high = others_of(v)
            a, b, c = cells[t, low], cells[t, high], cells[t, v]
            square = along = 0.0
            for d in range(3):
                e = points[b, d] - points[a, d]
                square += e * e
                along += e * (points[c, d] - points[a, d])
            share = along / square if square > 0.0 else 0.0
            height = 0.0
            for d in range(3):  # differences of vectors, not of squares: slivers stay accurate
                e = points[b, d] - points[a, d]
                height += (points[c, d] - points[a, d] - share * e) ** 2
            side = 3 * t + v
            edge = math.sqrt(square)
            length[side] = factor * edge
            apex[side, 0] = factor * share * edge
            apex[side, 1] = factor * max(math.sqrt(height), _FLAT * edge)
        for v in range(3):
            low, high = others_of(v)
            side = 3 * t + high  # its edge joins v and low
            x, y = apex[side, 0], apex[side, 1]
            angle[3 * t + v] = math.atan2(y, x if v < low else length[side] - x)


@lean
def cross(surface, side):
    """Return the side by which the next triangle is entered, -1 at a boundary; -2 if several."""
    other = surface.beyond[side]
    if other == side:
        return -1
    return other if surface.beyond[other] == side else -2


@lean_kernel
def classify(surface):
    """Find the kinds of nodes, and the sums of their angles (In/Out: surface).

    Nodes that are COMPLEX stay so.
    """
    cells, angle, kind = surface.cells, surface.angle, surface.kind
    for v in range(kind.shape[0]):
        begin, end = surface.ring_ptr[v], surface.ring_ptr[v + 1]
        if begin == end or kind[v] == COMPLEX:
            continue
        start = surface.ring[begin]
        at = place_in(cells, start, v)
        total, count, is_open, is_complex = angle[3 * start + at], 1, False, False
        for way in range(2):
            side = 3 * start + others_of(at)[1 - way]
            while True:
                side = cross(surface, side)
                if side < 0 or side // 3 == start:
                    break
                t, far = side // 3, side % 3
                k = place_in(cells, t, v)
                total += angle[3 * t + k]
                count += 1
                side = 3 * t + 3 - far - k
            is_complex = is_complex or side == -2
            is_open = is_open or side == -1
            if side >= 0:  # once around
                break
        surface.total[v] = total
        if is_complex or count != end - begin:
            kind[v] = COMPLEX
        elif is_open and total > math.pi + _EXCESS:
            kind[v] = REFLEX
        elif not is_open and total > 2.0 * math.pi + _EXCESS:
            kind[v] = SADDLE
