"""Limited sizes on small grids with inactive nodes: paths over the nodes of a finer grid.

The domain is that of `exact_on_grids`, the cubical complex of the active nodes.  Cut in parts
it stays the same; paths may then bend within its edges, as the shortest ones do in space.
"""

import itertools

import numpy as np
from numba import njit


def refined_active(active, parts):
    """Return which nodes of the grid cut in parts are in the domain, parts >= 2."""
    index = np.indices([(n - 1) * parts + 1 for n in active.shape])
    corners = itertools.product(*((i // parts, -(-i // parts)) for i in index))
    return np.logical_and.reduce([active[corner] for corner in corners])


def segment_samples(active, h0, parts, is_visible):
    """Return h0 on the fine nodes of all segments that carry linear data, else inf.

    Which do is what `exact_on_grids` says: the two ends in one box, and of the nodes of the
    face or box of which they are opposite corners none or all others bounded.
    """
    fine = np.full([(n - 1) * parts + 1 for n in active.shape], np.inf)
    finite = [tuple(x) for x in np.argwhere(active & np.isfinite(h0))]
    for x in finite:
        fine[tuple(parts * np.array(x))] = h0[x]
    for p, q in itertools.combinations(finite, 2):
        along = np.subtract(q, p)
        if np.abs(along).max() > 1 or not is_visible(p, q):
            continue
        corners = itertools.product(*({x, y} for x, y in zip(p, q, strict=True)))
        n_finite = sum(np.isfinite(h0[x]) for x in corners)
        if 2 < n_finite < 2 ** np.count_nonzero(along):
            continue
        for k in range(1, parts):
            place = tuple(parts * np.array(p) + k * along)
            fine[place] = min(fine[place], h0[p] + k / parts * (h0[q] - h0[p]))
    return fine


def fine_grid_sizes(grid, h0, g, parts, *, segments=False):
    """Return the sizes at the nodes by paths over those of the grid cut in parts.

    Never below the exact sizes, and with ``segments`` of samples of linear data.
    """
    active = np.ones(grid.shape, bool) if grid.active is None else grid.active
    h0 = np.where(active, h0, np.inf)
    fine_active = refined_active(active, parts)
    if segments:
        bound = segment_samples(
            active, h0, parts, lambda p, q: is_inside(active.ravel(), grid.shape, p, q)
        )
    else:
        bound = np.full(fine_active.shape, np.inf)
        bound[(slice(None, None, parts),) * grid.dim] = h0
    nodes = np.argwhere(fine_active)
    lengths = np.full((len(nodes), len(nodes)), np.inf)
    spacing = np.asarray(grid.spacing) / parts
    fill_lengths(fine_active.ravel(), fine_active.shape, nodes, spacing, lengths)
    value = bound[fine_active]
    while True:
        way = (value[:, None] + g * lengths).min(axis=0)
        if (way >= value).all():
            break
        value = np.minimum(value, way)
    fine = np.full(fine_active.shape, np.inf)
    fine[fine_active] = value
    return fine[(slice(None, None, parts),) * grid.dim]


@njit(cache=True)
def fill_lengths(active, shape, nodes, spacing, lengths):
    """Fill the lengths of the straight lines between nodes, int64[n, dim], that stay inside."""
    for i in range(len(nodes)):
        for j in range(i + 1):
            if is_inside(active, shape, nodes[i], nodes[j]):
                square = 0.0
                for d in range(len(spacing)):
                    square += ((nodes[i][d] - nodes[j][d]) * spacing[d]) ** 2
                lengths[i, j] = lengths[j, i] = np.sqrt(square)


@njit(cache=True)
def is_inside(active, shape, p, q):
    """Return whether every cell is active of which the line between two nodes meets the inside."""
    dim = len(shape)
    low, high = np.empty(dim, np.int64), np.empty(dim, np.int64)
    for d in range(dim):
        low[d], high[d] = min(p[d], q[d]), max(p[d], q[d])
    cell = low.copy()
    while True:
        enter, leave = 0.0, 1.0
        for d in range(dim):
            if low[d] < high[d]:
                a, b = (cell[d] - p[d]) / (q[d] - p[d]), (cell[d] + 1 - p[d]) / (q[d] - p[d])
                enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
        if leave - enter > 1e-9:
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
