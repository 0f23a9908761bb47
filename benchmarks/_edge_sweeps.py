"""Gradation of metrics by sweeps over the edges of a mesh, as in remeshers; for comparison only.

Each sweep grows the metric of either end of each edge by the length of the edge and intersects it
with that of the other end, two at a time, until no size changes by more than a share of 1e-6.
The growth is that in physical space (as in Mmg), in metric space, or the mixture of both with the
exponent 1/8 (as in NASA's refine): F. Alauzet, "Size gradation control of anisotropic meshes",
Finite Elements in Analysis and Design 46 (2010) 181-202.
"""

import math

import numpy as np
from numba import njit

from adaptsize._kernels.metrics import intersect_into
from adaptsize.metrics import Metric

PHYSICAL, METRIC, MIXED = 0, 1, 2
_MIXTURE = 1.0 / 8.0
_CHANGE = 1e-6
_SWEEPS = 500
_UNBOUNDED = 1e30


@njit
def _grow(axes, x, p, q, h, r, g, law, grown):
    """Fill the sizes of the metric of node p at node q (Out: grown)."""
    dim = len(axes)
    length, in_metric = 0.0, 0.0
    for j in range(dim):
        along = 0.0
        for i in range(dim):
            along += r[p, i, j] * (x[q, i] - x[p, i])
        length += along * along
        in_metric += (along / h[p, j]) ** 2
    length, in_metric = math.sqrt(length), math.sqrt(in_metric)
    for j in range(dim):
        physical, metric = 1.0 + g * length / h[p, j], 1.0 + g * in_metric
        if law == PHYSICAL:
            grown[j] = h[p, j] * physical
        elif law == METRIC:
            grown[j] = h[p, j] * metric
        else:
            grown[j] = h[p, j] * physical**_MIXTURE * metric ** (1.0 - _MIXTURE)


@njit
def _sweep(axes, x, edges, h, r, g, law, grown, before, k, n):
    """Pass all edges once, in both directions (In/Out: h, r); return the largest change."""
    largest = 0.0
    for e in range(edges.shape[0]):
        for turn in range(2):
            p, q = edges[e, turn], edges[e, 1 - turn]
            if h[p, 0] >= 1e20:
                continue
            _grow(axes, x, p, q, h, r, g, law, grown)
            before[:] = h[q]
            intersect_into(axes, (h[q], r[q]), (grown, r[p]), k, n)
            for j in range(len(axes)):
                largest = max(largest, before[j] / h[q, j] - 1.0)
    return largest


def swept(mesh, metric, g, law):
    """Return the metric after sweeps, and their number."""
    h = np.where(np.isfinite(metric.sizes), metric.sizes, _UNBOUNDED)
    r = metric.directions.copy()
    dim = mesh.dim
    scratch = (np.empty(dim), np.empty(dim), np.empty((dim, dim)), np.empty((dim, dim)))
    change, sweeps = 1.0, 0
    while change > _CHANGE and sweeps < _SWEEPS:
        change = _sweep((0,) * dim, mesh.points, mesh.edges, h, r, g, law, *scratch)
        sweeps += 1
    return Metric(np.where(h < 1e20, h, np.inf), r), sweeps


@njit
def _two_by_two(axes, x, sources, h, r, g, law, h_all, r_all, grown, k, n):
    for v in range(x.shape[0]):
        for y in sources:
            _grow(axes, x, y, v, h, r, g, law, grown)
            intersect_into(axes, (h_all[v], r_all[v]), (grown, r[y]), k, n)


def two_by_two(mesh, metric, g, law, backwards=False):
    """Return the grown metrics of all nodes intersected two by two, in the order of the nodes."""
    points, dim = mesh.points, mesh.dim
    h_all, r_all = np.full(points.shape, _UNBOUNDED), np.tile(np.eye(dim), (len(points), 1, 1))
    sources = np.flatnonzero(np.isfinite(metric.sizes).all(axis=1))[:: -1 if backwards else 1]
    scratch = np.empty(dim), np.empty((dim, dim)), np.empty((dim, dim))
    _two_by_two((0,) * dim, points, sources.copy(), metric.sizes, metric.directions, g, law,
                h_all, r_all, *scratch)  # fmt: skip
    return Metric(h_all, r_all)
