"""The medial axis of a distance on a Cartesian grid (Algorithm 1 of Persson), and feature sizes."""

import itertools
from collections.abc import Iterator

import numpy as np

from adaptsize.background import CartesianGrid
from adaptsize.background.grid import span_of
from adaptsize.background.marching import march_distance
from adaptsize.background.merging import place_numbers
from adaptsize.geometry import tuning
from adaptsize.geometry.medial.crossings import GAMMA, fronts_on_edges, is_inside
from adaptsize.geometry.medial.fronts import RESOLVED, Fronts, MedialAxis, meet_at_corner
from adaptsize.typing import BoolArray, FloatArray, LongArray, ProgressCallback


def medial_axis_on_grid(
    grid: CartesianGrid, phi: FloatArray, corner_angle: float, report: ProgressCallback
) -> MedialAxis:
    """Return the medial axis of the region where a distance, float64[shape], is negative."""
    step = float(grid.spacing.max())
    # Smallest curvature that is resolved, times the diameter of the part.
    n_inside = np.diff(span_of(is_inside(grid, phi < 0.0)), axis=1)[:, 0] + 1
    tolerance = 4.0 / float(np.linalg.norm(n_inside * grid.spacing))
    found, fronts = fronts_on_edges(grid, phi, tolerance, report)
    fronts = _look_half_way(grid, phi, fronts)
    # Directions must differ by this much, in radians, to have a normal between them.
    turned = max(GAMMA * tolerance * step, 1e-3)
    valid = (fronts.cosine < 1.0 - 0.5 * turned**2) & _come_from_boundary(grid, phi, fronts)
    found, fronts = found.taken(valid), fronts.taken(valid)
    at_corner, apex = meet_at_corner(
        lambda points: _interpolated(grid, phi, points), step, fronts, corner_angle
    )
    sharp = at_corner & (fronts.cosine < np.cos(np.radians(tuning.LEAST_TURN)))
    sharp &= (fronts.radii / step >= RESOLVED) & (fronts.radii / step <= tuning.NEAR_CORNER)
    found, fronts = found.taken(~at_corner), fronts.taken(~at_corner)
    across = np.abs(fronts.normals[np.arange(len(found.axis)), found.axis])
    away = (across * grid.spacing[found.axis])[:, None]
    away = away * np.column_stack([found.place, 1.0 - found.place])
    distances = np.full(grid.shape, np.inf)
    np.minimum.at(distances.reshape(-1), fronts.ends, away)
    angles = np.degrees(np.arccos(np.clip(fronts.cosine, -1.0, 1.0)))
    return MedialAxis(fronts.points, fronts.normals, fronts.radii, angles, distances, apex[sharp])


def feature_size_on_grid(
    grid: CartesianGrid, phi: FloatArray, medial: MedialAxis, report: ProgressCallback
) -> FloatArray:
    """Return the local feature size of the region where a distance is negative."""
    inside = is_inside(grid, phi <= 0.0)
    seeds = medial.distances.copy()
    seeds[_deepest(grid, phi, inside, seeds)] = 0.0
    text = "marching from the medial axis"
    size = march_distance(grid, seeds, where=inside, report=report, text=text)
    _reach_diagonally(grid, inside, size)
    size[inside] -= phi[inside]
    if grid.dim == 2:
        lengths = _edge_lengths(grid, phi, _corner_points(grid, medial.corners))
        near, text = inside | np.isfinite(lengths), "marching from edges"
        grown = march_distance(grid, lengths, where=near, report=report, text=text)
        size[inside] = np.minimum(size[inside], grown[inside])
    return size


# Directions of fronts


def _look_half_way(grid: CartesianGrid, phi: FloatArray, fronts: Fronts) -> Fronts:
    """Return fronts with directions found half way to the boundary.

    Where three fronts are close to each other, differences next to a crossing mix them.  The
    gradient of a distance is constant along the segment to the boundary, and at its midpoint it is
    clear of the crossing.  Repeated evaluation there converges, since the curvature of the level
    sets there is less than twice the reciprocal of the length.
    """
    resolved = fronts.radii >= RESOLVED * grid.spacing.max()
    for _ in range(2):
        found = _gradients(grid, phi, fronts.closest_points(0.5))
        length = np.linalg.norm(found, axis=2)
        # If the segment is short, or there is another kink at its midpoint, keep the direction.
        clear = (length > tuning.UNMIXED) & resolved[:, None]
        found /= np.where(clear, length, 1.0)[:, :, None]
        found = np.where(clear[:, :, None], found, fronts.directions)
        fronts = Fronts(fronts.points, fronts.radii, found, fronts.ends)
    return fronts


def _come_from_boundary(grid: CartesianGrid, phi: FloatArray, fronts: Fronts) -> BoolArray:
    """Return at which points both directions lead to the boundary at the right distance.

    Directions that lead out of the grid are accepted.
    """
    allowed = tuning.FOOT_SPACINGS * float(grid.spacing.max()) + tuning.FOOT_SHARE * fronts.radii
    off = np.abs(_interpolated(grid, phi, fronts.closest_points()))
    return np.asarray(((off <= allowed[:, None]) | np.isinf(off)).all(axis=1))


def _gradients(grid: CartesianGrid, phi: FloatArray, points: FloatArray) -> FloatArray:
    """Return central differences over one spacing of the interpolated distance."""
    steps = 0.5 * np.diag(grid.spacing)
    # Outside of the grid nothing is known: held at its border both values are the same.
    ends = (np.clip(points[..., None, :] + s, grid.lower, grid.upper) for s in (steps, -steps))
    high, low = (_interpolated(grid, phi, end) for end in ends)
    return (high - low) / grid.spacing


def _interpolated(grid: CartesianGrid, values: FloatArray, points: FloatArray) -> FloatArray:
    """Return multilinear interpolation at points[..., dim]; inf outside, where no boundary is."""
    from scipy.ndimage import map_coordinates

    places = ((points - grid.origin) / grid.spacing).reshape(-1, grid.dim)
    beyond = np.maximum(-places, places - (np.array(grid.shape) - 1)).max(axis=1, initial=0.0)
    found = map_coordinates(values, places.T, order=1, mode="nearest")
    # Points farther from the grid, in spacings, have no interpolated distance.
    found[beyond > 0.5] = np.inf
    return np.asarray(found.reshape(points.shape[:-1]))


# The feature size


def _around(
    grid: CartesianGrid, nodes: LongArray, reach: int
) -> Iterator[tuple[tuple[int, ...], tuple[LongArray, ...]]]:
    """Yield steps of up to some nodes along each axis, and where they lead, as an index."""
    last = np.array(grid.shape) - 1
    for step in itertools.product(range(-reach, reach + 1), repeat=grid.dim):
        yield step, tuple(np.clip(nodes + step, 0, last).T)


def _reach_diagonally(grid: CartesianGrid, inside: BoolArray, distances: FloatArray) -> None:
    """Fill distances (In/Out) at nodes that are connected by a diagonal only, as at sharp tips."""
    nodes = np.argwhere(inside & np.isinf(distances))
    while len(nodes):
        least = np.full(len(nodes), np.inf)
        for step, there in _around(grid, nodes, 1):
            least = np.minimum(least, distances[there] + np.linalg.norm(grid.spacing * step))
        distances[tuple(nodes.T)] = least
        left = nodes[np.isinf(least)]
        if len(left) == len(nodes):
            break
        nodes = left


def _deepest(
    grid: CartesianGrid, phi: FloatArray, inside: BoolArray, distances: FloatArray
) -> tuple[LongArray, ...]:
    """Return the inside nodes that are deeper than all neighbours, with no crossing nearby.

    Each is next to the centre of a ball that touches the boundary on all sides.
    """
    lowest = inside & np.isinf(distances)
    for axis in range(grid.dim):
        values, low = np.moveaxis(phi, axis, 0), np.moveaxis(lowest, axis, 0)
        low[1:] &= values[1:] <= values[:-1]
        low[:-1] &= values[:-1] <= values[1:]
    nodes = np.argwhere(lowest)
    keep = np.ones(len(nodes), np.bool_)
    for step, there in _around(grid, nodes, 2):
        keep &= np.isinf(distances[there])
        if max(map(abs, step)) == 1:
            keep &= phi[there] >= phi[tuple(nodes.T)]
    return tuple(nodes[keep].T)


# Edges of the boundary between corners, in the plane


def _corner_points(grid: CartesianGrid, witnesses: FloatArray) -> FloatArray:
    """Return corners, float64[m, dim], from the positions that crossings give, float64[n, dim]."""
    if len(witnesses) == 0:
        return witnesses
    # Corner positions from different crossings are merged up to this distance, in spacings.
    group = place_numbers(witnesses, 1.5 * float(grid.spacing.max()))
    order = np.argsort(group, kind="stable")
    parts = np.split(witnesses[order], np.cumsum(np.bincount(group))[:-1])
    # Smallest number of crossings that indicate a corner.
    found = [np.median(part, axis=0) for part in parts if len(part) >= 2]
    return np.array(found).reshape(-1, grid.dim)


def _edge_lengths(grid: CartesianGrid, phi: FloatArray, corners: FloatArray) -> FloatArray:
    """Return the lengths of boundary edges between corners, at nodes along them.

    Shortest paths along nodes close to the boundary start from all corners at once (Dijkstra).  An
    edge lies where two of them meet.

    Parameters
    ----------
    grid : CartesianGrid
        In the plane.
    phi : float64[shape]
    corners : float64[n, 2]

    Returns
    -------
    float64[shape]
        Length of the shortest edge at a node, inf away from edges.  Of several edges between two
        corners, only the shortest is found.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra
    from scipy.spatial import cKDTree

    lengths = np.full(grid.shape, np.inf)
    if len(corners) < 2:
        return lengths
    step = float(grid.spacing.max())
    # Nodes up to this distance from the boundary, in spacings, are on it.
    index = np.argwhere(np.abs(phi) <= 1.0 * step)
    pairs = cKDTree(index).query_pairs(1.5, output_type="ndarray")  # with diagonals
    # SciPy 1.13 takes numbers of this type only.
    a, b = pairs[np.lexsort(pairs.T[::-1])].T.astype(np.int32)
    links = np.hypot(*(grid.spacing * (index[b] - index[a])).T)
    graph = coo_array((links, (a, b)), shape=(len(index),) * 2)
    start = cKDTree(grid.origin + grid.spacing * index).query(corners)[1]
    path, before, owner = dijkstra(
        graph, directed=False, indices=np.unique(start), return_predecessors=True, min_only=True
    )
    corner_of = dict(zip(start.tolist(), corners, strict=True))
    along = path[a] + links + path[b]
    meet = np.flatnonzero((owner[a] != owner[b]) & np.isfinite(along))
    done = set()
    for link in meet[np.argsort(along[meet], kind="stable")]:
        owners = frozenset(owner[[a[link], b[link]]].tolist())
        if owners in done:  # by a shorter path
            continue
        done.add(owners)
        straight = float(np.linalg.norm(np.subtract(*(corner_of[o] for o in owners))))
        is_straight = along[link] <= tuning.DETOUR * straight + 2.0 * step
        length = straight if is_straight else along[link]
        for end in (a[link], b[link]):
            node = int(end)
            while node >= 0:
                at = tuple(index[node])
                lengths[at] = min(lengths[at], length)
                node = int(before[node])
    return lengths
