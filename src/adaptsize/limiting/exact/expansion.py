"""The exact method in plane domains with very many corners: triangular expansion."""

from __future__ import annotations

import numpy as np

from adaptsize._kernels import expansion as kernels
from adaptsize._kernels.exact_plane import COLUMNS, KIND
from adaptsize._kernels.heap import new_heap
from adaptsize._kernels.sight import ANY, NARROW
from adaptsize.geometry.boundary import FlatBoundary
from adaptsize.limiting.exact.candidates import Component
from adaptsize.typing import FloatArray, IntArray

# Windows that are followed between two calls of Python, some tenths of a second.
_AT_ONCE = 5_000_000

# Distance below which a point is on a line, in units of the rounding of the coordinates, as for
# lines of sight (see `plane_boundary`).
_SLACK = 16.0


def expand_from_nodes(
    component: Component, boundary: FlatBoundary, sources: IntArray
) -> tuple[FloatArray, IntArray, FloatArray] | None:
    """Return the sizes that bounds at nodes allow in the plane, and where their paths come from.

    The numbers of the nodes and the order of sources do not matter, but for rounding.

    Returns
    -------
    float64[n]
        Sizes.
    int32[n]
        The node from which the path to each node is straight, its own source or corner.
    float64[n, 2]
        The place of this node if it is a corner at which the path bends, else nan.
    None
        Instead of all, if cells overlap along an edge or have no measure.
    """
    mesh, h0 = component.mesh, component.h0
    if boundary.has_flat or not boundary.is_simple:
        return None
    cells = mesh.cells.copy()
    triangles = kernels.Triangles(mesh.points, cells, np.empty_like(cells), *mesh.rings)
    if not kernels.connect(triangles):
        return None
    n, m = mesh.n_points, mesh.n_cells
    nodes, table, walls = _corners(mesh.points, boundary.facets)
    corner = np.full(n, -1, np.int32)
    corner[nodes] = np.arange(len(nodes))
    front = kernels.Front(
        h0.copy(),
        np.full(n, -1, np.int32),
        corner,
        table,
        walls,
        np.zeros((len(nodes), 2)),
        new_heap(n),
        np.empty((2 * m + 16, 3), np.int32),
        np.empty((2 * m + 16, 4)),
    )
    kernels.push_all(front.heap, sources, front.h)
    slack = _SLACK * float(np.finfo(float).eps * np.abs(mesh.points).max())
    given = (component.g, slack, component.margin)
    while kernels.expand(triangles, front, *given, _AT_ONCE):
        component.workers.report("limiting the gradient", None)
    own = front.root < 0
    root = np.where(own, np.arange(n), front.root).astype(np.int32)
    bends = ~own & (front.root[root] >= 0)
    return front.h, root, np.where(bends[:, None], mesh.points[root], np.nan)


def _corners(points: FloatArray, facets: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the nodes at which paths may bend, and the columns of entries and walls for these.

    These are the nodes at which the mesh has an angle of more than 180 degrees, or several walls.
    """
    n, (start, end) = len(points), facets.T
    before, after = np.zeros(n, np.int32), np.zeros(n, np.int32)
    after[start], before[end] = end, start
    n_walls = np.bincount(start, minlength=n)
    nodes = np.flatnonzero(n_walls).astype(np.int32)
    ahead, back = points[after[nodes]] - points[nodes], points[before[nodes]] - points[nodes]
    lengths = [np.hypot(*ahead.T), np.hypot(*back.T)]
    ahead, back = ahead / lengths[0][:, None], back / lengths[1][:, None]
    turn = ahead[:, 0] * back[:, 1] - ahead[:, 1] * back[:, 0]
    # A narrower sector (radians) surrounds the tip of a slit, whose faces may not coincide.
    is_tip = (np.einsum("ij,ij->i", ahead, back) > 0.0) & (turn < 1e-9)
    several = n_walls[nodes] > 1
    bends = several | is_tip | (turn < 0.0)
    table = np.zeros((np.count_nonzero(bends), COLUMNS))
    table[:, KIND] = np.where(several[bends], ANY, NARROW)
    walls = np.column_stack([ahead, back, np.minimum(*lengths)])
    return nodes[bends], table, walls[bends]
