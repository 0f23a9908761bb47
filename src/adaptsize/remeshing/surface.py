"""The surface of a solid, prepared for being filled and adapted.

Triangles of CAD parts are as long as the part and narrow as a fillet.  They are divided and
flipped in flat facets, which leaves the surface as it is.  Slivers are removed, which moves it by a
share of the tolerance.  Edges that must not be rounded are listed.
"""

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from adaptsize._pickling import once
from adaptsize.background import SimplexMesh
from adaptsize.background.flipping import flip_edges
from adaptsize.background.simplex import cut_out
from adaptsize.background.splitting import bisect_edges, halved_edges, split_edges
from adaptsize.background.topology import (
    are_among,
    edges_of,
    have_different_nodes,
    is_tagged,
    marked,
    pairs_of_cells,
    places_among,
    renumbered_edges,
)
from adaptsize.geometry.boundary import facet_normals
from adaptsize.geometry.creases import folds_of, normals_of, sharp_facets
from adaptsize.remeshing import tuning
from adaptsize.remeshing.preparation import facets_that_stay
from adaptsize.remeshing.sizing import Size, once_per_point
from adaptsize.typing import BoolArray, FloatArray, IntArray


def refine_surface(
    mesh: SimplexMesh, size: Size, tolerance: float, thinnest: float | None = None
) -> tuple[SimplexMesh, IntArray]:
    """Return nearly the same surface with shorter edges, and those that must not be rounded.

    Edges are divided until they are at most four times as long as the size.  Edges in flat
    facets are flipped to avoid slivers.

    Parameters
    ----------
    mesh : SimplexMesh
        A closed surface.  Tagged edges are feature edges.
    size : callable
    tolerance : float
        Allowed distance from the surface, in the unit of the coordinates.
    thinnest : float, optional
        Triangles of less height than this share of the tolerance are removed; by default the first
        of `tuning.THINNEST`.

    Returns
    -------
    SimplexMesh
        Slivers apart, exactly the given surface.  Cell tags are kept; data are dropped.
    int32[n, 2]
        Edges that must not be rounded, rows sorted.
    """
    thinnest = tuning.THINNEST[0] if thinnest is None else thinnest
    size = once_per_point(size)
    height = sliver_height(mesh, size, thinnest * tolerance)
    mesh, _ = _without_slivers(mesh, height)
    mesh = _with_better_facets(mesh)
    # Mmg makes cells too small beside ridges that are closer than the sizes, so that they are few.
    bent, bulges = _bulges(mesh)
    kept = bent[bulges > tuning.BULGE_AT_RIDGE * tolerance]
    while True:
        middles = mesh.points[mesh.edges].mean(axis=1)
        # Edges are divided until they are short enough, or there are too many triangles.
        long = mesh.edge_lengths > tuning.EDGE_OVER_SIZE_ON_SURFACE * size(middles)
        if not long.any() or mesh.n_cells + 2 * int(long.sum()) > tuning.MOST_TRIANGLES:
            return mesh, _ridges(mesh, kept, size)
        split = split_edges(mesh, long)
        kept = halved_edges(kept, mesh.edges[split.split_edges], mesh.n_points)[0]
        mesh, new_node = _without_slivers(split.mesh, height)
        kept = renumbered_edges(kept, new_node)
        mesh = _with_better_facets(mesh)


def refine_facets(mesh: SimplexMesh, size: Size, tolerance: float) -> tuple[SimplexMesh, IntArray]:
    """Return the same mesh with shorter edges on its facets, and those that must not be rounded.

    A generator fits smooth surfaces through boundary and interfaces.  Between coarse facets these
    bulge by more than the tolerance, which makes an inclusion larger.  Edges where they would do so
    are ridges.  They and the facets beside them are divided until their edges are at most two sizes
    long, because Mmg has no normals at both ends of a ridge between corners and bends such facets.

    Parameters
    ----------
    mesh : SimplexMesh
        Tetrahedra, or triangles in space, whose edges are not divided.
    size : callable
    tolerance : float
        Allowed distance, in the unit of the coordinates.

    Returns
    -------
    SimplexMesh
        With tags, its first nodes those of ``mesh``.
    int32[n, 2]
        Edges that must not be rounded, rows sorted.
    """
    size = once_per_point(size)
    surface = facets_of(mesh)
    bent, bulges = _bulges(surface)
    # Where single edges of a smooth surface are ridges, Mmg makes cells too small beside their
    # ends.  If most edges need not be ridges, the others are only if they must.
    low = tuning.BULGE_IF_MOST_ARE_RIDGES
    most = np.count_nonzero(bulges > low * tolerance) > 0.5 * len(bent)
    kept = bent[bulges > (low if most else tuning.BULGE_AT_RIDGE) * tolerance]
    while mesh.cell_dim == 3:
        beside = np.isin(surface.cells, kept).any(axis=1)
        long = are_among(mesh.edges, edges_of(surface.cells[beside], mesh.n_points))
        long[long] = mesh.edge_lengths[long] > tuning.EDGE_OVER_SIZE_AT_RIDGE * size(
            mesh.points[mesh.edges[long]].mean(axis=1)
        )
        if not long.any():
            break
        chosen = mesh.edges[long]
        split = bisect_edges(mesh, chosen)
        kept = halved_edges(kept, chosen[split.split], mesh.n_points)[0]
        mesh = split.mesh
        surface = facets_of(mesh)
    return mesh, _ridges(surface, kept, size)


def facets_of(mesh: SimplexMesh) -> SimplexMesh:
    """Return boundary, interfaces and tagged facets of a volume; a surface itself.

    The cell tags number groups of facets with the same tag between the same regions.  The result is
    kept with the mesh, as its derived data are.
    """
    if mesh.cell_dim < mesh.dim:
        return mesh

    def collected() -> SimplexMesh:
        found = facets_that_stay(mesh)
        return SimplexMesh(mesh.points, found.nodes, cell_tags=found.groups)

    return once(mesh, "_mesh_of_facets_that_stay", collected)


def sliver_height(mesh: SimplexMesh, size: Size, height: float) -> float:
    """Return a height of slivers, lowered to what is small compared with all sizes on a surface.

    Where the tolerance is larger than a thin plate, its sides must not be joined.
    """
    return min(height, tuning.SLIVER_OVER_SIZE * float(size(mesh.points).min()))


def _without_slivers(mesh: SimplexMesh, height: float) -> tuple[SimplexMesh, IntArray]:
    """Remove slivers, but keep tagged edges; return the new node for each node, too."""
    thicker, new_node = remove_slivers(mesh, height)
    tagged = mesh.edges[is_tagged(mesh)]
    if thicker is mesh or len(tagged) == 0:
        return thicker, new_node
    tagged = renumbered_edges(tagged, new_node)
    return replace(thicker, tagged_facets=tagged, facet_tags=np.ones(len(tagged), int)), new_node


def _feature_angle() -> float:
    """Return the angle above which an edge is a feature edge, for Mmg, too; in radians."""
    return math.radians(tuning.RIDGE_ANGLE["surface"])


def _with_better_facets(mesh: SimplexMesh) -> SimplexMesh:
    """Flip edges in flat facets."""
    folds = folds_of(mesh, _feature_angle())
    return flip_edges(mesh, np.concatenate([folds.bent, folds.sharp]))


def _bulges(mesh: SimplexMesh) -> tuple[IntArray, FloatArray]:
    """Return the bent edges that are not sharp, and how far a smooth surface bulges there.

    A smooth surface through the corners of a triangle of height l bulges by about l a / 8 if its
    normal turns by the angle a on the way to the next triangle.
    """
    bent = are_among(mesh.edges, folds_of(mesh, _feature_angle()).bent)
    normals = normals_of(mesh)
    one, other = normals.facet_cells[bent].T
    sine = np.linalg.norm(np.cross(normals.normals[one], normals.normals[other]), axis=1)
    height = 2.0 * np.maximum(normals.areas[one], normals.areas[other]) / mesh.edge_lengths[bent]
    return mesh.edges[bent], np.asarray(sine * height / 8.0)


def _ridges(mesh: SimplexMesh, kept: IntArray, size: Size) -> IntArray:
    """Return feature edges and edges to keep, except for the latter beside other ones.

    Between two ridges much closer than the size, all tetrahedra are flat.
    """
    sharp = sharp_facets(mesh, normals_of(mesh), _feature_angle())
    kept_now = are_among(mesh.edges, kept) & ~sharp
    on_ridge = marked(mesh.edges[sharp | kept_now], mesh.n_points)
    height = 2.0 * mesh.measures[:, None] / mesh.edge_lengths[mesh.cell_facets]
    beside = np.flatnonzero(kept_now[mesh.cell_facets].any(axis=1))
    centroids = mesh.points[mesh.cells[beside]].mean(axis=1)
    narrow = height[beside] < tuning.BETWEEN_RIDGES * size(centroids)[:, None]
    near = mesh.cell_facets[beside][narrow & on_ridge[mesh.cells[beside]]]
    crowded = marked(near, len(mesh.edges))
    return mesh.edges[sharp | (kept_now & ~crowded)]


def remove_slivers(
    mesh: SimplexMesh, height: float, where: BoolArray | None = None
) -> tuple[SimplexMesh, IntArray]:
    """Return the surface without triangles of less height, where that is possible.

    CAD exports have gaps and strips of rounding width.  Between two feature edges so close,
    all tetrahedra are flat.  Edges shorter than ``height`` are collapsed, and a node that is
    closer to the opposite edge of its triangle than that gets connected across that edge.

    Parameters
    ----------
    mesh : SimplexMesh
        A closed surface.
    height : float
        In the unit of the coordinates.  The surface moves by less than this in each step.
    where : bool[n_points], optional
        Only edges and triangles between these nodes are changed.

    Returns
    -------
    SimplexMesh
        A surface of the same topology, on some of the nodes.  A triangle stays if its removal
        would join distant triangles or turn one over.  Data and facet tags are dropped; cell
        tags are kept.
    int32[n]
        The new node for each node of ``mesh``.

    Examples
    --------
    >>> points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1e-6, 0, 0]]
    >>> cells = [[0, 2, 4], [4, 2, 1], [0, 4, 3], [4, 1, 3], [0, 3, 2], [1, 2, 3]]
    >>> mesh, new_node = remove_slivers(SimplexMesh(points, cells), 1e-3)
    >>> mesh.cells.tolist(), new_node.tolist()
    ([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], [0, 1, 2, 3, 0])
    """
    new_node = np.arange(mesh.n_points, dtype=np.int32)
    where = np.ones(mesh.n_points, np.bool_) if where is None else where
    for _ in range(30):
        ends = _collapsible(mesh, height, where)
        if len(ends):
            mesh, step = _collapsed(mesh, ends)
            new_node, where = step[new_node], marked(step[where], mesh.n_points)
        flipped = _with_flipped_caps(mesh, height, where)
        if len(ends) == 0 and flipped is mesh:
            break
        mesh = flipped
    return mesh, new_node


def _collapsible(mesh: SimplexMesh, length: float, where: BoolArray) -> IntArray:
    """Return edges to collapse, the node that stays first, far enough from each other."""
    short = np.flatnonzero((mesh.edge_lengths < length) & where[mesh.edges].all(axis=1))
    ends = _oriented(mesh, mesh.edges[short])
    good = _keeps_topology(mesh, ends) & _keeps_orientation(mesh, ends, length)
    return ends[good][_independent(mesh, ends[good], mesh.edge_lengths[short[good]])]


def _collapsed(mesh: SimplexMesh, ends: IntArray) -> tuple[SimplexMesh, IntArray]:
    target = np.arange(mesh.n_points, dtype=np.int32)
    target[ends[:, 1]] = ends[:, 0]
    cells = target[mesh.cells]
    left = have_different_nodes(cells)
    tags = None if mesh.cell_tags is None else mesh.cell_tags[left]
    smaller, nodes = cut_out(mesh.points, cells[left], cell_tags=tags, tag_names=mesh.tag_names)
    return smaller, places_among(nodes, mesh.n_points)[target]


def _with_flipped_caps(mesh: SimplexMesh, height: float, where: BoolArray) -> SimplexMesh:
    """Flip the longest edges of triangles with a node closer to it than ``height``.

    Returns
    -------
    SimplexMesh
        The same object if there is none.
    """
    corners = mesh.points[mesh.cells]
    sides = np.linalg.norm(np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1), axis=2)
    apex = sides.argmax(axis=1)
    thin = (_heights(corners) < height) & (sides.min(axis=1) >= height)
    thin = np.flatnonzero(thin & where[mesh.cells].all(axis=1))
    chosen = marked(mesh.cell_facets[thin, apex[thin]], len(mesh.edges))
    places = pairs_of_cells(mesh, chosen & (mesh.facet_cell_counts == 2))
    cells, turn = np.divmod(places, 3)
    around = (turn[:, :, None] + np.arange(3)) % 3
    (c, p, q), (d, _, _) = (mesh.cells[cells[:, i, None], around[:, i]].T for i in (0, 1))
    before = _normals(mesh.points[mesh.cells])
    good = c != d
    least = _heights(corners[cells].reshape(-1, 3, 3)).reshape(-1, 2).min(axis=1)
    for new in ((c, p, d), (c, d, q)):
        flipped = mesh.points[np.column_stack(new)]
        good &= _heights(flipped) > least  # otherwise the same edges would be flipped back
        normal = _normals(flipped)
        for side in (0, 1):
            matters = _heights(corners[cells[:, side]]) >= height
            cosine = np.einsum("ij,ij->i", normal, before[cells[:, side]])
            good &= ~matters | (cosine > tuning.LEAST_COSINE)
    good &= ~are_among(np.sort(np.column_stack([c, d]), axis=1), mesh.edges)
    numbers = np.flatnonzero(good)
    rank = np.arange(len(numbers))
    best = np.full(mesh.n_points, len(numbers), np.int64)
    quads = np.column_stack([c, p, d, q])[numbers]
    np.minimum.at(best, quads, rank[:, None])
    done = numbers[(best[quads] == rank[:, None]).all(axis=1)]
    if len(done) == 0:
        return mesh
    new_cells = np.array(mesh.cells)
    new_cells[cells[done, 0]] = np.column_stack([c, p, d])[done]
    new_cells[cells[done, 1]] = np.column_stack([c, d, q])[done]
    return SimplexMesh(mesh.points, new_cells, cell_tags=mesh.cell_tags, tag_names=mesh.tag_names)


def _oriented(mesh: SimplexMesh, edges: IntArray) -> IntArray:
    """Return the edges with the node first that stays: the one where the surface turns most."""
    normals = _normals(mesh.points[mesh.cells])
    total = np.zeros((mesh.n_points, 3))
    np.add.at(total, mesh.cells.T, normals)
    count = np.bincount(mesh.cells.ravel(), minlength=mesh.n_points)
    agreement = np.linalg.norm(total, axis=1) / np.maximum(count, 1.0)
    turned = agreement[edges[:, 1]] < agreement[edges[:, 0]]
    return np.where(turned[:, None], edges[:, ::-1], edges)


def _normals(corners: FloatArray) -> FloatArray:
    normals = facet_normals(corners)
    lengths = np.linalg.norm(normals, axis=1)
    return np.asarray(normals / np.maximum(lengths, np.finfo(float).tiny)[:, None])


def _keeps_topology(mesh: SimplexMesh, ends: IntArray) -> BoolArray:
    """Whether the ends of each edge have exactly two neighbours in common."""
    from scipy.sparse import coo_matrix  # slow to import

    first, second = mesh.edges.T
    ones = np.ones(2 * len(first), np.int32)
    rows, columns = np.concatenate([first, second]), np.concatenate([second, first])
    near = coo_matrix((ones, (rows, columns)), (mesh.n_points,) * 2).tocsr()
    common = near[ends[:, 0]].multiply(near[ends[:, 1]]).sum(axis=1)
    return np.asarray(np.ravel(common) == 2)


def _keeps_orientation(mesh: SimplexMesh, ends: IntArray, length: float) -> BoolArray:
    """Whether no triangle turns far if the second node moves to the first.

    Triangles of less height than ``length`` do not count: their normals mean nothing.
    """
    good = np.ones(len(ends), bool)
    if len(ends) == 0:
        return good
    edge_of = np.full(mesh.n_points, -1, np.intp)
    edge_of[ends[:, 1]] = np.arange(len(ends))  # one of those that end here; others come later
    good &= edge_of[ends[:, 1]] == np.arange(len(ends))
    for k in range(3):
        cells = np.flatnonzero(edge_of[mesh.cells[:, k]] >= 0)
        edge = edge_of[mesh.cells[cells, k]]
        inside = (mesh.cells[cells] == ends[edge, :1]).any(axis=1)
        cells, edge = cells[~inside], edge[~inside]
        corners = mesh.points[mesh.cells[cells]]
        moved = corners.copy()
        moved[:, k] = mesh.points[ends[edge, 0]]
        cosine = np.einsum("ij,ij->i", _normals(corners), _normals(moved))
        matters = _heights(corners) > length
        good[edge[matters & (cosine < tuning.LEAST_COSINE)]] = False
    return good


def _heights(corners: FloatArray) -> FloatArray:
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    twice = np.linalg.norm(facet_normals(corners), axis=1)
    return np.asarray(twice / np.maximum(sides, np.finfo(float).tiny))


def _independent(mesh: SimplexMesh, ends: IntArray, lengths: FloatArray) -> npt.NDArray[np.intp]:
    """Return edges, the shortest first, of which no two have ends in neighbouring triangles."""
    rank = np.empty(len(ends), np.int64)
    rank[np.argsort(lengths, kind="stable")] = np.arange(len(ends))
    best = np.full(mesh.n_points, len(ends), np.int64)
    np.minimum.at(best, ends, rank[:, None])
    for _ in range(2):  # from nodes to triangles and back, twice
        of_cell = best[mesh.cells].min(axis=1)
        np.minimum.at(best, mesh.cells, of_cell[:, None])
    return np.flatnonzero((best[ends] == rank[:, None]).all(axis=1))
