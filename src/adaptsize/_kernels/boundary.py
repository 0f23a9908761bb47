"""The boundary of a flat mesh as a chain, without matching its facets.

Every cell is oriented by its signed measure.  A facet between two cells that lie on
different sides of it then occurs once in each direction, and what does not cancel is
the boundary: free facets, and those where the mesh is folded.  To find out where that
is, each node sums, over its cells, a number that changes sign with the direction of the facets
at it: the sum is 0 exactly inside, but for a chance of about 2^-60.
"""

import numpy as np

from adaptsize._kernels.compiling import inner, kernel

# Odd 64-bit constants without structure (fractional parts of the golden ratio, of sqrt 2).
_A = np.uint64(0x9E3779B97F4A7C15)
_B = np.uint64(0x6A09E667F3BCC909)
_SHIFT = np.uint64(32)


@inner
def _random(i):
    """Return 64 bits for a node number."""
    x = (np.uint64(i) + _B) * _A
    x = (x ^ (x >> _SHIFT)) * _B
    return x ^ (x >> _SHIFT)


@inner
def _facet(cells, c, v, dim):
    """Return the nodes of the facet opposite to v, ascending, and whether their order is odd.

    Of the two orders of a facet the even one has its normal out of a cell of positive measure.
    """
    a = cells[c, (v + 1) % (dim + 1)]
    b = cells[c, (v + 2) % (dim + 1)]
    odd = False
    if dim == 2:
        d = np.int32(-1)
    else:
        d = cells[c, (v + 3) % 4]
        odd = v % 2 == 1
        if b > d:
            b, d = d, b
            odd = not odd
    if a > b:
        a, b = b, a
        odd = not odd
    if dim == 3 and b > d:
        b, d = d, b
        odd = not odd
    return a, b, d, odd


@inner
def is_inverted(points, axes, cells, c):
    """Tell whether the signed measure of a cell is negative."""
    i, j, k = cells[c, 0], cells[c, 1], cells[c, 2]
    ax = points[j, 0] - points[i, 0]
    ay = points[j, 1] - points[i, 1]
    bx = points[k, 0] - points[i, 0]
    by = points[k, 1] - points[i, 1]
    if len(axes) == 2:
        return ax * by - ay * bx < 0.0
    m = cells[c, len(axes)]
    az = points[j, 2] - points[i, 2]
    bz = points[k, 2] - points[i, 2]
    cx = points[m, 0] - points[i, 0]
    cy = points[m, 1] - points[i, 1]
    cz = points[m, 2] - points[i, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return nx * cx + ny * cy + nz * cz < 0.0


@kernel
def sum_facets(points, axes, cells, sums):
    """Add up, at each node, signed random numbers of the facets there.

    A facet is told from the node by its other nodes: by r_b in the plane, and by the
    antisymmetric r_b s_c - r_c s_b in space, r and s being random numbers of the nodes.

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim, 2 or 3
    cells : int32[m, dim + 1]
    sums : uint64[n]
        In/Out: zeros; different from 0 then at the nodes of the boundary.
    """
    for c in range(cells.shape[0]):
        i, j, k = cells[c, 0], cells[c, 1], cells[c, 2]
        if is_inverted(points, axes, cells, c):
            i, j = j, i
        a, b, d = _random(i), _random(j), _random(k)
        if len(axes) == 2:
            sums[i] += b - d
            sums[j] += d - a
            sums[k] += a - b
        else:
            m = cells[c, len(axes)]
            e = _random(m)
            a2, b2, d2, e2 = (
                a ^ (a >> _SHIFT),
                b ^ (b >> _SHIFT),
                d ^ (d >> _SHIFT),
                e ^ (e >> _SHIFT),
            )
            ab, ad, ae = a * b2 - b * a2, a * d2 - d * a2, a * e2 - e * a2
            bd, be, de = b * d2 - d * b2, b * e2 - e * b2, d * e2 - e * d2
            sums[i] += bd + de - be
            sums[j] += ae - ad - de
            sums[k] += ab + be - ae
            sums[m] += ad - ab - bd


@kernel
def list_facets(points, axes, cells, sums, facets, odd):
    """List the facets all of whose nodes are on the boundary, and so all facets of the boundary.

    Parameters
    ----------
    points, axes, cells, sums
        As in `sum_facets`.
    facets : int32[f, dim]
        Out: nodes, ascending; as many as there is room for.
    odd : bool[f]
        Out: whether the normal of a facet out of its cell is that of the odd order.

    Returns
    -------
    int
        Their number; more than f if there was not enough room.
    """
    dim = len(axes)
    count = 0
    for c in range(cells.shape[0]):
        near = 0
        for v in range(dim + 1):
            if sums[cells[c, v]] != np.uint64(0):
                near += 1
        if near < dim:
            continue
        for v in range(dim + 1):
            if near == dim and sums[cells[c, v]] != np.uint64(0):
                continue
            if count < facets.shape[0]:
                a, b, d, is_odd = _facet(cells, c, v, dim)
                facets[count, 0] = a
                facets[count, 1] = b
                if dim == 3:
                    facets[count, 2] = d
                odd[count] = is_odd != is_inverted(points, axes, cells, c)
            count += 1
    return count
