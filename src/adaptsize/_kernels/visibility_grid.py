"""Whether a straight line between active nodes of a Cartesian grid stays in the domain.

The domain is the cubical complex of the active nodes: all nodes, edges, faces and boxes of
which every corner is active.  A line that is parallel to no axis stays inside if all
boxes are whole through whose interior it goes; one parallel to an axis or a plane of axes, if
the edges or faces are.

``clear`` tells for the box above each node how far the next box is that is not whole, in
boxes along the axis where it is farthest (chessboard distance).  All boxes within that
distance are whole, and the line is followed from one cube of whole boxes to the next: some
log(length) steps instead of its length, and nothing is overlooked.

Nodes are numbered as in march_grid.py.
"""

import math

from numba import njit

# Share of a box by which a line may cut a corner: rounding of positions, in boxes.
_GRAZING = 1e-9

# Distances are stored in 8 bits.
_FARTHEST = 255


@njit(cache=True, nogil=True)
def measure_clearance(u, strides, steps, clear):
    """Measure how far the boxes are from those that are not whole.

    Parameters
    ----------
    u : float64[n]
        Padded sizes; NaN where no node is active.
    strides : tuple of length dim
    steps : int64[m]
        Steps to all neighbours, also across the diagonals.
    clear : uint8[n]
        Out: for the box whose lowest corner is the node, 0 if it is not whole; at most 255.
    """
    n = u.shape[0]
    corners = 1 << len(strides)
    clear[:] = 0
    for i in range(strides[0], n - strides[0]):
        whole = True
        for c in range(corners):
            corner = i
            for a in range(len(strides)):
                corner += ((c >> a) & 1) * strides[a]
            whole = whole and u[corner] == u[corner]
        if whole:
            least = _FARTHEST - 1
            for t in range(steps.shape[0]):
                if steps[t] < 0:
                    least = min(least, clear[i + steps[t]])
            clear[i] = least + 1
    for back in range(strides[0], n - strides[0]):
        i = n - 1 - back
        if clear[i] > 1:
            least = clear[i] - 1
            for t in range(steps.shape[0]):
                if steps[t] > 0:
                    least = min(least, clear[i + steps[t]])
            clear[i] = least + 1


@njit(cache=True, nogil=True)
def _reach_beside(u, clear, strides, box, flat):
    """Return how many boxes are free ahead: 0 if the cell at ``box`` is not in the domain.

    Bit a of ``flat``: the cell has no extent along axis a, and a box on either side will do.
    """
    reach = 0
    for side in range(1 << len(strides)):
        if side & ~flat == 0:
            there = box
            for a in range(len(strides)):
                there -= ((side >> a) & 1) * strides[a]
            reach = max(reach, clear[there])
    if reach == 0:
        for corner in range(1 << len(strides)):
            if corner & flat == 0:
                there = box
                for a in range(len(strides)):
                    there += ((corner >> a) & 1) * strides[a]
                if u[there] != u[there]:  # NaN
                    return 0
        reach = 1
    return reach


@njit(cache=True, nogil=True)
def is_visible(u, clear, strides, k, d0, d1, d2):
    """Tell whether the line from node k by (d0, d1, d2) stays in the domain.

    Parameters
    ----------
    u : float64[n]
        NaN where no node is active.
    clear : uint8[n]
        See `measure_clearance`.
    strides : tuple of length dim
    k : int
        An active node.
    d0, d1, d2 : float
        The other end seen from k, as multiples of the spacings: a point of an edge, or of a
        diagonal of a face or box, that is in the domain.

    Returns
    -------
    bool
    """
    flat = 0
    longest = max(abs(d0), abs(d1))
    if d0 == 0.0:
        flat |= 1
    if d1 == 0.0:
        flat |= 2
    if len(strides) == 3:
        longest = max(longest, abs(d2))
        if d2 == 0.0:
            flat |= 4
    if longest == 0.0:
        return True
    # Lowest corner of the present box, seen from k.
    c0 = -1 if d0 < 0.0 else 0
    c1 = -1 if d1 < 0.0 else 0
    c2 = -1 if d2 < 0.0 else 0
    per_d0 = 1.0 / d0 if d0 != 0.0 else 0.0
    per_d1 = 1.0 / d1 if d1 != 0.0 else 0.0
    per_d2 = 1.0 / d2 if d2 != 0.0 else 0.0
    s2 = math.inf
    while True:
        box = k + c0 * strides[0] + c1 * strides[1]
        if len(strides) == 3:
            box += c2 * strides[2]
        reach = clear[box]
        if reach == 0 and flat == 0:
            return False
        if flat != 0:
            reach = _reach_beside(u, clear, strides, box, flat)
            if reach == 0:
                return False
        # Where the line leaves the cube of whole boxes.
        s0 = _leaves_at(c0, d0, per_d0, reach)
        s1 = _leaves_at(c1, d1, per_d1, reach)
        leave = min(s0, s1)
        if len(strides) == 3:
            s2 = _leaves_at(c2, d2, per_d2, reach)
            leave = min(leave, s2)
        if leave >= 1.0 - 1e-12:
            return True
        # Boxes that are cut at a corner only, or not at all, are passed over.
        c0 = _beyond(c0, d0, reach, s0, leave)
        c1 = _beyond(c1, d1, reach, s1, leave)
        if len(strides) == 3:
            c2 = _beyond(c2, d2, reach, s2, leave)


@njit(cache=True, nogil=True)
def _leaves_at(c, d, per_d, reach):
    """Return at which share of the line it leaves the boxes around box c, along one axis."""
    if d > 0.0:
        return (c + reach) * per_d
    if d < 0.0:
        return (c + 1 - reach) * per_d
    return math.inf


@njit(cache=True, nogil=True)
def _beyond(c, d, reach, share, leave):
    """Return the box, along one axis, that the line enters at the share ``leave``."""
    if d > 0.0:
        return c + reach if share == leave else int(leave * d + _GRAZING)
    if d < 0.0:
        return c - reach if share == leave else -1 - int(_GRAZING - leave * d)
    return c


@njit(cache=True, nogil=True)
def is_certain(u, source, end, strides, k, p, d0, d1, d2):
    """Tell whether node k sees the node p, by d, because the nodes ahead of it do.

    Those are the corners of the face through which the line leaves its first cell.  With
    that cell in the domain their word suffices: farther on, a section of the line through p
    and the face is a smaller copy of the face, in every box that holds a point of it inside lies
    one of its corners too, and the lines of the corners are known to stay in the domain.

    Parameters
    ----------
    u, strides, k, d0, d1, d2
        As in `is_visible`.
    source, end : int32[n], int32[n] or int32[1]
        Whoever has the source p alone sees it (see track_grid.py).
    p : int

    Returns
    -------
    bool
        False: not certain.
    """
    along = 0
    longest = abs(d0)
    if abs(d1) > longest:
        along, longest = 1, abs(d1)
    if len(strides) == 3 and abs(d2) > longest:
        along = 2
    for corner in range(1, 1 << len(strides)):
        node = k
        ahead = False
        in_cell = True
        for a in range(len(strides)):
            if (corner >> a) & 1:
                d = d0 if a == 0 else (d1 if a == 1 else d2)
                in_cell = in_cell and d != 0.0
                ahead = ahead or a == along
                node += strides[a] if d > 0.0 else -strides[a]
        if in_cell:
            if u[node] != u[node]:
                return False
            alone = end.shape[0] == 1 or end[node] < 0
            if ahead and node != p and not (source[node] == p and alone):
                return False
    return True
