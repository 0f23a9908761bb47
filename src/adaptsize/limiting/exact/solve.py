"""Exact limiting on meshes: which nodes, edges, faces and corners decide, and what they allow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from adaptsize._kernels import exact as kernels
from adaptsize._kernels import exact_items as items
from adaptsize._kernels import exact_plane
from adaptsize._kernels.exact import Entries
from adaptsize.background.topology import unique_rows
from adaptsize.geometry.boundary import FlatBoundary, plane_boundary
from adaptsize.limiting.edge_based import solve_edge_based
from adaptsize.limiting.exact.field import ExactField, Points, Wave, wave_at, wave_of
from adaptsize.limiting.exact.plane import (
    Plane,
    along_walls,
    at_nodes,
    joined,
    plane_of,
    solve_corners,
)
from adaptsize.limiting.exact.space import build_sight, solve_in_space
from adaptsize.limiting.exact.work import along_curve, entries_of, in_chunks
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

if TYPE_CHECKING:
    from adaptsize.background import SimplexMesh


# Sizes that differ by less than this share are equal.
_EQUAL = 1e-12


class Extra(NamedTuple):
    """Sources between the nodes."""

    points: FloatArray
    """float64[k, dim]"""
    sizes: FloatArray
    """float64[k]"""
    numbers: IntArray
    """int32[k]: numbers that follow those of the nodes."""


class Problem(NamedTuple):
    """A mesh with bounds."""

    mesh: SimplexMesh
    h0: FloatArray
    g: float
    face_sources: bool
    threads: int
    report: ProgressCallback
    extra: Extra | None = None
    linear: IntArray | None = None
    """int32[m, dim + 1]: simplices on which h0 counts as linear, if not the cells."""

    order: IntArray | None = None
    """int32[n_points]: the nodes along a Morton curve, if that is known."""
    meet: bool | None = None
    """Whether two nodes of any simplex have bounds, if that is known."""

    @property
    def cells(self) -> IntArray:
        """Simplices on which h0 counts as linear."""
        return self.mesh.cells if self.linear is None else self.linear


@dataclass(eq=False)
class Found:
    """Sizes and where they come from."""

    h: FloatArray
    source: IntArray
    """int32[n]: number of the entry in ``field``; -1 where the bound is kept."""
    field: ExactField
    bend: FloatArray | None = None
    """float64[n, dim]: last place where the way bends, nan where there is none; None if ``field``
    tells it."""
    proved: BoolArray | None = None
    """bool[n]: nodes whose size is proved exact; None if all are."""
    lower: FloatArray | None = None
    """float64[n]: lower bounds, if not all nodes are proved."""
    plane: Plane | None = None
    points: Points | None = None
    """What `solve_again` starts from."""
    finished: bool = True
    """Whether the search for ways around reflex edges came to its end."""

    def bends(self) -> FloatArray:
        """Return where the way to each node bends last, nan where nowhere; no rows if convex."""
        if self.bend is not None:
            return self.bend
        places = np.concatenate([wave.seen.entries.places[:, 0] for wave in self.field.waves])
        if self.field.sight is None:
            return np.empty((0, places.shape[1]))
        is_corner = np.concatenate([wave.seen.is_corner for wave in self.field.waves])
        bend = np.full((len(self.source), places.shape[1]), np.nan)
        nodes = np.flatnonzero(self.source >= 0)
        nodes = nodes[is_corner[self.source[nodes]]]
        bend[nodes] = places[self.source[nodes]]
        return bend


def solve_on_mesh(problem: Problem, boundary: FlatBoundary, convex: bool) -> Found:
    """Solve on triangles in the plane or on tetrahedra, of one component."""
    mesh = problem.mesh
    if len(boundary.facets) == 0:
        return _along_edges(problem)
    if convex:
        return _solve(problem, None, boundary)
    if mesh.dim == 3:
        return _solve_in_space(problem, boundary)
    plane = plane_of(mesh.points, plane_boundary(mesh, boundary))
    found = _solve(problem, plane, boundary)
    if rises_too_fast(problem, found.h):
        _keep_edges(problem, found)
    return found


def rises_too_fast(problem: Problem, h: FloatArray) -> bool:
    """Tell whether sizes grow faster than g along any edge, as they may where cells overlap."""
    mesh = problem.mesh
    axes = (0,) * mesh.dim
    return bool(items.any_edge_exceeds(mesh.points, axes, mesh.cells, h, problem.g))


def _solve(problem: Problem, plane: Plane | None, boundary: FlatBoundary) -> Found:
    """Solve in a convex domain (no ``plane``) or in the plane."""
    mesh, h0, g = problem.mesh, problem.h0, problem.g
    on_wall = np.empty(0, np.int32) if plane is None else plane.boundary.rows
    order = along_curve(mesh.points) if problem.order is None else problem.order
    points = Points(mesh.points, order, on_wall)
    nodes, steep = _candidates(problem)
    nodes = _survivors(problem, nodes, plane, steep is not None)
    field = ExactField(g, None if plane is None else plane.sight)
    field.add(_with_corners(_at_nodes(problem, nodes, plane), g, plane))
    h, source = h0.copy(), np.full(mesh.n_points, -1, np.int32)
    linear = steep is not None and problem.face_sources
    report = part_of(problem.report, 0.1, 0.5 if linear else 1.0)
    field.lower_by_last(points, h, source, problem.threads, report)
    if not linear or steep is None:
        return Found(h, source, field, plane=plane, points=points)
    wave = _on_cells(problem, steep, h, source, field, plane, boundary)
    if wave is not None:
        field.add(_with_corners(wave, g, plane))
        report = part_of(problem.report, 0.5, 1.0)
        field.lower_by_last(points, h, source, problem.threads, report)
    problem.report("limiting the gradient", 1.0)
    return Found(h, source, field)


def sources_at_nodes(problem: Problem, plane: Plane | None) -> Wave | None:
    """Return nodes and corners as sources; None if edges may be sources, too."""
    nodes, steep = _candidates(problem)
    if steep is not None and problem.face_sources:
        return None
    nodes = _survivors(problem, nodes, plane, steep is not None)
    return _with_corners(_at_nodes(problem, nodes, plane), problem.g, plane)


def _with_corners(wave: Wave, g: float, plane: Plane | None) -> Wave:
    """Return a wave with the corners that its sources lower."""
    return wave if plane is None else joined(wave, solve_corners(g, plane, wave))


def _survivors(problem: Problem, nodes: IntArray, plane: Plane | None, meet: bool) -> IntArray:
    """Return those of the nodes that keep their bound; all of few in the plane."""
    if plane is None:
        places = np.ascontiguousarray(problem.mesh.points[nodes])
        sizes, threads = problem.h0[nodes], problem.threads
        return nodes[survivors_among(places, sizes, problem.g, threads, problem.report)]
    if meet and len(nodes):
        return nodes[_seen_survivors(problem, nodes, plane)]
    return nodes


def _solve_in_space(problem: Problem, boundary: FlatBoundary) -> Found:
    """Solve in a solid that is not convex."""
    mesh, h0, g = problem.mesh, problem.h0, problem.g
    nodes, steep = _candidates(problem)
    sight = build_sight(mesh, boundary)
    field = ExactField(g, None)
    field.add(_at_nodes(problem, nodes, None))
    lower, source = h0.copy(), np.full(mesh.n_points, -1, np.int32)
    points = Points(mesh.points, along_curve(mesh.points), np.empty(0, np.int32))
    field.lower_by_last(points, lower, source, problem.threads, problem.report)
    if steep is not None and problem.face_sources:
        wave = _on_cells(problem, steep, lower, source, field, None, boundary, in_space=True)
        if wave is not None:
            field.add(wave)
            field.lower_by_last(points, lower, source, problem.threads, problem.report)
    waves = field.waves
    entries = Entries(
        np.concatenate([wave.seen.entries.places for wave in waves]),
        np.concatenate([wave.seen.entries.sizes for wave in waves]),
        np.concatenate([wave.seen.entries.counts for wave in waves]),
        waves[0].seen.entries.boxes,
        waves[0].seen.entries.n_leaves,
    )
    named = np.concatenate([wave.nodes for wave in waves])
    named[named >= mesh.n_points] = -1  # no node's cells are around it
    result = solve_in_space(
        mesh,
        h0,
        g,
        entries,
        named,
        lower,
        source,
        boundary,
        problem.report,
        sight=sight,
        threads=problem.threads,
    )
    field.network = result.network
    return Found(
        result.h,
        result.entry,
        field,
        result.bend,
        result.proved,
        result.lower,
        finished=result.finished,
    )


def _along_edges(problem: Problem) -> Found:
    """Solve where no cell has a measure: sizes go along edges, and nothing is proved."""
    mesh, h0, g = problem.mesh, problem.h0, problem.g
    nowhere = np.empty((0, mesh.dim))
    field = ExactField(g, None, [node_wave(nowhere, np.empty(0), np.empty(0, np.int32))])
    found = Found(h0.copy(), np.full(mesh.n_points, -1, np.int32), field, nowhere)
    _keep_edges(problem, found)
    return found


def _keep_edges(problem: Problem, found: Found) -> None:
    """Lower what exceeds a neighbour by more than g allows (In/Out: found).

    Around folds lines of sight end where ways along edges do not; nothing is proved there but
    what is as small as it could be if nothing hid anything.
    """
    mesh, g = problem.mesh, problem.g
    slope = Slope(np.array([g]))
    along = solve_edge_based(mesh, found.h, slope, residual=False, report=problem.report).h
    with np.errstate(invalid="ignore"):
        lowered = along < found.h * (1.0 - _EQUAL)
    if len(found.field.waves[0].nodes) and not lowered.any():
        return
    found.h[lowered] = along[lowered]
    found.source[lowered] = -1
    lower, source = problem.h0.copy(), np.full(mesh.n_points, -1, np.int32)
    points = Points(mesh.points, along_curve(mesh.points), np.empty(0, np.int32))
    unhidden = ExactField(g, None)
    for wave in found.field.waves:
        unhidden.add(wave)
        unhidden.lower_by_last(points, lower, source, problem.threads, problem.report)
    found.lower, found.proved = lower, found.h <= lower * (1.0 + _EQUAL)


def _candidates(problem: Problem) -> tuple[IntArray, BoolArray | None]:
    """Return the nodes that may be sources, and the steep cells if bounds meet in any cell."""
    mesh, cells, h0 = problem.mesh, problem.cells, problem.h0
    if not (items.have_neighbours(cells, h0) if problem.meet is None else problem.meet):
        return np.flatnonzero(np.isfinite(h0)).astype(np.int32), None
    steep, candidate = np.empty(len(cells), np.bool_), np.empty(mesh.n_points, np.bool_)
    axes = (0,) * mesh.dim
    items.mark_steep(
        mesh.points, axes, cells, h0, problem.g, problem.face_sources, steep, candidate
    )
    return np.flatnonzero(candidate).astype(np.int32), steep


def part_of(report: ProgressCallback, first: float, last: float) -> ProgressCallback:
    """Return a callback for a part of the work, from one share of the whole to another."""

    def told(text: str, share: float | None) -> None:
        report(text, None if share is None else first + (last - first) * share)

    return told


def survivors_among(
    places: FloatArray, sizes: FloatArray, g: float, threads: int, report: ProgressCallback
) -> BoolArray:
    """Tell which nodes of a convex domain keep their bound under those of the others."""
    survives = np.empty(len(places), np.bool_)
    if len(places) == 0:
        return survives
    entries, order = entries_of(places[:, None], sizes[:, None])
    axes = (0,) * places.shape[1]

    def task(first: int, last: int) -> None:
        kernels.find_survivors(places, axes, order, first, last, entries, g, sizes, survives)

    in_chunks(task, len(places), threads, part_of(report, 0.0, 0.1))
    return survives


def _seen_survivors(problem: Problem, nodes: IntArray, plane: Plane) -> BoolArray:
    """Tell which nodes keep their bound under those that they see."""
    places = np.ascontiguousarray(problem.mesh.points[nodes])
    sizes, rows = problem.h0[nodes], plane.boundary.rows[nodes]
    survives = np.empty(len(nodes), np.bool_)
    wave = _at_nodes(problem, nodes, plane)
    order = along_curve(places)

    def task(first: int, last: int) -> None:
        exact_plane.find_seen_survivors(
            places,
            (0, 0),
            order,
            first,
            last,
            wave.seen,
            plane.sight,
            problem.g,
            sizes,
            rows,
            survives,
        )

    in_chunks(task, len(nodes), problem.threads, part_of(problem.report, 0.0, 0.1))
    return survives


def _at_nodes(problem: Problem, nodes: IntArray, plane: Plane | None) -> Wave:
    """Return nodes, and sources between them, as sources."""
    mesh, extra = problem.mesh, problem.extra
    places, sizes, names = mesh.points[nodes], problem.h0[nodes], nodes
    if extra is not None:
        places = np.concatenate([places, extra.points])
        sizes, names = np.concatenate([sizes, extra.sizes]), np.concatenate([nodes, extra.numbers])
    wave = node_wave(np.ascontiguousarray(places), sizes, names)
    return wave if plane is None else at_nodes(wave, plane)


def node_wave(places: FloatArray, sizes: FloatArray, names: IntArray) -> Wave:
    """Return points as sources."""
    entries, order = entries_of(places[:, None], sizes[:, None])
    named = np.full(places.shape, -1, np.int32)
    named[:, 0] = names[order]
    return wave_of(entries, named)


def _on_cells(
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
    given = (mesh.points, (0,) * mesh.dim, problem.cells, steep, h0, h, problem.g)
    parts = [_listed(items.list_edges, given, 2)]
    if mesh.dim == 3:
        parts.append(_listed(items.list_faces, given, 3))
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

    First the nodes are such sources; then, of what is left, the edges and faces with a
    node that keeps its bound: where h0 has just become too steep, they dominate most others.
    """
    mesh, h0, g = problem.mesh, problem.h0, problem.g
    axes = (0,) * mesh.dim

    def kept(rows: IntArray, source: IntArray, wave: Wave, faces: bool | None) -> BoolArray:
        keep = np.empty(len(rows), np.bool_)
        entries = wave.seen.entries
        items.keep_undominated(mesh.points, axes, rows, h0, source, entries, g, faces, keep)
        return keep

    named = named[kept(named, source, field.waves[0], None)]
    used = named >= 0
    leads = (used & (source[named] < 0)).any(axis=1)
    if leads.all() or not leads.any():
        return named
    wave = wave_at(mesh.points, h0, named[leads])
    others = named[~leads]
    nodes = np.unique(others[others >= 0]).astype(np.int32)
    local = np.full(mesh.n_points, -1, np.int32)
    sizes, found = h.copy(), np.full(mesh.n_points, -1, np.int32)
    own = ExactField(g, None, [wave])
    places = np.ascontiguousarray(mesh.points[nodes])
    points = Points(mesh.points, nodes[along_curve(places)], local)
    own.lower_by_last(points, sizes, found, problem.threads, part_of(problem.report, 0.5, 0.5))
    others = others[kept(others, found, wave, True if mesh.dim == 3 else None)]
    return np.concatenate([named[leads], others])


def _listed(kernel, given, width: int) -> IntArray:  # type: ignore[no-untyped-def]
    """Return the edges or faces that a kernel lists and that all cells allow to be sources."""
    room = 0
    while True:
        rows = np.empty((room, 5), np.int32)
        count = kernel(*given, rows)
        if count <= room:
            break
        room = count
    if count == 0:
        return rows[:, :width]
    points, h0, g = given[0], given[4], given[6]
    unique, group = unique_rows(rows[:, :width], len(points))
    allows = rows[:, width]
    kept = np.bincount(group, weights=allows & 1 == 0) == 0
    kept &= np.bincount(group, weights=allows & 2 > 0) > 0
    if width == 2 and points.shape[1] == 3:
        rows = rows[np.argsort(group, kind="stable")]
        first = np.concatenate([[0], np.cumsum(np.bincount(group))])
        blocked = np.empty(len(unique), np.bool_)
        items.mark_blocked(points, rows, first, h0, g, blocked)
        kept &= ~blocked
    chosen: IntArray = unique[kept]
    return chosen
