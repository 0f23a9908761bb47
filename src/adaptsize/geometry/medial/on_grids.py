"""The medial axis of a distance on a Cartesian grid (Algorithm 1 of Persson), and feature sizes."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from adaptsize._defaults import CORNER_ANGLE
from adaptsize._kernels.level_sets import fill_level_set_curvature
from adaptsize.background import CartesianGrid
from adaptsize.background.grid import span_of
from adaptsize.background.merging import place_numbers
from adaptsize.geometry.distance.fast_marching import march_distance
from adaptsize.geometry.medial.fronts import RESOLVED, Fronts, MedialAxis, Rows, meet_at_corner
from adaptsize.typing import BoolArray, FloatArray, LongArray, ProgressCallback

# Factor on curvatures.  They are evaluated one node away, and one-sided gradients correspond to
# points two spacings apart.  Below 2, smooth fronts are mistaken for crossings.
_GAMMA = 2.0
# Gradients shorter than this (those of a distance have length 1) have no curvature, ...
_FLAT = 1e-6
# ... and shorter than this no direction.
_DIRECTED = 0.5

# Nodes that the parabolas reach on either side of the middle of an edge, ...
_REACH = 3
# ... and that differences reach beyond the edge.
_BORDER = 4
# Nodes searched between two progress reports, at which Ctrl-C takes effect.
_NODES_AT_ONCE = 2**15
# Roots this little outside of an edge are at its node: rounding must not lose them between two.
_ROUNDING = 1e-9

# Shortest gradient half way to the boundary, if there is no kink.
_SMOOTH = 0.9
# How far the point where a front comes from may be from the boundary, in spacings and as a share
# of the path: farther if the gradient mixes several fronts.
_FOOT_SPACINGS = 0.5
_FOOT_SHARE = 0.05


@dataclass(frozen=True)
class DomainOnGrid:
    """The region where a distance at the nodes of a grid is negative.

    Parameters
    ----------
    grid : CartesianGrid
        Inactive nodes are outside.
    phi : float64[shape]
    report : callable
    corner_angle : float
        As for `adaptsize.medial_axis`, degrees.
    """

    grid: CartesianGrid
    phi: FloatArray
    report: ProgressCallback
    corner_angle: float = CORNER_ANGLE

    def medial_axis(self) -> MedialAxis:
        """Return the medial axis."""
        grid, phi, step = self.grid, self.phi, float(self.grid.spacing.max())
        # Smallest curvature that is resolved, times the diameter of the part.
        tolerance = 4.0 / _diameter_inside(grid, phi)
        found, fronts = _fronts_on_edges(grid, phi, tolerance, self.report)
        fronts = _look_half_way(grid, phi, fronts)
        # Directions must differ by this much, in radians, to have a normal between them.
        turned = max(_GAMMA * tolerance * step, 1e-3)
        valid = (fronts.cosine < 1.0 - 0.5 * turned**2) & _come_from_boundary(grid, phi, fronts)
        found, fronts = found.taken(valid), fronts.taken(valid)
        at_corner, apex = meet_at_corner(
            lambda points: _interpolated(grid, phi, points), step, fronts, self.corner_angle
        )
        # At larger distances or smaller turns, a smooth boundary looks like a corner.
        # Smallest turn of the boundary, in degrees, at a corner that is reported.
        sharp = at_corner & (fronts.cosine < np.cos(np.radians(20.0)))
        # Crossings up to this distance from the boundary, in spacings, are used to locate corners.
        sharp &= (fronts.radii / step >= RESOLVED) & (fronts.radii / step <= 12.0)
        found, fronts = found.taken(~at_corner), fronts.taken(~at_corner)
        across = np.abs(fronts.normals[np.arange(len(found.axis)), found.axis])
        away = (across * grid.spacing[found.axis])[:, None]
        away = away * np.column_stack([found.place, 1.0 - found.place])
        return MedialAxis.of(fronts, away, apex[sharp], grid.shape)

    def feature_size(self, medial: MedialAxis) -> FloatArray:
        """Return the local feature size."""
        grid, phi = self.grid, self.phi
        inside = _is_inside(grid, phi <= 0.0)
        seeds = medial.distances.copy()
        seeds[_deepest(grid, phi, inside, seeds)] = 0.0
        text = "marching from the medial axis"
        size = march_distance(grid, seeds, where=inside, report=self.report, text=text)
        _reach_diagonally(grid, inside, size)
        size[inside] -= phi[inside]
        if grid.dim == 2:
            lengths = _edge_lengths(grid, phi, _corner_points(grid, medial.corners))
            near, text = inside | np.isfinite(lengths), "marching from edges"
            grown = march_distance(grid, lengths, where=near, report=self.report, text=text)
            size[inside] = np.minimum(size[inside], grown[inside])
        return size


def _is_inside(grid: CartesianGrid, inside: BoolArray) -> BoolArray:
    return inside if grid.active is None else inside & grid.active


def _diameter_inside(grid: CartesianGrid, phi: FloatArray) -> float:
    """Return the diagonal of the box of the inside nodes, enlarged by a cell."""
    n = np.diff(span_of(_is_inside(grid, phi < 0.0)), axis=1)[:, 0] + 1
    return float(np.sqrt(((n * grid.spacing) ** 2).sum()))


# Crossings of fronts on edges


class Padded(NamedTuple):
    """A distance with more nodes on every side, as a flat array, NaN at inactive nodes."""

    values: FloatArray
    shape: tuple[int, ...]
    strides: LongArray
    spacing: FloatArray

    @classmethod
    def of(cls, grid: CartesianGrid, phi: FloatArray) -> Padded:
        """Return the distance, continued by a point reflection, which keeps it linear."""
        values = phi if grid.active is None else np.where(grid.active, phi, np.nan)
        values = np.pad(values, _BORDER, mode="reflect", reflect_type="odd")
        strides = np.array(values.strides) // values.itemsize
        return cls(values.reshape(-1), values.shape, strides, grid.spacing)

    def positions(self, nodes: LongArray) -> LongArray:
        """Return the positions of nodes in the grid, int64[n, dim]."""
        return np.stack(np.unravel_index(nodes, self.shape), axis=-1) - _BORDER


@dataclass(frozen=True)
class Crossings(Rows):
    """Points on the edges of a grid where two fronts meet.

    Parameters
    ----------
    nodes : int64[n]
        Lower ends of the edges, as numbers in the padded array.
    axis : int64[n]
        Directions of the edges.
    place : float64[n]
        Where on the edge, 0 to 1.
    rise : float64[n]
        How much steeper the second front is than the first at the crossing.
    depth : float64[n]
        Distance from the boundary at the crossing.
    """

    nodes: LongArray
    axis: LongArray
    place: FloatArray
    rise: FloatArray
    depth: FloatArray


def _fronts_on_edges(
    grid: CartesianGrid, phi: FloatArray, tolerance: float, report: ProgressCallback
) -> tuple[Crossings, Fronts]:
    """Return the crossings on edges and the fronts that meet there, as their gradients show."""
    padded = Padded.of(grid, phi)
    found = find_crossings(padded, _is_inside(grid, phi < 0.0), tolerance, report)
    found = found.taken(_is_steepest(padded, found))
    gradients = np.stack([_gradient_of_front(padded, found, side) for side in (-1, 1)], axis=1)
    length = np.linalg.norm(gradients, axis=2)
    directed = (length > _DIRECTED).all(axis=1)
    found, length = found.taken(directed), length[directed]
    index, along = padded.positions(found.nodes), np.eye(grid.dim, dtype=np.int64)[found.axis]
    return found, Fronts(
        points=grid.origin + grid.spacing * (index + along * found.place[:, None]),
        radii=found.depth,
        directions=gradients[directed] / length[:, :, None],
        ends=np.ravel_multi_index(tuple(np.stack([index, index + along]).T), grid.shape),
    )


def find_crossings(
    phi: Padded, inside: BoolArray, tolerance: float, report: ProgressCallback
) -> Crossings:
    """Return all edges inside on which two fronts meet, in the order of their nodes.

    This is Algorithm 1 without its last step, the comparison with steeper crossings nearby.

    Parameters
    ----------
    phi : Padded
    inside : bool[shape]
    tolerance : float
        Smallest curvature that is resolved [1 / length].
    report : callable
    """
    dim = inside.ndim
    inside = np.pad(inside, _BORDER).reshape(-1)
    nodes = np.flatnonzero(inside)
    parts = []
    for first in range(0, len(nodes), _NODES_AT_ONCE):
        lower = np.repeat(nodes[first : first + _NODES_AT_ONCE], dim)
        axis = np.tile(np.arange(dim), len(lower) // dim)
        is_edge = inside[lower + phi.strides[axis]]
        with np.errstate(all="ignore"):  # overflow and NaN fail the comparisons
            found = _intersections(phi, lower[is_edge], axis[is_edge])
            parts.append(found.taken(_differ(phi, found, tolerance)))
        report("finding the medial axis", min(1.0, (first + _NODES_AT_ONCE) / len(nodes)))
    return Crossings.joined(parts)


def _intersections(phi: Padded, nodes: LongArray, axis: LongArray) -> Crossings:
    """Return where the parabolas through three nodes on either side of edges intersect on them."""
    step = phi.strides[axis]
    f1, f2, f3, f4, f5, f6 = (phi.values[nodes + s * step] for s in range(-2, 4))
    bend1, bend2 = 0.5 * (f1 - 2.0 * f2 + f3), 0.5 * (f4 - 2.0 * f5 + f6)
    slope1, slope2 = 0.5 * (3.0 * f3 - 4.0 * f2 + f1), 0.5 * (-3.0 * f4 + 4.0 * f5 - f6)
    # Second parabola minus first one, c + b s + a s^2.
    a = bend2 - bend1
    b = slope2 - 2.0 * bend2 - slope1
    c = f4 - slope2 + bend2 - f3
    # It rises from s = -2 to 3, so that it has one root on the edge or none.
    steeper = (b - 4.0 * a > 0.0) & (b + 6.0 * a > 0.0)
    root = np.sqrt(np.maximum(b * b - 4.0 * a * c, 0.0))
    place = -2.0 * c / (b + root)
    rise = (b + 2.0 * a * place) / phi.spacing[axis]
    depth = -(f3 + place * (slope1 + place * bend1))
    found = Crossings(nodes, axis, np.clip(place, 0.0, 1.0), rise, depth)
    return found.taken(steeper & (place >= -_ROUNDING) & (place <= 1.0 + _ROUNDING))


def _differ(phi: Padded, found: Crossings, tolerance: float) -> BoolArray:
    """Return where gradients differ by more than the curvature of the fronts explains."""
    step, scale = phi.strides[found.axis], _GAMMA * float(phi.spacing.max())
    first = _gradient(phi, found.nodes, found.axis, -1)
    second = _gradient(phi, found.nodes + step, found.axis, 1)
    cosine = (first * second).sum(axis=1)
    kappa = [_curvature(phi, found.nodes + s * step) for s in (-1, 2)]
    # Fronts whose directions differ by 60 degrees from one node to the next meet, whatever the
    # curvature next to them: around the centre of a ball it is as large.
    bound = np.maximum(1.0 - 0.5 * (scale * np.maximum(*kappa)) ** 2, 0.5)
    return np.asarray(cosine < np.minimum(bound, 1.0 - 0.5 * (scale * tolerance) ** 2))


def _curvature(phi: Padded, nodes: LongArray) -> FloatArray:
    """Return the largest modulus of a principal curvature of the level sets, 0 where unknown."""
    dim, shape, spacing = len(phi.shape), np.ones(3, np.int64), np.ones(3)
    shape[:dim], spacing[:dim] = phi.shape, phi.spacing
    kappa = np.zeros((len(nodes), dim - 1))
    if dim > 1:
        tolerance = 1.0 - _FLAT  # of the length of the gradient, about 1
        fields = (phi.values, phi.values)
        fill_level_set_curvature(fields, (spacing, shape), nodes, (tolerance, False), kappa)
    return np.asarray(np.nan_to_num(np.abs(kappa)).max(axis=1, initial=0.0))


def _gradient(phi: Padded, nodes: LongArray, axis: LongArray, side: int) -> FloatArray:
    """Return gradients, from one side (-1 or 1) along an axis and from the smoother one across."""
    steps = phi.strides[axis]
    columns = [_smoother_difference(phi.values, nodes, int(step)) for step in phi.strides]
    along = side * (phi.values[nodes + side * steps] - phi.values[nodes])
    is_along = axis[:, None] == np.arange(len(columns))
    return np.where(is_along, along[:, None], np.column_stack(columns)) / phi.spacing


def _smoother_difference(values: FloatArray, nodes: LongArray, step: int) -> FloatArray:
    """Return one-sided differences on the side with the smaller second difference.

    A side whose second difference is large holds a kink; taking the side *upwind* in the sense of
    Godunov instead crosses it.  The mean where both sides are as smooth.
    """
    f1, f2, f3, f4, f5 = (values[nodes + s * step] for s in range(-2, 3))
    back, front = f3 - f2, f4 - f3
    bend_back, bend_front = np.abs(back - (f2 - f1)), np.abs((f5 - f4) - front)
    slack = 1e-9 * (bend_back + bend_front)
    # NaN: nodes are missing on this side.
    is_front = np.isnan(bend_back) | (bend_front < bend_back - slack)
    is_back = np.isnan(bend_front) | (bend_back < bend_front - slack)
    return np.select([is_front, is_back], [front, back], 0.5 * (back + front))


def _gradient_of_front(phi: Padded, found: Crossings, side: int) -> FloatArray:
    """Return the gradient of one front (-1 or 1), from the most regular of three nodes.

    A distance has a gradient of length one.  Where differences mix several fronts the length
    is another one; then the next node away from the crossing is better.
    """
    step = phi.strides[found.axis]
    end, away = (found.nodes, found.place) if side < 0 else (found.nodes + step, 1.0 - found.place)
    gradients = np.stack(
        [_gradient(phi, end + side * t * step, found.axis, side) for t in range(3)]
    )
    # The length of the gradient must be better by this much for each node farther from the
    # crossing.
    irregular = np.abs(np.linalg.norm(gradients, axis=2) - 1.0) + 0.02 * np.arange(3)[:, None]
    irregular[np.isnan(irregular)] = np.inf
    # At nodes closer to a crossing, in spacings, differences may be of either front.
    irregular[0, away <= 0.25] = np.inf
    chosen = gradients[irregular.argmin(axis=0), np.arange(len(step))]
    return np.where(np.isfinite(irregular.min(axis=0))[:, None], chosen, 0.0)


def _is_steepest(phi: Padded, found: Crossings) -> BoolArray:
    """Return which crossings have no steeper one on their line, two nodes before to three after."""
    here = phi.positions(found.nodes)[np.arange(len(found.nodes)), found.axis]
    line = (found.nodes - here * phi.strides[found.axis]) * len(phi.shape) + found.axis
    order = np.lexsort((here, line))
    line, here, rise = line[order], here[order], found.rise[order]
    place = here + found.place[order]
    steepest = np.ones(len(order), np.bool_)
    for apart in range(1, 2 * _REACH + 1):
        a, b = slice(None, -apart), slice(apart, None)
        same = line[a] == line[b]
        # Of two equally steep ones, as for a crossing at a node, the first is kept.
        steepest[b] &= ~(same & (place[a] >= here[b] - 2) & (rise[a] >= rise[b]))
        steepest[a] &= ~(same & (place[b] <= here[a] + 3) & (rise[b] > rise[a]))
    result = np.empty_like(steepest)
    result[order] = steepest
    return result


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
        found = _gradients(grid, phi, fronts.feet(0.5))
        length = np.linalg.norm(found, axis=2)
        # If the segment is short, or there is another kink at its midpoint, keep the direction.
        clear = (length > _SMOOTH) & resolved[:, None]
        found /= np.where(clear, length, 1.0)[:, :, None]
        found = np.where(clear[:, :, None], found, fronts.directions)
        fronts = Fronts(fronts.points, fronts.radii, found, fronts.ends)
    return fronts


def _come_from_boundary(grid: CartesianGrid, phi: FloatArray, fronts: Fronts) -> BoolArray:
    """Return at which points both directions lead to the boundary at the right distance.

    Directions that lead out of the grid are accepted.
    """
    allowed = _FOOT_SPACINGS * float(grid.spacing.max()) + _FOOT_SHARE * fronts.radii
    off = np.abs(_interpolated(grid, phi, fronts.feet()))
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
    a, b = pairs[np.lexsort(pairs.T[::-1])].T
    links = np.hypot(*(grid.spacing * (index[b] - index[a])).T)
    graph = coo_array((links, (a, b)), shape=(len(index),) * 2)
    start = cKDTree(grid.origin + grid.spacing * index).query(corners)[1]
    way, before, owner = dijkstra(
        graph, directed=False, indices=np.unique(start), return_predecessors=True, min_only=True
    )
    corner_of = dict(zip(start.tolist(), corners, strict=True))
    along = way[a] + links + way[b]
    meet = np.flatnonzero((owner[a] != owner[b]) & np.isfinite(along))
    done = set()
    for link in meet[np.argsort(along[meet], kind="stable")]:
        owners = frozenset(owner[[a[link], b[link]]].tolist())
        if owners in done:  # by a shorter path
            continue
        done.add(owners)
        straight = float(np.linalg.norm(np.subtract(*(corner_of[o] for o in owners))))
        # A path along nodes is longer than a straight edge by up to 8 per cent, plus its ends.
        is_straight = along[link] <= 1.15 * straight + 2.0 * step
        length = straight if is_straight else along[link]
        for end in (a[link], b[link]):
            node = int(end)
            while node >= 0:
                at = tuple(index[node])
                lengths[at] = min(lengths[at], length)
                node = int(before[node])
    return lengths
