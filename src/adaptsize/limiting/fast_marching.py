"""Label-correcting fast marching on simplices and on Cartesian grids."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels import fast_marching as kernels
from adaptsize._kernels import fast_marching_grid as grid_kernels
from adaptsize._kernels.fast_marching import fill_policy
from adaptsize._kernels.heap import Heap, new_heap, push_all
from adaptsize.background import AnyMesh, CartesianGrid, SimplexMesh
from adaptsize.background.marching import (
    KEEP,
    PaddedGrid,
    march_on_grid,
    pad,
    strides_of_padded,
    unpad,
)
from adaptsize.background.partitioned import local_mesh
from adaptsize.limiting import tuning
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.limiting.problem import NeedsWholeMesh, Problem, Scheme, Solution
from adaptsize.options import Option
from adaptsize.ranks import SharedNodes
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

# Nodes accepted between two progress reports, at which Ctrl-C takes effect: about 0.1 s.
CHUNK = 50_000

# Nodes of the second-order pass between two progress reports.
_REFINED_AT_ONCE = 1_000_000

_TEXT = "limiting the gradient"


@dataclass(frozen=True)
class FastMarching(Scheme):
    r"""Fast marching: upwind updates of the nodes in the order of their sizes.

    On meshes, the size of node k is the minimum of ``h0`` and, over its cells T with opposite side
    F, of the Hopf-Lax update :math:`\min_{x \in F} h(x) + g_T |x_k - x|` with h linear on F [1]_.
    On grids it is the root of

    .. math:: \sum_a \max\left(\frac{h - v_a}{\Delta x_a}, 0\right)^2 = g^2,
              \qquad h \le h_0,

    with the smaller neighbour :math:`v_a` along each axis, the steady state of equation (17) of
    [3]_.  Nodes that are lowered after they have been accepted are accepted again [2]_.  Obtuse and
    sliver cells therefore need no special treatment.  The result is the largest solution of the
    equations.

    Parameters
    ----------
    order : int, default 1
        1, or 2 on grids.  At second order, the one-sided difference through two nodes replaces the
        first-order difference where both nodes lie upwind [4]_.  The upwind directions and the
        order of the nodes are those of the first-order sizes, so that one pass is sufficient.
        Order 2 is not monotone: a smaller h0 may give a larger size (by up to .5 % on 60 coarse
        grids with random bounds).

    Notes
    -----
    *Accuracy.*  First order in the edge length a, with a factor log(1/a) at point sources.  The
    second order is attained where the bounds are smooth.  At point sources it is of first order,
    too, with a constant three to six times smaller.

    *Cost.*  On meshes of n nodes the time is O(n log n), and memory is ``4 k (k - 1)`` bytes per
    cell of k nodes (24 for triangles, 48 for tetrahedra) and 24 per node.  If nearly all cells are
    obtuse slivers (Delaunay triangles of random points, then stretched 10:1), dependencies between
    nodes are cyclic, and nodes would be accepted hundreds of times.  After 8 acceptances per node,
    policy iteration is used instead, at the cost of some twenty sparse solves.  On grids the time
    is O(n).  Memory besides ``h0`` and the result is 20 bytes per node (40 at order 2), and 8 more
    if g varies.

    References
    ----------
    .. [1] F. Bornemann, C. Rasch, Comput. Vis. Sci. 9 (2006) 57-69.
    .. [2] J. A. Sethian, Proc. Natl. Acad. Sci. 93 (1996) 1591-1595.
    .. [3] P.-O. Persson, Engineering with Computers 22 (2006) 95-109.
    .. [4] J. A. Sethian, SIAM Review 41 (1999) 199-235.
    """

    name: ClassVar[str] = "fast-marching"
    optional: ClassVar[frozenset[str]] = frozenset({"periodic"})
    order: Annotated[int, Option(lower=1.0, upper=2.0)] = 1

    def supports(self, domain: AnyMesh | CartesianGrid) -> str:
        """Return which backgrounds the scheme needs."""
        is_mesh = not isinstance(domain, CartesianGrid)
        return "a CartesianGrid with order=2" if self.order == 2 and is_mesh else ""

    def solve(self, problem: Problem) -> Solution:
        """Solve a problem; ``iterations`` is the number of accepted nodes.

        In a periodic domain, paired nodes have the same size.  The scheme is monotone, so sizes
        fall from round to round, and the rounds end where neither the scheme nor the identification
        lowers any.  Where shortest paths cross k sides, there are k + 1 rounds.
        """
        while True:
            if isinstance(problem.domain, CartesianGrid):
                solution = march_grid(problem, self.order)
            else:
                solution = march_mesh(problem)
            if problem.periodic is None:
                return solution
            lowered = problem.periodic.least(solution.h)
            with np.errstate(invalid="ignore"):
                changed = lowered < solution.h * (1.0 - 1e-12)  # by more than rounding
            if not changed.any():
                return replace(solution, h=lowered)
            problem = replace(problem, h0=lowered)


def march_mesh(problem: Problem, *, along_edges: bool = False) -> Solution:
    """March on simplices until no node is lowered any more.

    Collective on a mesh in parts.  Ranks march in rounds, up to a common size, and exchange the
    sizes that have decreased at shared nodes.  A whole mesh takes one round.
    """
    domain = problem.any_mesh
    mesh, ranks, n = local_mesh(domain), domain.ranks, domain.n_points
    slope, report = problem.slope, problem.report
    limit = (slope.values, slope.step)
    h, heap, sides = problem.h0.copy(), new_heap(n), None if along_edges else True
    # Along edges every node is accepted once, in order, and sizes are minima of finitely many sums.
    keep: float
    most: float
    keep, most, window = KEEP, tuning.ACCEPTANCES_PER_NODE * n + CHUNK, np.inf
    if along_edges:
        keep, most = 1.0, np.inf
    else:
        window = _window(domain, slope)
    stars: tuple[Any, ...] = ()
    if mesh is not None:
        _sweep_into_heap(mesh, sides, h, limit, heap, keep)
        if heap.size[0] > 0 or ranks.size > 1:
            stars = _stars_in(mesh)
    known, accepted, unfinished = problem.h0.copy(), 0, ""

    def accept(until: float, keep: float = keep, most: float = most) -> int:
        """Return how many nodes were accepted, with those before; ends after ``most``."""
        total, count = accepted, CHUNK if heap.size[0] > 0 else 0
        while count == CHUNK and total < most:
            count = kernels.march(stars, h, limit, sides, heap, (keep, until, CHUNK))
            total += count
            report(_TEXT, min(total / n, 1.0))
        return total

    while True:
        waiting = float(heap.key[0]) if heap.size[0] > 0 else np.inf
        least, go_on = ranks.allreduce(np.array([waiting, float(accepted < most)]), "min")
        if least == np.inf:
            break
        if go_on:
            accepted = accept(float(least + window))
            _exchange(domain.shared, h, known, heap)
            continue
        if mesh is None or ranks.size > 1:
            raise NeedsWholeMesh
        # Only small changes are missing now.  First give every node a finite size.
        kernels.march(stars, h, limit, None, heap, (KEEP, np.inf, 1 << 62))
        _sweep_into_heap(mesh, sides, h, limit, heap, tuning.KEEP_ROUGHLY)
        accept(np.inf, tuning.KEEP_ROUGHLY, np.inf)
        h, unfinished = iterate_policies(mesh, slope, h, report)
        break

    def residual() -> float:
        excess = 0.0
        if mesh is not None:
            candidate, finite = np.empty(n), np.isfinite(h)
            kernels.sweep_cells(cells_in(mesh), h, limit, sides, candidate)
            excess = float((h[finite] - candidate[finite]).max(initial=0.0))
        largest = h[np.isfinite(h)].max(initial=0.0)
        excess, largest = ranks.allreduce(np.array([excess, largest]), "max").tolist()
        return excess / largest if excess > 0.0 else 0.0

    return Solution(h, accepted, residual, unfinished)


def _exchange(shared: SharedNodes, h: FloatArray, known: FloatArray, heap: Heap) -> None:
    """Send sizes that have decreased at shared nodes, and queue those received (In/Out: all).

    ``known`` holds the sizes of which the other ranks know.
    """
    if shared.ranks.size == 1:
        return
    sent = []
    for nodes in shared.nodes:
        changed = np.flatnonzero(h[nodes] < known[nodes])
        sent.append(np.column_stack([changed, h[nodes[changed]]]).astype(np.float64))
    received = shared.ranks.alltoallv(sent)
    candidate = np.full(len(h), np.inf)
    for nodes, rows in zip(shared.nodes, received, strict=True):
        at = nodes[rows[:, 0].astype(np.int64)]
        candidate[at] = np.minimum(candidate[at], rows[:, 1])
    _lower_into_heap(h, candidate, 1.0, heap)
    known[shared.every] = h[shared.every]


def _window(domain: AnyMesh, slope: Slope) -> float:
    """Return by how much sizes grow over several edges at nodes between parts; collective."""
    shared, grown, near = domain.shared, 0.0, np.empty(0, np.int64)
    if len(shared.every):
        between = np.zeros(domain.n_points, np.bool_)
        between[shared.every] = True
        near = np.flatnonzero(between[domain.cells].any(axis=1))
        corners = domain.points[domain.cells[near]]
        lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean(axis=1)
        grown = float((lengths * slope.values[near * slope.step]).sum())
    total, number = shared.ranks.allreduce(np.array([grown, len(near)]), "sum").tolist()
    return float(tuning.WINDOW * total / number) if total > 0.0 else np.inf


def cells_in(mesh: SimplexMesh) -> tuple[Any, ...]:
    """Return a mesh as the kernels of fast_marching.py take it."""
    return (mesh.points, (0,) * mesh.dim, mesh.cells)


def _stars_in(mesh: SimplexMesh) -> tuple[Any, ...]:
    """Return the stars of the nodes, as the kernels take them."""
    star = np.empty((mesh.cells.size, mesh.cell_dim), np.int32)
    kernels.fill_stars(mesh.cells, mesh.rings[0].copy(), star)
    return (mesh.points, (0,) * mesh.dim, (0,) * mesh.cell_dim, *mesh.rings, star)


def _lower_into_heap(h: FloatArray, candidate: FloatArray, keep: float, heap: Heap) -> None:
    """Lower nodes to their candidates (In/Out: h) and queue them (In/Out: heap)."""
    lowered = np.flatnonzero(candidate < h * keep).astype(np.int32)
    h[lowered] = candidate[lowered]
    push_all(heap, lowered, h)


def _sweep_into_heap(
    mesh: SimplexMesh,
    sides: bool | None,
    h: FloatArray,
    limit: tuple[FloatArray, int],
    heap: Heap,
    keep: float,
) -> None:
    """Lower all nodes once (In/Out: h) and queue those that were lowered (In/Out: heap)."""
    candidate = np.empty(mesh.n_points)
    kernels.sweep_cells(cells_in(mesh), h, limit, sides, candidate)
    _lower_into_heap(h, candidate, keep, heap)


def march_grid(problem: Problem, order: int = 1, *, along_edges: bool = False) -> Solution:
    """March on a grid until no node is lowered any more.

    Nodes are accepted in order of size, in buckets of the rise of a cell; the order within a
    bucket is arbitrary.  The residual is that of the first-order equations; the second-order pass
    is explicit.
    """
    grid = problem.grid
    slope, report = problem.slope, problem.report
    bounds = pad(grid, problem.h0)
    u = bounds.copy() if order == 2 else bounds
    weights = tuple(float(w) for w in 1.0 / grid.spacing**2)
    g = pad(grid, slope.values) if slope.step else slope.values
    geometry = (strides_of_padded(grid), weights, g, slope.step)
    accepted = march_on_grid(grid, u, geometry, along_edges, report, _TEXT)
    residual = partial(_grid_residual, u, geometry, along_edges)
    if order == 2:
        u = _refine(problem, u, bounds, geometry)
        # A few sizes may be too steep along an edge.
        march_on_grid(grid, u, geometry, True, report, _TEXT)
    return Solution(unpad(grid, u), accepted, residual)


def _grid_residual(u: FloatArray, geometry: PaddedGrid, along_edges: bool) -> float:
    """Return the largest excess of padded sizes over updates, relative to the largest finite h."""
    candidate = np.empty(u.size)
    grid_kernels.sweep_grid(u, geometry, along_edges, candidate)
    finite = np.isfinite(u)
    excess = float((u[finite] - candidate[finite]).max(initial=0.0))
    # With g(h) the smallest transformed size is 0.  If all bounds are equal, the largest is 0, too.
    return excess / float(u[finite].max()) if excess > 0.0 else 0.0


def _refine(problem: Problem, u1: FloatArray, u0: FloatArray, geometry: PaddedGrid) -> FloatArray:
    """Return the second-order sizes from the first-order ones."""
    order = np.flatnonzero(u1 < u0).astype(np.int32)
    order = order[np.argsort(u1[order])]  # equal sizes do not depend on each other
    count = order.size
    spacing = tuple(map(float, problem.domain.spacing))  # type: ignore[union-attr]
    u = u0.copy()
    for begin in range(0, count, _REFINED_AT_ONCE):
        part = order[begin : min(begin + _REFINED_AT_ONCE, count)]
        grid_kernels.refine_in_order(part, (u1, u0), geometry, spacing, u)
        problem.report("second-order pass", (begin + len(part)) / count)
    return u


_ROUNDING = 1e-13


class _Policy(NamedTuple):
    """For each node the linear update that it follows (see `fill_policy`)."""

    source: IntArray
    weight: FloatArray
    cost: FloatArray


def iterate_policies(
    mesh: SimplexMesh, slope: Slope, h: FloatArray, report: ProgressCallback
) -> tuple[FloatArray, str]:
    r"""Solve h_k = min(h0_k, min over cells of the Hopf-Lax update) from above.

    Each update is the minimum of linear functions of the sizes it uses.  Fix the best one
    for every node, solve the resulting linear equations :math:`(I - W) h = c`, and repeat
    until no node finds a better one (Howard [1]_).  From a start above the solution the
    sizes decrease monotonically.  The iteration converges like Newton's method, regardless
    of the length of the cycles in which nodes depend on each other.

    Parameters
    ----------
    mesh : SimplexMesh
    slope : Slope
    h : float64[n]
        Start: at most h0, at least the solution, and finite where the solution is.
    report : callable

    Returns
    -------
    h : float64[n]
        The solution, to 1e-13 relative.
    unfinished : str
        Empty if converged.  Otherwise a message that 200 policies were not enough (5 to 50
        were observed), with the last change.

    References
    ----------
    .. [1] O. Bokanowski, S. Maroso, H. Zidani, "Some convergence results for Howard's
       algorithm", SIAM J. Numer. Anal. 47 (2009) 3001-3026.
    """
    n = mesh.n_points
    bounded = np.flatnonzero(np.isfinite(h))
    # The first policy keeps every node at its start, which is a bound like h0.
    policy = _Policy(np.zeros((n, 3), np.int32), np.zeros((n, 3)), h.copy())
    value = np.empty(n)
    offer = _Policy(np.empty((n, 3), np.int32), np.empty((n, 3)), np.empty(n))
    for _ in range(tuning.POLICY_STEPS):
        limit = (slope.values, slope.step)
        fill_policy(cells_in(mesh), (h, h), limit, value, offer)
        # A policy is changed only if the size decreases.  Otherwise coincident nodes, or nodes
        # whose distance times g is below rounding, could all refer to each other.
        lower = value < h * KEEP
        if not lower.any():
            return h, ""
        policy.source[lower] = offer.source[lower]
        policy.weight[lower] = offer.weight[lower]
        policy.cost[lower] = offer.cost[lower]
        better = _solve(bounded, policy, n)
        # With g(h), sizes are transformed: the smallest is 0, and stays so.
        drop = (h[bounded] - better) / np.where(h[bounded] > 0.0, h[bounded], np.inf)
        change = float(np.max(drop, initial=0.0))
        h = np.minimum(h, value)
        h[bounded] = np.minimum(h[bounded], better)
        report("policy iteration", None)
        if change <= _ROUNDING:
            return h, ""
    return h, (
        f"policy iteration stopped after {tuning.POLICY_STEPS} steps with sizes still decreasing "
        f"by {change:.1g} relative"
    )


def _solve(nodes: npt.NDArray[np.int64], policy: _Policy, n: int) -> FloatArray:
    """Return the sizes of ``nodes`` that satisfy h = W h + c."""
    from scipy.sparse import csc_matrix, identity
    from scipy.sparse.linalg import splu

    place = np.empty(n, np.int64)
    place[nodes] = np.arange(len(nodes))
    weight = policy.weight[nodes]
    rows, columns = np.nonzero(weight > 0.0)
    entries = weight[rows, columns]
    shape = (len(nodes), len(nodes))
    used = csc_matrix((entries, (rows, place[policy.source[nodes][rows, columns]])), shape=shape)
    matrix = (identity(len(nodes), format="csc") - used).tocsc()
    return np.asarray(splu(matrix).solve(policy.cost[nodes]))
