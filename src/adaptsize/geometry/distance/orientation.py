"""Repair of the orientation of boundaries: all facets have the domain on the same side."""

from itertools import combinations
from typing import NamedTuple

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.merging import first_at_place, place_numbers
from adaptsize.background.topology import components_of, have_different_nodes, pairs_of_cells
from adaptsize.geometry import tuning
from adaptsize.geometry.boundary import facet_normals
from adaptsize.geometry.distance.winding import Rule, WindingNumber
from adaptsize.geometry.enclosed import cone_measures
from adaptsize.geometry.shells import FLAT, pieces_of, shells_of, surplus_of
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray, LongArray

# Points closer than this, relative to the diagonal, are one point.
MERGE_SHARE = 1e-9
# Nodes of a piece that are examined for being inside of others.
_MOST_SAMPLES = 200


def oriented(boundary: SimplexMesh) -> SimplexMesh:
    """Return a boundary whose normals point outward, as far as this can be determined.

    Coincident nodes are merged.  If the orientations of neighbouring facets are inconsistent, the
    minority (by area) is flipped.  If all pieces together enclose a negative volume, all are
    flipped.  Then those are flipped that enclose a negative volume, unless they are inside of
    others: cavities remain cavities.  Holes are allowed.  If more than two facets have an
    edge in common, those that bound what is outside make up the piece (see `shells_of`).

    Parameters
    ----------
    boundary : SimplexMesh
        Triangles in space, or segments in the plane; those of an outline run with the
        domain to their left.

    Returns
    -------
    SimplexMesh
        Nodes and cells keep their numbers; nodes that were merged into others are unused.
    """
    target = first_at_place(boundary.points, MERGE_SHARE * boundary.diagonal)
    cells = merged_cells(boundary.cells, target)
    is_clean = np.array_equal(cells, boundary.cells)
    merged = boundary if is_clean else SimplexMesh(boundary.points, cells)
    turned, piece, sign = _consistent(merged)
    volumes = sign * _volumes(merged, piece)
    of_piece = np.bincount(piece, volumes)
    of_piece[_are_sheets(merged, sign, piece)] = 0.0
    if of_piece.sum() < 0.0:
        turned, of_piece = ~turned, -of_piece
    turned ^= _stand_alone(merged, turned, piece, of_piece < 0.0)[piece]
    if not turned.any():
        return merged
    return SimplexMesh(merged.points, flipped_cells(merged.cells, turned))


def flipped_cells(cells: IntArray, turned: BoolArray) -> IntArray:
    """Return cells, some of them with the opposite orientation."""
    flipped = np.array(cells)
    flipped[turned, :2] = flipped[turned, 1::-1]
    return flipped


def _stand_alone(
    mesh: SimplexMesh, turned: BoolArray, piece: IndexArray, chosen: BoolArray
) -> BoolArray:
    """Return which of the chosen pieces have a node outside of all pieces that are not chosen."""
    alone = chosen.copy()
    if not chosen.any() or chosen.all():
        return alone
    cells = flipped_cells(mesh.cells, turned)
    winding = WindingNumber(SimplexMesh(mesh.points, cells[~chosen[piece]]))
    for k in np.flatnonzero(chosen):
        nodes = np.unique(cells[piece == k])
        samples = mesh.points[nodes[:: -(-len(nodes) // _MOST_SAMPLES)]]
        # Around nodes on the surface of another piece, the number is one half at most.
        alone[k] = bool((np.abs(winding(samples)) < 0.25).any())
    return alone


def merged_cells(cells: IntArray, target: IndexArray) -> IntArray:
    """Return the cells with merged nodes; cells that would degenerate keep their nodes."""
    new = target[cells].astype(np.int32)
    vanished = ~have_different_nodes(new)
    new[vanished] = cells[vanished]
    return new


def _consistent(mesh: SimplexMesh) -> tuple[BoolArray, IndexArray, FloatArray]:
    """Return which cells to flip, the piece of each cell, and 1, -1 for those that are flipped.

    The last is 0 for facets inside of a piece.
    """
    counts = mesh.facet_cell_counts
    if mesh.cell_dim == 1 or counts.max() <= 2 or counts.min() == 1:
        turned, piece = _consistent_with_neighbours(mesh)
        return turned, piece, np.where(turned, -1.0, 1.0)
    # Bodies that have edges in common: consistent as they are, or with facets between them.
    if is_cycle(mesh):
        return np.zeros(mesh.n_cells, np.bool_), pieces_of(mesh), np.ones(mesh.n_cells)
    surplus = surplus_of(mesh)
    if surplus.any():
        return np.zeros(mesh.n_cells, np.bool_), pieces_of(mesh), np.where(surplus, 0.0, 1.0)
    return _consistent_by_shells(mesh)


def _consistent_by_shells(mesh: SimplexMesh) -> tuple[BoolArray, IndexArray, FloatArray]:
    is_inner, inward = shells_of(mesh)
    piece = pieces_of(mesh)
    area = np.where(is_inner, 0.0, mesh.measures)
    total, against = np.bincount(piece, area), np.bincount(piece, np.where(inward, area, 0.0))
    turned = (inward ^ (against > 0.5 * total)[piece]) & ~is_inner
    return turned, piece, np.where(is_inner, 0.0, np.where(turned, -1.0, 1.0))


def _consistent_with_neighbours(mesh: SimplexMesh) -> tuple[BoolArray, IndexArray]:
    """Return which cells to flip, and the piece of each cell.

    Each cell is in a graph twice, flipped and not flipped.  Neighbours are joined in consistent
    states.  An orientable piece then has two components.
    """
    n, width = mesh.cells.shape
    cell, v = np.divmod(pairs_of_cells(mesh, mesh.facet_cell_counts == 2), width)
    # The direction of the facet opposite to a corner: its end, or whether its nodes ascend.
    forward = v == 0
    if width == 3:
        forward = mesh.cells[cell, (v + 1) % 3] < mesh.cells[cell, (v + 2) % 3]
    (one, other), same = cell.T, forward[:, 0] != forward[:, 1]
    ones = np.concatenate([one, one + n])
    others = np.concatenate([np.where(same, other, other + n), np.where(same, other + n, other)])
    label = components_of(np.column_stack([ones, others]), 2 * n)
    as_is, reversed_ = label[:n], label[n:]
    _, piece = np.unique(np.minimum(as_is, reversed_), return_inverse=True)
    # Of the two components of a piece, take the one in which less area is flipped.
    kept = np.bincount(as_is, mesh.measures, 2 * n)
    turned = kept[reversed_] > kept[as_is]
    ties = (kept[reversed_] == kept[as_is]) & (reversed_ < as_is)
    return turned | ties, piece.reshape(-1)


def _volumes(mesh: SimplexMesh, piece: IndexArray) -> FloatArray:
    """Return the contribution of each cell to the volume of its piece."""
    corners = mesh.points[mesh.cells]
    count = np.bincount(piece)
    middle = np.stack(
        [np.bincount(piece, x) / count for x in corners.mean(axis=1).T], axis=1
    )  # as many rows as pieces
    return cone_measures(mesh, middle[piece][:, None, :])


def _are_sheets(mesh: SimplexMesh, sign: FloatArray, piece: IndexArray) -> BoolArray:
    """Return which pieces enclose nothing; for closed ones, normals times areas sum to zero."""
    normals = facet_normals(mesh.points[mesh.cells]) / mesh.cell_dim
    total = np.stack([np.bincount(piece, sign * x) for x in normals.T], axis=1)
    area = np.bincount(piece, np.abs(sign) * mesh.measures)
    return np.asarray(np.linalg.norm(total, axis=1) > tuning.SHEET * area)


def winding_of(surface: SimplexMesh) -> tuple[WindingNumber, Rule]:
    """Return the winding number of an oriented surface, and the rule for its solid."""
    sides = _sides_of(surface)
    if _are_outward(surface, sides):  # nothing to orient, which takes several times as long
        return WindingNumber(surface), Rule(is_closed=True, is_signed=True)
    surface = oriented(surface)
    return WindingNumber(surface), rule_of(surface)


def rule_of(surface: SimplexMesh) -> Rule:
    """Return the rule for the solid of an oriented surface."""
    sides = _sides_of(surface)
    is_closed = sides.are_paired
    return Rule(is_closed, is_closed and (sides.are_single or _are_turned_as_one(surface)))


def _are_turned_as_one(surface: SimplexMesh) -> bool:
    """Return whether edges in two facets connect all facets that others connect.

    Then no piece is oriented otherwise than one that it touches.  Facets with the same nodes do not
    count: if their normals are opposite, they enclose nothing; else they have the orientation of
    those around them.
    """
    kept, is_alone = _without_opposite(same_places(surface.points, surface.cells)[surface.cells])
    if not kept.any():
        return False
    sides = _sides_of(SimplexMesh(surface.points, surface.cells[kept]))
    first = np.flatnonzero(np.diff(sides.start, prepend=-1))
    is_only = first[np.diff(first, append=len(sides.start)) == 1]
    between = np.column_stack([sides.at_start, sides.at_end])
    piece = components_of(between[is_only], int(kept.sum()))
    counted = is_alone[kept][between]
    least = np.where(counted, piece[between], len(piece)).min(axis=1)
    most = np.where(counted, piece[between], -1).max(axis=1)
    # Whichever of the facets of an edge belong together, they are of one piece.
    return bool((np.maximum.reduceat(most, first) <= np.minimum.reduceat(least, first)).all())


def _without_opposite(cells: IntArray) -> tuple[BoolArray, BoolArray]:
    """Return the cells without pairs of opposite ones, and which of these no other one repeats."""
    order = np.argsort(cells, axis=1)
    swaps = sum(order[:, i] > order[:, j] for i, j in combinations(range(cells.shape[1]), 2))
    sign = np.where(swaps % 2 == 0, 1, -1)
    nodes = np.take_along_axis(cells, order, axis=1)
    group = np.unique(nodes, axis=0, return_inverse=True)[1].reshape(-1)
    balance = np.bincount(group, sign)[group]
    left = np.flatnonzero(sign * balance > 0)
    left = left[np.argsort(group[left], kind="stable")]
    first = np.flatnonzero(np.diff(group[left], prepend=-1))
    place = np.arange(len(left)) - np.repeat(first, np.diff(first, append=len(left)))
    kept = np.zeros(len(cells), np.bool_)
    kept[left[place < np.abs(balance[left])]] = True
    return kept, np.abs(balance) == 1


def is_cycle(surface: SimplexMesh) -> bool:
    """Return whether the oriented facets have no boundary, so that winding numbers are integers.

    Coincident nodes are identified.
    """
    return _sides_of(surface).are_paired


class _Sides(NamedTuple):
    """The edges of the facets, of segments the nodes, in both directions.

    ``start`` and ``end`` are the sorted keys of the two directions, ``at_start`` and ``at_end`` the
    facets that have them.
    """

    start: LongArray
    end: LongArray
    at_start: IndexArray
    at_end: IndexArray

    @property
    def are_paired(self) -> bool:
        """Whether each edge has as many facets in the one direction as in the other."""
        return np.array_equal(self.start, self.end)

    @property
    def are_single(self) -> bool:
        """Whether each edge is in two facets, one in each direction."""
        return self.are_paired and bool((np.diff(self.start) > 0).all())


def _sides_of(surface: SimplexMesh) -> _Sides:
    cells = same_places(surface.points, surface.cells)[surface.cells].astype(np.int64)
    start, end, per_cell = cells[:, 0], cells[:, 1], 1
    if surface.cell_dim == 2:
        after = np.roll(cells, -1, axis=1)
        n, per_cell = surface.n_points, 3
        start, end = (cells * n + after).ravel(), (after * n + cells).ravel()
    one, other = np.argsort(start), np.argsort(end)
    return _Sides(start[one], end[other], one // per_cell, other // per_cell)


def _are_outward(surface: SimplexMesh, sides: _Sides) -> bool:
    """Return whether each edge is in two facets, in both directions, and each piece has a volume.

    `oriented` would turn nothing then.
    """
    if not sides.are_single:
        return False
    piece = components_of(np.column_stack([sides.at_start, sides.at_end]), surface.n_cells)
    volumes = np.bincount(piece, cone_measures(surface, surface.points.mean(axis=0)))
    area = np.bincount(piece, surface.measures)
    return bool((volumes > FLAT * area * surface.diagonal).all())


def same_places(points: FloatArray, cells: IntArray) -> IntArray:
    """Return for each point the number of its place, from 0; coincident points have the same.

    Points coincide if they differ by rounding relative to the extent of the points of cells.
    """
    used = points[cells]
    extent = float(np.linalg.norm(used.max(axis=(0, 1)) - used.min(axis=(0, 1))))
    # Corners closer to each other, in diagonals of the mesh, coincide when edges are matched.
    return place_numbers(points, 1e-9 * extent).astype(np.int32)
