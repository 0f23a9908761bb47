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
import shapely

#: By how much the domain is widened, relative to its extent, so that rounding blocks no path.
#: A chord that passes a corner at this depth is shorter than the path around it by its square only.
_RELATIVE_DEPTH = 1e-9


def limited_sizes(rings, points, g, sources=None, sizes=None, *, segments=None, segment_sizes=None):
    """Return min over sources of size + g * geodesic distance, float64[n].

    ``rings`` are the domain, whose holes may not touch each other.  Sources are points, float64[k,
    2], and segments, float64[m, 2, 2], with the sizes at their ends, linear in between.  Exact to
    about 1e-12 of the extent; inf if nothing reaches a point.
    """
    starts, start_sizes = _as_segments(sources, sizes, segments, segment_sizes)
    corners, domain = reflex_corners(rings), _widened(rings)
    if len(corners):
        direct = _straight_sizes(domain, corners, g, starts, start_sizes)
        corner_sizes = relaxed(direct, g * _visible_lengths(domain, corners))
        corner_starts = _as_segments(corners, corner_sizes, None, None)
        starts = np.concatenate([starts, corner_starts[0]])
        start_sizes = np.concatenate([start_sizes, corner_starts[1]])
    return _straight_sizes(domain, points, g, starts, start_sizes)


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


def line_sizes(sizes, interval, x, g):
    """Return min over s in an interval of ``sizes(s) + g |x - s|``, float64[n], by fine samples."""
    s = np.linspace(*interval, 200_001)
    values, rise = sizes(s), g * s
    from_left = np.minimum.accumulate(values - rise) + rise
    from_right = np.minimum.accumulate((values + rise)[::-1])[::-1] - rise
    return np.interp(x, s, np.minimum(from_left, from_right))


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


def polygon(rings):
    """Return the domain as an object of shapely."""
    return shapely.Polygon(rings[0], rings[1:])


def contains(rings, points):
    """Return which points lie in the domain or on its boundary, bool[n]."""
    return shapely.intersects_xy(_widened(rings), *np.transpose(points))


def sees(rings, a, b):
    """Return for which i the segment from a[i] to b[i] stays in the domain, bool[n].

    Running along the boundary and touching corners is allowed.  a, b: float64[n, 2], in the domain.
    """
    return _is_visible(_widened(rings), a, b)


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


def _widened(rings):
    depth = _RELATIVE_DEPTH * float(np.ptp(rings[0], axis=0).max())
    domain = polygon(rings).buffer(depth, join_style="mitre")
    shapely.prepare(domain)
    return domain


def _is_visible(domain, a, b):
    lines = shapely.linestrings(np.stack([a, b], axis=1))
    return shapely.covers(domain, lines) | (a == b).all(axis=1)


def _visible_lengths(domain, corners):
    """Return the distances between corners that see each other, else inf, float64[k, k]."""
    i, j = np.triu_indices(len(corners), 1)
    lengths = np.full((len(corners), len(corners)), np.inf)
    straight = np.linalg.norm(corners[i] - corners[j], axis=1)
    visible = _is_visible(domain, corners[i], corners[j])
    lengths[i, j] = lengths[j, i] = np.where(visible, straight, np.inf)
    return lengths


def candidates(points, starts, start_sizes, g):
    """Return the sizes that segments with linear data give straight to points, and their feet.

    The foot on a segment e = b - a is where ``rise * share + g |w - share e|`` is least: along
    the segment the slope of the distance is (s - t)/sqrt((s - t)^2 + D^2), with t the foot of the
    perpendicular and D its length; it is to balance the slope of the data.
    """
    a, e = starts[:, 0], starts[:, 1] - starts[:, 0]
    length, rise = np.linalg.norm(e, axis=1), np.diff(start_sizes, axis=1)[:, 0]
    w = points[:, None] - a
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = rise / (g * length)
        along = (w * e).sum(axis=2) / length
        height = np.linalg.norm(w - (along / length)[..., None] * e, axis=2)
        shift = height * slope / np.sqrt((1.0 - slope) * (1.0 + slope))
        share = np.clip((along - shift) / length, 0.0, 1.0)
    share = np.where(slope >= 1.0, 0.0, np.where(slope <= -1.0, 1.0, share))
    share[:, length == 0.0] = 0.0
    feet = a + share[..., None] * e
    values = start_sizes[:, 0] + np.where(share > 0.0, share * rise, 0.0)
    return values + g * np.linalg.norm(points[:, None] - feet, axis=2), feet


def _straight_sizes(domain, points, g, starts, start_sizes):
    """Return the least of the candidates straight from the starts whose feet a point sees."""
    values, feet = candidates(points, starts, start_sizes, g)
    least, left = np.full(len(points), np.inf), np.arange(len(points))
    for best in np.argsort(values, axis=1).T:
        value = values[left, best[left]]
        left, value = left[value < np.inf], value[value < np.inf]
        seen = _is_visible(domain, points[left], feet[left, best[left]])
        least[left[seen]] = value[seen]
        left = left[~seen]
    return least


def relaxed(values, weights):
    """Return the smallest sums of a value and the weights of a path (Bellman and Ford)."""
    while True:
        lower = np.minimum(values, (values[:, None] + weights).min(axis=0))
        if (lower == values).all():
            return values
        values = lower
