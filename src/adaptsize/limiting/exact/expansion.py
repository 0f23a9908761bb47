"""The exact method in plane domains with very many corners: triangular expansion."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from adaptsize._kernels import expansion as kernels
from adaptsize._kernels.exact_plane import COLUMNS, KIND
from adaptsize._kernels.heap import new_heap, push_all
from adaptsize._kernels.sight import ANY, NARROW
from adaptsize.background import SimplexMesh
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.topology import places_among
from adaptsize.geometry.boundary import FlatBoundary, turns_in_plane
from adaptsize.limiting.exact.candidates import Component, Extra
from adaptsize.typing import FloatArray, IntArray

# Windows that are followed between two calls of Python, at most: some tenths of a second.
_AT_ONCE = 5_000_000

# Stands for sizes that are not known yet.
_VERY_LOW = -1e300

# Distance below which a point is on a line, in units of the rounding of the coordinates, as for
# lines of sight (see `plane_boundary`).
_SLACK = 16.0


class Ground(NamedTuple):
    """What triangular expansion needs to know of a mesh in the plane."""

    triangles: kernels.Triangles
    nodes: IntArray
    """int32[c]: those at which paths may bend."""
    table: FloatArray
    """float64[c, COLUMNS]: as entries; without sizes."""
    walls: FloatArray
    """float64[c, 5]: their walls, as in `exact_plane.solve_corners`."""
    slack: float
    """Distance from a line below which a point is on it."""


def ground_of(mesh: SimplexMesh, boundary: FlatBoundary) -> Ground | None:
    """Return what expansion needs, or None if cells overlap along an edge or have no measure."""
    if boundary.has_flat or not boundary.is_simple:
        return None
    n, m = mesh.n_points, mesh.n_cells
    scratch = np.empty(n, np.int32), np.empty(3 * m, np.int32)
    triangles = kernels.Triangles(
        mesh.points, mesh.cells.copy(), np.empty(3 * m, np.int32), *mesh.rings
    )
    if not kernels.connect(triangles, *scratch):
        return None
    slack = _SLACK * float(np.finfo(float).eps * np.abs(mesh.points).max())
    return Ground(triangles, *_corners(mesh.points, boundary.facets), slack)


class Expanded(NamedTuple):
    """Sizes in the plane, and where their paths come from.

    Roots are nodes, or sources between these, numbered after them.
    """

    h: FloatArray
    """float64[n]"""
    root: IntArray
    """int32[n]: from which the path to each node is straight, its own source or corner."""
    bend: FloatArray
    """float64[n, 2]: the place of the root if it is a corner at which the path bends, else nan."""


def expand_from_points(
    component: Component,
    ground: Ground,
    sources: IntArray,
    is_lost: Callable[[FloatArray], bool],
) -> Expanded | None:
    """Return the sizes that bounds at nodes and at points between them allow in the plane.

    The numbers of the nodes and the order of sources do not matter, but for rounding.

    Parameters
    ----------
    component : Component
    ground : Ground
    sources : int32[k]
        The nodes that may be sources.
    is_lost : callable
        Called with sizes of which those that may still fall are very low: whether all is in vain.

    Returns
    -------
    Expanded or None
        None if all was in vain.
    """
    mesh, h0, triangles, slack = component.mesh, component.h0, ground.triangles, ground.slack
    n, m = mesh.n_points, mesh.n_cells
    size = h0.copy()
    if component.extra is not None:
        triangles = _with_points(triangles, mesh, component.extra, slack)
        size = np.concatenate([h0, component.extra.sizes])
        between = np.arange(n, len(size), dtype=np.int32)
        sources = np.concatenate([sources, between])
    n_windows = n + m // 2 + 2 * int(np.diff(triangles.ring_ptr).max())
    front = kernels.Front(
        size,
        np.full(len(size), -1, np.int32),
        places_among(ground.nodes, len(size)),
        ground.table.copy(),
        ground.walls,
        np.zeros((len(ground.nodes), 2)),
        new_heap(len(size)),
        np.empty(n_windows, np.int32),
        np.empty((n_windows, 4)),
        np.full(m, -1, np.int32),
        np.empty((m, 4)),
        np.empty(m + 1, np.int32),
        n,
    )
    push_all(front.heap, sources, front.h)
    given, at_once = (component.g, slack, component.margin), n
    while kernels.expand(triangles, front, *given, min(at_once, _AT_ONCE)):
        component.workers.report("limiting the gradient", None)
        at_once *= 2
        if is_lost(np.where(front.h[:n] <= front.heap.key[0], front.h[:n], _VERY_LOW)):
            return None
    if is_lost(front.h[:n]):
        return None
    own = front.root[:n] < 0
    root = np.where(own, np.arange(n), front.root[:n]).astype(np.int32)
    bends = ~own & (front.root[root] >= 0)
    return Expanded(front.h[:n], root, np.where(bends[:, None], triangles.points[root], np.nan))


def _with_points(
    triangles: kernels.Triangles, mesh: SimplexMesh, extra: Extra, slack: float
) -> kernels.Triangles:
    """Return triangles with sources between the nodes, each in all triangles that hold it."""
    which, cells = mesh.locator.within(extra.points, 2.0 * slack)
    counts = np.bincount(which, minlength=len(extra.points))
    ends = triangles.ring_ptr[-1] + np.cumsum(counts)
    ends = ends.astype(triangles.ring_ptr.dtype)
    return triangles._replace(
        points=read_only(np.concatenate([triangles.points, extra.points])),
        ring_ptr=read_only(np.concatenate([triangles.ring_ptr, ends])),
        ring=read_only(np.concatenate([triangles.ring, cells])),
    )


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
