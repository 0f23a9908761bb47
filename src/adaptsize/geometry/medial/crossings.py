"""Where the fronts of a distance on a Cartesian grid meet: crossings on the edges of the grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.level_sets import fill_level_set_curvature
from adaptsize.background import CartesianGrid
from adaptsize.geometry.medial.fronts import Fronts, Rows
from adaptsize.typing import BoolArray, FloatArray, LongArray, ProgressCallback

#: Factor on curvatures.  They are evaluated one node away, and one-sided gradients correspond to
# points two spacings apart.  Below 2, smooth fronts are mistaken for crossings.
GAMMA = 2.0
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


def is_inside(grid: CartesianGrid, inside: BoolArray) -> BoolArray:
    """Return which nodes are inside and active."""
    return inside if grid.active is None else inside & grid.active


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


def fronts_on_edges(
    grid: CartesianGrid, phi: FloatArray, tolerance: float, report: ProgressCallback
) -> tuple[Crossings, Fronts]:
    """Return the crossings on edges and the fronts that meet there, as their gradients show."""
    padded = Padded.of(grid, phi)
    found = find_crossings(padded, is_inside(grid, phi < 0.0), tolerance, report)
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
    step, scale = phi.strides[found.axis], GAMMA * float(phi.spacing.max())
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
