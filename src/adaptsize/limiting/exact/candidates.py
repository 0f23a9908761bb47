"""Candidate sources: nodes, edges and faces, without those that another source dominates."""

from __future__ import annotations

import numpy as np

from adaptsize._kernels import exact_candidates as kernels
from adaptsize._kernels import kinks
from adaptsize._kernels.exact import new_block
from adaptsize.background._curve import along_curve
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.topology import unique_rows
from adaptsize.geometry.boundary import FlatBoundary
from adaptsize.limiting.exact.field import ExactField, Points
from adaptsize.limiting.exact.plane import Plane, along_walls
from adaptsize.limiting.exact.problem import Kinks, Problem
from adaptsize.limiting.exact.waves import Wave, wave_at
from adaptsize.limiting.exact.work import part_of
from adaptsize.typing import BoolArray, FloatArray, IntArray


def candidates_of(problem: Problem) -> tuple[IntArray, BoolArray | None]:
    """Return the nodes that may be sources, and the steep cells if bounds meet in any cell."""
    mesh, cells, h0 = problem.mesh, problem.cells, problem.h0
    if not (kernels.have_neighbours(cells, h0) if problem.meet is None else problem.meet):
        return np.flatnonzero(np.isfinite(h0)).astype(np.int32), None
    found = steep, candidate = np.empty(len(cells), np.bool_), np.empty(mesh.n_points, np.bool_)
    axes = (0,) * mesh.dim
    kernels.mark_steep(
        mesh.points, axes, cells, h0, problem.g, problem.face_sources, problem.margin, *found
    )
    return np.flatnonzero(candidate).astype(np.int32), steep


def sources_on_cells(
    problem: Problem,
    steep: BoolArray,
    h: FloatArray,
    source: IntArray,
    field: ExactField,
    plane: Plane | None,
    boundary: FlatBoundary,
    *,
    in_space: bool = False,
) -> Wave | None:
    """Return the edges and faces of steep cells that may be sources."""
    mesh, h0 = problem.mesh, problem.h0
    given = (mesh.points, (0,) * mesh.dim, problem.cells, steep, h0, h + problem.margin, problem.g)
    rows = Kinks(_listed(kinks.list_edges, given), np.empty((0, 5), np.int32), mesh.points, h0)
    if mesh.dim == 3:
        rows = rows._replace(faces=_listed(kinks.list_faces, given))
    if problem.merge is not None:
        rows = problem.merge(rows)
    parts = [_chosen(rows.edges, 2, rows, problem.g)]
    if mesh.dim == 3:
        parts.append(_chosen(rows.faces, 3, rows, problem.g))
    named = np.full((sum(map(len, parts)), mesh.dim), -1, np.int32)
    named[: len(parts[0]), :2] = parts[0]
    if mesh.dim == 3:
        named[len(parts[0]) :] = parts[1]
    if plane is None and not in_space:
        named = _undominated(problem, named, h, source, field)
    if len(named) == 0:
        return None
    wave = wave_at(mesh.points, h0, named)
    return wave if plane is None else along_walls(wave, mesh.points, boundary.facets)


def _undominated(
    problem: Problem, named: IntArray, h: FloatArray, source: IntArray, field: ExactField
) -> IntArray:
    """Return edges and faces without those that a source of one of their nodes dominates.

    First the nodes are tested as such sources.  Then the remaining edges and faces with a node
    that keeps its bound are tested: where h0 has just become too steep, they dominate most others.
    """
    mesh, h0, g = problem.mesh, problem.h0, problem.g
    axes = (0,) * mesh.dim
    below = h0 - problem.margin

    def kept(rows: IntArray, source: IntArray, wave: Wave) -> BoolArray:
        keep = np.empty(len(rows), np.bool_)
        given = (*(read_only(array) for array in (rows, below, source)), wave.table)
        faces = True if mesh.dim == 3 else None
        block = new_block(mesh.dim)
        kernels.keep_undominated(mesh.points, axes, *given, g, True, faces, block, keep)
        return keep

    named = named[kept(named, source, field.waves[0])]
    used = named >= 0
    leads = (used & (source[named] < 0)).any(axis=1)
    if leads.all() or not leads.any():
        return named
    wave = wave_at(mesh.points, h0, named[leads])
    others = named[~leads]
    nodes = np.unique(others[others >= 0]).astype(np.int32)
    local = np.full(mesh.n_points, -1, np.int32)
    sizes, found = h.copy(), np.full(mesh.n_points, -1, np.int32)
    own = ExactField(g, None, True, [wave])
    places = np.ascontiguousarray(mesh.points[nodes])
    points = Points(mesh.points, nodes[along_curve(places)], local)
    own.lower_by_last(points, sizes, found, problem.threads, part_of(problem.report, 0.5, 0.5))
    others = others[kept(others, found, wave)]
    return np.concatenate([named[leads], others])


def _listed(kernel, given) -> IntArray:  # type: ignore[no-untyped-def]
    """Return the edges or faces that a kernel lists."""
    room = 2 * int(np.count_nonzero(given[3]))  # more is needed where most steep cells have kinks
    while True:
        rows = np.empty((room, 5), np.int32)
        count = kernel(*given, rows)
        if count <= room:
            break
        room = count
    return rows[:count]


def _chosen(rows: IntArray, width: int, listed: Kinks, g: float) -> IntArray:
    """Return the edges or faces that may be sources in all their cells."""
    if len(rows) == 0:
        return rows[:, :width]
    points, h0 = listed.points, listed.h0
    unique, group = unique_rows(rows[:, :width], len(points))
    allows = rows[:, width]
    kept = np.bincount(group, weights=allows & 1 == 0) == 0
    kept &= np.bincount(group, weights=allows & 2 > 0) > 0
    if width == 2 and points.shape[1] == 3:
        rows = rows[np.argsort(group, kind="stable")]
        first = np.concatenate([[0], np.cumsum(np.bincount(group))])
        blocked = np.empty(len(unique), np.bool_)
        arcs = np.empty((2, 2 * int(np.diff(first).max(initial=0))))
        kinks.mark_blocked(points, rows, first, h0, g, arcs[0], arcs[1], blocked)
        kept &= ~blocked
    chosen: IntArray = unique[kept]
    return chosen
