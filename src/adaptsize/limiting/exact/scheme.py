"""The exact method as a scheme: how each kind of background is solved, and by components."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np

from adaptsize._workers import Workers
from adaptsize.background import AnyMesh, CartesianGrid, SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.background._mesh_arrays import read_only
from adaptsize.background.partitioned import PartitionedMesh
from adaptsize.background.topology import places_among
from adaptsize.geometry.boundary import FlatBoundary
from adaptsize.limiting.edge_based import EdgeBased
from adaptsize.limiting.exact.boxes import all_tetrahedra, linear_on_boxes
from adaptsize.limiting.exact.candidates import (
    EQUAL,
    Component,
    ConvexNodes,
    Extra,
    bounds_meet,
)
from adaptsize.limiting.exact.components import (
    OUTSIDE,
    ComponentPiece,
    components_of,
    is_connected,
    moved_inside,
    piece_of,
    points_in_components,
)
from adaptsize.limiting.exact.convex import solve_convex, with_images
from adaptsize.limiting.exact.field import ComponentSolution, ExactField, node_entries
from adaptsize.limiting.exact.in_parts import solve_piece
from adaptsize.limiting.exact.kept import boundary_of
from adaptsize.limiting.exact.on_surface import limit_on_surface
from adaptsize.limiting.exact.solution import (
    UNFINISHED,
    ExactSolution,
    SolvedComponent,
    as_solution,
)
from adaptsize.limiting.exact.solve import solve_on_mesh
from adaptsize.limiting.periodic import Periodicity
from adaptsize.limiting.problem import NeedsWholeMesh, PointBounds, Problem, Scheme
from adaptsize.options import Option
from adaptsize.typing import BoolArray, FloatArray, IntArray

# Fewer nodes than this are sorted in less time than a thread takes to start, some .1 ms.
_MANY = 10_000


@dataclass(frozen=True)
class Exact(Scheme):
    r"""Each size directly from the bounds: :math:`\min_y h_0(y) + g\, d(x, y)`.

    d is the length of paths in the domain.  In convex domains, in the plane and on surfaces, it is
    that of the shortest path, and the result is exact to rounding; on surfaces that would need
    too many windows, this holds up to a certain distance from the sources.  In solids this holds at
    each x from which the minimising point is visible.  Elsewhere d is the length of a path over
    reflex edges, so that no size is too small; where that is searched for in too many places, it
    is a path propagated by a neighbour, and ``info.method`` says so.  The domain of a grid with
    inactive nodes is the cubical complex of the active nodes.

    The scheme needs a flat domain or triangles in space, and one number g or a function g(h).

    Parameters
    ----------
    face_sources : bool, default True
        True: ``h0`` also bounds the size inside the cells, where it is interpolated linearly.
        False: ``h0`` is a bound at the nodes only; limiting is then idempotent.  The boxes of a
        grid are split along all of their diagonals, and the lower size is used.
    threads : int, optional
        Number of threads, by default that of numba (``numba.set_num_threads``).  The result does
        not depend on it, bit for bit.

    Notes
    -----
    See docs/exact-limiting.md for theory and measured errors and times.
    """

    name: ClassVar[str] = "exact"
    optional: ClassVar[frozenset[str]] = frozenset({"point_sources", "periodic"})
    face_sources: Annotated[bool, Option()] = True
    threads: Annotated[int | None, Option(lower=1.0)] = None

    def supports(self, domain: AnyMesh | CartesianGrid) -> str:
        """Return which backgrounds the scheme needs."""
        applies = isinstance(domain, CartesianGrid) or domain.cell_dim in (domain.dim, 2)
        return "" if applies else "a flat domain of full dimension or triangles"

    def solve(self, problem: Problem) -> ExactSolution:
        """Solve a problem; ``iterations`` is the number of sources."""
        domain = problem.domain
        if problem.periodic is not None:
            return self._periodic(problem.periodic, problem)
        if isinstance(domain, CartesianGrid):
            return self._on_grid(domain, problem)
        if domain.cell_dim < domain.dim:
            return self._on_surface(domain, problem)
        if isinstance(domain, PartitionedMesh):
            return replace(self._by_components(domain, problem), parts=[])
        return self._on_mesh(domain, problem)

    def _periodic(self, cell: Periodicity, problem: Problem) -> ExactSolution:
        """Solve on a cell, then with the images of its sources."""
        if not cell.is_convex:
            raise ValueError(
                "periodic with method='exact' needs a convex cell whose images complete it to "
                "a convex domain; use method='fast-marching'"
            )
        solution = self.solve(replace(problem, periodic=None))
        return with_images(solution, cell, self._workers(problem))

    def _on_grid(self, grid: CartesianGrid, problem: Problem) -> ExactSolution:
        """Solve on a grid, by its boxes where h0 is linear on them."""
        if grid.active is not None:
            return self._on_active(grid, grid.active, problem)
        if self.face_sources and grid.dim > 1 and _meet(problem.h0):
            return self._on_grid_mesh(grid, problem)
        g, extra = problem.slope.number(self.name), _inside(grid, problem.point_sources)
        nodes = ConvexNodes(grid, problem.h0.ravel(), g, self._workers(problem), extra)
        return as_solution(problem.h0, [SolvedComponent(slice(None), solve_convex(nodes))])

    def _on_mesh(self, mesh: SimplexMesh, problem: Problem) -> ExactSolution:
        """Solve on a mesh, as a whole if it is one component without further nodes."""
        if mesh.dim > 1:
            component = self._component(problem, mesh, problem.h0)
            component = component._replace(extra=_inside(mesh, problem.point_sources))
            component, (boundary, convex), all_used = _prepared(component)
            if all_used and (convex or is_connected(mesh)):
                found = solve_on_mesh(component, boundary, convex)
                return as_solution(problem.h0, [SolvedComponent(slice(None), found)])
        return self._by_components(PartitionedMesh.from_serial(mesh), problem)

    def _workers(self, problem: Problem) -> Workers:
        """Return the threads for a problem in one process."""
        return Workers.of(self.threads, problem.report)

    def _on_surface(self, domain: AnyMesh, problem: Problem) -> ExactSolution:
        """Solve on triangles in space."""
        if isinstance(domain, PartitionedMesh):
            if domain.ranks.size > 1 or domain.mesh is None:
                raise NeedsWholeMesh
            return replace(self._on_surface(domain.mesh, problem), parts=[])
        g, given = problem.slope.number(self.name), problem.point_sources
        found = limit_on_surface(domain, problem.h0, g, given, self.face_sources, problem.report)
        # Between the nodes, sizes are interpolated.
        none = node_entries(np.empty((0, 3)), np.empty(0), np.empty(0, np.int32))
        kept = np.full(len(found.h), -1, np.int32)
        whole = ComponentSolution(
            found.h, kept, ExactField(g, None, False, [none]), found.bend, found.proved
        )
        whole.nodes = found.named
        n_proved = int(np.count_nonzero(found.proved))
        return ExactSolution(
            found.h,
            found.n_sources,
            parts=[SolvedComponent(slice(None), whole)],
            n_proved=n_proved,
            largest_gap=found.gap,
        )

    def _by_components(
        self,
        part: PartitionedMesh,
        problem: Problem,
        linear: IntArray | None = None,
        links: IntArray | None = None,
    ) -> ExactSolution:
        """Solve on one component after another; nodes in no cell keep their bounds.  Collective.

        Each rank uses one thread by default.  ``linear``, ``links``: as in `Component`, for the
        whole mesh.
        """
        ranks = part.ranks
        if ranks.size > 1 and part.dim == 1:
            raise NeedsWholeMesh
        scheme = replace(self, threads=1) if ranks.size > 1 and self.threads is None else self
        h0, given = problem.h0.ravel(), problem.point_sources
        if given is not None:
            given = moved_inside(part, given)
        located = points_in_components(part, given)
        parts = []
        for number in sorted({*components_of(part).bounded(ranks, h0), *located}):
            piece = piece_of(part, number)
            component = scheme._component(problem, piece.mesh, piece.bounds(h0))
            if given is not None and number in located:
                here = Extra.of(given, located[number], piece.mesh.n_points)
                component = component._replace(extra=here)
            if linear is not None:
                own = _of_piece(piece, part, linear)
                component = component._replace(linear=own, meet=True)
            if links is not None:
                mesh = SimplexMesh(piece.mesh.points, _of_piece(piece, part, links))
                component = component._replace(links=mesh)
            if ranks.size > 1:
                found = solve_piece(part, number, component)
            elif part.dim == 1:  # an interval; folds change nothing
                found = solve_convex(ConvexNodes.of(component.with_margin()))
            else:
                boundary, convex = boundary_of(piece.mesh, component.workers.threads)
                found = solve_on_mesh(component, boundary, convex)
            parts.append(SolvedComponent(piece.nodes, found))
        solution = as_solution(problem.h0, parts)
        finished = ranks.allreduce(int(not solution.unfinished), "min")
        return solution if finished else replace(solution, unfinished=UNFINISHED)

    def _component(self, problem: Problem, mesh: SimplexMesh, h0: FloatArray) -> Component:
        """Return the problem on a mesh with given bounds."""
        g, price = problem.slope.number(self.name), problem.at_any_price
        workers = self._workers(problem)
        return Component(mesh, h0, g, self.face_sources, workers, at_any_price=price)

    def _on_grid_mesh(self, grid: CartesianGrid, problem: Problem) -> ExactSolution:
        """Solve on the whole boxes of a grid, split into simplices on which h0 is linear.

        Each box is split along all of its diagonals, and the lower size is used.
        """
        linear = links = None
        if self.face_sources and grid.dim > 1:
            linear = linear_on_boxes(grid, problem.h0, problem.slope.number(self.name))
        if grid.dim == 3 and grid.active is not None:
            links = all_tetrahedra(grid)
        return self._by_components(PartitionedMesh.from_serial(grid.mesh), problem, linear, links)

    def _on_active(
        self, grid: CartesianGrid, is_active: BoolArray, problem: Problem
    ) -> ExactSolution:
        """Solve on the active nodes of a grid.

        The exact method is used on the whole boxes.  On the remaining edges, sizes propagate from
        node to node.  The two alternate until neither lowers a size.
        """
        by_edges, of_nodes = EdgeBased(), replace(self, face_sources=False)
        if grid.n_cells == 0:  # no whole box
            return as_solution(by_edges.solve(problem).h, [])
        solution, n_later = self._on_grid_mesh(grid, problem), 0
        while True:
            h = solution.h
            along = by_edges.solve(replace(problem, h0=h)).h
            lowered = _is_lower(along, h)
            if not lowered.any():
                break
            seeds = np.where(lowered, along, np.inf).ravel()
            rest = replace(problem, domain=grid.mesh, h0=seeds, point_sources=None)
            more = of_nodes.solve(rest)
            lower = np.minimum(along, more.h.reshape(h.shape))
            if grid.dim == 3:
                n_later += int(np.count_nonzero(_is_lower(lower, h)))
            unfinished = solution.unfinished or more.unfinished
            solution = replace(solution, h=lower, unfinished=unfinished, parts=[])
        n_proved = solution.n_proved - int(np.count_nonzero(~is_active)) - n_later
        return replace(solution, n_proved=max(0, n_proved))


def _is_lower(h: FloatArray, than: FloatArray) -> BoolArray:
    """Return which sizes are lower than others by more than rounding."""
    with np.errstate(invalid="ignore"):  # inf and NaN
        return np.asarray(h < than * (1.0 - EQUAL))


def _of_piece(piece: ComponentPiece, part: PartitionedMesh, cells: IntArray) -> IntArray:
    """Return the cells, given by nodes of the part, that are in a piece, by its nodes."""
    own = places_among(piece.nodes, part.n_points)[cells]
    return read_only(np.ascontiguousarray(own[own[:, 0] >= 0]))


def _prepared(component: Component) -> tuple[Component, tuple[FlatBoundary, bool], bool]:
    """Return the problem with order and neighbours, the boundary, and if all nodes are in cells.

    With the boundary, whether the mesh is convex.

    With several threads and many nodes, the boundary is computed at the same time.
    """
    mesh = component.mesh
    if component.workers.threads == 1 or mesh.n_points < _MANY:
        component = component._replace(
            order=mesh._along_curve, meet=bounds_meet(mesh.cells, component.h0, 1)
        )
        return component, boundary_of(mesh, 1), bool(mesh.in_a_cell.all())
    with ThreadPoolExecutor(1) as pool:
        threads = component.workers.threads
        order = pool.submit(along_curve, mesh.points, threads)
        meet = pool.submit(bounds_meet, mesh.cells, component.h0, threads)
        used = pool.submit(lambda: bool(mesh.in_a_cell.all()))
        boundary = boundary_of(mesh, threads)
        component = component._replace(order=order.result(), meet=meet.result())
        return component, boundary, used.result()


def _inside(background: SimplexMesh | CartesianGrid, given: PointBounds | None) -> Extra | None:
    """Return the sources between the nodes that lie in the domain."""
    if given is None:
        return None
    if isinstance(background, SimplexMesh):
        given = moved_inside(background, given)
    away = background.locator.weights(given.points)[2]
    inside = (away <= OUTSIDE * background.diagonal) & np.isfinite(given.sizes)
    return Extra.of(given, np.flatnonzero(inside).astype(np.int32), background.n_points)


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
