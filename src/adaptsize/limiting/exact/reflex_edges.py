"""The reflex edges of a solid, with straight chains merged, and their nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from adaptsize._kernels.space_bends import Edges
from adaptsize.background._curve import along_curve
from adaptsize.background.topology import components_of, unique_rows
from adaptsize.geometry.boundary import FlatBoundary
from adaptsize.limiting.exact.space_sight import NO_VOLUME, heights_of, scales_of
from adaptsize.typing import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# Angles between a path and the faces of an edge below this are zero.
GRAZING = 1e-9


class _Ridges(NamedTuple):
    """Edges of the boundary."""

    ends: IntArray
    """int32[r, 2]"""
    normals: FloatArray
    """float64[r, 2, 3]: unit normals of the two facets there."""
    inner: FloatArray
    """float64[r, 3]: direction from a reflex edge to the outside."""
    is_reflex: BoolArray
    is_sharp: BoolArray
    """Whether the number of facets is not two, or the two facets are not in one plane."""
    is_odd: BoolArray
    """Whether the number of facets with an area is not two."""


class Knots(NamedTuple):
    """Reflex edges and their nodes."""

    nodes: IntArray
    """int32[k]: nodes of reflex and odd edges, along a Morton curve."""
    edges: Edges
    obstacles: FloatArray
    """float64[e, 3]: direction from each edge to the outside."""
    knot: IntArray
    """int32[p], with ``edge``: pairs of a node and an edge on which it lies."""
    edge: IntArray
    beside: csr_array
    """(e, e): the common node of two edges, as an index in ``nodes`` plus 1."""


def _ridges_of(points: FloatArray, facets: IntArray) -> _Ridges:
    """Return the edges of a boundary and the turn of the boundary at each."""
    corners = points[facets]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    heights = heights_of(corners, areas)
    diagonal, rounding = scales_of(points, facets)
    thin = heights <= NO_VOLUME * diagonal
    units = np.where(thin[:, None], 0.0, normals / np.where(thin, 1.0, areas)[:, None])
    ends = np.concatenate([facets[:, [v, (v + 1) % 3]] for v in range(3)])
    apex = np.concatenate([facets[:, (v + 2) % 3] for v in range(3)])
    owner = np.tile(np.arange(len(facets)), 3)
    forward = ends[:, 0] < ends[:, 1]
    edges, number = unique_rows(ends, len(points))
    is_odd = (np.bincount(number) != 2) | (np.bincount(number, weights=forward) != 1.0)
    sides = np.zeros((len(edges), 2), np.int64)
    sides[number[forward], 0] = np.flatnonzero(forward)
    sides[number[~forward], 1] = np.flatnonzero(~forward)
    is_odd |= thin[owner[sides]].any(axis=1)

    along = points[edges[:, 1]] - points[edges[:, 0]]
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
    to_apex = points[apex[sides]] - points[edges[:, :1]]
    in_face = to_apex - np.einsum("rsa,ra->rs", to_apex, along)[:, :, None] * along[:, None]
    in_face /= np.maximum(np.linalg.norm(in_face, axis=2), 1e-300)[:, :, None]
    normal = units[owner[sides]]
    rise = np.einsum("ra,ra->r", normal[:, 0], to_apex[:, 1])
    reach = np.linalg.norm(to_apex[:, 1], axis=1)
    height = np.maximum(heights[owner[sides[:, 0]]], 1e-300)
    nil = 16.0 * rounding * (1.0 + reach / height)
    is_crack = (np.abs(rise) <= nil) & (np.einsum("ra,ra->r", normal[:, 0], normal[:, 1]) < 0.0)
    is_reflex = ((rise > nil) | is_crack) & ~is_odd
    inner = normal.sum(axis=1) + in_face.sum(axis=1)
    is_sharp = is_odd | is_crack | (np.abs(rise) > nil)
    return _Ridges(edges, normal, inner, is_reflex, is_sharp, is_odd)


def _chains_of(points: FloatArray, ridges: _Ridges, slack: float) -> IntArray:
    """Return for each reflex edge the number of the straight chain that it belongs to.

    A chain continues through nodes that have no other edge between facets of different planes.
    """
    ends = ridges.ends[ridges.is_reflex]
    n = len(points)
    sharp = np.bincount(ridges.ends[ridges.is_sharp].ravel(), minlength=n)
    reflex = np.bincount(ends.ravel(), minlength=n)
    number = np.tile(np.arange(len(ends)), 2)
    flat = ends.T.ravel()
    passed = (sharp[flat] == 2) & (reflex[flat] == 2)
    order = np.argsort(flat[passed], kind="stable")
    pairs = number[passed][order].reshape(-1, 2)
    along = points[ends[:, 1]] - points[ends[:, 0]]
    along /= np.linalg.norm(along, axis=1)[:, None]
    turn = np.linalg.norm(np.cross(along[pairs[:, 0]], along[pairs[:, 1]]), axis=1)
    chain = components_of(pairs[turn < GRAZING], len(ends))
    # Chains that are not straight are split into their edges.
    first = np.zeros(chain.max(initial=-1) + 1, np.int64)
    first[chain[::-1]] = np.arange(len(ends))[::-1]
    rep = first[chain]
    away = points[ends] - points[ends[rep, 0]][:, None]
    away -= np.einsum("rsa,ra->rs", away, along[rep])[:, :, None] * along[rep][:, None]
    bent = np.zeros(len(first), bool)
    bent[chain[(np.linalg.norm(away, axis=2) > 0.1 * slack).any(axis=1)]] = True
    loose = bent[chain]
    chain[loose] = len(first) + np.arange(np.count_nonzero(loose))
    return np.unique(chain, return_inverse=True)[1].ravel().astype(np.int32)


def find_knots(points: FloatArray, boundary: FlatBoundary, slack: float) -> Knots:
    """Return the reflex edges of a boundary, with straight chains merged, and their nodes."""
    from scipy.sparse import csr_array

    ridges = _ridges_of(points, boundary.facets)
    chain = _chains_of(points, ridges, slack)
    ends = ridges.ends[ridges.is_reflex]
    n_edges = chain.max(initial=-1) + 1
    rep = np.zeros(n_edges, np.int64)
    rep[chain[::-1]] = np.arange(len(ends))[::-1]
    origin = points[ends[rep, 0]]
    along = points[ends[rep, 1]] - origin
    along /= np.linalg.norm(along, axis=1)[:, None]
    place = np.einsum("rsa,ra->rs", points[ends] - origin[chain][:, None], along[chain])
    lowest, highest = np.full(n_edges, np.inf), np.full(n_edges, -np.inf)
    np.minimum.at(lowest, chain, place.min(axis=1))
    np.maximum.at(highest, chain, place.max(axis=1))
    reflex = np.flatnonzero(ridges.is_reflex)[rep]
    edges = Edges(
        origin + lowest[:, None] * along,
        along,
        highest - lowest,
        np.ascontiguousarray(ridges.normals[reflex]),
    )
    nodes = np.unique(ridges.ends[ridges.is_reflex | ridges.is_odd]).astype(np.int32)
    nodes = nodes[along_curve(points[nodes])]
    number = np.zeros(len(points), np.int32)
    number[nodes] = np.arange(len(nodes))
    pairs = np.unique(np.column_stack([number[ends].ravel(), np.repeat(chain, 2)]), axis=0)
    knot, edge = np.ascontiguousarray(pairs.T.astype(np.int32))
    ones = np.ones(len(knot))
    lies_on = csr_array((ones, (knot, edge)), shape=(len(nodes), n_edges))
    named = csr_array((ones + knot, (edge, knot)), shape=(n_edges, len(nodes)))
    beside = (named @ lies_on).astype(np.int64)
    beside.setdiag(0)
    beside.eliminate_zeros()
    return Knots(nodes, edges, ridges.inner[reflex], knot, edge, beside)
