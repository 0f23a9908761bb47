"""What sees what in a triangle mesh, by walking from cell to cell: compiled part of `exact_oracle`.

A straight line between two nodes counts as inside if it passes through cells that share
edges or nodes one after the other.  Slits of no width, pinched nodes, cracks and flat cells need
no rules of their own: what the line may enter at a node is what cells there are.
Nodes within ``tolerance`` of the line count as on it.

The arrays of a mesh are a tuple: ``points`` float64[n, 2], ``cells`` int64[m, 3], ``cell_edges``
int64[m, 3] (edge k joins the nodes k and k + 1 of the cell), and as compressed rows the
cells at edges (``edge_start``, ``edge_cells``) and at nodes (``node_start``, ``node_cells``).
"""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def new_scratch():
    """Return a stack of (edge or -1, cell or node, distance), and a list of nodes."""
    return np.empty((10_000, 2), np.int64), np.empty(10_000), np.empty(10_000, np.int64)


@njit(cache=True, nogil=True)
def sees(p, q, mesh, tolerance, scratch):
    """Return whether the straight line between the nodes p and q stays in the mesh."""
    points, cells, cell_edges, edge_start, edge_cells, node_start, node_cells = mesh
    stack, far, passed = scratch
    if p == q:
        return True
    px, py = points[p, 0], points[p, 1]
    dx, dy = points[q, 0] - px, points[q, 1] - py
    length = np.hypot(dx, dy)
    dx, dy = (dx / length, dy / length) if length > 0.0 else (1.0, 0.0)
    line = (px, py, dx, dy)
    stack[0, 0], stack[0, 1], far[0] = -1, p, 0.0
    n, n_passed = 1, 0
    steps = 10 * len(cells) + 10
    while n > 0 and steps > 0:
        n -= 1
        steps -= 1
        edge, origin, reached = stack[n, 0], stack[n, 1], far[n]
        if edge < 0:
            if origin == q:
                return True
            if origin in passed[:n_passed]:
                continue
            passed[n_passed] = origin
            n_passed += 1
            first, last = node_start[origin], node_start[origin + 1]
        else:
            first, last = edge_start[edge], edge_start[edge + 1]
        for k in range(first, last):
            cell = node_cells[k] if edge < 0 else edge_cells[k]
            if edge >= 0 and cell == origin:
                continue
            for v in range(3):  # leave the cell through nodes on the line, or across edges
                a, b = cells[cell, v], cells[cell, (v + 1) % 3]
                off_a, along_a = _place(a, points, line)
                off_b, along_b = _place(b, points, line)
                if abs(off_a) <= tolerance:
                    if edge < 0 and a == origin:
                        continue
                    if reached - tolerance <= along_a <= length + tolerance:
                        stack[n, 0], stack[n, 1], far[n] = -1, a, along_a
                        n += 1
                elif abs(off_b) > tolerance and off_a * off_b < 0.0:
                    if cell_edges[cell, v] == edge:
                        continue
                    along = (off_a * along_b - off_b * along_a) / (off_a - off_b)
                    if reached - tolerance <= along <= length + tolerance:
                        stack[n, 0], stack[n, 1], far[n] = cell_edges[cell, v], cell, along
                        n += 1
    return False


@njit(cache=True, nogil=True)
def _place(node, points, line):
    """Return the distance of a node from the line, to the left, and how far along it lies."""
    x, y = points[node, 0] - line[0], points[node, 1] - line[1]
    return line[2] * y - line[3] * x, line[2] * x + line[3] * y


@njit(cache=True, nogil=True)
def _is_tangent(corner, before, after, node, points):
    """Return whether the line from a node to a corner can go on there.

    Where it would go on into what is cut out, between the next node of the boundary and
    the one before, no shortest path that bends at the corner comes or goes this way.
    ``before`` < 0: there is more than one sector, anything may be.
    """
    if before < 0:
        return True
    x, y = points[corner, 0], points[corner, 1]
    dx, dy = x - points[node, 0], y - points[node, 1]
    bx, by = points[before, 0] - x, points[before, 1] - y
    ax, ay = points[after, 0] - x, points[after, 1] - y
    length = np.hypot(dx, dy)
    inside_before = bx * dy - by * dx > 1e-9 * length * np.hypot(bx, by)
    inside_after = dx * ay - dy * ax > 1e-9 * length * np.hypot(ax, ay)
    return not (inside_before and inside_after)


@njit(cache=True, nogil=True)
def fill_sizes(targets, own, starts, sizes, corners, beside, mesh, tolerance, g, out):
    """Fill out: the least of ``own`` and of size + g * distance over what each target sees.

    Parameters
    ----------
    targets : int64[k]
    own : float64[k]
    starts, sizes : int64[s], float64[s]
    corners : int64[c]
        The last c of ``starts`` are those, the rest are sources.
    beside : int64[c, 2]
        Nodes of the boundary before and after each corner, -1 where there are more.
    out : float64[k]
    """
    points = mesh[0]
    scratch = new_scratch()
    n_sources = len(starts) - len(corners)
    value, which = np.empty(len(starts)), np.empty(len(starts), np.int64)
    for i in range(len(targets)):
        x = targets[i]
        out[i] = own[i]
        n = 0
        for s in range(len(starts)):
            y = starts[s]
            away = np.hypot(points[x, 0] - points[y, 0], points[x, 1] - points[y, 1])
            candidate = sizes[s] + g * away
            if candidate >= own[i]:  # also inf
                continue
            if s >= n_sources:
                c = s - n_sources
                if not _is_tangent(y, beside[c, 0], beside[c, 1], x, points):
                    continue
            value[n], which[n] = candidate, y
            n += 1
        while n > 0:
            best = np.argmin(value[:n])
            if sees(which[best], x, mesh, tolerance, scratch):
                out[i] = value[best]
                break
            n -= 1
            value[best], which[best] = value[n], which[n]


@njit(cache=True, nogil=True)
def relax_corners(corners, sizes, beside, mesh, tolerance, g):
    """Lower the sizes of corners (in/out) by paths over others: Dijkstra's algorithm.

    What a path in a direction that is not tangent would give a corner is left out.
    """
    points = mesh[0]
    scratch = new_scratch()
    is_final = np.zeros(len(corners), np.bool_)
    for _ in range(len(corners)):
        least = -1
        for c in range(len(corners)):
            if not is_final[c] and (least < 0 or sizes[c] < sizes[least]):
                least = c
        if sizes[least] == np.inf:
            break
        is_final[least] = True
        v = corners[least]
        for c in range(len(corners)):
            w = corners[c]
            away = np.hypot(points[v, 0] - points[w, 0], points[v, 1] - points[w, 1])
            if (
                sizes[least] + g * away < sizes[c]
                and _is_tangent(v, beside[least, 0], beside[least, 1], w, points)
                and _is_tangent(w, beside[c, 0], beside[c, 1], v, points)
                and sees(v, w, mesh, tolerance, scratch)
            ):
                sizes[c] = sizes[least] + g * away
