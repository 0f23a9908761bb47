"""Exact limiting on any flat background: components, lines, meshes and grids."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from adaptsize._kernels.topology import join_cells, mark_nodes
from adaptsize._kernels.trees import fill_tiles
from adaptsize.background import CartesianGrid, SimplexMesh
from adaptsize.geometry.boundary import flat_boundary, is_convex
from adaptsize.limiting.exact.again import solve_again
from adaptsize.limiting.exact.field import ExactField, Points, wave_of
from adaptsize.limiting.exact.solve import Found, Problem, solve_on_mesh, survivors_among
from adaptsize.limiting.exact.work import entries_of, number_of_threads
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.limiting.grid_marching import solve_grid_edges
from adaptsize.limiting.solution import Solution
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

# Sizes that differ by less than this share are equal.
_EQUAL = 1e-12

# Nodes of a tile of a grid, which is a block of the kernels.
_TILES = {1: (32, 1, 1), 2: (4, 8, 1), 3: (4, 4, 2)}


class Part(NamedTuple):
    """A component of the domain, and what was found there."""

    nodes: IntArray | None
    """Its nodes in the background; None if they are all nodes."""
    found: Found


@dataclass(frozen=True, kw_only=True, eq=False)
class ExactSolution(Solution):
    """Limited sizes, where they come from, and how far they are proved."""

    parts: list[Part] = field(default_factory=list)
    """Components with a bound."""
    n_proved: int
    """Number of nodes whose size is proved to be the exact one."""
    largest_gap: float
    """Largest difference of a size that is not proved and its lower bound."""


def solve_exact(
    background: SimplexMesh | CartesianGrid,
    h0: FloatArray,
    slope: Slope,
    *,
    face_sources: bool,
    threads: int | None,
    report: ProgressCallback,
) -> ExactSolution:
    r"""Return :math:`\min_y h_0(y) + g\, d(x, y)` at all nodes, d the length of a way in the domain.

    Convex domains, and domains in the plane: to rounding.  In space where the minimum is at a
    point that x sees; elsewhere the length of a way over reflex edges, hence never too small.

    Parameters
    ----------
    background : SimplexMesh or CartesianGrid
        ``cell_dim == dim``.  The domain of a grid with inactive nodes is the cubical complex of
        the active ones.
    h0 : float64, of the nodal shape
        Finite at one node at least.
    slope : Slope
        One number.
    face_sources : bool
        Whether ``h0`` counts as linear on the cells (of ``grid.mesh``), or as given at nodes only.
    threads : int or None
        None: as many as numba uses.  The result is the same for any number, bit by bit.
    report : callable

    Raises
    ------
    ValueError
        If g varies in space, or the mesh is a surface or curve in a larger space.

    Notes
    -----
    See docs/exact-limiting.md for theory, proofs, and measured errors and times.
    """
    g = slope.number("exact")
    given = (g, face_sources, number_of_threads(threads), report)
    if isinstance(background, CartesianGrid):
        if background.active is not None:
            return _on_active(background, h0, given)
        if not face_sources or background.dim == 1 or not _meet(h0):
            return _as_solution(h0, [Part(None, _on_box(background, h0, given))])
        background = background.mesh
    elif background.cell_dim != background.dim:
        raise ValueError(
            f"method='exact' needs a flat domain of full dimension, got {background!r}"
        )
    if not (mark_used(background) and background.dim > 1):
        return _by_components(background, h0, given)
    boundary = flat_boundary(background)
    if not is_convex(background.points, boundary):
        return _by_components(background, h0, given)
    found = solve_on_mesh(Problem(background, h0.ravel(), *given), boundary)
    return _as_solution(h0, [Part(None, found)])


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
    """Solve as `solve_exact` from the solution for other bounds; None if that is no use.

    Only for meshes all of whose nodes are in one component.
    """
    if len(earlier.parts) != 1 or earlier.parts[0].nodes is not None:
        return None
    if not isinstance(background, SimplexMesh):
        return None
    given = (slope.number("exact"), face_sources, number_of_threads(threads), report)
    found = solve_again(Problem(background, h0, *given), earlier.parts[0].found)
    return None if found is None else _as_solution(h0, [Part(None, found)])


def mark_used(mesh: SimplexMesh) -> bool:
    """Tell whether all nodes are in a cell."""
    return int(mark_nodes(mesh.cells, np.zeros(mesh.n_points, np.bool_))) == mesh.n_points


def _by_components(
    mesh: SimplexMesh, h0: FloatArray, given: tuple[float, bool, int, ProgressCallback]
) -> ExactSolution:
    """Solve on one component after another; nodes in no cell keep their bounds."""
    parts = []
    for nodes, component in _components(mesh, h0.ravel()):
        bound = h0.ravel() if nodes is None else h0.ravel()[nodes]
        if mesh.dim == 1:  # an interval; folds change nothing
            found = _on_convex_nodes(component.points, None, bound, given)
        else:
            found = solve_on_mesh(Problem(component, bound, *given), None)
        parts.append(Part(nodes, found))
    return _as_solution(h0, parts)


def _as_solution(h0: FloatArray, parts: list[Part]) -> ExactSolution:
    """Return the solution made of those of the components; elsewhere bounds are kept."""
    h = h0.ravel().copy()
    n_hidden, gap, n_entries = 0, 0.0, 0
    for nodes, found in parts:
        h[slice(None) if nodes is None else nodes] = found.h
        n_entries += found.field.n_entries
        if found.proved is not None and found.lower is not None:
            hidden = ~found.proved
            n_hidden += int(np.count_nonzero(hidden))
            gap = max(gap, float((found.h - found.lower)[hidden].max(initial=0.0)))
    h = h.reshape(h0.shape)
    return ExactSolution(
        h, n_entries, 0.0, parts=parts, n_proved=h.size - n_hidden, largest_gap=gap
    )


def _components(
    mesh: SimplexMesh, h0: FloatArray
) -> Iterator[tuple[IntArray | None, SimplexMesh]]:
    """Yield the components of a mesh in which there is a bound, with their nodes."""
    parent = np.arange(mesh.n_points, dtype=np.int32)
    join_cells(mesh.cells, parent)
    if not parent.any():
        yield None, mesh
        return
    used = np.zeros(mesh.n_points, np.bool_)
    used[mesh.cells] = True
    local = np.empty(mesh.n_points, np.int32)
    of_cells = parent[mesh.cells[:, 0]]
    for root in np.unique(parent[used & np.isfinite(h0)]).tolist():
        nodes = np.flatnonzero(used & (parent == root)).astype(np.int32)
        local[nodes] = np.arange(len(nodes))
        cells = local[mesh.cells[of_cells == root]]
        yield nodes, SimplexMesh(mesh.points[nodes], cells)


def _on_box(
    grid: CartesianGrid, h0: FloatArray, given: tuple[float, bool, int, ProgressCallback]
) -> Found:
    """Solve on a grid of which all nodes are active, with bounds at nodes."""
    return _on_convex_nodes(None, grid, h0.ravel(), given)


def _on_convex_nodes(
    points: FloatArray | None,
    grid: CartesianGrid | None,
    h0: FloatArray,
    given: tuple[float, bool, int, ProgressCallback],
) -> Found:
    """Solve for bounds at the nodes of a convex domain, given by its points or as a grid."""
    g, _, threads, report = given
    nodes = np.flatnonzero(np.isfinite(h0))
    places = _places(grid, nodes) if points is None else points[nodes]
    kept = survivors_among(np.ascontiguousarray(places), h0[nodes], g, threads, report)
    nodes, places = nodes[kept], places[kept]
    entries, order = entries_of(places[:, None], h0[nodes, None])
    named = np.full((len(nodes), places.shape[1]), -1, np.int32)
    named[:, 0] = nodes[order]
    exact = ExactField(g, None)
    exact.add(wave_of(entries, named))
    h, source = h0.copy(), np.full(len(h0), -1, np.int32)
    none = np.empty(0, np.int32)
    for first, here in _slabs(points, grid):
        last = first + len(here.places)
        exact.lower_by_last(
            here._replace(on_wall=none), h[first:last], source[first:last], threads, report
        )
    return Found(h, source, exact, np.empty((0, places.shape[1])))


def _places(grid: CartesianGrid, nodes: IntArray) -> FloatArray:
    index = np.stack(np.unravel_index(nodes, grid.shape), axis=1)
    return grid.origin + grid.spacing * index


def _slabs(points: FloatArray | None, grid: CartesianGrid | None) -> Iterator[tuple[int, Points]]:
    """Yield the nodes in blocks: all those of a line, those of a grid a million at a time."""
    none = np.empty(0, np.int32)
    if points is not None:
        yield 0, Points(points, np.argsort(points[:, 0], kind="stable").astype(np.int32), none)
        return
    order, first = none, 0
    for slab, places in grid.slabs():
        shape = (slab.stop - slab.start, *grid.shape[1:])
        if len(order) != len(places):
            order = np.empty(len(places), np.int32)
            fill_tiles((*shape, 1, 1)[:3], _TILES[grid.dim], order)
        yield first, Points(places, order, none)
        first += len(places)


def _meet(h0: FloatArray) -> bool:
    """Tell whether two corners of any box of a grid have bounds."""
    finite = np.isfinite(h0)
    if not finite.any():
        return False
    for axis in range(h0.ndim):  # sums over boxes, axis by axis
        finite = finite.astype(np.int8) if finite.dtype == np.bool_ else finite
        n = finite.shape[axis]
        finite = finite.take(range(n - 1), axis) + finite.take(range(1, n), axis)
    return bool((finite > 1).any())


def _on_active(
    grid: CartesianGrid, h0: FloatArray, given: tuple[float, bool, int, ProgressCallback]
) -> ExactSolution:
    """Solve on the active nodes of a grid.

    Whole boxes are the domain of the exact method; what is left are edges on which sizes go
    from node to node.  Both take turns until neither lowers the other.
    """
    g, face_sources, threads, report = given
    slope = Slope(np.array([g]))
    if grid.n_cells == 0:  # no whole box
        found = solve_grid_edges(grid, h0, slope, residual=False, report=report)
        return _as_solution(found.h, [])
    mesh = grid.mesh
    solution = solve_exact(
        mesh, h0.ravel(), slope, face_sources=face_sources, threads=threads, report=report
    )
    h, parts = solution.h.reshape(h0.shape), solution.parts
    while True:
        along = solve_grid_edges(grid, h, slope, residual=False, report=report).h
        with np.errstate(invalid="ignore"):
            lowered = along < h * (1.0 - _EQUAL)
        if not lowered.any():
            break
        seeds = np.where(lowered, along, np.inf)
        more = solve_exact(
            mesh, seeds.ravel(), slope, face_sources=False, threads=threads, report=report
        )
        h, parts = np.minimum(along, more.h.reshape(h0.shape)), []
    return ExactSolution(
        h,
        solution.iterations,
        0.0,
        parts=parts,
        n_proved=solution.n_proved,
        largest_gap=solution.largest_gap,
    )
