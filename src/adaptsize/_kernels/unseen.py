"""Cones behind facets, in which a point inside a solid sees nothing, so that no line is traced.

The line from x to p leaves the solid through a facet (see rays.py) if it crosses the plane from
inside where the weights u, v and 1 - u - v are at least 0.  It crosses it at x + t (p - x) with

    t = N / (n . (p - x)),    N = n . (c - x) > 0,

so that u is at least 0 there if and only if (u(x) n + N a) . (p - x) >= 0, and so on.  What a facet
hides is thus the intersection of four half-spaces.  A box lies in one of these if its corner does
that is farthest against the normal.
"""

from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import lean
from adaptsize._kernels.vectors import dot, minus, triple

#: So many cones of a point are known at a time.  On the surface of a thread, 4, 8 and 16 of them
#: took the same time within 6 %, which is noise, and 1 a tenth more.
KEPT = 8


class Unseen(NamedTuple):
    """Cones in which one point sees nothing.

    Parameters
    ----------
    planes : float64[k, 16]
        Four rows of normal n and offset d: points p with n . p > d in all four are hidden.
    order : int64[k]
        Rows of ``planes``, those first that were needed last.
    n : int64[1]
        How many of them are in use.
    """

    planes: np.ndarray
    order: np.ndarray
    n: np.ndarray


@lean
def _put_first(order, place):
    """Move what stands at a place to the front."""
    row = order[place]
    for k in range(place, 0, -1):
        order[k] = order[k - 1]
    order[0] = row


@lean
def hide_behind(unseen, walls, t, x):
    """Add what facet t hides from x, in place of the cone that was needed longest ago."""
    planes, order, n = unseen
    corner, normal = triple(walls.facets, t, 0), triple(walls.facets, t, 3)
    a, b = triple(walls.facets, t, 6), triple(walls.facets, t, 9)
    to = minus(x, corner)
    below = -dot(to, normal)
    if not below > walls.slack:
        return
    if n[0] < len(order):
        order[n[0]] = n[0]
        n[0] += 1
    _put_first(order, n[0] - 1)
    row = order[0]
    u, v = dot(a, to), dot(b, to)
    w = 1.0 - u - v
    for d in range(3):
        planes[row, d] = normal[d]
        planes[row, 4 + d] = u * normal[d] + below * a[d]
        planes[row, 8 + d] = v * normal[d] + below * b[d]
        planes[row, 12 + d] = w * normal[d] - below * (a[d] + b[d])
    planes[row, 3] = dot(normal, corner) + walls.slack
    for k in range(4, 16, 4):
        planes[row, k + 3] = dot(triple(planes, row, k), x)


@lean
def is_unseen(unseen, centre, half):
    """Return whether a box, given half of its sides, is in one of the cones."""
    planes, order, n = unseen
    for k in range(n[0]):
        row, is_in = order[k], True
        for j in range(0, 16, 4):
            side = triple(planes, row, j)
            least = dot(side, centre) - planes[row, j + 3]
            for d in range(3):
                least -= abs(side[d]) * half[d]
            if not least > 0.0:
                is_in = False
                break
        if is_in:
            _put_first(order, k)
            return True
    return False
