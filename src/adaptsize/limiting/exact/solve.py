"""Exact limiting on meshes: sources at nodes, edges, faces and corners, and allowed sizes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptsize._kernels import exact_candidates as candidates
from adaptsize._kernels.exact_plane import CORNER, ROW
from adaptsize.background._curve import along_curve
from adaptsize.geometry.boundary import FlatBoundary, plane_boundary
from adaptsize.limiting.edge_based import limit_along_edges
from adaptsize.limiting.exact.candidates import candidates_of, sources_on_cells
from adaptsize.limiting.exact.field import ExactField, Points
from adaptsize.limiting.exact.origins import Alone, Paths, complete
from adaptsize.limiting.exact.plane import Plane, at_nodes, plane_of, with_corners
from adaptsize.limiting.exact.problem import Problem
from adaptsize.limiting.exact.waves import Wave, node_wave
from adaptsize.limiting.exact.work import part_of
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

# Sizes that differ by less than this share are equal.
_EQUAL = 1e-12


@dataclass(eq=False)
class Found:
    """Sizes and their sources."""

    h: FloatArray
    source: IntArray
    """int32[n]: number of the entry in ``field``; -1 if the bound is kept, or if only ``nodes``
    names the source."""
    field: ExactField
    bend: FloatArray | None = None
    """float64[n, dim]: last bend of the path, nan if there is none; None if it follows from
    ``field``."""
    proved: BoolArray | None = None
    """bool[n]: nodes whose size is proved exact; None if all are."""
    lower: FloatArray | None = None
    """float64[n]: lower bounds, if not all nodes are proved."""
    plane: Plane | None = None
    points: Points | None = None
    """Points for `solve_again`."""
    nodes: IntArray | None = None
    """int32[n, dim]: the nodes of each source; None if they follow from ``source``."""
    finished: bool = True
    """Whether the search for paths around reflex edges was completed."""

    def named(self) -> IntArray:
        """Return the nodes of the source of each size, padded with -1; the own one of a bound."""
        if self.nodes is not None:
            return self.nodes
        every = np.concatenate([wave.nodes for wave in self.field.waves])
        nodes = np.full((len(self.source), every.shape[1]), -1, np.int32)
        nodes[:, 0] = np.arange(len(nodes))
        has = self.source >= 0
        nodes[has] = every[self.source[has]]
        return nodes

    def bends(self) -> FloatArray:
        """Return the last bend of the path to each node, nan if none; no rows if convex."""
        if self.bend is not None:
            return self.bend
        waves = self.field.waves
        if self.field.sight is None:
            return np.empty((0, waves[0].nodes.shape[1]))
        places = np.concatenate([wave.table[:, :2] for wave in waves])
        is_corner = np.concatenate([wave.table[:, CORNER] > 0.0 for wave in waves])
        bend = np.full((len(self.source), 2), np.nan)
        nodes = np.flatnonzero(self.source >= 0)
        nodes = nodes[is_corner[self.source[nodes]]]
        bend[nodes] = places[self.source[nodes]]
        return bend


def solve_on_mesh(problem: Problem, boundary: FlatBoundary, convex: bool) -> Found:
    """Solve on one component of triangles in the plane or of tetrahedra."""
    mesh, problem = problem.mesh, problem.with_margin()
    if len(boundary.facets) == 0:
        return _along_edges(problem)
    if convex:
        return solve_by_sight(problem, None, boundary)
    if mesh.dim == 3:
        return _solve_in_space(problem, boundary)
    plane = plane_of(mesh.points, plane_boundary(mesh, boundary))
    found = solve_by_sight(problem, plane, boundary)
    if rises_too_fast(problem, found.h):
        _keep_edges(problem, found)
    return found


def rises_too_fast(problem: Problem, h: FloatArray) -> bool:
    """Return whether sizes grow faster than g along any edge, as they may if cells overlap."""
    mesh = problem.mesh
    axes = (0,) * mesh.dim
    return bool(candidates.any_edge_exceeds(mesh.points, axes, mesh.cells, h, problem.g))


def solve_by_sight(problem: Problem, plane: Plane | None, boundary: FlatBoundary) -> Found:
    """Solve in a convex domain (no ``plane``) or in the plane."""
    mesh, h0, g = problem.mesh, problem.h0, problem.g
    on_wall = np.empty(0, np.int32) if plane is None else plane.boundary.rows
    order = along_curve(mesh.points) if problem.order is None else problem.order
    points = Points(mesh.points, order, on_wall)
    nodes, steep = candidates_of(problem)
    linear = steep is not None and problem.face_sources
    field = ExactField(g, None if plane is None else plane.sight, linear)
    field.add(_node_sources(problem, nodes, steep is not None, plane, linear))
    h, source = h0.copy(), np.full(mesh.n_points, -1, np.int32)
    report = part_of(problem.report, 0.1, 0.5 if linear else 1.0)
    field.lower_by_last(points, h, source, problem.threads, report)
    if not linear or steep is None:
        return Found(h, source, field, plane=plane, points=points)
    wave = sources_on_cells(problem, steep, h, source, field, plane, boundary)
    if wave is None and plane is not None and plane.merge is not None:
        wave = field.waves[0].only(np.zeros(len(field.waves[0].nodes), np.bool_))
    if wave is not None:
        if plane is not None:
            wave = with_corners(wave, g, plane, linear, problem.report)
        field.add(wave)
        report = part_of(problem.report, 0.5, 1.0)
        field.lower_by_last(points, h, source, problem.threads, report)
    problem.report("limiting the gradient", 1.0)
    return Found(h, source, field)


def sources_at_nodes(problem: Problem, plane: Plane | None) -> Wave | None:
    """Return nodes and corners as sources; None if edges may be sources, too."""
    problem = problem.with_margin()
    nodes, steep = candidates_of(problem)
    if steep is not None and problem.face_sources:
        return None
    return _node_sources(problem, nodes, steep is not None, plane, linear=False)


def _node_sources(
    problem: Problem, nodes: IntArray, meet: bool, plane: Plane | None, linear: bool
) -> Wave:
    """Return the survivors among nodes, and corners; in the plane all nodes if no bounds meet."""
    wave = wave_of_nodes(problem, nodes)
    given = (problem.g, linear, problem.threads, problem.report, problem.margin)
    if plane is None:
        return survivors_of(wave, *given)
    wave = at_nodes(wave, plane)
    if meet:
        wave = survivors_of(wave, *given, plane)
    return with_corners(wave, problem.g, plane, linear, problem.report)


def _solve_in_space(problem: Problem, boundary: FlatBoundary) -> Found:
    """Solve in a solid that is not convex."""
    from adaptsize.limiting.exact.space import (
        Entries,
        solid_of,
        solve_in_space,
        spread_along_edges,
    )

    mesh, h0, g = problem.mesh, problem.h0, problem.g
    nodes, steep = candidates_of(problem)
    solid = solid_of(mesh, boundary)
    linear = steep is not None and problem.face_sources
    field = ExactField(g, None, linear, [wave_of_nodes(problem, nodes)])
    lower, source = h0.copy(), np.full(mesh.n_points, -1, np.int32)
    points = Points(mesh.points, solid.nodes, np.empty(0, np.int32))
    field.lower_by_last(points, lower, source, problem.threads, problem.report)
    if linear and steep is not None:
        wave = sources_on_cells(problem, steep, lower, source, field, None, boundary, in_space=True)
        if wave is not None:
            field.add(wave)
            field.lower_by_last(points, lower, source, problem.threads, problem.report)
    named = np.concatenate([wave.nodes for wave in field.waves])
    order = np.lexsort(named.T[::-1]).astype(np.int32)
    place = np.empty(len(order) + 1, np.int32)  # of each entry in this order
    place[order], place[-1] = np.arange(len(order)), -1
    named[named >= mesh.n_points] = -1  # a point source is not a node and has no cells
    table = np.concatenate([wave.table for wave in field.waves])[order]
    result = solve_in_space(
        solid,
        h0,
        g,
        Entries(table, named[order]),
        lower,
        place[source],
        spread_along_edges(mesh, g, problem.report),
        problem.report,
        threads=problem.threads,
    )
    field.network = result.network
    found = Found(
        result.h,
        np.append(order, np.int32(-1))[result.entry],
        field,
        result.bend,
        result.proved,
        result.lower,
        finished=result.finished,
    )
    _name_all(problem, found, result.start)
    return found


def _name_all(problem: Problem, found: Found, start: IntArray) -> None:
    """Name the sources of sizes that come along edges (In/Out: found)."""
    mesh, h = problem.mesh, found.h
    named, bend = found.named(), found.bends()
    if len(bend) == 0:
        bend = np.full(mesh.points.shape, np.nan)
    known: BoolArray = (found.source >= 0) | (h >= problem.h0)
    if known.all():
        return
    rows = np.column_stack([named, np.where(np.isnan(bend), np.inf, bend)])
    ids = np.arange(mesh.n_points)
    complete(Paths(mesh.points, ids, mesh.edges, h, problem.g, start), rows, known, Alone())
    found.nodes, bend = rows[:, : mesh.dim].astype(np.int32), rows[:, mesh.dim :]
    found.bend = np.where(np.isinf(bend), np.nan, bend)


def _along_edges(problem: Problem) -> Found:
    """Solve if no cell has a measure: sizes propagate along edges, and nothing is proved."""
    mesh, h0, g = problem.mesh, problem.h0, problem.g
    nowhere = np.empty((0, mesh.dim))
    none = node_wave(nowhere, np.empty(0), np.empty(0, np.int32))
    field = ExactField(g, None, False, [none])
    found = Found(h0.copy(), np.full(mesh.n_points, -1, np.int32), field, nowhere)
    _keep_edges(problem, found)
    return found


def _keep_edges(problem: Problem, found: Found) -> None:
    """Lower sizes that exceed a neighbour by more than g allows (In/Out: found).

    Around folds, lines of sight end where paths along edges continue.  There, a size is proved
    exact only if it equals the size that would result if all sources were visible.
    """
    mesh, g = problem.mesh, problem.g
    along = limit_along_edges(mesh, found.h, g, problem.report)
    with np.errstate(invalid="ignore"):
        lowered = along < found.h * (1.0 - _EQUAL)
    if len(found.field.waves[0].nodes) and not lowered.any():
        return
    found.h[lowered] = along[lowered]
    found.source[lowered] = -1
    _name_all(problem, found, np.full(mesh.n_points, -1, np.int32))
    lower, source = problem.h0.copy(), np.full(mesh.n_points, -1, np.int32)
    points = Points(mesh.points, along_curve(mesh.points), np.empty(0, np.int32))
    unhidden = ExactField(g, None, found.field.linear)
    for wave in found.field.waves:
        unhidden.add(wave)
        unhidden.lower_by_last(points, lower, source, problem.threads, problem.report)
    found.lower, found.proved = lower, found.h <= lower * (1.0 + _EQUAL)


def survivors_of(
    wave: Wave,
    g: float,
    linear: bool,
    threads: int,
    report: ProgressCallback,
    margin: float = 0.0,
    plane: Plane | None = None,
) -> Wave:
    """Return the nodes whose bound no other one that is visible from there undercuts by more.

    ``margin`` is that of `Problem`.
    """
    if len(wave.nodes) == 0:
        return wave
    dim = wave.nodes.shape[1]
    rows = np.empty(0, np.int32) if plane is None else wave.table[:, ROW].astype(np.int32)
    order = np.arange(len(wave.nodes), dtype=np.int32)
    points = Points(wave.table[:, :dim].copy(), order, rows)
    field = ExactField(g, None if plane is None else plane.sight, linear, [wave])
    by = np.full(len(order), -1, np.int32)
    sizes = wave.sizes[:, 0] - margin
    field.lower_by_last(points, sizes, by, threads, part_of(report, 0.0, 0.1), once=True)
    survives: BoolArray = by < 0
    return wave.only(survives)


def wave_of_nodes(problem: Problem, nodes: IntArray) -> Wave:
    """Return nodes, and sources between nodes, as a wave."""
    places, sizes, extra = problem.mesh.points[nodes], problem.h0[nodes], problem.extra
    if extra is not None:
        places = np.concatenate([places, extra.points])
        sizes, nodes = np.concatenate([sizes, extra.sizes]), np.concatenate([nodes, extra.numbers])
    return node_wave(places, sizes, nodes)
