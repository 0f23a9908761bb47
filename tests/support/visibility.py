"""What sees what in a polygonal domain: the compiled part of `geodesics`.

``walls`` float64[m, 4] are the edges of all rings, start and end; a segment is taken to stay in
the domain if it enters the outside by no more than about ``depth``.
"""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def fill_sizes(points, walls, depth, g, starts, start_sizes, corners, corner_sizes, out):
    """Fill out[n]: of the candidates straight from starts and corners, the least one seen."""
    n_starts = len(starts)
    n = n_starts + len(corners)
    value = np.empty(n)
    foot = np.empty((n, 2))
    cuts = np.empty(3 * len(walls) + 2)
    for c in range(len(corners)):
        foot[n_starts + c, 0], foot[n_starts + c, 1] = corners[c, 0], corners[c, 1]
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        for s in range(n_starts):
            ax, ay = starts[s, 0, 0], starts[s, 0, 1]
            ex, ey = starts[s, 1, 0] - ax, starts[s, 1, 1] - ay
            share = _lowest_share(x - ax, y - ay, ex, ey, start_sizes[s, 1] - start_sizes[s, 0], g)
            foot[s, 0], foot[s, 1] = ax + share * ex, ay + share * ey
            start = start_sizes[s, 0] + share * (start_sizes[s, 1] - start_sizes[s, 0])
            value[s] = start + g * np.sqrt((x - foot[s, 0]) ** 2 + (y - foot[s, 1]) ** 2)
        for c in range(len(corners)):
            away = np.sqrt((x - corners[c, 0]) ** 2 + (y - corners[c, 1]) ** 2)
            value[n_starts + c] = corner_sizes[c] + g * away
        out[i] = np.inf
        while True:
            best = -1
            for s in range(n):
                if value[s] < np.inf and (best < 0 or value[s] < value[best]):
                    best = s
            if best < 0:
                break
            if _is_visible(x, y, foot[best, 0], foot[best, 1], walls, depth, cuts):
                out[i] = value[best]
                break
            value[best] = np.inf


@njit(cache=True, nogil=True)
def _lowest_share(wx, wy, ex, ey, rise, g):
    """Return where on the segment e = b - a, as a share, ``rise * share + g |w - share e|`` is
    least: along the segment the slope of the distance is (s - t)/sqrt((s - t)^2 + D^2), with
    t the foot of the perpendicular and D its length; it is to balance the slope of the data.
    """
    length = np.hypot(ex, ey)
    if length == 0.0:
        return 0.0
    slope = rise / (g * length)
    if slope >= 1.0:
        return 0.0
    if slope <= -1.0:
        return 1.0
    along = (wx * ex + wy * ey) / length
    height = abs(wx * ey - wy * ex) / length
    shift = height * slope / np.sqrt((1.0 - slope) * (1.0 + slope))
    return min(1.0, max(0.0, (along - shift) / length))


@njit(cache=True, nogil=True)
def fill_visible(a, b, walls, depth, out):
    cuts = np.empty(3 * len(walls) + 2)
    for i in range(len(a)):
        out[i] = _is_visible(a[i, 0], a[i, 1], b[i, 0], b[i, 1], walls, depth, cuts)


@njit(cache=True, nogil=True)
def fill_inside(points, walls, depth, out):
    for i in range(len(points)):
        out[i] = _is_inside(points[i, 0], points[i, 1], walls, depth)


@njit(cache=True, nogil=True)
def _is_visible(px, py, qx, qy, walls, depth, cuts):
    """Return whether the segment pq of points of the domain stays in it.

    A wall crossed clearly, all four ends farther than ``depth`` from the other line, hides q.
    Where the segment touches walls it is cut, and the middle of each piece decides.
    Scratch: cuts[>= 3 len(walls) + 2].
    """
    dx, dy = qx - px, qy - py
    length = np.hypot(dx, dy)
    if length <= depth:
        return True
    dx, dy = dx / length, dy / length
    cuts[0], cuts[1] = 0.0, length
    n = 2
    touches = False
    for w in range(len(walls)):
        ax, ay = walls[w, 0] - px, walls[w, 1] - py
        bx, by = walls[w, 2] - px, walls[w, 3] - py
        off_a, off_b = dx * ay - dy * ax, dx * by - dy * bx
        if (off_a > depth and off_b > depth) or (off_a < -depth and off_b < -depth):
            continue
        ex, ey = bx - ax, by - ay
        wall = np.hypot(ex, ey)
        off_p = (ey * ax - ex * ay) / wall
        off_q = off_p + length * (ex * dy - ey * dx) / wall
        if (off_p > depth and off_q > depth) or (off_p < -depth and off_q < -depth):
            continue
        if min(abs(off_a), abs(off_b), abs(off_p), abs(off_q)) > depth:
            return False
        touches = True
        if abs(off_a) <= depth:
            n = _insert(ax * dx + ay * dy, cuts, n)
        if abs(off_b) <= depth:
            n = _insert(bx * dx + by * dy, cuts, n)
        if off_p != off_q:
            n = _insert(length * off_p / (off_p - off_q), cuts, n)
    if not touches:
        return True
    for c in range(n - 1):
        if cuts[c + 1] - cuts[c] > depth:
            middle = 0.5 * (cuts[c] + cuts[c + 1])
            if not _is_inside(px + middle * dx, py + middle * dy, walls, 4.0 * depth):
                return False
    return True


@njit(cache=True, nogil=True)
def _insert(cut, cuts, n):
    """Put a cut into the ascending cuts[:n] if it lies between the first and the last."""
    if not cuts[0] < cut < cuts[n - 1]:
        return n
    c = n
    while cuts[c - 1] > cut:
        cuts[c] = cuts[c - 1]
        c -= 1
    cuts[c] = cut
    return n + 1


@njit(cache=True, nogil=True)
def _is_inside(x, y, walls, depth):
    """Return whether a ray to the right crosses an odd number of walls, or a wall is here."""
    inside = False
    for w in range(len(walls)):
        ax, ay, bx, by = walls[w, 0], walls[w, 1], walls[w, 2], walls[w, 3]
        if min(ay, by) > y + depth or max(ay, by) < y - depth or max(ax, bx) < x - depth:
            continue
        ex, ey = bx - ax, by - ay
        share = ((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey)
        share = min(1.0, max(0.0, share))
        if np.hypot(x - ax - share * ex, y - ay - share * ey) <= depth:
            return True
        if (ay > y) != (by > y) and x < ax + (y - ay) * ex / ey:
            inside = not inside
    return inside
