"""Projection of boundary nodes onto the true boundary, as far as the cells allow."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from adaptsize._checks import as_float_array, refuse_where
from adaptsize.adaptation import tuning
from adaptsize.adaptation.boundary_maps import BoundaryMap, BoundaryMaps
from adaptsize.background import SimplexMesh, topology
from adaptsize.background.interfaces import interfaces
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: Where facets meet at an angle, the projected surface is measured at this share of their heights.
#: A ridge of it turns there by the whole angle, a smooth surface by about this share of it.
_BESIDE = 0.2
#: Number of times that the moves of nodes inside are averaged: they reach some five cells far.
_SWEEPS = 30


@dataclass(frozen=True)
class BoundaryMoves:
    """Result of the projection of boundary nodes.

    Attributes
    ----------
    n_nodes : int
        Nodes that were projected.
    n_corners : int
        Nodes not moved: corners, ridges, and nodes between two projections.
    n_shortened : int
        Nodes whose moves were shortened to keep their cells valid.
    largest_move : float
        Largest displacement of a node.
    largest_rest : float
        Largest remaining distance from the projected position.
    idle : tuple of int, or of None
        Tags of the projections for which there are no nodes that may move; None for a single one.
    """

    n_nodes: int
    n_corners: int
    n_shortened: int
    largest_move: float
    largest_rest: float
    idle: tuple[int | None, ...] = ()

    def __str__(self) -> str:
        """Return one line."""
        text = (
            f"{self.n_nodes} nodes moved by up to {self.largest_move:.3g}, "
            f"{self.n_corners} corner and ridge nodes kept"
        )
        if self.n_shortened:
            text += (
                f"; {self.n_shortened} moves shortened to keep cells valid, "
                f"up to {self.largest_rest:.3g} remains"
            )
        return text


def move_to_boundary(
    mesh: SimplexMesh, project: BoundaryMaps, corner_angle: float
) -> tuple[SimplexMesh, BoundaryMoves]:
    """Return the mesh with projected boundary nodes, and a report on the moves.

    Parameters
    ----------
    mesh : SimplexMesh
    project : callable, or mapping of int to callable
        A callable is used for all boundary nodes (for triangles in space: all nodes).  A mapping
        has one callable for the nodes of the facets with each tag.
    corner_angle : float
        Angle in degrees between two facets from which on their common nodes are not moved, if the
        projected surface has the angle there, too.

    Raises
    ------
    ValueError
        If ``project`` returns another shape, or numbers that are not finite.
    """
    facets, kind, projections = _facets_to_move(mesh, project)
    kept = _between_kinds(mesh.n_points, facets, kind)
    kept |= _corners(mesh, (facets, kind), projections, corner_angle)
    target = np.array(mesh.points)
    moving = np.zeros(mesh.n_points, np.bool_)
    for number, projection in enumerate(projections):
        nodes = np.unique(facets[kind == number])
        nodes = nodes[~kept[nodes]]
        moving[nodes] = True
        target[nodes] = _projected(projection, mesh.points[nodes])
    on_any = np.unique(facets[kind >= 0])
    move = target - mesh.points
    length = np.linalg.norm(move, axis=1)
    n_nodes = int(np.count_nonzero(moving))
    moving &= length > 1e-12 * mesh.diagonal
    share = _allowed_shares(mesh, move, moving)
    if (share[moving] < 1.0).any():
        free = _free_nodes(mesh, facets)
        move = _followed(mesh, move, free)
        share = _allowed_shares(mesh, move, moving | free)
    tags = [None] if callable(project) else list(project)
    idle = [tag for i, tag in enumerate(tags) if kept[facets[kind == i]].all()]
    report = BoundaryMoves(
        n_nodes=n_nodes,
        n_corners=int(np.count_nonzero(kept[on_any])),
        n_shortened=int(np.count_nonzero(share[moving] < 1.0)),
        largest_move=float((share * length)[moving].max(initial=0.0)),
        largest_rest=float(((1.0 - share) * length)[moving].max(initial=0.0)),
        idle=tuple(idle),
    )
    return mesh.moved(mesh.points + share[:, None] * move), report


def _projected(projection: BoundaryMap, points: FloatArray) -> FloatArray:
    """Return the checked projections of points."""
    found = as_float_array("project(points)", projection(points.copy()), points.shape)
    refuse_where("project(points)", ~np.isfinite(found), found, "must be finite")
    return found


def _facets_to_move(
    mesh: SimplexMesh, project: BoundaryMaps
) -> tuple[IntArray, npt.NDArray[np.int64], list[BoundaryMap]]:
    """Return facets, the number of the projection of each (-1: none), and the projections."""
    if mesh.cell_dim < mesh.dim and callable(project):
        return mesh.cells, np.zeros(mesh.n_cells, np.int64), [project]
    facets = mesh.facets[mesh.facet_cell_counts == 1]
    if callable(project):
        return facets, np.zeros(len(facets), np.int64), [project]
    kind = np.full(len(facets), -1)
    if mesh.tagged_facets is not None and mesh.facet_tags is not None:
        tagged = np.sort(mesh.tagged_facets, axis=1)
        numbers = np.full(len(tagged), -1)
        for number, tag in enumerate(project):
            numbers[mesh.facet_tags == tag] = number
        # Tagged boundary facets occur twice.  Duplicates are dropped.
        rows = topology.unique_rows(np.concatenate([facets, tagged]), mesh.n_points)[1]
        single = ~np.isin(rows[: len(facets)], rows[len(facets) :])
        facets = np.concatenate([facets[single], tagged])
        kind = np.concatenate([kind[single], numbers])
    return facets, kind, list(project.values())


def _between_kinds(n: int, facets: IntArray, kind: npt.NDArray[np.int64]) -> BoolArray:
    """Return which nodes belong to facets of two kinds."""
    lowest, highest = np.full(n, np.iinfo(np.int64).max), np.full(n, -2)
    of_node = np.repeat(kind[:, None], facets.shape[1], axis=1)
    np.minimum.at(lowest, facets, of_node)
    np.maximum.at(highest, facets, of_node)
    return np.asarray((highest >= -1) & (lowest != highest))


def _corners(
    mesh: SimplexMesh,
    moved: tuple[IntArray, npt.NDArray[np.int64]],
    projections: list[BoundaryMap],
    angle: float,
) -> BoolArray:
    """Return which nodes lie where two facets meet at an angle, or more than two meet.

    Coarse facets of a smooth surface meet at angles, too, which the projected surface has not.
    """
    facets, kind = moved
    skin = SimplexMesh(mesh.points, facets)
    corner = np.zeros(mesh.n_points, np.bool_)
    count = skin.facet_cell_counts
    corner[skin.facets[count > 2]] = True
    if mesh.cell_dim < mesh.dim:  # the rim of a surface
        corner[skin.facets[count == 1]] = True
    width = facets.shape[1]
    rows, opposite = np.divmod(topology.pairs_of_cells(skin, count == 2).T, width)
    across = [_height(mesh.points, facets, *side) for side in zip(rows, opposite, strict=True)]
    # Away from the common ridge on both sides: opposite where the boundary is flat.
    turns = _is_turned(across[0], across[1], angle)
    ridges = skin.facets[count == 2]
    for number, projection in enumerate(projections):
        own = np.flatnonzero(turns & (kind[rows] == number).all(axis=0))
        if len(own) == 0:
            continue
        middle = mesh.points[ridges[own]].mean(axis=1)
        beside = [middle, *(middle + _BESIDE * height[own] for height in across)]
        there = _projected(projection, np.concatenate(beside)).reshape(3, len(own), mesh.dim)
        turns[own] = _is_turned(there[1] - there[0], there[2] - there[0], angle)
    corner[ridges[turns]] = True
    return corner


def _is_turned(one: FloatArray, other: FloatArray, angle: float) -> BoolArray:
    """Return whether vectors to both sides of a ridge are not opposite within an angle."""
    along = -np.einsum("nd,nd->n", one, other)
    lengths = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
    return np.asarray(along <= np.cos(np.radians(angle)) * lengths)


def _height(
    points: FloatArray,
    facets: IntArray,
    rows: npt.NDArray[np.intp],
    opposite: npt.NDArray[np.intp],
) -> FloatArray:
    """Return vectors in facets to the given corners, across the opposite sides."""
    width = facets.shape[1]
    corners = points[facets[rows]]
    tip = corners[np.arange(len(rows)), opposite]
    foot = corners[np.arange(len(rows)), (opposite + 1) % width]
    height = tip - foot
    if width == 3:
        side = corners[np.arange(len(rows)), (opposite + 2) % width] - foot
        along = np.einsum("nd,nd->n", height, side) / np.einsum("nd,nd->n", side, side)
        height = height - along[:, None] * side
    return np.asarray(height)


def _free_nodes(mesh: SimplexMesh, facets: IntArray) -> BoolArray:
    """Return which nodes are inside, on none of the facets and on no interface."""
    free = np.array(mesh.in_a_cell)
    free[facets] = False
    free[mesh.facets[mesh.facet_cell_counts == 1]] = False
    between = interfaces(mesh)
    if between is not None:
        free[between[1]] = False
    return free


def _followed(mesh: SimplexMesh, move: FloatArray, free: BoolArray) -> FloatArray:
    """Return moves of which free nodes take the mean of their neighbours, again and again.

    Cells at a boundary that moves by more than their height would be turned over if the nodes
    inside stayed.
    """
    i, j = np.concatenate([mesh.edges, mesh.edges[:, ::-1]]).T
    ones = np.ones(len(i))
    beside = csr_array((ones, (i, j)), shape=(mesh.n_points, mesh.n_points))[free]
    count = np.diff(beside.indptr)[:, None]
    followed = move.copy()
    for _ in range(_SWEEPS):
        followed[free] = beside @ followed / count
    return followed


def _allowed_shares(mesh: SimplexMesh, move: FloatArray, moving: BoolArray) -> FloatArray:
    """Return the share of each move that keeps all cells valid, 0 to 1."""
    share = np.where(moving, 1.0, 0.0)
    cells = mesh.cells[moving[mesh.cells].any(axis=1)]
    before = _shape(mesh.points, cells)
    while True:
        bad = _is_worse(before, _shape(mesh.points + share[:, None] * move, cells))
        if not bad.any():
            return share
        # A bad cell has a moving node, so this terminates: without moves all cells are valid.
        nodes = np.unique(cells[bad])
        share[nodes] = np.where(share[nodes] > tuning.LEAST_SHARE, 0.5 * share[nodes], 0.0)


def _shape(points: FloatArray, cells: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return measures as vectors (of one component but for triangles in space), and lengths^k."""
    corners = points[cells]
    edges = corners[:, 1:] - corners[:, :1]
    k = edges.shape[1]
    if k == edges.shape[2]:
        measure = np.linalg.det(edges)[:, None]
    else:
        measure = np.cross(edges[:, 0], edges[:, 1])
    square = (edges**2).sum(axis=(1, 2))
    for i, j in combinations(range(1, k + 1), 2):
        square += ((corners[:, i] - corners[:, j]) ** 2).sum(axis=1)
    return measure, square ** (0.5 * k)


def _is_worse(
    before: tuple[FloatArray, FloatArray], after: tuple[FloatArray, FloatArray]
) -> BoolArray:
    """Return which cells keep too little of their measure or of their quality."""
    old = np.linalg.norm(before[0], axis=1)
    along = np.einsum("nd,nd->n", before[0], after[0])  # a turned cell counts as small
    left = np.divide(along, old**2, out=np.ones_like(old), where=old > 0.0)
    shape = left * before[1] / np.maximum(after[1], np.finfo(float).tiny)
    return np.asarray((left < tuning.MEASURE_KEPT) | (shape < tuning.QUALITY_KEPT))
