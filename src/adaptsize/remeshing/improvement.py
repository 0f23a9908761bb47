"""Meshes after a generator: nodes that left the boundary, and the worst cells.

Mmg puts single nodes beside corners off the surface, by up to five times its tolerance.  They are
projected back, and the few edges that are still too far away get a node on the surface.  Then the
worst cells are repaired, see `boundary_repair`.  No node is moved onto the surface that spoils a
cell.  Nodes of straight feature edges stay on these.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.splitting import bisect_edges
from adaptsize.quality.elements import minimum_angles
from adaptsize.remeshing.boundary_repair import repaired
from adaptsize.remeshing.sizing import Size
from adaptsize.remeshing.straight_edges import StraightEdges
from adaptsize.remeshing.surface import facets_of
from adaptsize.remeshing.taken_back import take_back, worst_of_nodes
from adaptsize.typing import FloatArray, IntArray

_ROUNDS = 3
#: Nodes farther from the old surface than this share of the tolerance are projected, unless a cell
#: becomes worse than the least quality.
_FAR = 0.5
_LEAST = 0.2
#: The same in later rounds, after which the worst cells are repaired again.  On a scan and on a CAD
#: part, single edges stayed 1.7 and 1.9 tolerances away with the first only.
_LATER = (0.05, 0.01, 0.01, 0.003)
#: A round that leaves smaller angles than this, in degrees, and than before, is not kept.
_FLAT = 10.0
#: Edges of facets whose middle is farther from the old surface than this share of the tolerance are
#: divided, unless they are more than the other share, in space and in the plane.
_NEAR, _FEW, _FEW_IN_PLANE = 0.9, 0.02, 0.3


def improved(
    mesh: SimplexMesh, given: SimplexMesh, tolerance: float, size: Size | None = None
) -> SimplexMesh:
    """Return a mesh with facets within the tolerance and better worst cells, where possible.

    Parameters
    ----------
    mesh : SimplexMesh
        Tetrahedra of positive volume, or triangles.
    given : SimplexMesh
        The mesh or surface whose boundary and interfaces these must have.
    tolerance : float
        Allowed distance of boundary and interfaces, in the unit of the coordinates.
    size : callable, optional
        Requested lengths of edges.

    Returns
    -------
    SimplexMesh
        With the same regions and tags.
    """
    lines = StraightEdges(given)
    mesh = lines.straightened(mesh, tolerance)
    if mesh.cell_dim < mesh.dim:
        return repaired(mesh, given, tolerance, size)
    if mesh.dim == 2:
        mesh = _with_closer_edges(mesh, given, tolerance)
        return repaired(mesh, given, tolerance, size)
    old, surface = facets_of(given), facets_of(mesh)
    nodes = np.unique(surface.cells)
    distance = _nearest(old, mesh.points[nodes])[1]
    # With more nodes beyond the tolerance, the generator has made another surface, which projection
    # would only hide.
    if 0.0 < (distance > tolerance).mean() <= 0.2:
        points = mesh.points.copy()
        _pull(points, mesh.cells, nodes[distance > _FAR * tolerance], old)
        mesh, surface = mesh.moved(points), surface.moved(points)

    def made(mesh: SimplexMesh, surface: SimplexMesh, least: float) -> SimplexMesh:
        divided = _divided(mesh, surface, old, tolerance, lines, least)
        return repaired(divided, given, tolerance, size)

    return _in_rounds(mesh, surface, old, tolerance, made)


def _in_rounds(
    mesh: SimplexMesh,
    surface: SimplexMesh,
    old: SimplexMesh,
    tolerance: float,
    made: Callable[[SimplexMesh, SimplexMesh, float], SimplexMesh],
) -> SimplexMesh:
    """Return a mesh brought nearer to the old surface, until it is near or no nearer than before.

    ``made`` returns a better mesh for a mesh, its facets and a least quality of new cells.
    """
    before, best = len(surface.edges), mesh
    for least in (_LEAST, *_LATER):
        mesh = made(best, surface, least)
        if least < _LEAST and minimum_angles(mesh).min() < min(_FLAT, minimum_angles(best).min()):
            break
        nodes = np.unique(facets_of(mesh).cells)
        far = nodes[_nearest(old, mesh.points[nodes])[1] > tolerance]
        if len(far):
            points = mesh.points.copy()
            _pull(points, mesh.cells, far, old, least)
            mesh = mesh.moved(points)
        best, surface = mesh, facets_of(mesh)
        middles = surface.points[surface.edges].mean(axis=1)
        n_far = len(far) + int((_nearest(old, middles)[1] > tolerance).sum())
        n_far += len(np.unique(_missed(surface, old, tolerance)[1]))
        # Many are far where the sizes are coarse: nothing is divided there.
        if n_far == 0 or n_far >= before or n_far > _FEW * len(surface.edges):
            break
        before = n_far
    return best


def _with_closer_edges(mesh: SimplexMesh, given: SimplexMesh, tolerance: float) -> SimplexMesh:
    """Return plane triangles with nodes of the old boundary where edges are too far from it.

    Mmg moves nodes of curves along the edges that it has made, which takes them off the curve.
    Mmg leaves edges that are up to sqrt 2 times as long as the size, which then bulge by twice as
    much.  Edges of interfaces and tagged edges are divided, too.
    """
    old = facets_of(given)
    nodes = np.unique(facets_of(mesh).cells)
    far = nodes[_nearest(old, mesh.points[nodes])[1] > _FAR * tolerance]
    if len(far):
        points = mesh.points.copy()
        _pull(points, mesh.cells, far, old)
        mesh = mesh.moved(points)
    for _ in range(_ROUNDS):
        edges = facets_of(mesh).cells
        there, distance = _nearest(old, mesh.points[edges].mean(axis=1))
        is_far = distance > _NEAR * tolerance
        if not 0 < is_far.sum() <= _FEW_IN_PLANE * len(edges):
            break
        mesh = _with_nodes(mesh, edges[is_far], there[is_far])
    return mesh


def _divided(
    mesh: SimplexMesh,
    surface: SimplexMesh,
    old: SimplexMesh,
    tolerance: float,
    lines: StraightEdges,
    least: float,
) -> SimplexMesh:
    """Return the mesh with nodes of the old surface on edges of facets that are too far from it.

    Then edges near places of the old surface that the facets miss get a node there.  ``surface``
    are the facets of the mesh, and ``least`` is the least quality of cells.
    """
    for _ in range(_ROUNDS):
        there, distance = _nearest(old, surface.points[surface.edges].mean(axis=1))
        is_far = distance > _NEAR * tolerance
        centroids = surface.points[surface.cells].mean(axis=1)
        sides = surface.cell_facets[_nearest(old, centroids)[1] > _NEAR * tolerance]
        longest = surface.edge_lengths[sides].argmax(axis=1)
        is_far[sides[np.arange(len(sides)), longest]] = True
        if not 0 < is_far.sum() <= _FEW * len(surface.edges):
            break
        mesh = _with_nodes(mesh, surface.edges[is_far], there[is_far], least)
        surface = facets_of(mesh)
    for _ in range(_ROUNDS):
        places, cells = _missed(surface, old, tolerance)
        if not 0 < len(places) <= _FEW * len(old.edges):
            break
        sides = surface.cell_facets[cells]
        middles = surface.points[surface.edges[sides]].mean(axis=2)
        away = np.linalg.norm(middles - places[:, None], axis=2)
        away[lines.are_on(mesh)[surface.edges[sides]].all(axis=2)] = np.inf
        nearest = sides[np.arange(len(places)), away.argmin(axis=1)]
        able = np.flatnonzero(np.isfinite(away.min(axis=1)))
        edges, first = np.unique(nearest[able], return_index=True)  # the farthest place of each
        mesh = _with_nodes(mesh, surface.edges[edges], places[able[first]], least)
        surface = facets_of(mesh)
    return mesh


def _missed(
    surface: SimplexMesh, old: SimplexMesh, tolerance: float
) -> tuple[FloatArray, IntArray]:
    """Return nodes and middles of edges of the old surface that are too far from the new one.

    The farthest is first.  Also return the nearest new cells.
    """
    places = np.concatenate([old.points[np.unique(old.cells)], old.points[old.edges].mean(axis=1)])
    cells, _, distance = surface.locator.nearest(places)
    order = np.argsort(-distance)[: np.count_nonzero(distance > tolerance)]
    return places[order], cells[order]


def _with_nodes(
    mesh: SimplexMesh, edges: IntArray, there: FloatArray, least: float = _LEAST
) -> SimplexMesh:
    """Return the mesh with some of the edges divided, with nodes at the given points.

    An edge is not divided if a node there, even halfway, would spoil cells.
    """
    factors = np.array([mesh.n_points, 1])
    keys = np.sort(edges, axis=1).astype(np.int64) @ factors
    rows = np.searchsorted(mesh.edges.astype(np.int64) @ factors, keys)  # in increasing order
    target = np.full((len(mesh.edges), mesh.dim), np.nan)
    target[rows] = there
    split = bisect_edges(mesh, ~np.isnan(target[:, 0]))
    nodes = mesh.n_points + np.arange(len(split.split_edges))
    points, start = split.mesh.points.copy(), split.mesh.points
    kept = np.minimum(worst_of_nodes(start, split.mesh.cells), least)
    moved = np.zeros(len(nodes), np.bool_)
    for share in (1.0, 0.5):
        left = nodes[~moved]
        points[left] += share * (target[split.split_edges[~moved]] - points[left])
        take_back(points, split.mesh.cells, start, left, kept)
        moved = (points[nodes] != start[nodes]).any(axis=1)
    if not moved.all():
        rest = mesh.edges[split.split_edges[moved]]
        return _with_nodes(mesh, rest, points[nodes[moved]], least)
    return replace(split.mesh, points=points)


def _pull(
    points: FloatArray,
    cells: IntArray,
    nodes: IntArray,
    old: SimplexMesh,
    least: float = _LEAST,
) -> None:
    """Move nodes onto a surface, or halfway if cells would become worse than a least quality.

    Changes ``points``.
    """
    for share in (1.0, 0.5):
        start, kept = points.copy(), np.minimum(worst_of_nodes(points, cells), least)
        points[nodes] += share * (_nearest(old, points[nodes])[0] - points[nodes])
        take_back(points, cells, start, nodes, kept)


def _nearest(old: SimplexMesh, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the closest points of a surface, and their distances."""
    cells, weights, distance = old.locator.nearest(points)
    return np.einsum("ij,ijk->ik", weights, old.points[old.cells[cells]]), distance
