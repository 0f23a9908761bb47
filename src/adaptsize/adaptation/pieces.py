"""Quadrature over the intersections of the cells of two meshes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.clipping import new_clipping
from adaptsize._kernels.pieces import fill_pieces
from adaptsize.adaptation.field_transfer import FieldTransfer
from adaptsize.background import SimplexMesh
from adaptsize.background.location import in_space
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: Pairs of cells that are processed at a time, and room for simplices for each, by dimension.
_PAIRS = {2: 8192, 3: 1024}
_ROOM = {2: 8, 3: 48}


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


def common_points(transfer: FieldTransfer, degree: int) -> Iterator[Points]:
    """Return points of quadrature in the intersections, for polynomials of a degree."""
    old, new = transfer.old, transfer.new
    dim, overlap, scale = old.dim, transfer.overlap, old.locator.scale
    of_new = np.repeat(np.arange(new.n_cells, dtype=np.int32), np.diff(overlap.indptr))
    of_old = overlap.indices.astype(np.int32)
    meshes = [(in_space(m.points * scale), np.array(m.cells)) for m in (old, new)]
    room, work, rule = _ROOM[dim] * _PAIRS[dim], new_clipping(), rule_of(dim, degree)
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
        pair_of, in_new, in_old = (array[:used] for array in out)
        cells, old_cells = pairs[0][pair_of], pairs[1][pair_of]
        measures = np.abs(np.linalg.det(in_old)) * old.measures[old_cells]
        yield Points(
            cells, rule.places @ in_new, old_cells, rule.places @ in_old,
            measures[:, None] * rule.weights,
        )  # fmt: skip
        first += done


def points_of_cells(transfer: FieldTransfer, degree: int, which: IntArray) -> Points:
    """Return points of quadrature in some new cells, and the nearest places in old cells."""
    new: SimplexMesh = transfer.new
    rule = rule_of(new.dim, degree)
    places = np.broadcast_to(rule.places, (len(which), *rule.places.shape))
    points = places @ new.points[new.cells[which]]
    cells, old_places, _ = transfer.old.locator.nearest(points.reshape(-1, new.dim))
    n = len(rule.weights)
    return Points(
        np.repeat(which, n).astype(np.int32), places.reshape(-1, 1, new.dim + 1),
        cells.astype(np.int32), old_places[:, None], (new.measures[which][:, None] * rule.weights)
        .reshape(-1, 1),
    )  # fmt: skip
