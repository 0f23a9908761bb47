"""Generalised winding number of segments in the plane or triangles in space, by a tree.

The number at q is the share of the directions from q in which the surface is seen, seen from
inside counted positive and from outside negative,

    w(q) = 1 / (4 pi) sum of solid angles      (space),
    w(q) = 1 / (2 pi) sum of angles            (plane),

1 inside and 0 outside a closed surface with normals outward.  A node of the tree that is far
away counts by three terms of the expansion of  n . (p - q) / |p - q|^dim  around its centre.

The tree is one of cells in space (trees.py), without its boxes.
"""

import math

import numpy as np

from adaptsize._kernels.compiling import inner, kernel, lean, lean_kernel
from adaptsize._kernels.trees import cells_of_leaf
from adaptsize._kernels.vectors import cross, dot, minus, norm

#: Columns of the array of moments, see `fill_moments`.
N_MOMENTS = 34


@kernel
def fill_moments(tree, moments):
    """Fill the moments of the nodes of a tree, for the far-field expansion.

    Parameters
    ----------
    tree : Tree
        Of segments in the plane z = 0, or triangles.
    moments : float64[2 * n_leaves, 34]
        Out: centre c (3), radius around it (1), and the integrals over the surface of the
        normal n_i (3), of n_i d_j (9) and of n_i d_j d_k (18, with jk = 00, 01, 02, 11, 12,
        22), where d = p - c.
    """
    points, cells = tree.points, tree.cells
    n_cells = cells.shape[0]
    n_leaves = moments.shape[0] // 2
    width = cells.shape[1]
    normal = np.empty(3)
    middle = np.empty(3)
    # Mean of the products of coordinates over a cell, around its centroid, over their sum over
    # its corners: 1/6 for segments, 1/12 for triangles.
    spread = 1.0 / (width * (width + 1.0))
    moments[:] = 0.0
    for node in range(2 * n_leaves - 1, 0, -1):
        span = 1
        leaf = node
        while leaf < n_leaves:
            leaf *= 2
            span *= 2
        begin = (leaf - n_leaves) * n_cells // n_leaves
        end = (leaf - n_leaves + span) * n_cells // n_leaves
        total = 0.0
        for c in range(begin, end):
            area = _oriented(points, cells, c, normal, middle) + 1e-300
            total += area
            for d in range(3):
                moments[node, d] += area * middle[d]
                moments[node, 4 + d] += normal[d]
        for d in range(3):
            moments[node, d] /= total
        radius2 = 0.0
        for c in range(begin, end):
            _oriented(points, cells, c, normal, middle)
            column = 16
            for b in range(3):
                at_b = middle[b] - moments[node, b]
                for a in range(3):
                    moments[node, 7 + 3 * a + b] += normal[a] * at_b
                for d in range(b, 3):
                    product = at_b * (middle[d] - moments[node, d])
                    for v in range(width):
                        out_b = points[cells[c, v], b] - middle[b]
                        product += spread * out_b * (points[cells[c, v], d] - middle[d])
                    for a in range(3):
                        moments[node, column + 6 * a] += normal[a] * product
                    column += 1
            for v in range(width):
                away2 = 0.0
                for d in range(3):
                    away2 += (points[cells[c, v], d] - moments[node, d]) ** 2
                radius2 = max(radius2, away2)
        moments[node, 3] = math.sqrt(radius2)


@inner
def _oriented(points, cells, c, normal, middle):
    """Fill a n and the centroid of cell c; return a."""
    i, j = cells[c, 0], cells[c, 1]
    if cells.shape[1] == 2:
        normal[0] = points[j, 1] - points[i, 1]
        normal[1] = points[i, 0] - points[j, 0]
        normal[2] = 0.0
        for d in range(3):
            middle[d] = 0.5 * (points[i, d] + points[j, d])
    else:
        k = cells[c, 2]
        for d in range(3):
            e, f = (d + 1) % 3, (d + 2) % 3
            u, v = points[j, e] - points[i, e], points[j, f] - points[i, f]
            s, t = points[k, e] - points[i, e], points[k, f] - points[i, f]
            normal[d] = 0.5 * (u * t - v * s)
            middle[d] = (points[i, d] + points[j, d] + points[k, d]) / 3.0
    return math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)


@lean
def _angle(points, cells, c, x):
    """Return the share of directions from x that cell c takes, with its sign.

    Segments: atan2 of cross and dot product.  Triangles: van Oosterom and Strackee (1983).
    """
    i, j = cells[c, 0], cells[c, 1]
    u, v = minus(points[i], x), minus(points[j], x)
    if cells.shape[1] == 2:
        return math.atan2(u[0] * v[1] - u[1] * v[0], u[0] * v[0] + u[1] * v[1]) / (2.0 * math.pi)
    w = minus(points[cells[c, 2]], x)
    a, b, c_ = norm(u), norm(v), norm(w)
    rest = a * b * c_ + dot(u, v) * c_ + dot(v, w) * a + dot(w, u) * b
    return math.atan2(dot(u, cross(v, w)), rest) / (2.0 * math.pi)


@lean
def _expansion(m, rx, ry, rz, in_plane):
    """Return the share of directions that a node takes at (-rx, -ry, -rz) from its centre."""
    r2 = rx * rx + ry * ry + rz * rz
    per_angle = 1.0 / (2.0 * math.pi) if in_plane else 1.0 / (4.0 * math.pi)
    power = 2.0 if in_plane else 3.0
    flux = m[4] * rx + m[5] * ry + m[6] * rz
    trace = m[7] + m[11] + m[15]
    twice = rx * (m[7] * rx + m[8] * ry + m[9] * rz)
    twice += ry * (m[10] * rx + m[11] * ry + m[12] * rz)
    twice += rz * (m[13] * rx + m[14] * ry + m[15] * rz)
    xx, yy, zz = rx * rx, ry * ry, rz * rz
    xy, xz, yz = 2.0 * rx * ry, 2.0 * rx * rz, 2.0 * ry * rz
    thrice = rx * (m[16] * xx + m[17] * xy + m[18] * xz)
    thrice += rx * (m[19] * yy + m[20] * yz + m[21] * zz)
    thrice += ry * (m[22] * xx + m[23] * xy + m[24] * xz)
    thrice += ry * (m[25] * yy + m[26] * yz + m[27] * zz)
    thrice += rz * (m[28] * xx + m[29] * xy + m[30] * xz)
    thrice += rz * (m[31] * yy + m[32] * yz + m[33] * zz)
    once = rx * (m[16] + m[19] + m[21] + 2.0 * (m[16] + m[23] + m[30]))
    once += ry * (m[22] + m[25] + m[27] + 2.0 * (m[17] + m[25] + m[32]))
    once += rz * (m[28] + m[31] + m[33] + 2.0 * (m[18] + m[26] + m[33]))
    per_r = 1.0 / r2 if in_plane else 1.0 / (r2 * math.sqrt(r2))
    second = 0.5 * power * ((power + 2.0) * thrice / r2 - once) / r2
    return (flux + trace - power * twice / r2 + second) * per_r * per_angle


@lean_kernel
def wind(tree, moments, far, queries, stack, numbers):
    """Fill the winding number at points.

    Parameters
    ----------
    tree : Tree
    moments : float64[2 * n_leaves, 34]
        From `fill_moments`.
    far : float
        A node of the tree is expanded as a whole beyond this number of its radii.
    queries : float64[n_queries, 3]
    stack : int64[DEPTH]
        Scratch.
    numbers : float64[n_queries]
        Out.
    """
    points, cells = tree.points, tree.cells
    n_leaves = moments.shape[0] // 2
    for q in range(queries.shape[0]):
        x = (queries[q, 0], queries[q, 1], queries[q, 2])
        total = 0.0
        # Unlike in the descents of trees.py, nodes that are not entered count, too.
        stack[0], height = 1, 1
        while height > 0:
            height -= 1
            node = stack[height]
            m = moments[node]
            rx, ry, rz = m[0] - x[0], m[1] - x[1], m[2] - x[2]
            close = far * m[3]
            if rx * rx + ry * ry + rz * rz > close * close:
                total += _expansion(m, rx, ry, rz, cells.shape[1] == 2)
            elif node < n_leaves:
                stack[height], stack[height + 1] = 2 * node, 2 * node + 1
                height += 2
            else:
                for c in range(*cells_of_leaf(node - n_leaves, moments, cells.shape[0])):
                    total += _angle(points, cells, c, x)
        numbers[q] = total
