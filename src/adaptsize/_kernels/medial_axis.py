"""Crossings of the fronts of a distance function along the edges of a Cartesian grid.

The grid comes as a flat array with a border of three nodes on every side.  ``strides`` and
``spacing`` always have three entries; an axis that the grid lacks has the stride 0, so
that every difference along it is zero.  NaN (inactive nodes) fails every comparison.
"""

import math

from adaptsize._kernels.compiling import lean, lean_kernel

# Roots this little outside of an edge are at its node: rounding must not lose them between two.
_ROUNDING = 1e-9

# Fronts that differ by 60 degrees from one node to the next meet, whatever the curvature next to
# them: around the centre of a ball it is as large.
_SURELY = 0.5

# Crossings this close to a node, in spacings, count as being at it.
_AT_NODE = 0.25

# A node farther from the crossing must be better by this much.
_FARTHER = 0.02


@lean
def largest_curvature(phi, k, strides, spacing):
    """Return the larger modulus of the principal curvatures of the level set at a node.

    Central differences in the formulas for the mean curvature H and the Gaussian one G,

        H = (|f|^2 trace F - f.F f) / (2 |f|^3),    G = f.adj(F) f / |f|^4,

    f the gradient of ``phi`` and F the matrix of its second derivatives; both curvatures are
    H +- sqrt(H^2 - G).  In the plane G = 0 and one of them is the curvature, the other 0.

    Parameters
    ----------
    phi : float64[n]
        Distance with its border.
    k : int
    strides, spacing : tuples of length 3

    Returns
    -------
    float
        0 where the gradient vanishes or a value is missing.
    """
    sx, sy, sz = strides
    hx, hy, hz = spacing
    fx = (phi[k + sx] - phi[k - sx]) / (2.0 * hx)
    fy = (phi[k + sy] - phi[k - sy]) / (2.0 * hy)
    fz = (phi[k + sz] - phi[k - sz]) / (2.0 * hz)
    f2 = fx * fx + fy * fy + fz * fz
    if not f2 > 1e-12:
        return 0.0
    here = 2.0 * phi[k]
    fxx = (phi[k + sx] - here + phi[k - sx]) / (hx * hx)
    fyy = (phi[k + sy] - here + phi[k - sy]) / (hy * hy)
    fzz = (phi[k + sz] - here + phi[k - sz]) / (hz * hz)
    fxy = phi[k + sx + sy] - phi[k + sx - sy] - phi[k - sx + sy] + phi[k - sx - sy]
    fxz = phi[k + sx + sz] - phi[k + sx - sz] - phi[k - sx + sz] + phi[k - sx - sz]
    fyz = phi[k + sy + sz] - phi[k + sy - sz] - phi[k - sy + sz] + phi[k - sy - sz]
    fxy /= 4.0 * hx * hy
    fxz /= 4.0 * hx * hz
    fyz /= 4.0 * hy * hz
    mean = (fyy + fzz) * fx * fx + (fxx + fzz) * fy * fy + (fxx + fyy) * fz * fz
    mean -= 2.0 * (fx * fy * fxy + fx * fz * fxz + fy * fz * fyz)
    mean /= 2.0 * f2 * math.sqrt(f2)
    gauss = fx * fx * (fyy * fzz - fyz * fyz)
    gauss += fy * fy * (fxx * fzz - fxz * fxz)
    gauss += fz * fz * (fxx * fyy - fxy * fxy)
    gauss += 2.0 * fx * fy * (fxz * fyz - fxy * fzz)
    gauss += 2.0 * fy * fz * (fxy * fxz - fyz * fxx)
    gauss += 2.0 * fx * fz * (fxy * fyz - fxz * fyy)
    gauss /= f2 * f2
    apart = math.sqrt(max(mean * mean - gauss, 0.0))
    largest = abs(mean) + apart
    return largest if largest >= 0.0 else 0.0


@lean
def smoother_difference(phi, k, stride):
    """Return the one-sided difference at a node on the side with the smaller second difference.

    A side whose second difference is large holds a kink; taking the side *upwind* in the sense of
    Godunov instead crosses it.  The mean where both sides are as smooth.

    Parameters
    ----------
    phi : float64[n]
    k, stride : int

    Returns
    -------
    float
        The difference, not divided by the spacing; NaN if both sides are missing.
    """
    back = phi[k] - phi[k - stride]
    front = phi[k + stride] - phi[k]
    bend_back = abs(back - (phi[k - stride] - phi[k - 2 * stride]))
    bend_front = abs((phi[k + 2 * stride] - phi[k + stride]) - front)
    if not bend_back >= 0.0:  # NaN: a missing node on this side
        return front
    if not bend_front >= 0.0:
        return back
    slack = 1e-9 * (bend_back + bend_front)
    if bend_back < bend_front - slack:
        return back
    if bend_front < bend_back - slack:
        return front
    return 0.5 * (back + front)


@lean
def gradient_of_front(phi, k, a, step, away, strides, spacing):
    """Return the gradient of one front near a crossing, from the most regular of three nodes.

    A distance has a gradient of length one.  Where differences mix several fronts the length
    is another one; then the next node away from the crossing is better.

    Parameters
    ----------
    phi : float64[n]
    k, a : int
        End of the edge, and axis of the edge.
    step : int
        Step in the flat array away from the edge.
    away : float
        Distance of the node from the crossing, in spacings: at the medial axis
        differences to either side may be of either front, and the node is not used.
    strides, spacing : tuples of length 3

    Returns
    -------
    tuple of 3 float
    """
    best = math.inf
    bx = by = bz = 0.0
    for t in range(0 if away > _AT_NODE else 1, 3):
        j = k + t * step
        x = y = z = 0.0
        for c in range(3):
            if strides[c] == 0:
                continue
            if c != a:
                d = smoother_difference(phi, j, strides[c]) / spacing[c]
            elif step < 0:
                d = (phi[j] - phi[j + step]) / spacing[c]
            else:
                d = (phi[j + step] - phi[j]) / spacing[c]
            if c == 0:
                x = d
            elif c == 1:
                y = d
            else:
                z = d
        irregular = abs(math.sqrt(x * x + y * y + z * z) - 1.0) + _FARTHER * t
        if irregular < best:
            best = irregular
            bx, by, bz = x, y, z
    return bx, by, bz


@lean
def _meeting_on_edge(phi, k, s):
    """Return where the parabolas through three nodes on either side of an edge cross.

    Parameters
    ----------
    phi : float64[n]
    k, s : int
        Lower end of the edge, and step to the other one.

    Returns
    -------
    place : float
        0 to 1 on the edge; inf unless the second parabola is steeper throughout.
    rise : float
        How much steeper it is there, not divided by the spacing.
    depth : float
        Distance from the boundary there.
    """
    f1, f2, f3 = phi[k - 2 * s], phi[k - s], phi[k]
    f4, f5, f6 = phi[k + s], phi[k + 2 * s], phi[k + 3 * s]
    bend1 = 0.5 * (f1 - 2.0 * f2 + f3)
    bend2 = 0.5 * (f4 - 2.0 * f5 + f6)
    slope1 = 0.5 * (3.0 * f3 - 4.0 * f2 + f1)
    slope2 = 0.5 * (-3.0 * f4 + 4.0 * f5 - f6)
    # Second parabola minus first one, c + b s + a s^2.
    qa = bend2 - bend1
    qb = slope2 - 2.0 * bend2 - slope1
    qc = f4 - slope2 + bend2 - f3
    # It rises from s = -2 to 3, so that it has one root on the edge or none.
    if not (qb - 4.0 * qa > 0.0 and qb + 6.0 * qa > 0.0):
        return math.inf, 0.0, 0.0
    root = math.sqrt(max(qb * qb - 4.0 * qa * qc, 0.0))
    s0 = -2.0 * qc / (qb + root)
    return s0, qb + 2.0 * qa * s0, -(f3 + s0 * (slope1 + s0 * bend1))


@lean
def _differ(phi, k, a, strides, spacing, tolerance, gamma, step):
    """Return whether the gradients at both ends of an edge differ by more than curvature explains.

    ``step`` is the largest spacing; the other arguments are those of `find_crossings`.
    """
    s = strides[a]
    alpha = 0.0
    for c in range(3):
        t = strides[c]
        if t == 0:
            continue
        if c == a:
            da = (phi[k] - phi[k - s]) / spacing[c]
            db = (phi[k + 2 * s] - phi[k + s]) / spacing[c]
        else:
            da = smoother_difference(phi, k, t) / spacing[c]
            db = smoother_difference(phi, k + s, t) / spacing[c]
        alpha += da * db
    kappa = gamma * tolerance * step
    if not alpha < 1.0 - 0.5 * kappa * kappa:
        return False
    kappa = largest_curvature(phi, k - s, strides, spacing)
    kappa = max(kappa, largest_curvature(phi, k + 2 * s, strides, spacing))
    kappa *= gamma * step
    return alpha < max(1.0 - 0.5 * kappa * kappa, _SURELY)


@lean_kernel
def find_crossings(
    phi,
    counts,
    border,
    strides,
    spacing,
    tolerance,
    gamma,
    start,
    node,
    axis,
    place,
    rise,
    depth,
    gradients,
):
    """List the edges on which two fronts meet: Algorithm 1 without its last step.

    Parameters
    ----------
    phi : float64[n]
        Signed distance with its border, negative inside; NaN at missing nodes.
    counts, border : tuples of 3 int
        Nodes along each axis and width of the border; 1 and 0 for missing axes, which come first.
    strides, spacing : tuples of length 3
        Those of missing axes are 0 and 1.
    tolerance : float
        Smallest curvature that is resolved [1 / length].
    gamma : float
        Factor on curvatures.
    start : int
        First row of nodes (along the last axis) to look at, ``counts[0] * counts[1]`` in all.
    node : int64[m]
        Out: number of the node at the lower end, in the grid without border.
    axis : int64[m]
        Out: direction of the edge.
    place : float64[m]
        Out: where on the edge, 0 to 1.
    rise : float64[m]
        Out: how much steeper the second front is than the first at the crossing.
    depth : float64[m]
        Out: distance from the boundary at the crossing.
    gradients : float64[m, 2, 3]
        Out: gradients of the fronts on both sides.

    Returns
    -------
    count : int
        Entries filled.
    row : int
        First row not done; the number of rows at the end.
    """
    count = 0
    n_rows = counts[0] * counts[1]
    step = 0.0
    for c in range(3):
        if strides[c] > 0:
            step = max(step, spacing[c])
    for row in range(start, n_rows):
        if count + 3 * counts[2] > node.shape[0]:
            return count, row
        i = row // counts[1]
        j = row - i * counts[1]
        first = (i + border[0]) * strides[0] + (j + border[1]) * strides[1] + border[2]
        for m in range(counts[2]):
            k = first + m
            if not phi[k] < 0.0:
                continue
            for a in range(3):
                s = strides[a]
                # Missing axes, and edges out of the grid.
                if s == 0 or (m if a == 2 else (j if a == 1 else i)) == counts[a] - 1:
                    continue
                if not phi[k + s] < 0.0:
                    continue
                s0, faster, below = _meeting_on_edge(phi, k, s)
                if not -_ROUNDING <= s0 <= 1.0 + _ROUNDING:
                    continue
                if not _differ(phi, k, a, strides, spacing, tolerance, gamma, step):
                    continue
                node[count] = row * counts[2] + m
                axis[count] = a
                place[count] = min(max(s0, 0.0), 1.0)
                rise[count] = faster / spacing[a]
                depth[count] = below
                for side in range(2):
                    end = k if side == 0 else k + s
                    step_off = -s if side == 0 else s
                    away = s0 if side == 0 else 1.0 - s0
                    x, y, z = gradient_of_front(phi, end, a, step_off, away, strides, spacing)
                    gradients[count, side, 0] = x
                    gradients[count, side, 1] = y
                    gradients[count, side, 2] = z
                count += 1
    return count, n_rows
