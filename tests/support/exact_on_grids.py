"""Exact limited sizes on small Cartesian grids by brute force, straight from the definition.

The domain is the cubical complex of the active nodes.  A line stays inside if every
cell is active of which it meets the inside; this is decided by the overlap of
intervals along the line, for all cells around it.
"""

import itertools

import numpy as np
from geodesics import candidates, relaxed
from numba import njit
from scipy.spatial.distance import cdist

#: Share of a line that may lie in a cell without meeting its inside: rounding.
_TOUCH = 1e-9


def exact_sizes(shape, spacing, active, h0, g, *, segments):
    """Return the limited sizes of the definition; paths in space bend at nodes.

    Cost O(n^2) lines; n segments more of them each.
    """
    value = _from_segments(spacing, active, h0, g) if segments else np.full(shape, np.inf)
    h = np.full(shape, np.inf)
    h[active] = along_lines(np.minimum(h0, value), active, spacing, g)
    return h


def along_lines(h0, active, spacing, g):
    """Return the sizes at the active nodes by straight lines from node to node, float64[n]."""
    nodes = np.argwhere(active).astype(float, order="C")
    seen = np.empty((len(nodes), len(nodes)), bool)
    fill_seen(active.flatten(), np.array(active.shape), nodes, seen)
    steps = np.where(seen, cdist(nodes * spacing, nodes * spacing), np.inf)
    return relaxed(h0[active], g * steps)


def segments_with_data(active, h0):
    """Yield the node and the direction of each segment that carries linear data.

    Its ends are in one box and see each other, and of the nodes of the face or box of which they
    are opposite corners none or all others are bounded.
    """
    shape = np.array(active.shape)
    finite = [tuple(x) for x in np.argwhere(active & np.isfinite(h0))]
    for p, q in itertools.combinations(finite, 2):
        along = np.subtract(q, p)
        if np.abs(along).max() > 1 or not sees(active.flatten(), shape, p, q):
            continue
        corners = itertools.product(*({x, y} for x, y in zip(p, q, strict=True)))
        n_finite = sum(np.isfinite(h0[x]) for x in corners)
        if n_finite == 2 or n_finite == 2 ** np.count_nonzero(along):
            yield p, along


def refined_active(active, parts):
    """Return which nodes of the grid cut in parts are in the domain, parts >= 2."""
    index = np.indices([(n - 1) * parts + 1 for n in active.shape])
    corners = itertools.product(*((i // parts, -(-i // parts)) for i in index))
    return np.logical_and.reduce([active[corner] for corner in corners])


def fine_grid_sizes(grid, h0, g, parts, *, segments=False):
    """Return the sizes at the nodes by paths over those of the grid cut in parts.

    Paths may then bend within edges, as the shortest ones do in space.  Never below the exact
    sizes, and with ``segments`` of samples of linear data.
    """
    active = np.ones(grid.shape, bool) if grid.active is None else grid.active
    h0 = np.where(active, h0, np.inf)
    fine_active = refined_active(active, parts)
    fine = np.full(fine_active.shape, np.inf)
    at_nodes = (slice(None, None, parts),) * grid.dim
    fine[at_nodes] = h0
    for p, along in segments_with_data(active, h0) if segments else ():
        q = tuple(p + along)
        for k in range(1, parts):
            place = tuple(parts * np.array(p) + k * along)
            fine[place] = min(fine[place], h0[p] + k / parts * (h0[q] - h0[p]))
    fine[fine_active] = along_lines(fine, fine_active, np.asarray(grid.spacing) / parts, g)
    fine[~fine_active] = np.inf
    return fine[at_nodes]


def _from_segments(spacing, active, h0, g):
    """Return for each node the least value of a foot on a segment that it sees."""
    value = np.full(active.shape, np.inf)
    ends = np.array([(p, p + along) for p, along in segments_with_data(active, h0)])
    if len(ends) == 0:
        return value
    nodes = np.argwhere(active).astype(float, order="C")
    sizes, feet = candidates(nodes * spacing, ends * spacing, h0[tuple(ends.T)].T, g)
    shape = np.array(active.shape)
    for node, of_segments, places in zip(nodes, sizes, feet / spacing, strict=True):
        for k in np.argsort(of_segments):
            if sees(active.flatten(), shape, node, places[k]):
                value[tuple(node.astype(int))] = of_segments[k]
                break
    return value


@njit(cache=True)
def fill_seen(active, shape, nodes, seen):
    """Fill which nodes, float64[n, dim], see each other."""
    for i in range(len(nodes)):
        for j in range(i + 1):
            seen[i, j] = seen[j, i] = _sees(active, shape, nodes[i], nodes[j])


def sees(active, shape, p, q):
    """Return whether the line between two points stays inside.

    They are in multiples of the spacings; axes along which they are the same lie at nodes.
    """
    return _sees(active, shape, *np.array([p, q], float))  # rows of one type: compiled once


@njit(cache=True)
def _sees(active, shape, p, q):
    dim = len(shape)
    low, high = np.empty(dim, np.int64), np.empty(dim, np.int64)
    for d in range(dim):
        low[d] = high[d] = np.int64(np.rint(p[d]))
        if p[d] != q[d]:
            low[d] = np.int64(np.floor(min(p[d], q[d]) + 1e-12))
            high[d] = np.int64(np.ceil(max(p[d], q[d]) - 1e-12))
    cell = low.copy()
    while True:
        enter, leave = 0.0, 1.0
        for d in range(dim):
            if low[d] < high[d]:
                a, b = (cell[d] - p[d]) / (q[d] - p[d]), (cell[d] + 1 - p[d]) / (q[d] - p[d])
                enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
        if leave - enter > _TOUCH:
            for corner in range(2**dim):
                place = 0
                for d in range(dim):
                    up = (corner >> d) & 1 if low[d] < high[d] else 0
                    place = place * shape[d] + cell[d] + up
                if not active[place]:
                    return False
        d = 0
        while d < dim:
            cell[d] += 1
            if cell[d] < high[d]:
                break
            cell[d] = low[d]
            d += 1
        if d == dim:
            return True
