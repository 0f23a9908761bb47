"""The exact method on distributed meshes.

Each rank solves the problem of its own cells with the serial functions.  The sources that it
keeps are sent to the ranks on which they may matter, and lower the sizes there.  The result is the
minimum of the same numbers as on one process: see docs/distributed.md for the proof.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.exact_candidates import have_neighbours
from adaptsize.background._curve import along_curve
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.distributed.boundary import Skeleton, find_skeleton
from adaptsize.distributed.entries import exchange_entries, of_this_rank, reach_of
from adaptsize.distributed.info import Solved
from adaptsize.distributed.kinks import merge_kinks
from adaptsize.distributed.pieces import Piece, components_of, piece_of
from adaptsize.distributed.point_sources import locate
from adaptsize.distributed.solids import find_body, solve_body
from adaptsize.distributed.sources import Numbers, numbers_of, trace, untraced, with_piece
from adaptsize.geometry.boundary import plane_boundary
from adaptsize.limiting.exact.field import ExactField, Points
from adaptsize.limiting.exact.plane import Plane, plane_of
from adaptsize.limiting.exact.problem import Extra, Problem, margin_for
from adaptsize.limiting.exact.solve import (
    Found,
    rises_too_fast,
    solve_by_sight,
    survivors_of,
    wave_of_nodes,
)
from adaptsize.limiting.exact.work import number_of_threads
from adaptsize.limiting.problem import PointBounds
from adaptsize.ranks import Communicator, Ids
from adaptsize.typing import BoolArray, FloatArray, IntArray, ProgressCallback


class Given(NamedTuple):
    """Options, the same on all ranks."""

    g: float
    face_sources: bool
    threads: int | None
    report: ProgressCallback
    point_sources: PointBounds | None
    trace: bool
    """Whether to return the sources of the sizes."""


def solve_exact(part: PartitionedMesh, h0: FloatArray, given: Given) -> Solved | None:
    """Return the limited sizes on the nodes of this rank; collective.

    Returns None, on all ranks, if the mesh has cells without measure or cells that overlap.
    """
    traced = untraced(part) if given.trace else None
    whole = Solved(h0.copy(), 0, n_hidden=0)
    numbers = components_of(part).bounded(part.ranks, h0)
    located = locate(part, given.point_sources)
    if located is not None:
        numbers = sorted({*numbers, *located.pairs[:, 0].tolist()})
    for number in numbers:
        piece = piece_of(part, number)
        extra = None if located is None else located.extra(number, piece)
        solve = _solve_interval if part.dim == 1 else _solve_piece
        found = solve(part, number, piece, h0, given, extra)
        if found is None:
            return None
        whole.h[piece.nodes] = found.h[: len(piece.nodes)]
        if traced is not None and found.traced is not None:
            traced = with_piece(traced, piece, found.traced)
        whole = Solved(
            whole.h,
            whole.iterations + found.iterations,
            whole.finished and found.finished,
            (whole.n_hidden or 0) + (found.n_hidden or 0),
            max(whole.largest_gap, found.largest_gap),
        )
    return whole._replace(traced=traced)


def _solve_piece(
    part: PartitionedMesh,
    number: int,
    piece: Piece,
    h0: FloatArray,
    given: Given,
    extra: Extra | None,
) -> Solved | None:
    """Return the sizes in one component; None if its cells overlap."""
    threads = number_of_threads(given.threads)
    skeleton = part.once(f"_skeleton_{number}", lambda: find_skeleton(piece, threads))
    if skeleton is None:
        return None
    mesh, comm, bound = piece.mesh, piece.ranks, piece.bounds(h0)
    least = _least(bound, extra)
    facts = comm.allgather((least, bool(have_neighbours(mesh.cells, bound))))
    problem = Problem(
        mesh,
        bound,
        given.g,
        given.face_sources,
        threads,
        given.report,
        extra,
        order=along_curve(mesh.points),
        meet=any(meet for _, meet in facts),
        margin=margin_for(min(least for least, _ in facts), given.g, skeleton.diagonal),
        merge=lambda rows: merge_kinks(piece, rows),
    )
    ids = numbers_of(piece, problem, part.n_global_points)
    if skeleton.convex:
        numbers = Numbers(ids, piece.ids[:0]) if given.trace else None
        return _with_others(piece, problem, None, skeleton, numbers)
    if mesh.dim == 3:
        body = part.once(f"_body_{number}", lambda: find_body(piece, skeleton))
        return solve_body(part, piece, body, problem, ids, tracing=given.trace)
    plane, corners = part.once(f"_plane_{number}", lambda: _plane_on(piece, skeleton))
    numbers = Numbers(ids, corners) if given.trace else None
    found = _with_others(piece, problem, plane.without_sizes(), skeleton, numbers)
    folded = not piece.is_empty and rises_too_fast(problem, found.h)
    return None if comm.allreduce(int(folded), "max") else found


def _least(bound: FloatArray, extra: Extra | None) -> float:
    """Return the smallest bound at nodes of this rank and at points between the nodes."""
    least = float(bound.min())
    return least if extra is None else min(least, float(extra.sizes.min()))


def _solve_interval(
    part: PartitionedMesh,
    number: int,
    piece: Piece,
    h0: FloatArray,
    given: Given,
    extra: Extra | None,
) -> Solved:
    """Return the sizes in one component of segments on a line; one exchange."""
    g, threads = given.g, number_of_threads(given.threads)
    mesh, bound = piece.mesh, piece.bounds(h0)
    places = mesh.points
    order = along_curve(places)[: len(piece.ids)]
    ends = part.once(f"_ends_{number}", lambda: _ends(piece))
    least = piece.ranks.allreduce(_least(bound, extra), "min")
    nodes = np.flatnonzero(np.isfinite(bound)).astype(np.int32)
    problem = Problem(mesh, bound, g, False, threads, given.report, extra)
    wave = wave_of_nodes(problem, nodes)
    margin = margin_for(least, g, ends[1] - ends[0])
    wave = survivors_of(wave, g, False, threads, given.report, margin)
    h, source = bound.copy(), np.full(len(bound), -1, np.int32)
    points = Points(places, order, np.empty(0, np.int32))
    found = Found(h, source, ExactField(g, None, False, [wave]))
    found.field.lower_by_last(points, h, source, threads, given.report)
    ids = numbers_of(piece, problem, part.n_global_points)
    numbers = Numbers(ids, piece.ids[:0]) if given.trace else None
    return _exchanged(piece, problem, found, points, numbers)


def _ends(piece: Piece) -> tuple[float, float]:
    """Return the ends of an interval; collective."""
    own = piece.mesh.points[: len(piece.ids)]
    ends = np.array([own.min(initial=np.inf), -own.max(initial=-np.inf)])
    low, high = piece.ranks.allreduce(ends, "min").tolist()
    return low, -high


def _with_others(
    piece: Piece,
    problem: Problem,
    plane: Plane | None,
    skeleton: Skeleton,
    numbers: Numbers | None,
) -> Solved:
    """Return the sizes in a convex domain (no ``plane``) or in the plane; one exchange."""
    mesh, boundary = problem.mesh, skeleton.boundary
    if plane is not None:  # its facets are named by local nodes, others do not matter
        boundary = boundary._replace(facets=_local_facets(piece, skeleton))
    found = solve_by_sight(problem, plane, boundary)
    assert problem.order is not None
    order = problem.order[:0] if piece.is_empty else problem.order
    on_wall = np.empty(0, np.int32) if plane is None else plane.boundary.rows
    return _exchanged(piece, problem, found, Points(mesh.points, order, on_wall), numbers)


def _exchanged(
    piece: Piece, problem: Problem, found: Found, points: Points, numbers: Numbers | None
) -> Solved:
    """Return the sizes of one rank (In/Out: found) lowered by sources of others; one exchange.

    Sources are traced if the numbers of their nodes are given.
    """
    field = found.field
    sent = [of_this_rank(wave, problem.mesh.n_points) for wave in field.waves]
    reach = reach_of(points.places, points.order, found.h)
    named = None if numbers is None else [numbers.of(wave) for wave in sent]
    received, ids = exchange_entries(piece.ranks, sent, reach, problem.g, named)
    own = field.waves.copy()
    field.add(received)
    field.lower_by_last(points, found.h, found.source, problem.threads, problem.report)
    solved = Solved(found.h, field.n_entries)
    if numbers is None:
        return solved
    n = len(piece.ids)
    every = np.concatenate([*map(numbers.of, own), ids])
    sizes = np.concatenate([wave.sizes for wave in field.waves])
    traced = trace(piece.ids, found.source[:n], every, sizes, found.bends()[:n])
    return solved._replace(traced=traced)


def _plane_on(piece: Piece, skeleton: Skeleton) -> tuple[Plane, Ids]:
    """Return walls and corners, the same on all ranks, with the rows of local nodes.

    The nodes of corners are numbers in the second result, which holds global numbers.
    """
    counts = [np.bincount(ends, minlength=len(skeleton.ids)) for ends in skeleton.boundary.facets.T]
    irregular = np.flatnonzero((counts[0] != 1) | (counts[1] != 1)).astype(np.int32)
    wider, mesh = skeleton.with_cells(piece, irregular)
    whole = plane_boundary(mesh, wider.boundary)
    plane = plane_of(mesh.points, whole)
    rows = np.append(whole.rows, np.int32(-1))[wider.rows(piece.ids)]
    if piece.is_empty:
        rows = np.full(piece.mesh.n_points, -1, np.int32)

    def merge(sizes: FloatArray, arrivals: FloatArray, lowered: BoolArray) -> None:
        _merge_corners(piece.ranks, sizes, arrivals, lowered)

    return replace(plane, boundary=whole._replace(rows=rows), merge=merge), wider.ids


def _merge_corners(
    comm: Communicator, sizes: FloatArray, arrivals: FloatArray, lowered: BoolArray
) -> None:
    """Take the smallest size that any rank has found at each corner (In/Out: all)."""
    every = comm.allgather((sizes, arrivals, lowered))
    all_sizes = np.array([own[0] for own in every])
    best = np.argmin(all_sizes, axis=0), np.arange(len(sizes))
    sizes[:] = all_sizes[best]
    arrivals[:] = np.array([own[1] for own in every])[best]
    lowered[:] = np.array([own[2] for own in every])[best]


def _local_facets(piece: Piece, skeleton: Skeleton) -> IntArray:
    """Return the facets of the boundary both of whose nodes are on this rank, as local nodes."""
    at = np.minimum(np.searchsorted(piece.ids, skeleton.ids), max(len(piece.ids) - 1, 0))
    if piece.is_empty:
        return np.empty((0, 2), np.int32)
    local = np.where(piece.ids[at] == skeleton.ids, at, -1).astype(np.int32)
    facets = local[skeleton.boundary.facets]
    return facets[(facets >= 0).all(axis=1)]
