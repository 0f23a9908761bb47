"""Exact limiting on any flat background: components, lines, meshes and grids."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.exact_candidates import have_neighbours
from adaptsize._kernels.topology import join_cells, mark_nodes
from adaptsize._kernels.trees import fill_tiles
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.splitting_grid import both_ways
from adaptsize.geometry.boundary import FlatBoundary, flat_boundary
from adaptsize.geometry.convexity import is_convex
from adaptsize.limiting.edge_based import solve_grid_edges
from adaptsize.limiting.exact.again import solve_again
from adaptsize.limiting.exact.field import ExactField, Points
from adaptsize.limiting.exact.problem import Extra, Problem, margin_for
from adaptsize.limiting.exact.solve import Found, solve_on_mesh, survivors_of
from adaptsize.limiting.exact.waves import node_wave
from adaptsize.limiting.exact.work import number_of_threads, part_of
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.limiting.problem import PointBounds
from adaptsize.limiting.solution import Solution
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

# Sizes that differ by less than this share are equal.
_EQUAL = 1e-12

# Points this far outside, relative to the diagonal of the background, count as inside.
OUTSIDE = 1e-9

# Nodes of a tile of a grid, which is a block of the kernels.
_TILES = {1: (32, 1, 1), 2: (4, 8, 1), 3: (4, 4, 2)}


UNFINISHED = (
    "the exact method stopped its search for paths over reflex edges with sizes still falling: "
    "some sizes are larger than the shortest paths allow"
)


class Part(NamedTuple):
    """A component of the domain and its solution."""

    nodes: IntArray | None
    """Its nodes in the background; None for all nodes."""
    found: Found


@dataclass(frozen=True, kw_only=True, eq=False)
class ExactSolution(Solution):
    """Limited sizes, their sources, and which sizes are proved exact."""

    parts: list[Part] = field(default_factory=list)
    """Components with a bound."""
    n_proved: int
    """Number of nodes whose size is proved exact."""
    largest_gap: float
    """Largest difference between a size that is not proved exact and its lower bound."""


def solve_exact(
    background: SimplexMesh | CartesianGrid,
    h0: FloatArray,
    slope: Slope,
    *,
    face_sources: bool,
    threads: int | None,
    report: ProgressCallback,
    point_sources: PointBounds | None = None,
) -> ExactSolution:
    r"""Return :math:`\min_y h_0(y) + g\, d(x, y)` with the length d of paths in the domain.

    In convex domains and in the plane, d is the length of the shortest path and the result is
    exact to rounding.  In solids this holds at each x from which the minimising point is visible.
    Elsewhere d is the length of a path over reflex edges, so that no size is too small.

    Parameters
    ----------
    background : SimplexMesh or CartesianGrid
        Must have ``cell_dim == dim``.  The domain of a grid with inactive nodes is the cubical
        complex of the active nodes.
    h0 : float64, of the nodal shape
        Finite at one node at least.
    slope : Slope
        One number.
    face_sources : bool
        Whether ``h0`` is linear on the cells (of ``grid.mesh``), or given at the nodes only.
    threads : int or None
        Number of threads; None is that of numba.  The result does not depend on it, bit for bit.
    report : callable
    point_sources : PointBounds, optional
        Bounds at points between the nodes.  Points outside the domain have no effect.

    Raises
    ------
    ValueError
        If g varies in space, or the mesh is a surface or curve in a larger space.

    Notes
    -----
    See docs/exact-limiting.md for theory, proofs, and measured errors and times.
    """
    g = slope.number("exact")
    extra = _inside(background, point_sources)
    given = (g, face_sources, number_of_threads(threads), report)
    if isinstance(background, CartesianGrid):
        if background.active is not None:
            return _on_active(background, h0, given, point_sources)
        if not face_sources or background.dim == 1 or not _meet(h0):
            found = _on_convex_nodes(background, h0.ravel(), given, extra)
            return as_solution(h0, [Part(None, found)])
        return _on_grid_mesh(background, h0, given, extra)
    if background.cell_dim != background.dim:
        raise ValueError(
            f"method='exact' needs a flat domain of full dimension, got {background!r}"
        )
    if background.dim == 1:
        return _by_components(background, h0, given, extra)
    problem, boundary, all_used = _prepared(Problem(background, h0.ravel(), *given, extra))
    convex = is_convex(background.points, boundary)
    if not (all_used and (convex or _is_connected(background))):
        return _by_components(background, h0, given, extra)
    return as_solution(h0, [Part(None, solve_on_mesh(problem, boundary, convex))])


def _prepared(problem: Problem) -> tuple[Problem, FlatBoundary, bool]:
    """Return the problem with order and neighbours, the boundary, and if all nodes are in cells.

    With several threads, the boundary is computed at the same time.
    """
    mesh = problem.mesh
    with ThreadPoolExecutor(1) as beside:
        order = beside.submit(along_curve, mesh.points)
        meet = beside.submit(have_neighbours, mesh.cells, problem.h0)
        used = beside.submit(mark_nodes, mesh.cells, np.zeros(mesh.n_points, np.bool_))
        if problem.threads == 1:
            wait([order, meet, used])
        boundary = flat_boundary(mesh, problem.threads)
        problem = problem._replace(order=order.result(), meet=meet.result())
        return problem, boundary, used.result() == mesh.n_points


def solve_exact_again(
    background: SimplexMesh | CartesianGrid,
    h0: FloatArray,
    slope: Slope,
    earlier: ExactSolution,
    *,
    face_sources: bool,
    threads: int | None,
    report: ProgressCallback,
) -> ExactSolution | None:
    """Solve like `solve_exact`, from the solution for other bounds; None if not supported.

    Supported are meshes all of whose nodes are in one component.
    """
    if len(earlier.parts) != 1 or earlier.parts[0].nodes is not None:
        return None
    if not isinstance(background, SimplexMesh):
        return None
    given = (slope.number("exact"), face_sources, number_of_threads(threads), report)
    found = solve_again(Problem(background, h0, *given), earlier.parts[0].found)
    return None if found is None else as_solution(h0, [Part(None, found)])


def _inside(
    background: SimplexMesh | CartesianGrid, point_sources: PointBounds | None
) -> Extra | None:
    """Return the sources between the nodes that lie in the domain."""
    if point_sources is None:
        return None
    places, sizes = point_sources
    numbers = background.n_points + np.arange(len(places), dtype=np.int32)
    away = background.locator.weights(places)[2]
    inside = (away <= OUTSIDE * background.diagonal) & np.isfinite(sizes)
    return Extra(np.ascontiguousarray(places[inside]), sizes[inside], numbers[inside])


def _by_components(
    mesh: SimplexMesh,
    h0: FloatArray,
    given: tuple[float, bool, int, ProgressCallback],
    extra: Extra | None,
    linear: IntArray | None = None,
) -> ExactSolution:
    """Solve on one component after another; nodes in no cell keep their bounds."""
    parts = []
    bound = h0.ravel().copy()
    which, beside = np.empty(0, np.int64), np.empty(0, np.int32)
    if extra is not None:  # each belongs to all components of which a cell holds it
        which, cells = mesh.locator.within(extra.points, OUTSIDE * mesh.diagonal)
        beside = mesh.cells[cells, 0]
    for nodes, component in _components(mesh, bound, beside):
        own = bound if nodes is None else bound[nodes]
        some = extra
        if extra is not None and nodes is not None:
            here = np.unique(which[np.isin(beside, nodes)])
            # Their numbers follow those of the nodes, in a component as in the whole mesh.
            numbers = extra.numbers[here] + np.int32(len(nodes) - mesh.n_points)
            some = Extra(extra.points[here], extra.sizes[here], numbers)
        if mesh.dim == 1:  # an interval; folds change nothing
            problem = Problem(component, own, *given, some).with_margin()
            found = _on_convex_nodes(component.points, own, given, some, problem.margin)
        else:
            also = linear
            if linear is not None and nodes is not None:
                local = np.full(mesh.n_points, -1, np.int32)
                local[nodes] = np.arange(len(nodes))
                also = local[linear]
                also = read_only(np.ascontiguousarray(also[also[:, 0] >= 0]))
            boundary = flat_boundary(component, given[2])
            convex = is_convex(component.points, boundary)
            found = solve_on_mesh(Problem(component, own, *given, some, also), boundary, convex)
        parts.append(Part(nodes, found))
    return as_solution(h0, parts)


def as_solution(h0: FloatArray, parts: list[Part]) -> ExactSolution:
    """Return the solution composed of those of the components; elsewhere bounds are kept."""
    flat = h0.ravel().copy()
    n_hidden, gap, n_entries = 0, 0.0, 0
    finished = all(found.finished for _, found in parts)
    for nodes, found in parts:
        flat[slice(None) if nodes is None else nodes] = found.h
        n_entries += found.field.n_entries
        if found.proved is not None and found.lower is not None:
            hidden = ~found.proved
            n_hidden += int(np.count_nonzero(hidden))
            gap = max(gap, float((found.h - found.lower)[hidden].max(initial=0.0)))
    h = flat.reshape(h0.shape)
    return ExactSolution(
        h,
        n_entries,
        0.0,
        "" if finished else UNFINISHED,
        parts=parts,
        n_proved=h.size - n_hidden,
        largest_gap=gap,
    )


def _roots(mesh: SimplexMesh) -> IntArray:
    """Return for each node the smallest node of its component."""
    parent = np.arange(mesh.n_points, dtype=np.int32)
    join_cells(mesh.cells, parent)
    return parent


def _is_connected(mesh: SimplexMesh) -> bool:
    """Return whether all nodes are in one component."""
    return not _roots(mesh).any()


def _components(
    mesh: SimplexMesh, h0: FloatArray, beside: IntArray
) -> Iterator[tuple[IntArray | None, SimplexMesh]]:
    """Yield the components with a bound, or with one of the nodes ``beside``, and their nodes."""
    parent = _roots(mesh)
    if not parent.any():
        yield None, mesh
        return
    used = np.zeros(mesh.n_points, np.bool_)
    used[mesh.cells] = True
    local = np.empty(mesh.n_points, np.int32)
    of_cells = parent[mesh.cells[:, 0]]
    wanted = np.concatenate([parent[used & np.isfinite(h0)], parent[beside]])
    for root in np.unique(wanted).tolist():
        nodes = np.flatnonzero(used & (parent == root)).astype(np.int32)
        local[nodes] = np.arange(len(nodes))
        cells = local[mesh.cells[of_cells == root]]
        yield nodes, SimplexMesh(mesh.points[nodes], cells)


def _on_convex_nodes(
    domain: FloatArray | CartesianGrid,
    h0: FloatArray,
    given: tuple[float, bool, int, ProgressCallback],
    extra: Extra | None,
    margin: float = 0.0,
) -> Found:
    """Solve for bounds at the nodes of a convex domain, given by its points or as a grid."""
    g, _, threads, report = given
    nodes = np.flatnonzero(np.isfinite(h0)).astype(np.int32)
    if isinstance(domain, CartesianGrid):
        index = np.stack(np.unravel_index(nodes, domain.shape), axis=1)
        places = domain.origin + domain.spacing * index
    else:
        places = domain[nodes]
    sizes = h0[nodes]
    if extra is not None:
        places = np.concatenate([places, extra.points])
        sizes, nodes = np.concatenate([sizes, extra.sizes]), np.concatenate([nodes, extra.numbers])
    wave = survivors_of(node_wave(places, sizes, nodes), g, False, threads, report, margin)
    exact = ExactField(g, None, False, [wave])
    h, source = h0.copy(), np.full(len(h0), -1, np.int32)
    for first, points in slabs_of(domain):
        last = first + len(points.places)
        part = part_of(report, 0.1 + 0.9 * first / len(h), 0.1 + 0.9 * last / len(h))
        exact.lower_by_last(points, h[first:last], source[first:last], threads, part)
    return Found(h, source, exact)


def slabs_of(domain: FloatArray | CartesianGrid) -> Iterator[tuple[int, Points]]:
    """Yield the nodes in blocks: all nodes of a line, a million at a time of a grid."""
    none = np.empty(0, np.int32)
    if not isinstance(domain, CartesianGrid):
        yield 0, Points(domain, np.argsort(domain[:, 0], kind="stable").astype(np.int32), none)
        return
    order, first = none, 0
    for slab, places in domain.slabs():
        shape = (slab.stop - slab.start, *domain.shape[1:])
        if len(order) != len(places):
            order = np.empty(len(places), np.int32)
            fill_tiles((*shape, 1, 1)[:3], _TILES[domain.dim], order)
        yield first, Points(places, order, none)
        first += len(places)


def _on_grid_mesh(
    grid: CartesianGrid,
    h0: FloatArray,
    given: tuple[float, bool, int, ProgressCallback],
    extra: Extra | None,
) -> ExactSolution:
    """Solve on the whole boxes of a grid, split into simplices on which h0 is linear.

    In the plane each box is split along both diagonals, and the lower size is used; no diagonal is
    preferred.
    """
    linear = read_only(both_ways(np.isfinite(h0), grid.active)) if grid.dim == 2 else None
    return _by_components(grid.mesh, h0, given, extra, linear)


def _meet(h0: FloatArray) -> bool:
    """Return whether two corners of any box of a grid have bounds."""
    finite = np.isfinite(h0)
    if not finite.any():
        return False
    for axis in range(h0.ndim):  # sums over boxes, axis by axis
        finite = finite.astype(np.int8) if finite.dtype == np.bool_ else finite
        n = finite.shape[axis]
        finite = finite.take(range(n - 1), axis) + finite.take(range(1, n), axis)
    return bool((finite > 1).any())


def _on_active(
    grid: CartesianGrid,
    h0: FloatArray,
    given: tuple[float, bool, int, ProgressCallback],
    point_sources: PointBounds | None,
) -> ExactSolution:
    """Solve on the active nodes of a grid.

    The exact method is used on the whole boxes.  On the remaining edges, sizes propagate from node
    to node.  The two alternate until neither lowers a size.
    """
    g, _, threads, report = given
    assert grid.active is not None  # else the box is convex
    slope = Slope(np.array([g]))
    if grid.n_cells == 0:  # no whole box
        found = solve_grid_edges(grid, h0, slope, report=report)
        return as_solution(found.h, [])
    mesh = grid.mesh
    solution = _on_grid_mesh(grid, h0, given, _inside(mesh, point_sources))
    h, parts, n_later = solution.h, solution.parts, 0
    unfinished = solution.unfinished
    while True:
        along = solve_grid_edges(grid, h, slope, report=report).h
        with np.errstate(invalid="ignore"):
            lowered = along < h * (1.0 - _EQUAL)
        if not lowered.any():
            break
        seeds = np.where(lowered, along, np.inf)
        more = solve_exact(
            mesh, seeds.ravel(), slope, face_sources=False, threads=threads, report=report
        )
        unfinished = unfinished or more.unfinished
        lower = np.minimum(along, more.h.reshape(h0.shape))
        n_later += int(np.count_nonzero(lower < h * (1.0 - _EQUAL))) if grid.dim == 3 else 0
        h, parts = lower, []
    return ExactSolution(
        h,
        solution.iterations,
        0.0,
        unfinished,
        parts=parts,
        n_proved=max(0, solution.n_proved - int(np.count_nonzero(~grid.active)) - n_later),
        largest_gap=solution.largest_gap,
    )


def limit_points(
    points: FloatArray, bounds: FloatArray, n: int, g: float, report: ProgressCallback
) -> tuple[FloatArray, IntArray]:
    r"""Return :math:`\min_j b_j + g |x_i - x_j|` at the first n points, and the j of each.

    Parameters
    ----------
    points : float64[m, dim]
        dim 2 or 3.
    bounds : float64[m]
        inf where there is none.
    n : int
        Sizes are returned at so many points.
    g : float
    report : callable

    Returns
    -------
    float64[n]
        Bit by bit the same in any order of the points.
    int32[n]
        -1 where no bound reaches.
    """
    margin = margin_for(float(bounds.min()), g, float(np.linalg.norm(np.ptp(points, axis=0))))
    threads = number_of_threads(None)
    nodes = np.flatnonzero(np.isfinite(bounds)).astype(np.int32)
    wave = node_wave(points[nodes], bounds[nodes], nodes)
    field = ExactField(g, None, False, [survivors_of(wave, g, False, threads, report, margin)])
    wanted = Points(points[:n], along_curve(points[:n]), np.empty(0, np.int32))
    h, source = bounds[:n].copy(), np.full(n, -1, np.int32)
    field.lower_by_last(wanted, h, source, threads, report)
    return h, Found(h, source, field).named()[:, 0]
