"""Directions around the nodes of a triangulated surface, unrolled into planes.

Around a node the angles of its triangles are laid side by side and, at an inner node,
stretched to fill 360 degrees.  A direction at the node is then a vector of a plane,
on a smooth surface (its tangent plane) as on a sharp edge, where the unrolled angles
fill 360 degrees by themselves and nothing is stretched.
"""

import math

from adaptsize._kernels.compiling import inner, kernel
from adaptsize._kernels.local_updates_higher import edge_frame

# On smooth surfaces the angles around a node also miss or exceed 360 degrees, by little.
_CLEARLY_TOO_MUCH = 0.2


@kernel
def fill_twins(cells, star_ptr, twin):
    """Find for each entry of the stars (see `fill_stars`) those of the same triangle.

    Parameters
    ----------
    cells : int32[m, 3]
    star_ptr : int64[n + 1]
    twin : int32[3 m, 2]
        Out: ``twin[e, v]`` is the entry of the cell of e in the star of ``star[e, v]``; there
        the node whose entry e is stands at place ``1 - v``.
    """
    free = star_ptr.copy()
    for c in range(cells.shape[0]):
        e_0 = free[cells[c, 0]]
        e_1 = free[cells[c, 1]]
        e_2 = free[cells[c, 2]]
        for v in range(3):
            free[cells[c, v]] += 1
        twin[e_0, 0] = e_1
        twin[e_0, 1] = e_2
        twin[e_1, 0] = e_2
        twin[e_1, 1] = e_0
        twin[e_2, 0] = e_0
        twin[e_2, 1] = e_1


@inner
def _walk(first, last, e, v, star, order):
    """List the triangles of a fan from spoke v of entry e on, each next to the one before.

    ``order[i]`` becomes 2 e + v for entry e, whose spoke v comes first.  Returns their
    number and whether the fan is closed.
    """
    begin = star[e, v]
    count = 0
    while count < last - first:
        order[count] = 2 * e + v
        count += 1
        w = star[e, 1 - v]
        if w == begin:
            return count, True
        following = -1
        for f in range(first, last):
            if f != e:
                if star[f, 0] == w:
                    following = f
                    v = 0
                    break
                if star[f, 1] == w:
                    following = f
                    v = 1
                    break
        if following < 0:
            break
        e = following
    return count, False


@kernel
def fill_headings(points, axes, star_ptr, star, order, heading, bends):
    """Fill the directions of the neighbours of every node, unrolled into a plane.

    Shortest paths bend at nodes whose angles have no room in it: more than 180 degrees
    on the boundary, clearly more than 360 inside.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim
    star_ptr, star
        Stars of the nodes (see `fill_stars`).
    order : int64[largest number of entries of a node]
        Work array.
    heading : float64[3 m, 2, 2]
        Out: ``heading[e, v]`` is the unit vector from the node of entry e to ``star[e, v]`` in
        the plane of that node; zeros if its triangles do not form one fan.
    bends : bool[n]
        Out: whether paths may bend at the node.
    """
    for j in range(star_ptr.shape[0] - 1):
        first = star_ptr[j]
        last = star_ptr[j + 1]
        bends[j] = False
        if last == first:
            continue
        count, closed = _walk(first, last, first, 0, star, order)
        if not closed:  # begin anew from the end that was met
            end = order[count - 1]
            count, closed = _walk(first, last, end // 2, 1 - end % 2, star, order)
        if count < last - first:
            heading[first:last] = 0.0
            bends[j] = True
            continue
        x = 1.0
        y = 0.0
        for i in range(count):
            e = order[i] // 2
            v = order[i] % 2
            length2, foot, height2 = edge_frame(points, axes, star[e, 1 - v], j, star[e, v])
            heading[e, v, 0] = x
            heading[e, v, 1] = y
            r2 = foot * foot * length2 + height2
            if r2 > 0.0:
                r = math.sqrt(r2)
                cosine = foot * math.sqrt(length2) / r
                sine = math.sqrt(height2) / r
                x, y = x * cosine - y * sine, y * cosine + x * sine
            heading[e, 1 - v, 0] = x
            heading[e, 1 - v, 1] = y
            bends[j] = bends[j] or (y < -1e-9 and not closed)
        if closed and abs(y) > 1e-12:
            # Turn each spoke by its share of what is missing to a full turn.
            missing = -math.atan2(y, x)
            bends[j] = missing < -_CLEARLY_TOO_MUCH
            missing /= count
            turn_x = math.cos(missing)
            turn_y = math.sin(missing)
            x = 1.0
            y = 0.0
            for i in range(count):
                e = order[i] // 2
                v = order[i] % 2
                _turn(heading, e, v, x, y)
                x, y = x * turn_x - y * turn_y, y * turn_x + x * turn_y
                _turn(heading, e, 1 - v, x, y)


@inner
def _turn(heading, e, v, x, y):
    """Turn one heading by the angle with cosine x and sine y."""
    h_x = heading[e, v, 0]
    h_y = heading[e, v, 1]
    heading[e, v, 0] = h_x * x - h_y * y
    heading[e, v, 1] = h_y * x + h_x * y
