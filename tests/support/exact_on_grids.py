"""Exact limited sizes on small Cartesian grids by brute force, straight from the definition.

The domain is the cubical complex of the active nodes.  A line stays inside if every
cell is active of which it meets the inside; this is decided by the overlap of
intervals along the line, for all cells around it.
"""

import itertools

import numpy as np

#: Share of a line that may lie in a cell without meeting its inside: rounding.
_TOUCH = 1e-9


def sees(active, start, stop):
    """Return whether the line between two points, in multiples of the spacings, stays inside."""
    start, stop = np.asarray(start, float), np.asarray(stop, float)
    move = stop - start
    extended = np.flatnonzero(move)
    if len(extended) == 0:
        return True
    lower = np.floor(np.minimum(start, stop) + 1e-12).astype(int)
    upper = np.ceil(np.maximum(start, stop) - 1e-12).astype(int)
    for cell in itertools.product(*(range(lower[a], upper[a]) for a in extended)):
        enter, leave = 0.0, 1.0
        for a, i in zip(extended, cell, strict=True):
            shares = sorted(((i - start[a]) / move[a], (i + 1 - start[a]) / move[a]))
            enter, leave = max(enter, shares[0]), min(leave, shares[1])
        if leave - enter <= _TOUCH:
            continue
        corner = np.rint(start).astype(int)  # flat axes lie at nodes
        for more in itertools.product((0, 1), repeat=len(extended)):
            corner[extended] = np.add(cell, more)
            if not active[tuple(corner)]:
                return False
    return True


def exact_sizes(shape, spacing, active, h0, g, *, segments):
    """Return the limited sizes of the definition; paths in space bend at nodes.

    Cost O(n^2) lines; n segments more of them each.
    """
    spacing = np.asarray(spacing, float)
    nodes = [x for x in itertools.product(*map(range, shape)) if active[x]]
    value = np.array([h0[x] for x in nodes])
    if segments:
        value = np.minimum(value, _from_segments(nodes, spacing, active, h0, g))
    places = np.array(nodes)
    length = np.linalg.norm((places[:, None] - places) * spacing, axis=2)
    for i, j in itertools.combinations(range(len(nodes)), 2):
        if not sees(active, nodes[i], nodes[j]):
            length[i, j] = length[j, i] = np.inf
    while True:
        with np.errstate(invalid="ignore"):
            way = np.where(np.isinf(length), np.inf, value[:, None] + g * length).min(axis=0)
        if (way >= value).all():
            break
        value = np.minimum(value, way)
    h = np.full(shape, np.inf)
    for x, v in zip(nodes, value, strict=True):
        h[x] = v
    return h


def _from_segments(nodes, spacing, active, h0, g):
    """Return for each node the least value of a foot on a segment that it sees."""
    places = np.array(nodes)
    value = np.full(len(nodes), np.inf)
    finite = [x for x in nodes if np.isfinite(h0[x])]
    for p, q in itertools.combinations(finite, 2):
        if max(abs(np.subtract(p, q))) > 1 or not sees(active, p, q):
            continue
        along = np.subtract(q, p)
        corners = itertools.product(*({x, y} for x, y in zip(p, q, strict=True)))
        n_finite = sum(np.isfinite(h0[x]) for x in corners)
        if 2 < n_finite < 2 ** np.count_nonzero(along):
            continue
        # Golden sections: the function of the weight is convex.
        t = _golden(
            lambda t, p=p, along=along: _on_segment(t, places, p, along, spacing, h0, g), len(nodes)
        )
        candidate = _on_segment(t, places, p, along, spacing, h0, g)
        for i in np.flatnonzero(candidate < value):
            if sees(active, nodes[i], p + t[i] * along):
                value[i] = candidate[i]
    return value


def _on_segment(t, places, p, along, spacing, h0, g):
    q = tuple(np.add(p, along))
    foot = p + t[:, None] * along
    start = h0[p] + t * (h0[q] - h0[p])
    return start + g * np.linalg.norm((places - foot) * spacing, axis=1)


def _golden(f, n):
    ratio = (np.sqrt(5.0) - 1.0) / 2.0
    left, right = np.zeros(n), np.ones(n)
    for _ in range(70):
        a, b = right - ratio * (right - left), left + ratio * (right - left)
        lower = f(a) < f(b)
        left, right = np.where(lower, left, a), np.where(lower, b, right)
    t = 0.5 * (left + right)
    for end in (0.0, 1.0):
        better = f(np.full(n, end)) <= f(t)
        t = np.where(better, end, t)
    return t
