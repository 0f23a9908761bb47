"""Meshes after a generator: nodes that left the boundary, and the worst tetrahedra.

Mmg puts single nodes beside corners off the surface, by up to five times its tolerance.  They are
projected back, and the few edges that are still too far away get a node on the surface.  Then edges
and faces of the worst cells are swapped, each region on its own, and nodes are moved: inside of
regions freely, on smooth boundaries and interfaces along these.  No move is kept that makes the
worst cell around a node worse or brings a facet farther away than the tolerance, and no pass that
lowers the least angle or the least radius ratio of the mesh.  Nodes of straight feature edges stay
on these.  In the plane, nodes are projected back and edges get nodes.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.smoothing import smooth_nodes
from adaptsize.background import SimplexMesh, topology
from adaptsize.background.splitting import bisect_edges
from adaptsize.geometry.creases import normals_of
from adaptsize.quality.elements import minimum_angles, radius_ratios
from adaptsize.remeshing.distmesh.finish import swapped, take_back, worst_of_nodes
from adaptsize.remeshing.preparation import facet_numbers, number_regions
from adaptsize.remeshing.straight_edges import StraightEdges
from adaptsize.remeshing.surface import facets_of
from adaptsize.typing import BoolArray, FloatArray, IntArray

_ROUNDS = 3
#: Nodes farther from the old surface than this share of the tolerance are projected, unless a cell
#: becomes worse than the least quality.  Moves along a surface are not kept if a facet gets farther
#: away than that and than before.
_FAR = 0.5
_LEAST = 0.2
#: Edges of facets whose middle is farther from the old surface than this share of the tolerance are
#: divided, unless they are more than the other share, in space and in the plane.
_NEAR, _FEW, _FEW_IN_PLANE = 0.9, 0.02, 0.3
#: Cosine of the angle between a facet and the plane at a node up to which a surface is smooth, and
#: up to which nodes are moved along it if nothing else helps.
_SMOOTH, _ROUGH = 0.97, 0.3


def improved(mesh: SimplexMesh, given: SimplexMesh, tolerance: float) -> SimplexMesh:
    """Return a mesh with facets within the tolerance, where that is possible.

    Tetrahedra get better cells, too.  In surfaces, only nodes of straight feature edges are moved.

    Parameters
    ----------
    mesh : SimplexMesh
        Tetrahedra of positive volume, or triangles.
    given : SimplexMesh
        The mesh or surface whose boundary and interfaces these must have.
    tolerance : float
        Allowed distance of boundary and interfaces, in the unit of the coordinates.

    Returns
    -------
    SimplexMesh
        With the same tags and the same facets, but that those are divided which are too far, and
        with the same nodes, some of them moved.
    """
    lines = StraightEdges(given)
    mesh = lines.straightened(mesh, tolerance)
    if mesh.cell_dim < mesh.dim:
        return mesh
    if mesh.dim == 2:
        return _with_closer_edges(mesh, given, tolerance)
    old, surface = facets_of(given), facets_of(mesh)
    nodes = np.unique(surface.cells)
    distance = _nearest(old, mesh.points[nodes])[1]
    # With more nodes beyond the tolerance, the generator has made another surface, which projection
    # would only hide.
    if 0.0 < (distance > tolerance).mean() <= 0.2:
        points = mesh.points.copy()
        _pull(points, mesh.cells, nodes[distance > _FAR * tolerance], old)
        mesh, surface = mesh.moved(points), surface.moved(points)
    mesh, surface = _divided(mesh, surface, old, tolerance, lines)
    points, cells = mesh.points.copy(), mesh.cells
    groups = np.zeros(len(cells), np.int32) if mesh.cell_tags is None else mesh.cell_tags
    on_sheet, on_lines = _nodes_of_sheets(mesh), lines.are_on(mesh)
    far = np.unique(surface.cells)
    far = far[_nearest(old, points[far])[1] > tolerance]
    qualities = _qualities(mesh)
    best, wider = qualities.min(axis=0), 0
    kept: tuple[FloatArray, IntArray, IntArray] | None = None
    fewest, n_missed = len(far), len(_missed(surface, old, tolerance)[0])
    for _ in range(8):
        bad = qualities[:, 0] < 20.0
        if not (bad.any() or len(far)) or wider > 2:
            break
        is_moved = topology.marked(np.union1d(cells[bad], far), len(points))
        for _ in range(wider):  # the neighbours must move, too
            is_moved[cells[is_moved[cells].any(axis=1)]] = True
        near = is_moved[cells].any(axis=1)
        is_moved &= ~on_lines
        least = _SMOOTH if wider == 0 else _ROUGH
        part, of_part = _swapped(points, cells[near], groups[near], on_sheet)
        points = points.copy()
        _move(points, part, np.flatnonzero(is_moved), surface, old, tolerance, least)
        far = far[_pull(points, part, far, old) > tolerance]
        cells = np.concatenate([cells[~near], part])
        groups = np.concatenate([groups[~near], of_part])
        of_cells = _qualities(SimplexMesh(points, part))
        qualities = np.concatenate([qualities[~near], of_cells])
        worst = qualities.min(axis=0)
        wider += int(worst[0] < best[0] + 0.1)
        is_better = len(far) < fewest or (len(far) == fewest and (worst >= best).all())
        # Only nodes on rough surfaces may leave the old one in the other direction.
        if is_better and least == _ROUGH:
            is_better = len(_missed(surface.moved(points), old, tolerance)[0]) <= n_missed
        if is_better:
            kept, fewest, best = (points, cells, groups), len(far), worst
    if kept is None:
        return mesh
    points, cells, groups = kept
    tags = None if mesh.cell_tags is None else groups
    return replace(mesh, points=points, cells=cells, cell_tags=tags)


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


def _qualities(mesh: SimplexMesh) -> FloatArray:
    """Return the smallest angle and the radius ratio of each cell, float64[n, 2]."""
    return np.column_stack([minimum_angles(mesh), radius_ratios(mesh)])


def _divided(
    mesh: SimplexMesh,
    surface: SimplexMesh,
    old: SimplexMesh,
    tolerance: float,
    lines: StraightEdges,
) -> tuple[SimplexMesh, SimplexMesh]:
    """Return the mesh with nodes of the old surface on edges of facets that are too far from it.

    Then edges near places of the old surface that the facets miss get a node there.  Also return
    the facets of the mesh; ``surface`` are those before.
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
        mesh = _with_nodes(mesh, surface.edges[is_far], there[is_far])
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
        mesh = _with_nodes(mesh, surface.edges[edges], places[able[first]])
        surface = facets_of(mesh)
    return mesh, surface


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


def _with_nodes(mesh: SimplexMesh, edges: IntArray, there: FloatArray) -> SimplexMesh:
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
    least = np.minimum(worst_of_nodes(start, split.mesh.cells), _LEAST)
    moved = np.zeros(len(nodes), np.bool_)
    for share in (1.0, 0.5):
        left = nodes[~moved]
        points[left] += share * (target[split.split_edges[~moved]] - points[left])
        take_back(points, split.mesh.cells, start, left, least)
        moved = (points[nodes] != start[nodes]).any(axis=1)
    if not moved.all():
        return _with_nodes(mesh, mesh.edges[split.split_edges[moved]], points[nodes[moved]])
    return replace(split.mesh, points=points)


def _nodes_of_sheets(mesh: SimplexMesh) -> BoolArray:
    """Return which nodes are on tagged facets with the same region on both sides."""
    found = np.zeros(mesh.n_points, np.bool_)
    if mesh.tagged_facets is not None:
        regions, n = number_regions(mesh)[0], len(mesh.facets)
        lowest, highest = topology.regions_beside(mesh.cell_facets, regions, n)
        is_sheet = (mesh.facet_cell_counts == 2) & (lowest == highest)
        found[mesh.tagged_facets[is_sheet[facet_numbers(mesh, mesh.tagged_facets)]]] = True
    return found


def _pull(points: FloatArray, cells: IntArray, nodes: IntArray, old: SimplexMesh) -> FloatArray:
    """Move nodes onto a surface, or halfway if cells do not allow more; return their distances.

    Changes ``points``.
    """
    for share in (1.0, 0.5):
        start, least = points.copy(), np.minimum(worst_of_nodes(points, cells), _LEAST)
        points[nodes] += share * (_nearest(old, points[nodes])[0] - points[nodes])
        take_back(points, cells, start, nodes, least)
    return _nearest(old, points[nodes])[1]


def _nearest(old: SimplexMesh, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the closest points of a surface, and their distances."""
    cells, weights, distance = old.locator.nearest(points)
    return np.einsum("ij,ijk->ik", weights, old.points[old.cells[cells]]), distance


def _swapped(
    points: FloatArray, cells: IntArray, groups: IntArray, on_sheet: BoolArray
) -> tuple[IntArray, IntArray]:
    """Return cells with edges and faces swapped, each region on its own, and their regions."""
    fixed = on_sheet[cells].any(axis=1)
    parts, of_parts = [cells[fixed]], [groups[fixed]]
    for group in np.unique(groups):
        part = swapped(points, cells[(groups == group) & ~fixed])
        parts.append(part)
        of_parts.append(np.full(len(part), group, groups.dtype))
    return np.concatenate(parts), np.concatenate(of_parts)


def _move(
    points: FloatArray,
    cells: IntArray,
    nodes: npt.NDArray[np.intp],
    surface: SimplexMesh,
    old: SimplexMesh,
    tolerance: float,
    cosine: float,
) -> None:
    """Move nodes to better positions, on surfaces where these are smooth.  Changes ``points``.

    ``cells`` are all cells at ``nodes``.
    """
    normals, on_surface, is_smooth = _normals_at(points, surface, cosine)
    nodes = nodes[~on_surface[nodes] | is_smooth[nodes]]
    edges = topology.edges_of(cells, len(points))
    lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    steps = np.full(len(points), np.inf)
    np.minimum.at(steps, edges, lengths[:, None])
    before, start = worst_of_nodes(points, cells), points.copy()
    smooth_nodes(
        points,
        cells,
        topology.rings(cells, len(points)),
        (nodes.astype(np.int64), normals, steps * 0.3),
    )
    at = nodes[on_surface[nodes] & (points[nodes] != start[nodes]).any(axis=1)]
    if len(at) == 0:
        return
    points[at] = _nearest(old, points[at])[0]
    has_moved = topology.marked(at, len(points))
    facets = surface.cells[has_moved[surface.cells].any(axis=1)]
    allowed = np.maximum(_off(old, start[facets]), _FAR * tolerance)
    far = _off(old, points[facets]) > allowed
    points[facets[far]] = start[facets[far]]
    take_back(points, cells, start, nodes, before)


def _off(old: SimplexMesh, corners: FloatArray) -> FloatArray:
    """Return the distance of triangles from a surface: of centroids and middles of edges."""
    middles = (corners[:, [k, k - 1]].mean(axis=1) for k in range(3))
    samples = np.concatenate([corners.mean(axis=1), *middles])
    return np.asarray(_nearest(old, samples)[1].reshape(4, -1).max(axis=0))


def _normals_at(
    points: FloatArray, surface: SimplexMesh, least: float
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Return the normals at nodes of a surface, which nodes are on it, and where it is smooth.

    Nodes inside the mesh have the normal 0.  A surface is smooth where its facets deviate little
    from the mean plane, and all edges have two facets of the same group.
    """
    moved = SimplexMesh(points, surface.cells)
    normal = normals_of(moved).normals
    tensor = np.zeros((len(points), 3, 3))
    outer = normal[:, :, None] * normal[:, None, :]
    np.add.at(tensor, surface.cells, outer[:, None])
    used = np.unique(surface.cells)
    normals = np.zeros_like(points)
    normals[used] = np.linalg.eigh(tensor[used])[1][:, :, 2]
    on_surface, is_smooth = (topology.marked(used, len(points)) for _ in range(2))
    cosine = np.abs(np.einsum("ij,ikj->ik", normal, normals[surface.cells]))
    is_smooth[surface.cells[cosine < least]] = False
    uneven = surface.facet_cell_counts != 2
    if surface.cell_tags is not None:
        lowest, highest = topology.regions_beside(
            surface.cell_facets, surface.cell_tags, len(surface.facets)
        )
        uneven |= lowest != highest
    is_smooth[surface.edges[uneven]] = False
    return normals, on_surface, is_smooth
