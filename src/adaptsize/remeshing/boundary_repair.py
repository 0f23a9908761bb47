"""Repair of the worst cells of a mesh, also on its boundary, within the tolerance.

A generator leaves single flat cells where the boundary has details shorter than the size, or where
it has fitted facets badly.  With the boundary fixed, most of them cannot be improved.  So nodes of
the boundary are moved along the given one, edges are collapsed and swapped, and flat cells are
removed.  An operation is applied only if

* the smallest angle around does not fall and no cell is inverted,
* the topology stays: of the mesh, of boundary and interfaces, and of feature edges,
* the new facets are within the tolerance of the given surface, on the same side, and what was near
  the old facets of the given surface is within the tolerance of the new ones,
* no edge becomes longer than sqrt 2 sizes.

Where none of these improves a bad tetrahedron, a node is inserted in it, or in its faces and edges,
with the best of the cavities around, see `insertion`.

Feature edges are kept as such at first.  Where cells remain bad, sharp edges may be cut off within
the tolerance.  Edges where regions or facets of different tags meet are always kept.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.boundary_repair import INSERTION, insert_best, repair_waiting
from adaptsize._kernels.complexes import CELLS, FACETS, LINES, Complex, new_complex
from adaptsize._kernels.envelope import Given, Samples, find_nearest, list_samples
from adaptsize._kernels.insertion import insert_in_facets
from adaptsize._kernels.local_mesh import (
    PLANE,
    SURFACE,
    TETRAHEDRA,
    LocalMesh,
    Work,
    fill_angles,
    new_work,
)
from adaptsize._kernels.trees import new_stack
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import tree_over
from adaptsize.background.location import in_space
from adaptsize.background.simplex import cut_out, facets_with_normals
from adaptsize.background.topology import places_among, regions_beside
from adaptsize.geometry.boundary import facet_normals
from adaptsize.geometry.creases import feature_facets, normals_of
from adaptsize.remeshing import tuning
from adaptsize.remeshing.preparation import facet_numbers
from adaptsize.remeshing.protocol import NO_TAG
from adaptsize.remeshing.sizing import Size
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray, LongArray

#: The kinds of meshes in `tuning`.
_NAMES = {TETRAHEDRA: "tetrahedra", SURFACE: "surface", PLANE: "plane triangles"}


class Wanted(NamedTuple):
    """Places on the given surface where nodes of a boundary are wanted.

    Parameters
    ----------
    places : float64[n, 3]
    facets : int32[n, 3]
        The facet of the boundary in which each is to be inserted.
    least : float
        Least angle of new cells in degrees, unless there are smaller ones around.  In `repaired`,
        they are no worse than the worst one of the mesh.
    """

    places: FloatArray
    facets: IntArray
    least: float


def repaired(
    mesh: SimplexMesh,
    given: SimplexMesh,
    tolerance: float,
    size: Size | None = None,
    wanted: Wanted | None = None,
) -> SimplexMesh:
    """Return a mesh with better worst cells, whose boundary is within the tolerance.

    Parameters
    ----------
    mesh : SimplexMesh
        Tetrahedra or triangles in the plane of positive measure, or triangles in space.
    given : SimplexMesh
        The mesh or surface whose boundary, interfaces and feature edges these must have.
    tolerance : float
        Allowed distance, in the unit of the coordinates.  What is farther away gets no farther.
    size : callable, optional
        Requested lengths of edges at points; those around each node by default.
    wanted : Wanted, optional
        Nodes to insert first, in tetrahedra.

    Returns
    -------
    SimplexMesh
        With the same regions and tags; ``mesh`` itself if nothing has changed.  No cell is worse
        than the worst one before.
    """
    kind, goal = _NAMES[_kind_of(mesh)], tuning.GOAL[_NAMES[_kind_of(mesh)]]
    angles = angles_of(mesh)
    if wanted is not None:
        wanted = wanted._replace(least=max(wanted.least, float(angles.min())))
    elif not (angles < goal).any():
        return mesh
    sizes = _lengths_around(mesh) if size is None else size(mesh.points)
    mesh, sizes = _improved(mesh, given, tolerance, sizes, goal, keep_sharp=True, wanted=wanted)
    if kind in tuning.LAST_GOAL and (angles_of(mesh) < tuning.LAST_GOAL[kind]).any():
        goal = tuning.LAST_GOAL[kind]
        mesh, sizes = _improved(mesh, given, tolerance, sizes, goal, keep_sharp=False)
    return mesh


def angles_of(mesh: SimplexMesh) -> FloatArray:
    """Return the quality of cells in degrees: the smallest angle; less for needles."""
    angles = np.empty(mesh.n_cells)
    fill_angles(_in_range(mesh)[0], np.array(mesh.cells), _kind_of(mesh), angles)
    return angles


def _kind_of(mesh: SimplexMesh) -> int:
    if mesh.cell_dim == 3:
        return TETRAHEDRA
    return SURFACE if mesh.dim == 3 else PLANE


def _in_range(mesh: SimplexMesh) -> tuple[FloatArray, float]:
    """Return the points in space times a power of two, so that squares are in range; and that."""
    largest = float(np.abs(mesh.points).max())
    scale = math.ldexp(1.0, -math.frexp(largest)[1]) if largest > 0.0 else 1.0
    return in_space(mesh.points * scale), scale


def _lengths_around(mesh: SimplexMesh) -> FloatArray:
    """Return the mean length of the edges around each node and those around its neighbours."""
    ends = np.concatenate([mesh.edges, mesh.edges[:, ::-1]])
    count = np.maximum(np.bincount(ends[:, 0], minlength=mesh.n_points), 1)
    lengths = np.concatenate([mesh.edge_lengths, mesh.edge_lengths])
    mean = np.bincount(ends[:, 0], lengths, mesh.n_points) / count
    wider = np.bincount(ends[:, 0], mean[ends[:, 1]], mesh.n_points) / count
    return np.maximum(mean, wider)


class _Skin(NamedTuple):
    """What bounds and separates the regions of a mesh, and its lines.

    Parameters
    ----------
    facets : int32[n, 3]
        Triangles, outward on the boundary.
    keys : int64[n, 4]
        Tag, adjacent regions, and whether they differ: facets of the same key are one group.
    lines : int32[m, 2]
    line_tags : int64[m]
        ``NO_TAG`` for lines without one.
    """

    facets: IntArray
    keys: LongArray
    lines: IntArray
    line_tags: LongArray


def _skin_of(mesh: SimplexMesh, *, keep_sharp: bool) -> _Skin:
    """Return facets and lines of a mesh; sharp edges are lines on request."""
    if _kind_of(mesh) == PLANE:
        lines, keys = _separating(mesh)
        return _Skin(np.empty((0, 3), np.int32), np.empty((0, 4), np.int64), lines, keys[:, 0])
    if mesh.cell_dim == 3:
        facets, keys = _separating(mesh)
        surface = SimplexMesh(mesh.points, facets, cell_tags=_numbers_of(keys))
        edge_tags = np.full(len(surface.edges), NO_TAG)
    else:
        facets, surface = mesh.cells, mesh
        keys = np.zeros((len(facets), 4), np.int64)
        keys[:, 0] = NO_TAG if mesh.cell_tags is None else mesh.cell_tags
        edge_tags = np.full(len(surface.edges), NO_TAG)
        if mesh.tagged_facets is not None and mesh.facet_tags is not None:
            edge_tags[facet_numbers(mesh, mesh.tagged_facets)] = mesh.facet_tags
    is_line = (surface.facet_cell_counts != 2) | (edge_tags != NO_TAG)
    if surface.cell_tags is not None:
        lowest, highest = regions_beside(
            surface.cell_facets, surface.cell_tags, len(surface.facets)
        )
        is_line |= lowest != highest
    if keep_sharp:
        angle = math.radians(tuning.RIDGE_ANGLE["surface"])
        is_line |= feature_facets(surface, normals_of(surface), angle)
    return _Skin(facets, keys, surface.edges[is_line], edge_tags[is_line])


def _numbers_of(keys: LongArray) -> IntArray:
    return np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int32)


def _separating(mesh: SimplexMesh) -> tuple[IntArray, LongArray]:
    """Return the facets on the boundary, between regions and with a tag, and their keys."""
    n = len(mesh.facets)
    regions = np.zeros(mesh.n_cells, np.int32) if mesh.cell_tags is None else mesh.cell_tags
    lowest, highest = regions_beside(mesh.cell_facets, regions, n)
    is_boundary, tags = mesh.facet_cell_counts == 1, np.full(n, NO_TAG)
    if mesh.tagged_facets is not None and mesh.facet_tags is not None:
        number = facet_numbers(mesh, mesh.tagged_facets)
        tags[number[number >= 0]] = mesh.facet_tags[number >= 0]
    chosen = (mesh.facet_cell_counts != 2) | (lowest != highest) | (tags != NO_TAG)
    cell, opposite, facets, _ = facets_with_normals(mesh, chosen)
    row = mesh.cell_facets[cell, opposite]
    order = np.lexsort((cell, regions[cell], row))
    rows, first = np.unique(row[order], return_index=True)
    keys = np.column_stack([tags, lowest, highest, is_boundary])[rows]
    return facets[order[first]].astype(np.int32), keys


def _skin_of_given(given: SimplexMesh, mesh: SimplexMesh, *, keep_sharp: bool) -> _Skin:
    """Return facets and lines of the given mesh, with keys like those of the new one."""
    skin = _skin_of(given, keep_sharp=keep_sharp)
    if given.cell_dim == mesh.cell_dim:
        return skin
    keys = skin.keys.copy()  # a surface that was filled
    keys[:, 3] = 1
    if mesh.tagged_facets is None:
        keys[:, 0] = NO_TAG
    return skin._replace(keys=keys)


def corners_of(points: FloatArray, lines: IntArray, tags: LongArray) -> BoolArray:
    """Return the nodes where other than two lines meet, or two of different tags, or they turn."""
    degree = np.bincount(lines.ravel(), minlength=len(points))
    is_corner = (degree != 2) & (degree != 0)
    arms = np.zeros((len(points), 3))
    along = points[lines[:, 1]] - points[lines[:, 0]]
    along /= np.maximum(np.linalg.norm(along, axis=1), np.finfo(float).tiny)[:, None]
    np.add.at(arms, lines[:, 0], along)
    np.add.at(arms, lines[:, 1], -along)
    # Half of the sum of the unit vectors to both neighbours is the sine of half of the turn.
    turns = 0.5 * np.linalg.norm(arms, axis=1) > math.sin(0.5 * math.radians(tuning.TURN_AT_CORNER))
    least, most = np.full(len(points), NO_TAG), np.full(len(points), -NO_TAG)
    np.minimum.at(least, lines, tags[:, None])
    np.maximum.at(most, lines, tags[:, None])
    return np.asarray(is_corner | ((degree == 2) & (turns | (least != most))))


class _Groups(NamedTuple):
    """Groups of new and of given simplices.

    Groups of new simplices of which there are no given ones have negative numbers.
    """

    new: IntArray
    given: IntArray

    @classmethod
    def of(cls, new: LongArray, given: LongArray) -> "_Groups":
        """Return the groups from rows that describe the simplices."""
        numbers = _numbers_of(np.concatenate([new, given]))
        one, other = numbers[: len(new)], numbers[len(new) :]
        return cls(np.where(np.isin(one, other), one, -2 - one).astype(np.int32), other)

    @classmethod
    def unknown(cls, new: npt.NDArray[np.integer], n_given: int) -> "_Groups":
        """Return groups that are all compared with all given simplices."""
        return cls((-2 - new).astype(np.int32), np.zeros(n_given, np.int32))


class _Sampled(NamedTuple):
    """Samples of given simplices.

    Parameters
    ----------
    at : float64[s, 5]
        As those of `Samples`.
    owner : int64[s]
        Rows of the nearest new simplices.
    first : int
        The first row of new simplices.
    off2 : float64[n]
        Square of the distance of each new simplex from the given ones.
    """

    at: FloatArray
    owner: LongArray
    first: int
    off2: FloatArray


class _Follower(NamedTuple):
    """Makes new simplices follow given ones."""

    given_points: FloatArray
    points: FloatArray
    tolerance: float

    def sampled(
        self, given: IntArray, groups: _Groups, new: IntArray, first: int
    ) -> tuple[Given, _Sampled]:
        """Return given simplices in a tree, and samples for new ones, from a first row on."""
        k, given_points = new.shape[1], self.given_points
        if len(given) == 0 or len(new) == 0:  # no operation will look at it
            given_points, given = np.zeros((k, 3)), np.arange(k, dtype=np.int32)[None]
            none = _Sampled(np.empty((0, 5)), np.empty(0, np.int64), first, np.zeros(len(new)))
            return _tree_of(given_points, given, np.zeros(1, np.int32))[0], none
        tree, _ = _tree_of(given_points, given, groups.given)
        queries, wanted, of_new = _samples_of(self.points, new, groups.new)
        row, away2, feet = _nearest(tree, queries, wanted)
        label = np.where(np.isin(groups.given, groups.new), groups.given, -1).astype(np.int32)
        places, labels, _ = _samples_of(given_points, given, label)
        places, labels = np.concatenate([places, feet]), np.append(labels, wanted)
        own, own_order = _tree_of(self.points, new, groups.new)
        found, distance2, _ = _nearest(own, places, labels)
        reach2 = np.maximum(distance2, self.tolerance**2) * (1.0 + 1e-9)
        at = np.column_stack([places, np.maximum(labels, -1), reach2])
        if k == 3:
            tree.about[:, 1:] = _compared_normals(tree, self.points[new], row[-len(new) :])
        off2 = away2[of_new].max(axis=1)
        return tree, _Sampled(at, first + own_order[found], first, off2)


def _samples(parts: list[_Sampled], room: int, tolerance: float) -> Samples:
    """Return samples in the lists of the new simplices."""
    at = np.concatenate([part.at for part in parts])
    chain = np.full((max(room, len(at)), 2), -1, np.int32)
    off2 = np.zeros(room)
    for part in parts:
        off2[part.first : part.first + len(part.off2)] = part.off2
    found = Samples(at, chain, off2, tolerance)
    list_samples(found, np.concatenate([part.owner for part in parts]))
    return found


def _tree_of(points: FloatArray, cells: IntArray, label: IntArray) -> tuple[Given, LongArray]:
    """Return simplices in a tree, without normals, and the simplex in each of its rows."""
    tree, order = tree_over(points, cells)
    about = np.zeros((len(cells), 4))
    about[:, 0] = label[order]
    return Given(tree.points, tree.cells, tree.boxes, about), order


def _samples_of(
    points: FloatArray, cells: IntArray, label: IntArray
) -> tuple[FloatArray, IntArray, LongArray]:
    """Return nodes, middles of edges and, last, centroids of simplices; labels; rows of each cell.

    Nodes and edges between groups are repeated for each group.
    """
    m, k = cells.shape
    n, group = len(points), _numbers_of(label[:, None].astype(np.int64)).astype(np.int64)
    keys = (group[:, None] * n + cells).ravel()
    _, first, node = np.unique(keys, return_index=True, return_inverse=True)
    pairs = np.concatenate([cells[:, [v, (v + 1) % k]] for v in range(k if k > 2 else 1)])
    low, high = pairs.min(axis=1).astype(np.int64), pairs.max(axis=1)
    keys = (np.tile(group, len(pairs) // m) * n + low) * n + high
    _, at, edge = np.unique(keys, return_index=True, return_inverse=True)
    places = [points[cells.ravel()[first]], points[pairs[at]].mean(axis=1)]
    labels = [np.repeat(label, k)[first], np.tile(label, len(pairs) // m)[at], label]
    rows = np.column_stack([
        node.reshape(m, k),
        len(first) + edge.reshape(-1, m).T,
        len(first) + len(at) + np.arange(m),
    ])  # fmt: skip
    found = np.concatenate([*places, points[cells].mean(axis=1)])
    return found, np.concatenate(labels).astype(np.int32), rows


def _nearest(
    given: Given, queries: FloatArray, wanted: IntArray
) -> tuple[IndexArray, FloatArray, FloatArray]:
    """Return the rows of the closest simplices, squared distances and closest points."""
    row, distance2 = np.empty(len(queries), np.int64), np.empty(len(queries))
    foot = np.empty((len(queries), 3))
    find_nearest(given, queries, wanted, new_stack(), row, distance2, foot)
    return row, distance2, foot


def _compared_normals(given: Given, corners: FloatArray, nearest: IndexArray) -> FloatArray:
    """Return unit normals of given triangles in the direction of the new ones.

    They are zero in groups where the directions do not agree, as in a surface that is not oriented.
    """
    normal, new = (_unit(facet_normals(x)) for x in (given.points[given.cells], corners))
    cosine = np.einsum("ij,ij->i", new, normal[nearest])
    label = given.about[:, 0].astype(np.int64)
    group, n_groups = label[nearest], int(label.max()) + 1
    clear = np.abs(cosine) > tuning.CLEAR_COSINE
    same = np.bincount(group[clear & (cosine > 0.0)], minlength=n_groups)
    opposite = np.bincount(group[clear & (cosine < 0.0)], minlength=n_groups)
    total = np.maximum(same + opposite, 1)
    least = tuning.AGREEING * total
    sign = np.where(same > least, 1.0, np.where(opposite > least, -1.0, 0.0))
    return np.asarray(normal * sign[label][:, None])


def _unit(vectors: FloatArray) -> FloatArray:
    lengths = np.maximum(np.linalg.norm(vectors, axis=1), np.finfo(float).tiny)
    return np.asarray(vectors / lengths[:, None])


class _Tags(NamedTuple):
    """Tags by the numbers of groups of facets and of lines."""

    of_facets: dict[int, int]
    of_lines: dict[int, int]


def _improved(
    mesh: SimplexMesh,
    given: SimplexMesh,
    tolerance: float,
    sizes: FloatArray,
    goal: float,
    *,
    keep_sharp: bool,
    wanted: Wanted | None = None,
) -> tuple[SimplexMesh, FloatArray]:
    """Return the mesh after local operations, and the sizes at its nodes."""
    points, scale = _in_range(mesh)
    follower = _Follower(in_space(given.points * scale), points, tolerance * scale)
    local, tags = local_mesh(mesh, given, follower, sizes * scale, goal, keep_sharp=keep_sharp)
    counts = np.zeros(8, np.int64)
    work = new_work(len(local.points), len(local.angle))
    if wanted is not None and local.kind == TETRAHEDRA:
        places, facets = wanted.places * scale, wanted.facets.astype(np.int64)
        counts[-1] = insert_in_facets(local, places, facets, wanted.least, work)
    limits = (tuning.CELLS_PER_BAD_CELL, tuning.INSERTED_BELOW)
    repair(local, mesh.n_cells, work, limits, counts)
    if not counts[1:].any():
        return mesh, sizes
    new, nodes = _result(mesh, local, tags, scale)
    return new, local.size[nodes] / scale


def repair(
    local: LocalMesh, n_cells: int, work: Work, limits: tuple[int, float], counts: LongArray
) -> None:
    """Improve the cells in the first rows, and insert nodes where nothing else helps.

    See `repair_waiting` for the parameters.
    """
    while (cell := repair_waiting(local, n_cells, work, limits, counts)) >= 0:
        counts[INSERTION] += insert_best(local, cell, work)
        n_cells = 0


def local_mesh(
    mesh: SimplexMesh,
    given: SimplexMesh,
    follower: _Follower,
    sizes: FloatArray,
    goal: float,
    *,
    keep_sharp: bool,
) -> tuple[LocalMesh, _Tags]:
    """Return a mesh for local operations, and the tags of its groups.

    Sharp edges are lines on request.
    """
    kind, points = _kind_of(mesh), follower.points
    skin = _skin_of(mesh, keep_sharp=keep_sharp)
    old = _skin_of_given(given, mesh, keep_sharp=keep_sharp)
    groups = _Groups.of(skin.keys, old.keys)
    line_tags, number = np.unique(skin.line_tags, return_inverse=True)
    line_groups = _Groups.unknown(number.reshape(-1), len(old.lines))
    regions = np.zeros(mesh.n_cells, np.int32) if mesh.cell_tags is None else mesh.cell_tags
    parts = [(CELLS, mesh.cells, groups.new if kind == SURFACE else regions)]
    if kind == TETRAHEDRA:
        parts.append((FACETS, skin.facets, groups.new))
    parts.append((LINES, skin.lines, line_groups.new))
    room = 0
    if kind == TETRAHEDRA:
        share, some = tuning.ADDED_NODES
        room = some + int(share * mesh.n_points)
    n_more = mesh.n_cells // 4 + 64 + tuning.ROWS_OF_NODE * room
    cx = new_complex(parts, mesh.n_points + room, n_more)
    first_facet = 0 if kind == SURFACE else mesh.n_cells
    first_line = mesh.n_cells + (len(skin.facets) if kind == TETRAHEDRA else 0)
    surface, of_facets = follower.sampled(old.facets, groups, skin.facets, first_facet)
    curves, of_lines = follower.sampled(old.lines, line_groups, skin.lines, first_line)
    samples = _samples([of_facets, of_lines], len(cx.nodes), follower.tolerance)
    is_corner = corners_of(points, skin.lines, skin.line_tags)
    if len(old.lines) == 0:
        is_corner[skin.lines] = True
    angle = np.empty(len(cx.nodes))
    fill_angles(points, np.array(mesh.cells), kind, angle)
    facets = FACETS if kind == TETRAHEDRA else CELLS
    tags = _Tags(
        dict(zip(groups.new.tolist(), skin.keys[:, 0].tolist(), strict=True)),
        {-2 - k: tag for k, tag in enumerate(line_tags.tolist())},
    )
    n_points = np.array([mesh.n_points])
    points, sizes = (np.concatenate([x, np.zeros((room, *x.shape[1:]))]) for x in (points, sizes))
    is_corner = np.append(is_corner, np.zeros(room, np.bool_))
    return LocalMesh(
        kind, goal, facets, points, n_points, sizes, is_corner, cx, surface, curves, samples, angle
    ), tags


def _rows_of(cx: Complex, level: np.int64, k: int) -> tuple[IntArray, IntArray]:
    """Return the simplices of a level and their labels."""
    rows = cx.about[:, 1] == level
    return cx.nodes[rows, :k], cx.about[rows, 0]


def _result(
    mesh: SimplexMesh, local: LocalMesh, tags: _Tags, scale: float
) -> tuple[SimplexMesh, IntArray]:
    """Return the changed mesh with its tags, and its nodes in the old one."""
    k = mesh.cell_dim + 1
    cells, labels = _rows_of(local.cx, CELLS, k)
    new, nodes = cut_out(local.points[:, : mesh.dim] / scale, cells, tag_names=mesh.tag_names)
    if mesh.cell_tags is not None:
        if local.kind == SURFACE:  # the groups of its cells are the tags
            labels = _looked_up(tags.of_facets, labels).astype(np.int32)
        new = replace(new, cell_tags=labels)
    if mesh.tagged_facets is not None:
        is_solid = local.kind == TETRAHEDRA
        facets, labels = _rows_of(local.cx, FACETS if is_solid else LINES, k - 1)
        found = _looked_up(tags.of_facets if is_solid else tags.of_lines, labels)
        tagged, number = found != NO_TAG, places_among(nodes, len(local.points))
        new = replace(new, tagged_facets=number[facets[tagged]], facet_tags=found[tagged])
    return new, nodes


def _looked_up(table: dict[int, int], labels: IntArray) -> LongArray:
    known, inverse = np.unique(labels, return_inverse=True)
    return np.array([table[k] for k in known.tolist()], np.int64)[inverse.reshape(-1)]
