"""Projection of boundary nodes onto the true boundary, as far as the cells allow."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, describe, refuse_where
from adaptsize.adaptation import tuning
from adaptsize.background import SimplexMesh, topology
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: Takes points near the boundary, float64[n, dim], and returns their projections onto it.
Projection: TypeAlias = Callable[[FloatArray], npt.ArrayLike]
ProjectionLike: TypeAlias = Projection | Mapping[int, Projection]


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
    """

    n_nodes: int
    n_corners: int
    n_shortened: int
    largest_move: float
    largest_rest: float

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


def check_projection(project: object) -> None:
    """Raise a ValueError unless ``project`` is None, a callable or maps tags to callables."""
    good = project is None or callable(project)
    if isinstance(project, Mapping):
        good = all(callable(p) and isinstance(t, int | np.integer) for t, p in project.items())
    if not good:
        raise ValueError(
            "project must be a callable that takes and returns points, or a mapping of boundary "
            f"tags to callables, got {describe(project)}"
        )


def move_to_boundary(
    mesh: SimplexMesh, project: ProjectionLike, corner_angle: float
) -> tuple[SimplexMesh, BoundaryMoves]:
    """Return the mesh with projected boundary nodes, and a report on the moves.

    Parameters
    ----------
    mesh : SimplexMesh
    project : callable, or mapping of int to callable
        A callable is used for all boundary nodes (for triangles in space: all nodes).  A mapping
        has one callable for the nodes of the facets with each tag.
    corner_angle : float
        Angle in degrees between two facets from which on their common nodes are not moved.

    Raises
    ------
    ValueError
        If ``project`` returns another shape, or numbers that are not finite.
    """
    facets, kind, projections = _facets_to_move(mesh, project)
    kept = _between_kinds(mesh.n_points, facets, kind) | _corners(mesh, facets, corner_angle)
    target = np.array(mesh.points)
    moving = np.zeros(mesh.n_points, np.bool_)
    for number, projection in enumerate(projections):
        nodes = np.unique(facets[kind == number])
        nodes = nodes[~kept[nodes]]
        moving[nodes] = True
        places = mesh.points[nodes]
        found = as_float_array("project(points)", projection(places), places.shape)
        refuse_where("project(points)", ~np.isfinite(found), found, "must be finite")
        target[nodes] = found
    on_any = np.unique(facets[kind >= 0])
    move = target - mesh.points
    length = np.linalg.norm(move, axis=1)
    n_nodes = int(np.count_nonzero(moving))
    moving &= length > 1e-12 * mesh.diagonal
    share = _allowed_shares(mesh, move, moving)
    report = BoundaryMoves(
        n_nodes=n_nodes,
        n_corners=int(np.count_nonzero(kept[on_any])),
        n_shortened=int(np.count_nonzero(share[moving] < 1.0)),
        largest_move=float((share * length).max(initial=0.0)),
        largest_rest=float(((1.0 - share) * length)[moving].max(initial=0.0)),
    )
    return mesh.moved(mesh.points + share[:, None] * move), report


def _facets_to_move(
    mesh: SimplexMesh, project: ProjectionLike
) -> tuple[IntArray, npt.NDArray[np.int64], list[Projection]]:
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


def _corners(mesh: SimplexMesh, facets: IntArray, angle: float) -> BoolArray:
    """Return which nodes lie where two facets meet at an angle, or more than two meet."""
    skin = SimplexMesh(mesh.points, facets)
    corner = np.zeros(mesh.n_points, np.bool_)
    count = skin.facet_cell_counts
    corner[skin.facets[count > 2]] = True
    if mesh.cell_dim < mesh.dim:  # the rim of a surface
        corner[skin.facets[count == 1]] = True
    width = facets.shape[1]
    across = [
        _height(mesh.points, facets, places // width, places % width)
        for places in topology.pairs_of_cells(skin, count == 2).T
    ]
    # Away from the common ridge on both sides: opposite where the boundary is flat.
    cosine = -np.einsum("nd,nd->n", *across)
    corner[skin.facets[count == 2][cosine < np.cos(np.radians(angle))]] = True
    return corner


def _height(
    points: FloatArray,
    facets: IntArray,
    rows: npt.NDArray[np.intp],
    opposite: npt.NDArray[np.intp],
) -> FloatArray:
    """Return unit vectors in facets to the given corners, across the opposite sides."""
    width = facets.shape[1]
    corners = points[facets[rows]]
    tip = corners[np.arange(len(rows)), opposite]
    foot = corners[np.arange(len(rows)), (opposite + 1) % width]
    height = tip - foot
    if width == 3:
        side = corners[np.arange(len(rows)), (opposite + 2) % width] - foot
        along = np.einsum("nd,nd->n", height, side) / np.einsum("nd,nd->n", side, side)
        height = height - along[:, None] * side
    length = np.linalg.norm(height, axis=1, keepdims=True)
    return np.asarray(height / np.maximum(length, np.finfo(float).tiny))


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
