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

Where none of these improves a bad tetrahedron in a wall thinner than the tolerance, a node of it is
lifted off the given surface, within the tolerance.  Where that does not help either, and elsewhere,
a node is inserted in it, or in its faces and edges, with the best of the cavities around, see
`insertion`.

Feature edges are kept as such at first.  Where cells remain bad, sharp edges may be cut off within
the tolerance.  Edges where regions or facets of different tags meet are always kept.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.boundary_repair import (
    INSERTION,
    LIFT,
    insert_best,
    lift_best,
    repair_waiting,
)
from adaptsize._kernels.complexes import CELLS, FACETS, LINES, Complex, new_complex
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
from adaptsize.background import SimplexMesh
from adaptsize.background.location import in_space
from adaptsize.background.simplex import cut_out
from adaptsize.background.topology import any_of, marked, places_among
from adaptsize.remeshing import tuning
from adaptsize.remeshing.following import Follower, Groups, samples_of_parts
from adaptsize.remeshing.protocol import NO_TAG
from adaptsize.remeshing.sizing import Size
from adaptsize.remeshing.skins import corners_of, kind_of, skin_of, skin_of_given
from adaptsize.typing import BoolArray, FloatArray, IntArray, LongArray

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
    kind, goal = _NAMES[kind_of(mesh)], tuning.GOAL[_NAMES[kind_of(mesh)]]
    angles = angles_of(mesh)
    if wanted is not None:
        wanted = wanted._replace(least=max(wanted.least, float(angles.min())))
        # What could not be improved before would bring other places farther away now.
        goal = tuning.LAST_GOAL.get(kind, goal)
    elif not (angles < goal).any():
        return mesh
    if size is None:
        sizes = _lengths_around(mesh)
    else:  # where there are none, no edge gets longer
        sizes, near = np.zeros(mesh.n_points), _nodes_near(mesh, angles < goal, wanted)
        sizes[near] = size(mesh.points[near])
    new = _improved(mesh, given, tolerance, sizes, goal, keep_sharp=True, wanted=wanted)
    if kind in tuning.LAST_GOAL and (angles_of(new.mesh) < tuning.LAST_GOAL[kind]).any():
        goal = tuning.LAST_GOAL[kind]
        new = _improved(new.mesh, given, tolerance, new.sizes, goal, keep_sharp=False)
    return new.mesh


def blunted(surface: SimplexMesh, tolerance: float, longest: float) -> tuple[SimplexMesh, IntArray]:
    """Return triangles in space with better shapes, whose sharp edges are cut off where possible.

    Also returned are their nodes in the given surface, some of which have moved.  Edges become no
    longer than ``longest``.
    """
    sizes = np.full(surface.n_points, longest / math.sqrt(2.0))
    new = _improved(surface, surface, tolerance, sizes, tuning.GOAL["surface"], keep_sharp=False)
    return new.mesh, new.nodes


def angles_of(mesh: SimplexMesh) -> FloatArray:
    """Return the quality of cells in degrees: the smallest angle; less for needles."""
    angles = np.empty(mesh.n_cells)
    fill_angles(_in_range(mesh)[0], np.array(mesh.cells), kind_of(mesh), angles)
    return angles


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


def _nodes_near(mesh: SimplexMesh, bad: BoolArray, wanted: Wanted | None) -> BoolArray:
    """Return the nodes around cells to improve, and around facets in which nodes are wanted."""
    near = marked(mesh.cells[bad], mesh.n_points)
    if wanted is not None:
        near[wanted.facets] = True
    for _ in range(tuning.RINGS_OF_REPAIR):
        near = marked(mesh.cells[any_of(near, mesh.cells)], mesh.n_points)
    return near


class _Changed(NamedTuple):
    """A mesh after local operations, its nodes in the one before, and the sizes there."""

    mesh: SimplexMesh
    nodes: IntArray
    sizes: FloatArray


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
) -> _Changed:
    """Return the mesh after local operations."""
    points, scale = _in_range(mesh)
    near = _nodes_near(mesh, angles_of(mesh) < goal, wanted)
    follower = Follower(in_space(given.points * scale), points, tolerance * scale, near)
    local, tags = local_mesh(mesh, given, follower, sizes * scale, goal, keep_sharp=keep_sharp)
    counts = np.zeros(LIFT + 1, np.int64)
    work = new_work(len(local.points), len(local.angle))
    if wanted is not None and local.kind == TETRAHEDRA:
        places, facets = wanted.places * scale, wanted.facets.astype(np.int64)
        counts[INSERTION] = insert_in_facets(local, places, facets, wanted.least, work)
    limits = (tuning.CELLS_PER_BAD_CELL, tuning.INSERTED_BELOW)
    repair(local, mesh.n_cells, work, limits, counts)
    if not counts[1:].any():
        return _Changed(mesh, np.arange(mesh.n_points, dtype=np.int32), sizes)
    new, nodes = _result(mesh, local, tags, scale)
    return _Changed(new, nodes, local.size[nodes] / scale)


def repair(
    local: LocalMesh, n_cells: int, work: Work, limits: tuple[int, float], counts: LongArray
) -> None:
    """Improve the cells in the first rows; lift and insert nodes where nothing else helps.

    See `repair_waiting` for the parameters.
    """
    while (cell := repair_waiting(local, n_cells, work, limits, counts)) >= 0:
        is_lifted = lift_best(local, cell, work)
        counts[LIFT] += is_lifted
        if not is_lifted:
            counts[INSERTION] += insert_best(local, cell, work)
        n_cells = 0


def local_mesh(
    mesh: SimplexMesh,
    given: SimplexMesh,
    follower: Follower,
    sizes: FloatArray,
    goal: float,
    *,
    keep_sharp: bool,
) -> tuple[LocalMesh, _Tags]:
    """Return a mesh for local operations, and the tags of its groups.

    Sharp edges are lines on request.
    """
    kind, points = kind_of(mesh), follower.points
    skin = skin_of(mesh, keep_sharp=keep_sharp)
    old = skin_of_given(given, mesh, keep_sharp=keep_sharp)
    groups = Groups.of(skin.keys, old.keys)
    line_tags, number = np.unique(skin.line_tags, return_inverse=True)
    line_groups = Groups.unknown(number.reshape(-1), len(old.lines))
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
    samples = samples_of_parts([of_facets, of_lines], len(cx.nodes), follower.tolerance)
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
