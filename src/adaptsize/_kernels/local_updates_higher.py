r"""The size of one node from an edge on which more is known than two sizes.

All updates minimise over 0 <= s <= 1, with y(s) = x_a + s (x_b - x_a),

    f(s) = w(s) + c(s) |x_k - y(s)|,       c(s) = (g_k + (1 - s) g_a + s g_b) / 2,

the sizes w on the edge and, by the trapezoidal rule, what the last, straight piece of
a path adds.  They differ in w:

* linear, where only the two sizes are known;
* gradient-augmented: the cubic Hermite interpolant of sizes and slopes;
* factored, where the sizes come from a point source z: w = h_z + G(s) |y(s) - z| with
  the cubic Hermite interpolant G of the mean slopes (h - h_z) / |y - z|.  A cubic
  meets a cone badly near its tip; its mean slope is constant.

The data of a triangle (k, a, b) are passed as numbers in its own plane, so that the
same update serves the plane and surfaces.  ``axes`` as in local_updates.py.
"""

import math

from adaptsize._kernels.compiling import inner, kernel

# Newton's method converges quadratically, from a good start: two or three steps are usual.
_MOST_STEPS = 6
# After a step as short as this the next one is near rounding.
_SHORT_STEP = 1e-3
_NO_STEP = 1e-12
# Tolerance for mean slopes outside the range of g; beyond it, a source is rejected.
_SLACK = 0.01
_ROUNDING = 1e-9


@kernel
def edge_frame(points, axes, k, a, b):
    """Return where node k lies as seen from the edge (a, b).

    Parameters
    ----------
    points : float64[n, dim]
    axes : tuple of length dim
    k, a, b : int

    Returns
    -------
    length2, foot, height2 : float
        Square of the length of the edge; foot of x_k on its line as a fraction of the
        edge (0 if it has no length); square of the height over it.
    """
    length2 = 0.0
    dot = 0.0
    for d in range(len(axes)):
        e = points[b, d] - points[a, d]
        length2 += e * e
        dot += e * (points[k, d] - points[a, d])
    foot = dot / length2 if length2 > 0.0 else 0.0
    # Subtract vectors, not squares: this keeps the height of a sliver accurate.
    height2 = 0.0
    for d in range(len(axes)):
        height2 += (points[k, d] - points[a, d] - foot * (points[b, d] - points[a, d])) ** 2
    return length2, foot, height2


@kernel
def minimum_on_linear(length2, foot, height2, h_a, rise, c_a, c_rise):
    """Return f near its minimum for linear sizes, and where.

    The place is exact for constant c (see `minimum_on_edge`) and off by O(c_rise)
    otherwise, which f sees squared.

    Parameters
    ----------
    length2, foot, height2 : float
        See `edge_frame`.
    h_a, rise : float
        Size at a; that at b less that at a.
    c_a, c_rise : float
        c(0) and c(1) - c(0).

    Returns
    -------
    value, s : float
        inf if the minimum is at an end.
    """
    c = c_a + 0.5 * c_rise
    scale2 = length2 * (c * c * length2 - rise * rise)
    if scale2 > 0.0:
        s = foot - rise * math.sqrt(height2 / scale2)
        if 0.0 < s < 1.0:
            along = s - foot
            r = math.sqrt(height2 + length2 * along * along)
            return h_a + s * rise + (c_a + s * c_rise) * r, s
    return math.inf, 0.0


@kernel
def minimum_on_cubic(
    length2, foot, height2, h_a, rise, slope_a, slope_b, lean_a, lean_b, c_a, c_rise
):
    """Return the least f that Newton's method finds for cubic sizes, and where.

    Parameters
    ----------
    length2, foot, height2, h_a, rise, c_a, c_rise
        As in `minimum_on_linear`; the length is positive.
    slope_a, slope_b : float
        dh/ds at the ends.
    lean_a, lean_b : float
        How far the rays at the ends lean from a to b: components of the gradient
        along the edge over those across it.  The ray through x_k is sought first as
        if they came from one point, where the lean is linear in s.

    Returns
    -------
    value, s : float
        A value of f and its place.
    """
    height = math.sqrt(height2 / length2)
    s_a = foot - height * lean_a
    spread = 1.0 + height * (lean_b - lean_a)
    if spread > 0.5:
        s = min(max(s_a / spread, 0.0), 1.0)
    else:
        s = minimum_on_linear(length2, foot, height2, h_a, rise, c_a, c_rise)[1]
    quadratic = 3.0 * rise - 2.0 * slope_a - slope_b
    cubic = slope_a + slope_b - 2.0 * rise
    least = math.inf
    best = s
    step = 1.0
    for _ in range(_MOST_STEPS):
        along = s - foot
        r = math.sqrt(height2 + length2 * along * along)
        c = c_a + c_rise * s
        value = h_a + s * (slope_a + s * (quadratic + s * cubic)) + c * r
        if value < least:
            least = value
            best = s
        if step < _SHORT_STEP or r <= 0.0:
            break
        pull = length2 * along / r  # dr/ds
        first = slope_a + s * (2.0 * quadratic + 3.0 * s * cubic) + c_rise * r + c * pull
        second = (
            2.0 * quadratic
            + 6.0 * s * cubic
            + 2.0 * c_rise * pull
            + c * (length2 - pull * pull) / r
        )
        if second <= 0.0:
            break
        new = min(max(s - first / second, 0.0), 1.0)
        step = abs(new - s)
        if step < _NO_STEP:
            break
        s = new
    return least, best


@kernel
def minimum_from_source(
    points,
    axes,
    frame,
    a,
    b,
    z,
    h_z,
    h_a,
    h_b,
    slope_a,
    slope_b,
    known,
    c_a,
    c_rise,
    limits,
    convex,
):
    """Return the least f that Newton's method finds for sizes from a point source, and where.

    Parameters
    ----------
    points, axes
        As in `edge_frame`.
    frame : tuple
        What `edge_frame` returns.
    a, b, z : int
        Ends of the edge and the source, three different nodes.
    h_z, h_a, h_b : float
        Sizes; inf for ``h_b`` if that does not come from z: then the mean slope is
        taken as linear from a onwards.
    slope_a, slope_b : float
        dh/ds at the ends, used if known.
    known : bool
        False takes the mean slope as linear between the ends.
    c_a, c_rise : float
        As in `minimum_on_linear`.
    limits : tuple
        Least and largest g, and the largest |grad g|, in the whole mesh.

    Returns
    -------
    value, s : float
        inf if the sizes do not look as if they came from z.
    """
    length2, foot, height2 = frame
    dot_a = 0.0
    t2_a = 0.0
    t2_b = 0.0
    for d in range(len(axes)):
        from_z = points[a, d] - points[z, d]
        dot_a += from_z * (points[b, d] - points[a, d])
        t2_a += from_z * from_z
        t2_b += (points[b, d] - points[z, d]) ** 2
    if t2_a <= 0.0 or t2_b <= 0.0:
        return math.inf, 0.0
    t_a = math.sqrt(t2_a)
    t_b = math.sqrt(t2_b)
    lowest, highest, steepest = limits
    mean_a = (h_a - h_z) / t_a
    mean_b = mean_a if math.isinf(h_b) else (h_b - h_z) / t_b
    if min(mean_a, mean_b) < lowest * (1.0 - _ROUNDING):
        return math.inf, 0.0
    mean_a = max(mean_a, lowest)
    mean_b = max(mean_b, lowest)
    if max(mean_a, mean_b) > highest:
        if convex:
            mean_a = min(mean_a, highest)
            mean_b = min(mean_b, highest)
        elif max(mean_a, mean_b) > highest * (1.0 + _SLACK):
            return math.inf, 0.0
    # h = h_z + G t gives G' = (h' - G t') / t, with t' = (y - z).(x_b - x_a) / t.
    # G is the mean of g along a ray, so that it is no steeper than g.
    most = steepest * math.sqrt(length2)
    if known:
        slope_a = min(max((slope_a - mean_a * dot_a / t_a) / t_a, -most), most)
    else:
        slope_a = mean_b - mean_a
    if math.isinf(h_b):
        mean_b = mean_a + slope_a
        slope_b = slope_a
    elif known:
        slope_b = min(max((slope_b - mean_b * (dot_a + length2) / t_b) / t_b, -most), most)
    else:
        slope_b = slope_a
    # Begin where the straight line from z to x_k crosses the edge.
    s = foot
    if height2 > 0.0:
        foot_z = -dot_a / length2
        behind = math.sqrt(max(t2_a - foot_z * foot_z * length2, 0.0) / height2)
        s += (foot_z - foot) / (1.0 + behind)
    s = min(max(s, 0.0), 1.0)
    return _minimum_on_factored(
        length2, foot, height2, s, h_z, t2_a, dot_a, mean_a, mean_b - mean_a, slope_a, slope_b,
        c_a, c_rise,
    )  # fmt: skip


@inner
def _minimum_on_factored(
    length2, foot, height2, s, h_z, t2_a, dot_a, mean_a, rise, slope_a, slope_b, c_a, c_rise
):
    """Return the least f from the start s for given mean slopes and their derivatives.

    t2_a = |x_a - z|^2 and dot_a = (x_a - z).(x_b - x_a); otherwise as above.
    """
    quadratic = 3.0 * rise - 2.0 * slope_a - slope_b
    cubic = slope_a + slope_b - 2.0 * rise
    least = math.inf
    best = s
    step = 1.0
    for _ in range(_MOST_STEPS):
        along = s - foot
        r = math.sqrt(height2 + length2 * along * along)
        t = math.sqrt(max(t2_a + s * (2.0 * dot_a + s * length2), 0.0))
        c = c_a + c_rise * s
        mean = mean_a + s * (slope_a + s * (quadratic + s * cubic))
        value = h_z + mean * t + c * r
        if value < least:
            least = value
            best = s
        if step < _SHORT_STEP or r <= 0.0 or t <= 0.0:
            break
        pull = length2 * along / r  # dr/ds
        push = (dot_a + s * length2) / t  # dt/ds
        mean_1 = slope_a + s * (2.0 * quadratic + 3.0 * s * cubic)
        first = mean_1 * t + mean * push + c_rise * r + c * pull
        second = (
            (2.0 * quadratic + 6.0 * s * cubic) * t
            + 2.0 * mean_1 * push
            + mean * (length2 - push * push) / t
            + 2.0 * c_rise * pull
            + c * (length2 - pull * pull) / r
        )
        if second <= 0.0:
            break
        new = min(max(s - first / second, 0.0), 1.0)
        step = abs(new - s)
        if step < _NO_STEP:
            break
        s = new
    return least, best


@kernel
def gradient_behind(frame, s, g_k, g_a, g_b):
    """Return the gradient at x_k of a size that came straight from y(s), in the triangle's plane.

    That of c |x_k - y|, which turns the ray by what g does across it, with the length
    that it must have, g_k.

    Parameters
    ----------
    frame : tuple
        What `edge_frame` returns.
    s : float
    g_k, g_a, g_b : float

    Returns
    -------
    along, across : float
        Components from a to b, and from the edge to x_k; zeros if x_k lies on the edge there.
    """
    length2, foot, height2 = frame
    length = math.sqrt(length2)
    height = math.sqrt(height2)
    along = (foot - s) * length
    r = math.sqrt(along * along + height2)
    if r <= 0.0:
        return 0.0, 0.0
    c = 0.5 * (g_k + g_a + s * (g_b - g_a)) / r
    along *= c
    across = c * height
    if height > 1e-3 * length and length > 0.0:  # else grad g of the triangle means nothing
        along += 0.5 * r * (g_b - g_a) / length
        across += 0.5 * r * (g_k - g_a - foot * (g_b - g_a)) / height
    norm = math.sqrt(along * along + across * across)
    if norm <= 0.0:
        return 0.0, 0.0
    return along * g_k / norm, across * g_k / norm
