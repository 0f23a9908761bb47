"""Exact limited sizes in flat domains that need not be convex: references for the limiter.

Nothing here knows of meshes or of adaptsize.  A polygonal domain is a tuple of rings,
float64[n, 2] each, first the outer one counterclockwise, then the holes clockwise, so
that the domain lies to the left of every edge.  The domain includes its boundary.

The limited size is min over sources s of ``U_s + g d(s, x)`` with d the length of the
shortest path in the domain.  Such a path is straight except at reflex corners (Lozano-Perez
and Wesley 1979), so a graph of what sees what gives it to rounding.  A segment
that carries linear data is a source as well: where x does not see the minimum over
the whole segment, the minimum over what it does see lies on a ray that touches a corner, and
the path through that corner is no longer.
"""

import numpy as np
from visibility import fill_inside, fill_sizes, fill_visible

#: Depth, relative to the domain's extent, to which a path may enter the outside.  A chord that
#: passes a corner at this depth is shorter than the path around it by its square only.
_RELATIVE_DEPTH = 1e-11


def limited_sizes(rings, points, g, sources=None, sizes=None, *, segments=None, segment_sizes=None):
    """Return min over sources of size + g * geodesic distance, float64[n].

    ``rings`` are the domain, whose holes may not touch each other.  Sources are points, float64[k,
    2], and segments, float64[m, 2, 2], with the sizes at their ends, linear in between.  Exact to
    about 1e-12 of the extent; inf if nothing reaches a point.
    """
    starts, start_sizes = _as_segments(sources, sizes, segments, segment_sizes)
    walls, depth = _walls(rings)
    corners = reflex_corners(rings)
    corner_sizes = np.full(len(corners), np.inf)
    if len(corners):
        direct = np.empty(len(corners))
        none = np.empty((0, 2))
        fill_sizes(corners, walls, depth, g, starts, start_sizes, none, np.empty(0), direct)
        corner_sizes = _relaxed(direct, g * _visible_lengths(corners, walls, depth))
    points = np.ascontiguousarray(points, float)
    result = np.empty(len(points))
    fill_sizes(points, walls, depth, g, starts, start_sizes, corners, corner_sizes, result)
    return result


def distances(rings, source, points):
    """Return the length of the shortest path in the domain from ``source`` to each point."""
    return limited_sizes(rings, points, 1.0, sources=np.reshape(source, (1, 2)), sizes=[0.0])


def prism_sizes(rings, points, g, sources, sizes):
    """Return the exact limited sizes in the prism (polygonal domain) x (interval of z).

    ``points`` float64[n, 3], ``sources`` float64[k, 3].  The prism is a product, and so
    is its inner metric: ``d^2 = d_polygon^2 + (z - z_s)^2``; unfolding the walls along
    the reflex edges, which run along z, says the same.  The interval's ends never matter.
    """
    result = np.full(len(points), np.inf)
    for source, size in zip(np.asarray(sources, float), sizes, strict=True):
        flat = distances(rings, source[:2], points[:, :2])
        result = np.minimum(result, size + g * np.hypot(flat, points[:, 2] - source[2]))
    return result


def window_sizes(window, points, g, sources, sizes):
    """Return the exact limited sizes in space, less a wall with a rectangular window.

    ``window`` is (width, lower, upper): the wall fills ``|x| < width/2`` but for
    ``lower < (y, z) < upper``.  Sources float64[k, 3] lie beside the wall.

    The domain is two half-spaces and the box of the window, all convex, so a path from one
    side to the other is ``|a - p| + |p - q| + |q - b|``, p and q in the two rectangles that end
    the window: a convex function, smooth since ``|p - q| >= width``.  Minimising it over p
    and q in turn, each in closed form, therefore converges to its minimum.
    """
    width, lower, upper = window
    result = np.full(len(points), np.inf)
    for source, size in zip(np.asarray(sources, float), sizes, strict=True):
        mirror = np.array([-1.0 if source[0] > 0.0 else 1.0, 1.0, 1.0])
        a, b = source * mirror, points * mirror
        length = np.linalg.norm(b - a, axis=1)
        near, far = ((x, np.asarray(lower), np.asarray(upper)) for x in (-0.5 * width, 0.5 * width))
        inside = np.flatnonzero((b[:, 0] > near[0]) & (b[:, 0] < far[0]))
        length[inside] = _bent_in_rectangle(a, b[inside], near)[1]
        beyond = np.flatnonzero(b[:, 0] >= far[0])
        length[beyond] = _twice_bent(a, b[beyond], near, far)
        result = np.minimum(result, size + g * length)
    return result


def _twice_bent(a, b, near, far):
    """Return the least length from a to the points b, through both rectangles, float64[n]."""
    length = np.full(len(b), np.inf)
    q = _bent_in_rectangle(a, b, far)[0]
    active = np.arange(len(b))
    while len(active):
        p = _bent_in_rectangle(a, q[active], near)[0]
        q[active], rest = _bent_in_rectangle(p, b[active], far)
        new = np.linalg.norm(p - a, axis=1) + rest
        # A round leaves the share 1/((1 + w/|a - p|)(1 + w/|q - b|)) of the excess or less,
        # w = |p - q|: what is left at the end is some 1e-14.
        going = new < length[active] * (1.0 - 1e-15)
        length[active] = new
        active = active[going]
    return length


def _bent_in_rectangle(a, b, rectangle):
    """Return p in the rectangle of least ``|a - p| + |p - b|``, float64[n, 3], and that sum.

    Where the line does not go through, p is on an edge: turned about the edge into one plane,
    the path is straight, or goes to an end of the edge.
    """
    x, lower, upper = rectangle
    a = np.broadcast_to(a, b.shape)
    share = (x - a[:, :1]) / (b[:, :1] - a[:, :1])
    p = a + share * (b - a)
    p[:, 0] = x
    goes_through = ((p[:, 1:] >= lower) & (p[:, 1:] <= upper)).all(axis=1)
    length = np.where(goes_through, np.linalg.norm(b - a, axis=1), np.inf)
    for across, along in ((1, 2), (2, 1)):
        for bound in (lower[across - 1], upper[across - 1]):
            edge = np.empty_like(p)
            off_a, off_b = (np.hypot(e[:, 0] - x, e[:, across] - bound) for e in (a, b))
            edge[:, 0], edge[:, across] = x, bound
            mean = (a[:, along] * off_b + b[:, along] * off_a) / (off_a + off_b)
            edge[:, along] = np.clip(mean, lower[along - 1], upper[along - 1])
            bent = np.linalg.norm(a - edge, axis=1) + np.linalg.norm(b - edge, axis=1)
            shorter = bent < length
            length[shorter], p[shorter] = bent[shorter], edge[shorter]
    return p, length


def curve_sizes(curve, sizes, interval, points, g, *, n_samples=720):
    """Return min over s in an interval of ``sizes(s) + g |x - curve(s)|``, float64[n].

    For smooth data on a smooth curve in a convex domain: ``curve(s)`` gives float64[len(s), dim],
    ``sizes(s)`` float64[len(s)].  Samples find the valleys, golden sections their ground.
    With ``curve = lambda s: s[:, None]`` the limit of a function of one variable.

    Every valley of the samples is searched whose samples are within reach of the
    lowest: its ground is at most half a step of Lipschitz growth below them.
    """
    s = np.linspace(*interval, n_samples)
    places, values = curve(s), sizes(s)
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1).max()
    reach = g * speed + np.abs(np.diff(values)).max()
    result = np.empty(len(points))
    for first in range(0, len(points), 4096):  # 4096 x 720 x 8 bytes = 24 MB
        some = points[first : first + 4096]
        all_values = values + g * _lengths_between(some, places)
        padded = np.pad(all_values, ((0, 0), (1, 1)), constant_values=np.inf)
        is_valley = (all_values <= padded[:, :-2]) & (all_values <= padded[:, 2:])
        lowest = all_values.min(axis=1)
        point, sample = np.nonzero(is_valley & (all_values <= lowest[:, None] + reach))
        left, right = s[np.maximum(sample - 1, 0)], s[np.minimum(sample + 1, n_samples - 1)]
        ground = _golden_minimum(
            lambda t, x=some[point]: sizes(t) + g * np.linalg.norm(x - curve(t), axis=1),
            left,
            right,
        )
        np.minimum.at(lowest, point, ground)
        result[first : first + 4096] = lowest
    return result


def radial_sizes(sizes, radius, points, g):
    """Return the limit of ``sizes(|x|)``, given everywhere in the disc or ball, float64[n].

    The nearest point at another radius is on the same ray, so this is a problem on [0, radius].
    """
    r = np.linalg.norm(points, axis=1)[:, None]
    return curve_sizes(lambda s: s[:, None], sizes, (0.0, radius), r, g)


def _lengths_between(points, places):
    squares = sum((points[:, a, None] - places[:, a]) ** 2 for a in range(points.shape[1]))
    return np.sqrt(squares)


def _golden_minimum(f, left, right):
    """Return the least value of f seen in each interval; the bracket shrinks to rounding."""
    ratio = (np.sqrt(5.0) - 1.0) / 2.0
    a, b = right - ratio * (right - left), left + ratio * (right - left)
    f_a, f_b = f(a), f(b)
    least = np.minimum(f_a, f_b)
    for _ in range(60):  # 0.618^60 = 3e-13
        lower = f_a < f_b
        left, right = np.where(lower, left, a), np.where(lower, b, right)
        new = np.where(lower, right - ratio * (right - left), left + ratio * (right - left))
        f_new = f(new)
        a, b, f_a, f_b = (
            np.where(lower, new, b),
            np.where(lower, a, new),
            np.where(lower, f_new, f_b),
            np.where(lower, f_a, f_new),
        )
        least = np.minimum(least, f_new)
    return least


def reflex_corners(rings):
    """Return the corners where the domain's angle exceeds 180 degrees, float64[k, 2]."""
    found = []
    for ring in rings:
        before = ring - np.roll(ring, 1, axis=0)
        after = np.roll(ring, -1, axis=0) - ring
        turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        length = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
        found.append(ring[turn < -1e-12 * length])
    return np.concatenate(found)


def contains(rings, points):
    """Return which points lie in the domain or on its boundary, bool[n]."""
    result = np.empty(len(points), bool)
    fill_inside(np.ascontiguousarray(points, float), *_walls(rings), result)
    return result


def sees(rings, a, b):
    """Return for which i the segment from a[i] to b[i] stays in the domain, bool[n].

    Running along the boundary and touching corners is allowed.  a, b: float64[n, 2], in the domain.
    """
    result = np.empty(len(a), bool)
    walls, depth = _walls(rings)
    fill_visible(
        np.ascontiguousarray(a, float), np.ascontiguousarray(b, float), walls, depth, result
    )
    return result


def area(rings):
    """Return the area of the domain: outer ring less holes."""
    return 0.5 * sum(
        float(np.sum(r[:, 0] * np.roll(r[:, 1], -1) - r[:, 1] * np.roll(r[:, 0], -1)))
        for r in rings
    )


def perimeter(rings):
    """Return the length of the boundary, holes included."""
    return sum(float(np.linalg.norm(np.roll(r, -1, axis=0) - r, axis=1).sum()) for r in rings)


def _as_segments(sources, sizes, segments, segment_sizes):
    """Return all sources as segments, a point as one of no length."""
    starts, start_sizes = [np.empty((0, 2, 2))], [np.empty((0, 2))]
    if sources is not None:
        starts.append(np.repeat(np.asarray(sources, float)[:, None, :], 2, axis=1))
        start_sizes.append(np.repeat(np.asarray(sizes, float)[:, None], 2, axis=1))
    if segments is not None:
        starts.append(np.asarray(segments, float))
        start_sizes.append(np.asarray(segment_sizes, float))
    return np.concatenate(starts), np.concatenate(start_sizes)


def _walls(rings):
    """Return the edges of all rings, float64[m, 4] (both ends), and the depth allowed."""
    walls = np.concatenate([np.hstack([r, np.roll(r, -1, axis=0)]) for r in rings])
    return walls, _RELATIVE_DEPTH * float(np.ptp(rings[0], axis=0).max())


def _visible_lengths(corners, walls, depth):
    """Return the distances between corners that see each other, else inf, float64[k, k]."""
    k = len(corners)
    i, j = np.triu_indices(k, 1)
    visible = np.empty(len(i), bool)
    fill_visible(corners[i], corners[j], walls, depth, visible)
    lengths = np.full((k, k), np.inf)
    straight = np.linalg.norm(corners[i] - corners[j], axis=1)
    lengths[i, j] = lengths[j, i] = np.where(visible, straight, np.inf)
    return lengths


def _relaxed(values, weights):
    """Return the smallest sums of a value and the weights of a path (Bellman and Ford)."""
    while True:
        lower = np.minimum(values, (values[:, None] + weights).min(axis=0))
        if (lower == values).all():
            return values
        values = lower
