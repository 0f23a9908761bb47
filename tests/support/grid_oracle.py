"""Limited sizes on small grids with inactive nodes: paths over the nodes of a finer grid.

The domain is that of `exact_on_grids`, the cubical complex of the active nodes.  Cut in parts
it stays the same; paths may then bend within its edges, as the shortest ones do in space.
"""

import itertools

import numpy as np
from exact_on_grids import along_lines, segments_with_data


def refined_active(active, parts):
    """Return which nodes of the grid cut in parts are in the domain, parts >= 2."""
    index = np.indices([(n - 1) * parts + 1 for n in active.shape])
    corners = itertools.product(*((i // parts, -(-i // parts)) for i in index))
    return np.logical_and.reduce([active[corner] for corner in corners])


def fine_grid_sizes(grid, h0, g, parts, *, segments=False):
    """Return the sizes at the nodes by paths over those of the grid cut in parts.

    Never below the exact sizes, and with ``segments`` of samples of linear data.
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
