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

Feature edges are kept as such at first.  Where cells remain bad, sharp edges may be cut off within
the tolerance.  Edges where regions or facets of different tags meet are always kept.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.boundary_repair import repair
from adaptsize._kernels.complexes import Complex, new_complex
from adaptsize._kernels.envelope import Envelope, find_nearest, list_samples, measure_rows
from adaptsize._kernels.heap import new_heap
from adaptsize._kernels.local_mesh import (
    MOST_AROUND,
    MOST_NODES,
    PLANE,
    SURFACE,
    TETRAHEDRA,
    LocalMesh,
    Work,
    fill_angles,
    put_all_in_queue,
)
from adaptsize._kernels.trees import new_stack
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import tree_over
from adaptsize.background.location import in_space
from adaptsize.background.simplex import cut_out, facets_with_normals
from adaptsize.background.topology import compacted, is_tagged, places_among, regions_beside
from adaptsize.geometry.boundary import facet_normals
from adaptsize.geometry.creases import feature_facets, normals_of
from adaptsize.remeshing.mmg import RIDGE_ANGLE
from adaptsize.remeshing.preparation import facet_numbers
from adaptsize.remeshing.protocol import NO_TAG
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray, LongArray

#: Angles in degrees below which cells are improved, by the kind of the mesh: the dihedral angles of
#: tetrahedra and the angles of triangles.
GOAL = {TETRAHEDRA: 20.0, SURFACE: 25.0, PLANE: 25.0}
#: Angles below which sharp edges may be cut off.
_LAST_GOAL = {TETRAHEDRA: 15.0, SURFACE: 15.0}
#: Angle in degrees by which a feature edge turns at a corner.
_CORNER = 40.0
#: Cells that are examined at most, over the number of bad ones.
_ATTEMPTS = 40


def repaired(
    mesh: SimplexMesh, given: SimplexMesh, tolerance: float, sizes: FloatArray | None = None
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
    sizes : float64[n_points], optional
        Requested lengths of edges at the nodes; those around each node by default.

    Returns
    -------
    SimplexMesh
        With the same regions and tags; ``mesh`` itself if nothing has changed.  No cell is worse
        than the worst one before.
    """
    kind = _kind_of(mesh)
    if not (angles_of(mesh) < GOAL[kind]).any():
        return mesh
    if sizes is None:
        sizes = _lengths_around(mesh)
    mesh, sizes = _improved(mesh, given, tolerance, sizes, GOAL[kind], keep_sharp=True)
    if kind in _LAST_GOAL and (angles_of(mesh) < _LAST_GOAL[kind]).any():
        goal = _LAST_GOAL[kind]
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
        if mesh.tagged_facets is not None:
            edge_tags[facet_numbers(mesh, mesh.tagged_facets)] = mesh.facet_tags
    is_line = (surface.facet_cell_counts != 2) | (edge_tags != NO_TAG)
    if surface.cell_tags is not None:
        lowest, highest = regions_beside(
            surface.cell_facets, surface.cell_tags, len(surface.facets)
        )
        is_line |= lowest != highest
    if keep_sharp:
        angle = math.radians(RIDGE_ANGLE["surface"])
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
    if mesh.tagged_facets is not None:
        number = facet_numbers(mesh, mesh.tagged_facets)
        assert mesh.facet_tags is not None
        tags[number[number >= 0]] = mesh.facet_tags[number >= 0]
    chosen = (mesh.facet_cell_counts != 2) | (lowest != highest) | (tags != NO_TAG)
    cell, opposite, facets, _ = facets_with_normals(mesh, chosen)
    number = mesh.cell_facets[cell, opposite]
    order = np.lexsort((cell, regions[cell], number))
    rows, first = np.unique(number[order], return_index=True)
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


def _corners_of(points: FloatArray, lines: IntArray) -> BoolArray:
    """Return the nodes where other than two lines meet, or where they turn."""
    degree = np.bincount(lines.ravel(), minlength=len(points))
    is_corner = (degree != 2) & (degree != 0)
    arms = np.zeros((len(points), 3))
    along = points[lines[:, 1]] - points[lines[:, 0]]
    along /= np.maximum(np.linalg.norm(along, axis=1), np.finfo(float).tiny)[:, None]
    np.add.at(arms, lines[:, 0], along)
    np.add.at(arms, lines[:, 1], -along)
    # Half of the sum of the unit vectors to both neighbours is the sine of half of the turn.
    turns = 0.5 * np.linalg.norm(arms, axis=1) > math.sin(0.5 * math.radians(_CORNER))
    return np.asarray(is_corner | ((degree == 2) & turns))


class _Groups(NamedTuple):
    """Groups of new and given simplices, numbered together."""

    new: IntArray
    given: IntArray
    accepts: IntArray
    """For each group the same one if there are given simplices in it, else -1."""

    @classmethod
    def of(cls, new: LongArray, given: LongArray) -> "_Groups":
        """Return the groups from rows that describe the simplices."""
        numbers = _numbers_of(np.concatenate([new, given]))
        accepts = np.full(int(numbers.max(initial=0)) + 1, -1, np.int32)
        known = np.unique(numbers[len(new) :])
        accepts[known] = known
        return cls(numbers[: len(new)], numbers[len(new) :], accepts)


def _improved(
    mesh: SimplexMesh,
    given: SimplexMesh,
    tolerance: float,
    sizes: FloatArray,
    goal: float,
    *,
    keep_sharp: bool,
) -> tuple[SimplexMesh, FloatArray]:
    """Return the mesh after local operations, and the sizes at its nodes."""
    points, scale = _in_range(mesh)
    given_points = in_space(given.points * scale)
    skin = _skin_of(mesh, keep_sharp=keep_sharp)
    old = _skin_of_given(given, mesh, keep_sharp=keep_sharp)
    kind, allowed, n = _kind_of(mesh), tolerance * scale, mesh.n_points
    groups = _Groups.of(skin.keys, old.keys)
    tags, line_label = np.unique(skin.line_tags, return_inverse=True)
    is_corner = _corners_of(points, skin.lines)
    if len(old.lines) == 0:
        is_corner[skin.lines] = True
    regions = np.zeros(mesh.n_cells, np.int32) if mesh.cell_tags is None else mesh.cell_tags
    cells = _complex(mesh.cells, groups.new if kind == SURFACE else regions, n)
    facets = cells if kind == SURFACE else _complex(skin.facets, groups.new, n)
    lines = _complex(skin.lines, line_label.reshape(-1), n)
    surface = _envelope(given_points, old.facets, points, facets, groups, allowed, kind)
    no_groups = np.zeros(len(lines.label), np.int32)
    line_groups = _Groups(
        no_groups, np.zeros(len(old.lines), np.int32), np.full(len(tags) + 1, -1, np.int32)
    )
    curves = _envelope(given_points, old.lines, points, lines, line_groups, allowed, kind)
    angle = np.empty(len(cells.label))
    fill_angles(points, cells.nodes[: mesh.n_cells], kind, angle[: mesh.n_cells])
    local = LocalMesh(
        kind, goal, points, sizes * scale, is_corner, cells, facets, lines, surface, curves, angle
    )
    work = _new_work(n, len(angle))
    put_all_in_queue(local, mesh.n_cells, work)
    counts = np.zeros(7, np.int64)
    most = 1000 + _ATTEMPTS * int(work.waiting.size[0])
    repair(local, work, most, counts)
    if not counts[1:].any():
        return mesh, sizes
    return _result(mesh, local, groups, skin, tags, sizes, scale)


def _result(
    mesh: SimplexMesh,
    local: LocalMesh,
    groups: _Groups,
    skin: _Skin,
    line_tags: LongArray,
    sizes: FloatArray,
    scale: float,
) -> tuple[SimplexMesh, FloatArray]:
    """Return the changed mesh with its tags, and the sizes at its nodes."""
    alive = local.cells.alive
    cells = local.cells.nodes[alive]
    nodes = compacted(cells)[0]
    new_number = places_among(nodes, mesh.n_points)
    new, _ = cut_out(local.points[:, : mesh.dim] / scale, cells, tag_names=mesh.tag_names)
    tag_of_group = np.full(len(groups.accepts), NO_TAG)
    tag_of_group[groups.new] = skin.keys[:, 0]
    if mesh.cell_tags is not None:
        labels = local.cells.label[alive]
        tags = tag_of_group[labels] if local.kind == SURFACE else labels
        new = replace(new, cell_tags=tags)
    if mesh.tagged_facets is not None:
        part, tag_of = (
            (local.facets, tag_of_group) if local.kind == TETRAHEDRA else (local.lines, line_tags)
        )
        tags = tag_of[part.label[part.alive]]
        tagged = tags != NO_TAG
        facets = new_number[part.nodes[part.alive][tagged]]
        new = replace(new, tagged_facets=facets, facet_tags=tags[tagged])
    return new, sizes[nodes]


def _complex(simplices: IntArray, label: npt.NDArray[np.integer], n_points: int) -> Complex:
    room = len(simplices) + len(simplices) // 4 + 64
    return new_complex(simplices, label, n_points, room)


def _new_work(n_points: int, room: int) -> Work:
    seen, joined = np.zeros((2, n_points), np.int64)
    n = MOST_AROUND + 2
    return Work(
        stack=new_stack(), waiting=new_heap(room), around=np.empty(MOST_NODES, np.int64),
        seen=seen, joined=joined, stamp=np.zeros(1, np.int64),
        rows=np.empty((MOST_AROUND, 3), np.int64), loop=np.empty(n, np.int64),
        split=np.empty((n, n), np.int64), value=np.empty((n, n)),
        made=np.empty((2 * n, 5), np.int64), ranges=np.empty((n, 2), np.int64),
        choice=np.zeros(4, np.int64), place=np.zeros(3),
    )  # fmt: skip


def _envelope(
    given_points: FloatArray,
    given: IntArray,
    points: FloatArray,
    new: Complex,
    groups: _Groups,
    tolerance: float,
    kind: int,
) -> Envelope:
    """Return the given simplices, with samples in the lists of the new simplices."""
    count, k = int(new.alive.sum()), new.nodes.shape[1]
    room = len(new.alive)
    if len(given) == 0 or count == 0:  # no operation will look at it
        given_points, given = np.zeros((k, 3)), np.arange(k, dtype=np.int32)[None]
        groups = groups._replace(given=np.zeros(1, np.int32))
    tree, order = tree_over(given_points, given)
    label = groups.given[order]
    cells, new_label = new.nodes[:count], groups.accepts[new.label[:count]]
    queries, wanted = _samples_of(points, cells, new_label)
    row, feet = _nearest(tree, label, queries, wanted)[::2]
    known = np.isin(groups.given, np.unique(new_label))
    given_label = np.where(known, groups.given, -1).astype(np.int32)
    sample, sample_label = _samples_of(given_points, given, given_label)
    sample, sample_label = np.concatenate([sample, feet]), np.append(sample_label, wanted)
    if count == 0:
        sample, sample_label = np.empty((0, 3)), np.empty(0, np.int32)
    normal = np.zeros((len(tree.cells), 3))
    if k == 3 and kind != PLANE and count:
        at_centres = row[len(row) - count :]
        normal = _compared_normals(tree.points, tree.cells, points[cells], at_centres, label)
    reach2, owner = np.empty(len(sample)), np.empty(len(sample), np.int64)
    if count:
        new_tree, new_order = tree_over(points, cells)
        found, reach2, _ = _nearest(new_tree, new_label[new_order], sample, sample_label)
        owner = new_order[found]
    env = Envelope(
        tree, label, normal, groups.accepts, sample, sample_label,
        np.maximum(reach2, tolerance**2) * (1.0 + 1e-9),
        np.full(room, -1, np.int32), np.full(len(sample), -1, np.int32), np.zeros(room), tolerance,
    )  # fmt: skip
    list_samples(env, owner)
    measure_rows(env, new, points, count, new_stack())
    return env


def _samples_of(
    points: FloatArray, cells: IntArray, label: IntArray
) -> tuple[FloatArray, IntArray]:
    """Return nodes, middles of edges and, last, the centroids of triangles; and their labels."""
    k = cells.shape[1]
    nodes = np.unique(np.column_stack([np.repeat(label, k), cells.ravel()]), axis=0)
    parts, labels = [points[nodes[:, 1]]], [nodes[:, 0]]
    pairs = [cells[:, [v, (v + 1) % k]] for v in range(k if k > 2 else 1)]
    ends = np.sort(np.concatenate(pairs), axis=1)
    edges = np.unique(np.column_stack([np.tile(label, len(pairs)), ends]), axis=0)
    parts += [points[edges[:, 1:]].mean(axis=1), points[cells].mean(axis=1)]
    labels += [edges[:, 0], label]
    return np.concatenate(parts), np.concatenate(labels).astype(np.int32)


def _nearest(
    tree: object, label: IntArray, queries: FloatArray, wanted: IntArray
) -> tuple[IndexArray, FloatArray, FloatArray]:
    """Return the rows of the closest simplices, squared distances and closest points."""
    row, distance2 = np.empty(len(queries), np.int64), np.empty(len(queries))
    foot = np.empty((len(queries), 3))
    find_nearest(tree, label, queries, wanted, new_stack(), row, distance2, foot)
    return row, distance2, foot


def _compared_normals(
    points: FloatArray, cells: IntArray, corners: FloatArray, nearest: IndexArray, label: IntArray
) -> FloatArray:
    """Return unit normals of given triangles in the direction of the new ones.

    They are zero in groups where the directions do not agree, as in a surface that is not oriented.
    """
    normal, new = facet_normals(points[cells]), facet_normals(corners)
    for n in (normal, new):
        n /= np.maximum(np.linalg.norm(n, axis=1), np.finfo(float).tiny)[:, None]
    cosine = np.einsum("ij,ij->i", new, normal[nearest])
    n_labels = int(label.max()) + 1
    group, clear = label[nearest], np.abs(cosine) > 0.5
    same = np.bincount(group[clear & (cosine > 0.0)], minlength=n_labels)
    opposite = np.bincount(group[clear & (cosine < 0.0)], minlength=n_labels)
    total = np.maximum(same + opposite, 1)
    sign = np.where(same > 0.95 * total, 1.0, np.where(opposite > 0.95 * total, -1.0, 0.0))
    return np.asarray(normal * sign[label][:, None])
