"""Exact limiting on meshes: sources at nodes, edges, faces and corners, and allowed sizes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from adaptsize._kernels import exact as kernels
from adaptsize._kernels import exact_candidates as candidates
from adaptsize._kernels import exact_plane
from adaptsize._kernels.exact import Entries
from adaptsize.geometry.boundary import FlatBoundary, plane_boundary
from adaptsize.limiting.edge_based import solve_edge_based
from adaptsize.limiting.exact.candidates import candidates_of, sources_on_cells
from adaptsize.limiting.exact.field import ExactField, Points, Wave, wave_of
from adaptsize.limiting.exact.plane import (
    Plane,
    at_nodes,
    joined,
    plane_of,
    solve_corners,
)
from adaptsize.limiting.exact.problem import Problem
from adaptsize.limiting.exact.space import solve_in_space
from adaptsize.limiting.exact.space_sight import build_sight
from adaptsize.limiting.exact.work import along_curve, entries_of, in_chunks, part_of
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback

if TYPE_CHECKING:
    pass


# Sizes that differ by less than this share are equal.
_EQUAL = 1e-12


@dataclass(eq=False)
class Found:
    """Sizes and their sources."""

    h: FloatArray
    source: IntArray
    """int32[n]: number of the entry in ``field``; -1 if the bound is kept."""
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
    finished: bool = True
    """Whether the search for paths around reflex edges was completed."""

    def bends(self) -> FloatArray:
        """Return the last bend of the path to each node, nan if none; no rows if convex."""
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
    """Solve on one component of triangles in the plane or of tetrahedra."""
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
    """Return whether sizes grow faster than g along any edge, as they may if cells overlap."""
    mesh = problem.mesh
    axes = (0,) * mesh.dim
    return bool(candidates.any_edge_exceeds(mesh.points, axes, mesh.cells, h, problem.g))


def _solve(problem: Problem, plane: Plane | None, boundary: FlatBoundary) -> Found:
    """Solve in a convex domain (no ``plane``) or in the plane."""
    mesh, h0, g = problem.mesh, problem.h0, problem.g
    on_wall = np.empty(0, np.int32) if plane is None else plane.boundary.rows
    order = along_curve(mesh.points) if problem.order is None else problem.order
    points = Points(mesh.points, order, on_wall)
    nodes, steep = candidates_of(problem)
    nodes = _survivors(problem, nodes, plane, steep is not None)
    field = ExactField(g, None if plane is None else plane.sight)
    field.add(_with_corners(_at_nodes(problem, nodes, plane), g, plane))
    h, source = h0.copy(), np.full(mesh.n_points, -1, np.int32)
    linear = steep is not None and problem.face_sources
    report = part_of(problem.report, 0.1, 0.5 if linear else 1.0)
    field.lower_by_last(points, h, source, problem.threads, report)
    if not linear or steep is None:
        return Found(h, source, field, plane=plane, points=points)
    wave = sources_on_cells(problem, steep, h, source, field, plane, boundary)
    if wave is not None:
        field.add(_with_corners(wave, g, plane))
        report = part_of(problem.report, 0.5, 1.0)
        field.lower_by_last(points, h, source, problem.threads, report)
    problem.report("limiting the gradient", 1.0)
    return Found(h, source, field)


def sources_at_nodes(problem: Problem, plane: Plane | None) -> Wave | None:
    """Return nodes and corners as sources; None if edges may be sources, too."""
    nodes, steep = candidates_of(problem)
    if steep is not None and problem.face_sources:
        return None
    nodes = _survivors(problem, nodes, plane, steep is not None)
    return _with_corners(_at_nodes(problem, nodes, plane), problem.g, plane)


def _with_corners(wave: Wave, g: float, plane: Plane | None) -> Wave:
    """Return a wave with the corners that its sources lower."""
    return wave if plane is None else joined(wave, solve_corners(g, plane, wave))


def _survivors(problem: Problem, nodes: IntArray, plane: Plane | None, meet: bool) -> IntArray:
    """Return the nodes that keep their bound; in the plane, all nodes if no bounds meet."""
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
    nodes, steep = candidates_of(problem)
    sight = build_sight(mesh, boundary)
    field = ExactField(g, None)
    field.add(_at_nodes(problem, nodes, None))
    lower, source = h0.copy(), np.full(mesh.n_points, -1, np.int32)
    points = Points(mesh.points, along_curve(mesh.points), np.empty(0, np.int32))
    field.lower_by_last(points, lower, source, problem.threads, problem.report)
    if steep is not None and problem.face_sources:
        wave = sources_on_cells(problem, steep, lower, source, field, None, boundary, in_space=True)
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
    named[named >= mesh.n_points] = -1  # a point source is not a node and has no cells
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
    """Solve if no cell has a measure: sizes propagate along edges, and nothing is proved."""
    mesh, h0, g = problem.mesh, problem.h0, problem.g
    nowhere = np.empty((0, mesh.dim))
    field = ExactField(g, None, [node_wave(nowhere, np.empty(0), np.empty(0, np.int32))])
    found = Found(h0.copy(), np.full(mesh.n_points, -1, np.int32), field, nowhere)
    _keep_edges(problem, found)
    return found


def _keep_edges(problem: Problem, found: Found) -> None:
    """Lower sizes that exceed a neighbour by more than g allows (In/Out: found).

    Around folds, lines of sight end where paths along edges continue.  There, a size is proved
    exact only if it equals the size that would result if all sources were visible.
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


def survivors_among(
    places: FloatArray, sizes: FloatArray, g: float, threads: int, report: ProgressCallback
) -> BoolArray:
    """Return which nodes of a convex domain keep their bound, given the bounds of the others."""
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
    """Return which nodes keep their bound, given the bounds visible from them."""
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
    """Return nodes, and sources between nodes, as a wave."""
    mesh, extra = problem.mesh, problem.extra
    places, sizes, names = mesh.points[nodes], problem.h0[nodes], nodes
    if extra is not None:
        places = np.concatenate([places, extra.points])
        sizes, names = np.concatenate([sizes, extra.sizes]), np.concatenate([nodes, extra.numbers])
    wave = node_wave(np.ascontiguousarray(places), sizes, names)
    return wave if plane is None else at_nodes(wave, plane)


def node_wave(places: FloatArray, sizes: FloatArray, names: IntArray) -> Wave:
    """Return points as a wave of sources."""
    entries, order = entries_of(places[:, None], sizes[:, None])
    named = np.full(places.shape, -1, np.int32)
    named[:, 0] = names[order]
    return wave_of(entries, named)
