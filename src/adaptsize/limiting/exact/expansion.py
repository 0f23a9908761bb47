"""The exact method in plane domains with very many corners: triangular expansion."""

import numpy as np

from adaptsize._kernels import expansion as kernels
from adaptsize._kernels.exact_plane import COLUMNS, KIND
from adaptsize._kernels.heap import new_heap, push_all
from adaptsize._kernels.sight import ANY, NARROW
from adaptsize.background.topology import places_among
from adaptsize.geometry.boundary import FlatBoundary, turns_in_plane
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
    n, m = mesh.n_points, mesh.n_cells
    scratch = np.empty(n, np.int32), np.empty(3 * m, np.int32)
    triangles = kernels.Triangles(mesh.points, cells, np.empty(3 * m, np.int32), *mesh.rings)
    if not kernels.connect(triangles, *scratch):
        return None
    n_windows = n + m // 2 + int(np.diff(triangles.ring_ptr).max())
    nodes, table, walls = _corners(mesh.points, boundary.facets)
    corner = places_among(nodes, n)
    front = kernels.Front(
        h0.copy(),
        np.full(n, -1, np.int32),
        corner,
        table,
        walls,
        np.zeros((len(nodes), 2)),
        new_heap(n),
        np.empty(n_windows, np.int32),
        np.empty((n_windows, 4)),
        np.full(m, -1, np.int32),
        np.empty((m, 4)),
        np.empty(m + 1, np.int32),
    )
    push_all(front.heap, sources, front.h)
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
    turns = turns_in_plane(points, facets)
    # A narrower sector (radians) surrounds the tip of a slit, whose faces may not coincide.
    bends = ~((turns.angles >= 0.0) & (turns.angles < np.pi - 1e-9))
    into, out = turns.into[bends], turns.out[bends]
    lengths = np.hypot(*into.T)[:, None], np.hypot(*out.T)[:, None]
    table = np.zeros((len(into), COLUMNS))
    table[:, KIND] = np.where(turns.once[bends], NARROW, ANY)
    walls = np.hstack([out / lengths[1], -into / lengths[0], np.minimum(*lengths)])
    return turns.nodes[bends], table, walls
