"""Quadrature over the intersections of the cells of two meshes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.clipping import new_clipping
from adaptsize._kernels.overlap_pieces import fill_pieces
from adaptsize.adaptation.field_transfer import FieldTransfer
from adaptsize.background.location import in_space
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: Pairs of cells that are processed at a time, and room for simplices for each, by dimension.
_PAIRS = {2: 8192, 3: 1024}
_ROOM = {2: 8, 3: 48}
#: Points of quadrature that are processed at a time.
_POINTS = 1 << 17


class Rule(NamedTuple):
    """A quadrature rule on a simplex."""

    places: FloatArray
    """Barycentric coordinates, float64[n, k]."""
    weights: FloatArray
    """They add up to 1."""


@cache
def rule_of(dim: int, degree: int) -> Rule:
    """Return a rule with positive weights that is exact for polynomials of a degree.

    It is a product of Gauss-Jacobi rules, on a cube that is mapped onto the simplex.
    """
    from scipy.special import roots_jacobi

    n = degree // 2 + 1
    places, weights = np.ones((1, 1)), np.ones(1)
    for axis in range(dim):
        x, w = roots_jacobi(n, axis, 0)  # (1 - x)^axis
        t, w = 0.5 * (1.0 + x), w / w.sum()
        # The simplex of one dimension more has the former one at t = 0, and a point at t = 1.
        scaled = places[:, None, :] * (1.0 - t)[None, :, None]
        tip = np.broadcast_to(t[None, :, None], (*scaled.shape[:2], 1))
        places = np.concatenate([scaled, tip], axis=2).reshape(-1, axis + 2)
        weights = np.outer(weights, w).ravel()
    return Rule(places, weights)


class Points(NamedTuple):
    """Points of quadrature in some cells, of p pieces with q points each."""

    cells: IntArray
    """The new cell of each piece, int32[p]."""
    places: FloatArray
    """Barycentric coordinates in this cell, float64[p, q, k]."""
    old_cells: IntArray
    old_places: FloatArray
    weights: FloatArray
    """float64[p, q]; over all pieces they add up to the measure that the meshes have in common."""

    def some(self, which: BoolArray) -> Points:
        """Return the points of some pieces."""
        return Points(*(array[which] for array in self))  # type: ignore[arg-type]


class Pieces(NamedTuple):
    """Simplices in the intersections of some pairs of cells."""

    cells: IntArray
    """The new cell of each piece, int32[p]."""
    in_new: FloatArray
    """Barycentric coordinates of the corners in this cell, float64[p, k, k]."""
    old_cells: IntArray
    in_old: FloatArray
    measures: FloatArray

    def points(self, degree: int) -> Points:
        """Return points of quadrature for polynomials of a degree."""
        rule = rule_of(self.in_new.shape[1] - 1, degree)
        return Points(
            self.cells, rule.places @ self.in_new, self.old_cells, rule.places @ self.in_old,
            self.measures[:, None] * rule.weights,
        )  # fmt: skip


def common_pieces(transfer: FieldTransfer) -> Iterator[Pieces]:
    """Return the simplices that fill the intersections of all pairs of cells, some at a time."""
    old, new = transfer.old, transfer.new
    dim, overlap, scale = old.dim, transfer.overlap, old.locator.scale
    of_new = np.repeat(np.arange(new.n_cells, dtype=np.int32), np.diff(overlap.indptr))
    of_old = overlap.indices.astype(np.int32)
    meshes = [(in_space(m.points * scale), np.array(m.cells)) for m in (old, new)]
    room, work = _ROOM[dim] * _PAIRS[dim], new_clipping()
    first = 0
    while first < len(of_new):
        own = slice(first, first + _PAIRS[dim])
        out = (
            np.empty(room, np.int32),
            np.empty((room, dim + 1, dim + 1)),
            np.empty((room, dim + 1, dim + 1)),
        )
        pairs = of_new[own].copy(), of_old[own].copy()
        done, used = fill_pieces(*meshes, pairs, work, out, tuple(range(dim)))
        pair_of, in_new, in_old = out[0][:used], out[1][:used], out[2][:used]
        cells, old_cells = pairs[0][pair_of], pairs[1][pair_of]
        measures = np.abs(np.linalg.det(in_old)) * old.measures[old_cells]
        yield Pieces(cells, in_new, old_cells, in_old, measures)
        first += done


def some_cells(rule: Rule, which: IntArray) -> Iterator[IntArray]:
    """Return cells in parts with a limited number of points of a rule."""
    size = max(_POINTS // len(rule.weights), 1)
    for first in range(0, max(len(which), 1), size):
        yield which[first : first + size]


def points_of_cells(transfer: FieldTransfer, degree: int, cells: IntArray) -> Iterator[Points]:
    """Return points of quadrature in some new cells, and the nearest places in old cells."""
    new = transfer.new
    rule = rule_of(new.dim, degree)
    for which in some_cells(rule, cells):
        places = np.broadcast_to(rule.places, (len(which), *rule.places.shape))
        points = places @ new.points[new.cells[which]]
        old_cells, old_places, _ = transfer.old.locator.nearest(points.reshape(-1, new.dim))
        weights = new.measures[which][:, None] * rule.weights
        yield Points(
            np.repeat(which, len(rule.weights)).astype(np.int32),
            places.reshape(-1, 1, new.dim + 1),
            old_cells.astype(np.int32), old_places[:, None], weights.reshape(-1, 1),
        )  # fmt: skip
