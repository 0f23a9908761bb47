"""The shape of a flat domain, as far as straight lines are concerned: is it convex, where not."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from adaptsize._kernels import boundary as kernels
from adaptsize.background.topology import unique_rows
from adaptsize.typing import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh

# The boundary may turn inwards by so much (radians) in a domain that counts as convex.
_FLAT = 1e-9

# Where it turns inwards by more than this, it is cut into pieces.
_CUT = np.radians(30.0)


class FlatBoundary(NamedTuple):
    """Boundary facets of triangles in the plane or of tetrahedra."""

    facets: IntArray
    """int32[f, dim], the domain to the left (2-D), normals outward (3-D)."""
    is_simple: bool
    """Whether no facet is shared by more than two cells or folded."""


class Turns(NamedTuple):
    """How the boundary turns at its nodes (2-D) or edges (3-D)."""

    ridges: IntArray
    """int32[r, dim - 1]: nodes or edges."""
    angles: FloatArray
    """float64[r]: positive where the domain is convex, nan where not two facets meet."""


def flat_boundary(mesh: SimplexMesh) -> FlatBoundary:
    """Return the boundary of a mesh of triangles in the plane or of tetrahedra.

    O(n_cells), and far quicker than listing all facets.
    """
    axes = (0,) * mesh.dim
    sums = np.zeros(mesh.n_points, np.uint64)
    kernels.sum_facets(mesh.points, axes, mesh.cells, sums)
    room = 64 + 8 * int(np.count_nonzero(sums))  # more is needed only where facets pile up
    while True:
        rows = np.empty((room, mesh.dim), np.int32)
        odd = np.empty(room, np.bool_)
        count = kernels.list_facets(mesh.points, axes, mesh.cells, sums, rows, odd)
        if count <= room:
            break
        room = count
    rows, odd = rows[:count], odd[:count]
    if count == 0:  # nothing but folds upon folds
        return FlatBoundary(rows, False)
    unique, number = unique_rows(rows, mesh.n_points)
    times = np.bincount(number)
    net = np.bincount(number, weights=np.where(odd, -1.0, 1.0))
    on_boundary = (net != 0.0) | (times != 2)
    facets = unique[on_boundary]
    flip = net[on_boundary] < 0.0
    facets[flip, :2] = facets[flip, 1::-1]
    return FlatBoundary(facets, bool((times[on_boundary] == 1).all()))


def turns_of(points: FloatArray, boundary: FlatBoundary) -> Turns:
    """Return the angles by which the boundary turns."""
    if points.shape[1] == 2:
        return _turns_in_plane(points, boundary.facets)
    return _turns_in_space(points, boundary.facets)


def is_convex(points: FloatArray, boundary: FlatBoundary, turns: Turns) -> bool:
    """Tell whether the domain within a boundary is convex, to 1e-9 radians.

    Rigorous: cells that overlap, folds, cracks, holes and several components are all
    found.  The number of cells over a point can only change across the boundary; and a closed
    boundary that nowhere turns inwards and winds around once is that of a convex domain.
    """
    if not boundary.is_simple or not bool((turns.angles >= -_FLAT).all()):
        return False
    if points.shape[1] == 2:
        return abs(float(turns.angles.sum()) - 2.0 * np.pi) < 1e-3
    corners = points[boundary.facets]
    a, b, c = np.moveaxis(corners - corners.mean(axis=(0, 1)), 1, 0)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    mixed = (
        la * lb * lc
        + np.einsum("ij,ij->i", a, b) * lc
        + np.einsum("ij,ij->i", b, c) * la
        + np.einsum("ij,ij->i", c, a) * lb
    )
    # Solid angles of the facets, seen from the middle (van Oosterom and Strackee).
    around = 2.0 * np.arctan2(volume, mixed)
    return bool((volume > 0.0).all()) and abs(float(around.sum()) - 4.0 * np.pi) < 1e-3


def pieces_of(n_points: int, boundary: FlatBoundary, turns: Turns) -> IntArray:
    """Return for each node the number of its piece of boundary; -1 inside and where it is cut.

    Pieces are cut where the boundary turns inwards by more than 30 degrees or not two
    facets meet.
    """
    piece = np.full(n_points, -1, np.int32)
    cut = np.zeros(n_points, bool)
    cut[turns.ridges[~(turns.angles >= -_CUT)].ravel()] = True
    nodes = np.unique(boundary.facets)
    place = np.full(n_points, -1, np.int64)
    place[nodes] = np.arange(len(nodes))
    joins = np.concatenate(
        [boundary.facets[:, [v - 1, v]] for v in range(boundary.facets.shape[1])]
    )
    joins = place[joins[~cut[joins].any(axis=1)]]
    graph = coo_matrix((np.ones(len(joins)), joins.T), shape=(len(nodes), len(nodes)))
    piece[nodes] = connected_components(graph, directed=False)[1]
    piece[cut] = -1
    return piece


def creases_of(n_points: int, turns: Turns) -> tuple[IntArray, IntArray]:
    """Return the edges along which the boundary turns inwards, as compressed rows per node."""
    edges = turns.ridges[~(turns.angles >= -_FLAT)]
    return _rows_of_edges(n_points, edges)


def _rows_of_edges(n_points: int, edges: IntArray) -> tuple[IntArray, IntArray]:
    """Return the other ends of the edges at each node, as compressed rows."""
    ends = np.concatenate([edges, edges[:, ::-1]])
    ends = ends[np.argsort(ends[:, 0], kind="stable")]
    first = np.zeros(n_points + 1, np.int32)
    first[1:] = np.cumsum(np.bincount(ends[:, 0], minlength=n_points))
    return first, np.ascontiguousarray(ends[:, 1])


def outward_in_plane(n_points: int, points: FloatArray, boundary: FlatBoundary) -> FloatArray:
    """Return for nodes of the boundary what is outside; float64[n, 3].

    The unit vector that halves the outer angle, and the cosine of half that angle.  0, 0, 0
    inside, and where not one edge of the boundary enters and one leaves.
    """
    outward = np.zeros((n_points, 3))
    start, end = boundary.facets.T
    times = np.bincount(start, minlength=n_points) + 4 * np.bincount(end, minlength=n_points)
    nodes = np.flatnonzero(times == 5)  # once a start, once an end
    number = np.full(n_points, -1)
    number[nodes] = np.arange(len(nodes))
    along = points[end] - points[start]
    with np.errstate(invalid="ignore"):  # edges of no length, at no corner
        along /= np.hypot(*along.T)[:, None]
    into, out = np.zeros((2, len(nodes) + 1, 2))
    into[number[end]], out[number[start]] = along, along
    into, out = into[:-1], out[:-1]
    # The sum of the two normals fails at the tip of a crack, the difference of the two
    # tangents on a straight line.
    reflex = into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0] <= 0.0
    normal = (into + out)[:, ::-1] * [1.0, -1.0]
    inwards = np.where(reflex[:, None], out - into, into - out)
    straight = np.einsum("ij,ij->i", into, out) > 0.0
    halving = np.where(straight[:, None], normal, inwards)
    halving /= np.hypot(*halving.T)[:, None]
    outward[nodes, :2] = halving
    outward[nodes, 2] = np.einsum("ij,ij->i", halving, out)
    outward[~np.isfinite(outward).all(axis=1)] = 0.0
    return outward


def sides_of(n_points: int, boundary: FlatBoundary) -> tuple[IntArray, IntArray]:
    """Return the neighbours of nodes along the boundary in the plane, as compressed rows."""
    return _rows_of_edges(n_points, boundary.facets)


def _turns_in_plane(points: FloatArray, facets: IntArray) -> Turns:
    """Return the angle at each node of the boundary; nan unless one edge enters and one leaves."""
    n = len(points)
    nodes = np.unique(facets)
    once = (np.bincount(facets[:, 0], minlength=n) == 1) & (
        np.bincount(facets[:, 1], minlength=n) == 1
    )
    before = np.zeros(n, np.int64)
    after = np.zeros(n, np.int64)
    after[facets[:, 0]] = facets[:, 1]
    before[facets[:, 1]] = facets[:, 0]
    into = points[nodes] - points[before[nodes]]
    out = points[after[nodes]] - points[nodes]
    cross = into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0]
    dot = np.einsum("ij,ij->i", into, out)
    angles = np.arctan2(cross, dot)
    degenerate = ~once[nodes] | ((cross == 0.0) & (dot <= 0.0))
    return Turns(nodes[:, None].astype(np.int32), np.where(degenerate, np.nan, angles))


def _turns_in_space(points: FloatArray, facets: IntArray) -> Turns:
    """Return the angle between the two facets at each edge of the boundary."""
    corners = points[facets]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    n_facets = len(facets)
    ends = np.concatenate([facets[:, [v, (v + 1) % 3]] for v in range(3)])
    apex = np.concatenate([facets[:, (v + 2) % 3] for v in range(3)])
    owner = np.tile(np.arange(n_facets), 3)
    forward = ends[:, 0] < ends[:, 1]
    edges, number = unique_rows(ends, len(points))
    regular = (np.bincount(number) == 2) & (np.bincount(number, weights=forward) == 1.0)
    first = np.zeros(len(edges), np.int64)
    second = np.zeros(len(edges), np.int64)
    first[number[forward]] = np.flatnonzero(forward)
    second[number[~forward]] = np.flatnonzero(~forward)
    has_area = (areas > 0.0)[:, None]
    units = np.divide(normals, areas[:, None], out=np.zeros_like(normals), where=has_area)
    normal, other = units[owner[first]], units[owner[second]]
    rise = np.einsum("ij,ij->i", normal, points[apex[second]] - points[edges[:, 0]])
    sine: npt.NDArray[np.float64] = np.linalg.norm(np.cross(normal, other), axis=1)
    angles = np.arctan2(sine, np.einsum("ij,ij->i", normal, other))
    angles = np.where(rise > 0.0, -angles, angles)
    bad: BoolArray = ~regular | (areas[owner[first]] == 0.0) | (areas[owner[second]] == 0.0)
    return Turns(edges, np.where(bad, np.nan, angles))


def clearance_of(points: FloatArray, facets: IntArray) -> FloatArray:
    r"""Return lower bounds of the distances of the nodes from the boundary, float64[n].

    The facets are sampled, the cells of side s of a grid that hold a sample are marked, and the
    distances between the middles of cells to the next marked one are found.  A node and the
    middle of its cell, and a sample and that of its cell, are at most
    :math:`s \sqrt{d} / 2` apart.  A point :math:`\sum \lambda_i v_i` of a simplex of
    m + 1 vertices and longest edge l is not farther from the nearest of them than

    .. math:: \Big(\sum_i \lambda_i |y - v_i|^2\Big)^{1/2} =
              \Big(\sum_{i < j} \lambda_i \lambda_j |v_i - v_j|^2\Big)^{1/2}
              \le l \sqrt{\frac{m}{2 (m + 1)}} =: \rho .

    So the distance of the middles less :math:`s \sqrt{d} + \rho` is a lower bound.
    The grid has about a quarter of n cells; O(n), and 0 everywhere if facets are so long and
    many that sampling them would take more.
    """
    n, dim = points.shape
    lower = points.min(axis=0)
    extents = np.sort(np.ptp(points, axis=0))[::-1]
    # As if flat in 0, 1, .. directions: so the cells are few even where an extent vanishes.
    side = float(((np.cumprod(extents) * 4.0 / n) ** (1.0 / np.arange(1.0, dim + 1.0))).max())
    corners = points[facets]
    edges = corners - np.roll(corners, 1, axis=1)
    longest = np.sqrt(np.einsum("fva,fva->fv", edges, edges).max(axis=1, initial=0.0))
    if side == 0.0:
        return np.zeros(n)
    parts = 2.0 ** np.ceil(np.log2(np.maximum(longest / side, 1.0)))
    if not np.sum((parts + 1.0) ** (dim - 1)) < 8.0 * n:
        return np.zeros(n)
    marked = np.zeros(tuple((np.ptp(points, axis=0) // side).astype(int) + 2), bool)
    for count in np.unique(parts):
        weights = _lattice_weights(int(count), dim)
        samples = np.einsum("sv,fva->fsa", weights, corners[parts == count]).reshape(-1, dim)
        marked[tuple(((samples - lower) / side).astype(int).T)] = True
    away = distance_transform_edt(~marked, sampling=side)
    rho = float((longest / parts).max(initial=0.0)) * np.sqrt((dim - 1) / (2.0 * dim))
    slack = side * np.sqrt(dim) + rho + 1e-12 * float(np.abs(points).max())
    bound = away[tuple(((points - lower) / side).astype(int).T)] - slack
    return np.asarray(np.maximum(bound, 0.0))


def _lattice_weights(parts: int, n_vertices: int) -> FloatArray:
    """Return the barycentric coordinates of the corners of a simplex cut in equal parts."""
    steps = np.stack(np.meshgrid(*[np.arange(parts + 1.0)] * (n_vertices - 1)), axis=-1)
    steps = steps.reshape(-1, n_vertices - 1)
    steps = steps[steps.sum(axis=1) <= parts]
    return np.column_stack([parts - steps.sum(axis=1), steps]) / parts
