"""Distance to triangles in space or segments in the plane."""

import math

import numpy as np

from adaptsize._kernels.surface_distance import (
    Features,
    Nearest,
    Queue,
    propagate_features,
    scan_facets,
)
from adaptsize.background import AnyBackground, CartesianGrid, SimplexMesh, topology
from adaptsize.background.grid_location import frame_of
from adaptsize.background.interpolation import places_of
from adaptsize.background.location import in_space
from adaptsize.geometry.distance.orientation import same_places, winding_of
from adaptsize.typing import BoolArray, FloatArray, IntArray, LongArray, ProgressCallback

# Facets are split for the scan down to this length in spacings: boxes around long oblique facets
# would contain many nodes far from them.
_LONGEST = 6.0
# Facets, and nodes, between two progress reports: about 0.2 s.
_FACETS_AT_ONCE = 20_000
_POINTS_AT_ONCE = 20_000

# Nodes accepted between two progress reports: about 0.3 s.
_NODES_AT_ONCE = 200_000
_BUCKETS = 64


def surface_distance(
    background: AnyBackground, surface: SimplexMesh, band: float, report: ProgressCallback
) -> FloatArray:
    """Return the unsigned distance of each node to a surface, of ``nodal_shape``.

    On grids, distances up to ``band`` spacings are exact.  Nodes farther away get the distance to
    the nearest of the facets propagated by their neighbours, which is exact with rare exceptions.
    On other backgrounds all distances are exact.
    """
    if isinstance(background, CartesianGrid) and math.isfinite(band):
        return _on_grid(background, surface, band * float(background.spacing.max()), report)
    n, place = background.n_points, places_of(background)
    distance = np.empty(n)
    for first in range(0, n, _POINTS_AT_ONCE):
        nodes = np.arange(first, min(first + _POINTS_AT_ONCE, n))
        distance[nodes] = surface.locator.nearest(place(nodes))[2]
        report("distance", (nodes[-1] + 1) / n)
    return distance.reshape(background.nodal_shape)


def _on_grid(
    grid: CartesianGrid, surface: SimplexMesh, reach: float, report: ProgressCallback
) -> FloatArray:
    frame = frame_of(grid)
    points, facets = in_space(surface.points), np.array(surface.cells)
    reach *= 1.0 + 1e-9  # include nodes at exactly this distance
    distance = np.full(grid.n_points, reach)
    nearest = np.full(grid.n_points, -1, np.int32)
    known = Nearest(distance, nearest)
    corners, pieces, owner = _short_facets(points, facets, grid, reach)
    n = len(pieces)
    for first in range(0, n, _FACETS_AT_ONCE):
        part = (first, min(first + _FACETS_AT_ONCE, n))
        scan_facets((corners, pieces), part, frame, reach, known)
        report("distance in the band", part[1] / n)
    found = nearest >= 0
    nearest[found] = owner[nearest[found]]
    distance[~found] = np.inf
    if not found.all():
        _seed_hull(grid, surface, distance, nearest)
        nodes = same_places(points, facets)[facets]
        features = Features(points, facets, nodes, *topology.rings(nodes, len(points)))
        propagate(grid, features, known, report)
    return distance.reshape(grid.shape)


def _short_facets(
    points: FloatArray, facets: IntArray, grid: CartesianGrid, reach: float
) -> tuple[FloatArray, IntArray, IntArray]:
    """Bisect facets at their longest edge until they are short; omit distant ones.

    Returns
    -------
    float64[n, 3], int32[m, k]
        Points and parts of facets.
    int32[m]
        The facet of each part.
    """
    longest = _LONGEST * float(grid.spacing.max())
    lower, upper = in_space(grid.lower[None])[0] - reach, in_space(grid.upper[None])[0] + reach
    corners, owner = points[facets], np.arange(len(facets), dtype=np.int32)
    short, owners = [], []
    while len(corners):
        near = (corners.min(axis=1) <= upper) & (corners.max(axis=1) >= lower)
        corners, owner = corners[near.all(axis=1)], owner[near.all(axis=1)]
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        done = edges.max(axis=1, initial=0.0) <= longest
        short.append(corners[done])
        owners.append(owner[done])
        corners, owner, edges = corners[~done], owner[~done], edges[~done]
        which, a = np.arange(len(corners)), edges.argmax(axis=1)
        b = (a + 1) % facets.shape[1]
        middle = 0.5 * (corners[which, a] + corners[which, b])
        halves = np.repeat(corners[None], 2, axis=0)
        halves[0, which, a], halves[1, which, b] = middle, middle
        corners, owner = np.concatenate(halves), np.tile(owner, 2)
    found = np.concatenate(short)
    cells = np.arange(found.shape[0] * found.shape[1], dtype=np.int32).reshape(found.shape[:2])
    return found.reshape(-1, 3), cells, np.concatenate(owners)


def _seed_hull(
    grid: CartesianGrid, surface: SimplexMesh, distance: FloatArray, nearest: IntArray
) -> None:
    """Set the distances of nodes on the sides of the grid, if facets may lie outside.

    The segment from a node to its closest point leaves the grid near one of these nodes.
    """
    used = surface.points[np.unique(surface.cells)]
    if (used >= grid.lower).all() and (used <= grid.upper).all():
        return
    inner = np.zeros(grid.shape, np.bool_)
    inner[(slice(1, -1),) * grid.dim] = True
    hull = np.flatnonzero(~inner.ravel() & (nearest < 0))
    nearest[hull], _, distance[hull] = surface.locator.nearest(places_of(grid)(hull))


def inside_surface(
    background: AnyBackground, surface: SimplexMesh, distance: FloatArray, report: ProgressCallback
) -> BoolArray:
    """Return which nodes lie inside a surface, given their distances to it.

    If winding numbers are integers, they are evaluated once per group of nodes that no facet can
    separate.
    """
    winding, rule = winding_of(surface)
    if not rule.is_closed:
        return winding.contains(background.points, report, rule=rule).reshape(
            background.nodal_shape
        )
    label = _connected(background, distance).ravel()
    one_of = np.empty(int(label.max()) + 1, np.int64)
    one_of[label] = np.arange(label.size)
    inside = winding.contains(places_of(background)(one_of), report, rule=rule)
    return np.asarray(inside[label]).reshape(background.nodal_shape)


def _connected(background: AnyBackground, distance: FloatArray) -> LongArray:
    """Return for each node the number of its group, from 0.

    If the sum of the distances of two neighbours to the surface exceeds the distance between them,
    there is no facet between them.
    """
    from scipy import ndimage

    if isinstance(background, CartesianGrid):
        apart = distance > 0.5 * float(background.spacing.max()) * (1.0 + 1e-9)
        label, n = ndimage.label(apart)
        groups: LongArray = label.astype(np.int64) - 1
        alone = ~apart
        groups[alone] = n + np.arange(int(alone.sum()))
        return groups
    mesh = background if isinstance(background, SimplexMesh) else background.mesh
    joined = distance[mesh.edges].sum(axis=1) > mesh.edge_lengths * (1.0 + 1e-9)
    return topology.components_of(mesh.edges[joined], mesh.n_points)


def propagate(
    grid: CartesianGrid, features: Features, found: Nearest, report: ProgressCallback
) -> None:
    """Fill unknown distances (In/Out, inf) from the nearest features of neighbours (In/Out)."""
    frame, n = frame_of(grid), grid.n_points
    first, following = np.full(_BUCKETS, -1, np.int32), np.full(n, -2, np.int32)
    queue = Queue(float(grid.spacing.min()), first, following, np.array([-1, 0], np.int64))
    accepted, newly = 0, _NODES_AT_ONCE
    while newly == _NODES_AT_ONCE:
        newly = propagate_features(features, frame, found, queue, _NODES_AT_ONCE)
        accepted += newly
        report("distance beyond the band", min(accepted / n, 1.0))
