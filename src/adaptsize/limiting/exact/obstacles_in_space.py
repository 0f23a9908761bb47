"""The boundary of a solid: lines of sight, and its reflex edges, with straight chains merged."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize._kernels.space_network import GRAZING
from adaptsize._kernels.space_paths import Edges
from adaptsize._kernels.space_sight import Sight, Stars, Walls, fill_stars
from adaptsize.background._curve import along_curve, boxes_over
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.topology import components_of, places_among
from adaptsize.geometry.boundary import facet_normals
from adaptsize.geometry.convexity import Ridges, cross, norms
from adaptsize.geometry.flat_faces import diagonal_of
from adaptsize.typing import BoolArray, FloatArray, IntArray

# Distances below this share of the diagonal are zero.
_SLACK = 1e-11


# Cells with a smaller ratio of volume to the cube of the longest edge have no volume.
_NO_VOLUME = 1e-12


class FacetShapes(NamedTuple):
    """What is measured at the facets of a boundary."""

    units: FloatArray
    """float64[f, 3]: unit normals."""
    areas: FloatArray
    """float64[f]: twice the areas."""
    heights: FloatArray
    """float64[f]: the least heights."""
    diagonal: float
    """Of the domain."""
    rounding: float
    """The rounding error of a coordinate."""

    @property
    def thin(self) -> BoolArray:
        """Facets without an area."""
        return self.heights <= _NO_VOLUME * self.diagonal


def measure_facets(points: FloatArray, facets: IntArray) -> FacetShapes:
    """Return normals, areas and heights of facets."""
    corners = points[facets]
    normals = facet_normals(corners)
    areas = norms(normals)
    a, b, c = (norms(corners[:, v] - corners[:, v - 1]) for v in range(3))
    longest = np.maximum(np.maximum(a, b), c)
    heights = np.divide(areas, longest, out=np.zeros_like(areas), where=longest > 0.0)
    normals /= np.maximum(areas, 1e-300)[:, None]
    rounding = float(np.finfo(float).eps * np.abs(corners).max())
    return FacetShapes(normals, areas, heights, diagonal_of(points, facets), rounding)


def build_sight(
    points: FloatArray, cells: IntArray, facets: IntArray, shapes: FacetShapes
) -> Sight:
    """Return the boundary of tetrahedra, for lines of sight."""
    order = np.flatnonzero(~shapes.thin)
    order = order[along_curve(points[facets[order]].mean(axis=1))]
    corners, units, heights = points[facets[order]], shapes.units[order], shapes.heights[order]
    area, slack = shapes.areas[order, None], _SLACK * shapes.diagonal
    triangles = [
        corners[:, 0],
        units,
        cross(corners[:, 2] - corners[:, 0], units) / area,
        cross(units, corners[:, 1] - corners[:, 0]) / area,
        # The normal of a sliver is uncertain, and so is the side on which a distant point lies.
        np.maximum(slack, 4.0 * shapes.rounding * shapes.diagonal / heights),
        np.minimum(slack / heights, 1e-3),
    ]
    lower, upper = (
        f(f(corners[:, 0], corners[:, 1]), corners[:, 2]) for f in (np.minimum, np.maximum)
    )
    boxes = boxes_over(lower, upper, np.zeros(len(order)))
    walls = Walls(np.column_stack(triangles), boxes, slack)
    return Sight(walls, _stars_at(points, cells, _nodes_of(facets, len(points))))


def _nodes_of(cells: IntArray, n: int) -> IntArray:
    """Return the nodes of some cells, ascending: faster than by sorting."""
    used = np.zeros(n, np.bool_)
    used[cells] = True
    return np.flatnonzero(used).astype(np.int32)


def _stars_at(points: FloatArray, cells: IntArray, nodes: IntArray) -> Stars:
    """Return the cells with a volume at boundary nodes."""
    rows = places_among(nodes, len(points))
    first = np.empty(len(nodes) + 1, np.int32)
    star = np.empty((int(np.count_nonzero(rows[cells] >= 0)), 3), np.int32)
    points = read_only(points)
    fill_stars(points, read_only(cells), rows, _NO_VOLUME, first, star)
    return Stars(points, rows, first, star)


class _Turns(NamedTuple):
    """How the boundary turns at its edges."""

    is_reflex: BoolArray
    is_sharp: BoolArray
    """Whether the number of facets is not two, or the two facets are not in one plane."""
    is_odd: BoolArray
    """Whether the number of facets with an area is not two."""


class Pieces(NamedTuple):
    """Reflex edges between successive nodes, edge by edge."""

    edge: IntArray
    """int32[p]"""
    nodes: IntArray
    """int32[p, 2]: indices in ``ReflexEdges.nodes``."""
    ends: FloatArray
    """float64[p, 2]: the places of these nodes along the edge."""


class ReflexEdges(NamedTuple):
    """Reflex edges and their nodes."""

    nodes: IntArray
    """int32[k]: nodes of reflex and odd edges, along a Morton curve."""
    edges: Edges
    obstacles: FloatArray
    """float64[e, 3]: direction from each edge to the outside."""
    pieces: Pieces


def _turns_at(ridges: Ridges, points: FloatArray, shapes: FacetShapes) -> _Turns:
    """Return the turn of a boundary at each of its edges."""
    left, right = ridges.facets.T
    is_odd = ~ridges.regular | shapes.thin[ridges.facets].any(axis=1)
    to_apex = points[ridges.apex[:, 1]] - points[ridges.ends[:, 0]]
    rise = np.einsum("ra,ra->r", shapes.units[left], to_apex)
    height = np.maximum(shapes.heights[left], 1e-300)
    nil = 16.0 * shapes.rounding * (1.0 + norms(to_apex) / height)
    is_flat = np.abs(rise) <= nil
    is_crack = is_flat.copy()
    flat = np.flatnonzero(is_flat)
    units = shapes.units[left[flat]], shapes.units[right[flat]]
    is_crack[flat] = np.einsum("ra,ra->r", *units) < 0.0
    is_reflex = ((rise > nil) | is_crack) & ~is_odd
    return _Turns(is_reflex, is_odd | is_crack | ~is_flat, is_odd)


def _sides_of(
    ridges: Ridges, which: IntArray, points: FloatArray, shapes: FacetShapes
) -> tuple[FloatArray, FloatArray]:
    """Return the normals of both facets at some edges, and the direction to the outside."""
    ends = ridges.ends[which]
    along = points[ends[:, 1]] - points[ends[:, 0]]
    along /= np.maximum(norms(along), 1e-300)[:, None]
    to_apex = points[ridges.apex[which]] - points[ends[:, :1]]
    in_face = to_apex - np.einsum("rsa,ra->rs", to_apex, along)[:, :, None] * along[:, None]
    in_face /= np.maximum(np.linalg.norm(in_face, axis=2), 1e-300)[:, :, None]
    normals = shapes.units[ridges.facets[which]]
    return normals, normals.sum(axis=1) + in_face.sum(axis=1)


def _chains_of(points: FloatArray, every: IntArray, turns: _Turns, slack: float) -> IntArray:
    """Return for each reflex edge the number of the straight chain that it belongs to.

    ``every``: int32[r, 2], the ends of all edges.  A chain continues through nodes that have no
    other edge between facets of different planes.
    """
    ends = every[turns.is_reflex]
    n = len(points)
    sharp = np.bincount(every[turns.is_sharp].ravel(), minlength=n)
    reflex = np.bincount(ends.ravel(), minlength=n)
    number = np.tile(np.arange(len(ends)), 2)
    flat = ends.T.ravel()
    passed = (sharp[flat] == 2) & (reflex[flat] == 2)
    order = np.argsort(flat[passed], kind="stable")
    pairs = number[passed][order].reshape(-1, 2)
    along = points[ends[:, 1]] - points[ends[:, 0]]
    along /= np.linalg.norm(along, axis=1)[:, None]
    turn = np.linalg.norm(cross(along[pairs[:, 0]], along[pairs[:, 1]]), axis=1)
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


def find_reflex_edges(
    ridges: Ridges, points: FloatArray, shapes: FacetShapes, slack: float
) -> ReflexEdges:
    """Return the reflex edges of a boundary, with straight chains merged, and their nodes."""
    turns = _turns_at(ridges, points, shapes)
    chain = _chains_of(points, ridges.ends, turns, slack)
    ends = ridges.ends[turns.is_reflex]
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
    reflex = np.flatnonzero(turns.is_reflex)[rep].astype(np.int32)
    normals, outwards = _sides_of(ridges, reflex, points, shapes)
    edges = Edges(origin + lowest[:, None] * along, along, highest - lowest, normals)
    nodes = _nodes_of(ridges.ends[turns.is_reflex | turns.is_odd], len(points))
    nodes = nodes[along_curve(points[nodes])]
    number = np.zeros(len(points), np.int32)
    number[nodes] = np.arange(len(nodes))
    pairs = number[ends].ravel().astype(np.int64) * max(1, n_edges) + np.repeat(chain, 2)
    corner, edge = (a.astype(np.int32) for a in np.divmod(np.unique(pairs), max(1, n_edges)))
    place = np.einsum("pa,pa->p", points[nodes[corner]] - edges.start[edge], along[edge])
    order = np.lexsort((place, edge))
    same = np.flatnonzero(edge[order[1:]] == edge[order[:-1]])
    first, last = order[same], order[same + 1]
    spans = np.column_stack([place[first], place[last]])
    both = np.column_stack([corner[first], corner[last]])
    pieces = Pieces(edge[first], both, spans)
    return ReflexEdges(nodes, edges, outwards, pieces)
