"""`limit_gradient`: check the arguments, choose a scheme and report on the result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from adaptsize._calls import recorded
from adaptsize._checks import as_points, as_sizes, describe, one_of, warn_caller
from adaptsize._messages import Message
from adaptsize._progress import reporting, silent
from adaptsize._with_info import with_info
from adaptsize.background import AnyMesh, CartesianGrid, Octree, PartitionedMesh
from adaptsize.background.simplex import as_mesh, as_own
from adaptsize.background.topology import components_of
from adaptsize.errors import ConvergenceWarning, InputWarning, OptionError
from adaptsize.limiting.agreement import (
    require_equal_arguments,
    require_equal_functions,
    slope_of_parts,
    solve_on_whole,
)
from adaptsize.limiting.barth_sethian import PositiveCoefficient
from adaptsize.limiting.edge_based import EdgeBased
from adaptsize.limiting.exact import Exact
from adaptsize.limiting.exact.components import with_points_at_nodes
from adaptsize.limiting.fast_marching import FastMarching
from adaptsize.limiting.gradient_limit import SizeTransform, factors_of, in_space
from adaptsize.limiting.hamilton_jacobi import HamiltonJacobi
from adaptsize.limiting.info import LimitingInfo
from adaptsize.limiting.periodic import as_periodicity
from adaptsize.limiting.problem import (
    NeedsWholeMesh,
    PointBounds,
    Problem,
    Scheme,
    Solution,
    TooManyCorners,
    as_nodal_sizes,
)
from adaptsize.ranks import Communicator, SingleRank
from adaptsize.typing import (
    BoolArray,
    FloatArray,
    GradientLimit,
    GradientOfSize,
    ProgressCallback,
)

SCHEMES: dict[str, type[Scheme]] = {
    scheme.name: scheme
    for scheme in (Exact, FastMarching, PositiveCoefficient, HamiltonJacobi, EdgeBased)
}


@recorded("limit_gradient")
@with_info
def limit_gradient(
    background: AnyMesh | CartesianGrid | Octree,
    h0: npt.ArrayLike,
    g: GradientLimit,
    *,
    method: Scheme | str = "auto",
    initial: npt.ArrayLike | None = None,
    point_sources: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    periodic: npt.ArrayLike | None = None,
    progress: ProgressCallback | bool | None = None,
    wants_info: bool = True,
) -> tuple[FloatArray, LimitingInfo]:
    r"""Return the largest mesh size below ``h0`` whose gradient is at most ``g``.

    This is the steady state of the gradient limiting equation [1]_

    .. math:: h_t + |\nabla h| = \min(|\nabla h|, g), \qquad h(x, 0) = h_0(x),

    on the nodes of the background.  Sizes propagate inside the domain only.  Two regions
    that are separated by a slit, a hole, inactive nodes or a gap between two sheets do not
    affect each other directly, however close they are.

    Parameters
    ----------
    background : SimplexMesh, PartitionedMesh, CartesianGrid or Octree
        A mesh may consist of segments, of triangles in the plane or in space, or of
        tetrahedra.  Obtuse, sliver and degenerate cells are allowed.  A grid may have any
        spacing; its inactive nodes lie outside the domain.  An octree is replaced by its
        conforming simplicial mesh.
    h0 : float or array_like of float, of the nodal shape
        Upper bound on the size, in the unit of the coordinates: one number for all nodes, or
        one per node.  It must be positive, and finite at one node at least; inf means that
        there is no bound.  The values of ``h0`` and g at inactive nodes of a grid are ignored.
    g : float, array_like, callable, or pair (array_like, callable)
        Gradient limit (length per length), finite and >= 0.  Neighbouring elements
        then differ by a factor of about ``1 + g``; usual values are 0.2 to 0.3.  It can be

        * one number,
        * one number per node; on meshes the mean is taken in each cell,
        * on meshes, one number per cell, as is needed for a limit that jumps; an array of
          ``n_points`` entries, in parts on all ranks, is always read as per node, also on closed
          polylines, which have as many cells as nodes,
        * a function ``g(h)`` that takes an array of sizes and returns positive bounded
          limits,
        * a pair ``(a, b)`` for the product a(x) b(h).
    method : str or scheme, default "auto"
        An object of `adaptsize.limiting` with the options of the scheme, or its name:

        * ``"exact"`` (`Exact`) computes each size directly from the bounds visible from the node,
          and on surfaces from shortest paths.  It needs a flat domain, or triangles in space, and
          a single number g or a function g(h).  The result is exact to rounding in convex
          domains, in the plane and on surfaces; see the notes.
        * ``"fast-marching"`` (`FastMarching`) is of first order and monotone, and works on every
          background.  ``FastMarching(order=2)`` is of second order, on grids.
        * ``"auto"`` takes the exact method where it applies, else fast marching.  It also takes
          fast marching in plane domains with so many corners that the exact method would be
          many times slower: with c > 64 reflex corners and fewer than c^2 / 40 nodes in a
          component, if edges are sources, too, or the mesh is in parts.  Bounds at points are then
          taken to the nodes of their cells.  ``info.method`` names the method.
        * ``"positive-coefficient"`` (`PositiveCoefficient`), on meshes, is the iteration of Barth
          and Sethian [2]_.
        * ``"hamilton-jacobi"`` (`HamiltonJacobi`), on grids, is the upwind iteration of [1]_.
        * ``"edge-based"`` (`EdgeBased`) computes shortest paths along edges.  It does not converge
          and is meant for comparison only.
    initial : float or array_like of float, of the nodal shape, optional
        Start values of an iteration; the default is the fast marching
        solution.  The values are lowered to ``h0`` where they exceed it.  The Hamilton-Jacobi
        iteration converges from any start, and fastest from the solution for a slightly
        different ``h0``.  The positive coefficient scheme can only lower its start values.
    point_sources : tuple of (array_like, array_like), optional
        For the exact method: points of shape (k, dim) and the bounds there, of shape
        (k,).  The points need not be nodes.  Points outside the domain have no effect, except on
        surfaces, where a point at the distance d acts from the closest point of the surface, with
        the size plus g d.  A point where components of the domain touch acts in all of them.
    periodic : array_like of float, shape (k, dim) or (k, dim, dim + 1), optional
        For the exact method and fast marching of first order: translations by which
        the domain is repeated, such as ``[[a, 0], [0, b]]``; or, for fast marching, rotations
        ``[R | t]`` of x to R x + t, as of a sector.  The result is that on the domain with all of
        its images.  Nodes on opposite sides must come in pairs; both get the same
        size.  See the notes.
    progress : callable or bool, optional
        Called with a text and the fraction completed; True shows a progress bar on a
        terminal.  An exception raised in it (or Ctrl-C) stops the computation.

    Returns
    -------
    h : ndarray of float64, of the nodal shape
        ``h <= h0`` everywhere.  Along every edge, ``h[i] - h[j]`` is at most g times the
        length of the edge, to rounding.  With g(h) this holds in the variable Phi of the
        notes; for an iteration from ``initial`` it holds to its tolerance.  On meshes, g is the
        smallest of the cells at the edge; on grids, that at the end of larger size.
        The size is inf only at inactive nodes and in components of the domain where all of
        ``h0`` is inf, with a warning.  Mesh nodes that belong to no cell keep ``h0``.
        ``limit_gradient.with_info``, with the same arguments, returns the pair ``(h, info)`` with
        a `LimitingInfo`, whose attributes are computed on first access; on a mesh in parts they
        are computed at once.

    Raises
    ------
    ValueError
        If a shape is wrong; if ``h0`` is NaN, zero, negative or inf throughout; if g is
        negative, NaN or above 1e30; if the method does not support the background, order or g;
        or if an argument is given that the method does not use.

    Warns
    -----
    InputWarning
        If components of the domain have no bound, so that their sizes are inf.
    ConvergenceWarning
        If an iteration does not meet its tolerance, or if another loop reaches
        its limit.  ``info.converged`` is then False.

    Notes
    -----
    *g(h).*  The change of variable :math:`\Phi(h) = \int dh/g(h)` turns the limit into 1.
    Hence the solution exists and is unique, and g need not be monotone.

    *Interpolation.*  The bound holds for *nodal differences*.  The gradient of the linear
    interpolant may exceed g around point sources and where fronts meet, by a factor of up to
    :math:`1/\cos(\theta/2)` for a cell with angle :math:`\theta` at its upstream vertex.
    This also happens with exact nodal values, at every mesh size.

    *Exact method.*  In convex domains, in the plane and on surfaces the result is
    :math:`\min_y h_0(y) + g\,d(x, y)` to rounding, where d is the length of the shortest path
    in the domain.  On smooth and finely triangulated surfaces with few sources, the search is
    limited beyond a certain distance from them; there d is the length of some path, and
    ``info.largest_gap`` is an estimate.  In solids the same holds at each x from which the
    minimising point y is visible.  Elsewhere d is the length of a path over edges of the
    boundary, so that the result is an upper bound; no size is too small.  ``info.n_proved``
    counts the nodes with a proof, and ``info.largest_gap`` bounds the error at the others.

    *Periodic domains.*  Sizes propagate through a side of the cell to its opposite one.  Where
    cell and images make up a convex domain, the exact method adds the images of the sources,
    and the result is exact to rounding.  Elsewhere fast marching identifies the nodes.

    *Meshes in parts.*  The result is that on the whole mesh, for any partition: equal bit for bit
    with the exact method and along edges, and to 1e-12 with fast marching of first order.  There
    are no other schemes, no ``initial`` and no ``periodic``.  Ranks that share a node must give it
    the same bound; `PartitionedMesh.minimum` makes them agree.  Functions g, ``method`` and
    ``point_sources`` must be the same on all ranks.  If the input of any rank is bad, all ranks
    raise the error.  Each rank uses one thread unless ``Exact(threads=...)`` is given.  In convex
    domains and in the plane, the exact method takes one exchange between the ranks, besides
    reductions of a few numbers, once the boundary of the mesh is known.  Meshes with cells without
    measure, or cells that overlap, and surfaces are collected on rank 0.  See
    docs/distributed.md.

    References
    ----------
    .. [1] P.-O. Persson, "Mesh size functions for implicit geometries and PDE-based
       gradient limiting", Engineering with Computers 22 (2006) 95-109.
    .. [2] T. J. Barth, J. A. Sethian, "Numerical schemes for the Hamilton-Jacobi and
       level set equations on triangulated domains", J. Comput. Phys. 145 (1998) 1-40.

    Examples
    --------
    A size of 0.1 at one corner of the unit square:

    >>> import numpy as np
    >>> from adaptsize import CartesianGrid, SimplexMesh
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> h = limit_gradient(mesh, [0.1, np.inf, np.inf, np.inf], 0.3)
    >>> h.round(3)
    array([0.1  , 0.4  , 0.524, 0.4  ])

    The same on a grid from two corners:

    >>> grid = CartesianGrid(origin=[0.0, 0.0], spacing=0.5, shape=(3, 3))
    >>> h0 = np.full(grid.shape, np.inf)
    >>> h0[0, 0], h0[2, 2] = 0.1, 0.2
    >>> limit_gradient(grid, h0, 0.3).round(3)
    array([[0.1  , 0.25 , 0.4  ],
           [0.25 , 0.312, 0.35 ],
           [0.4  , 0.35 , 0.2  ]])
    """
    background = as_own(background)
    of_place, of_size = factors_of(g)

    def check() -> tuple[Problem, Scheme | None]:
        scheme = _scheme_of(method)
        if periodic is not None and (initial is not None or getattr(scheme, "order", 1) != 1):
            raise ValueError("periodic cannot be combined with initial, or with order=2")
        return _checked(background, h0, of_place, initial, point_sources, periodic), scheme

    given, scheme = _ranks_of(background).agree(check)
    if isinstance(background, PartitionedMesh):
        given = _equal_on_ranks(given, (of_place, of_size), method=scheme, with_info=wants_info)
    transform = _transform_of(given, of_size)
    with reporting(progress) as report:
        problem = replace(
            given if transform is None else _transformed(given, transform),
            report=report,
            at_any_price=scheme is not None,
        )
        scheme, solution = _solved(problem, scheme)
    h = solution.h
    if transform is not None:
        h = _ranks_of(background).agree(lambda: transform.backward(solution.h))
    h = np.minimum(h, given.h0)  # the transformation rounds
    _warn_of(solution, problem.domain, h)
    problem = replace(problem, report=silent, initial=None)
    info = LimitingInfo(scheme, problem, solution, background, transform)
    if wants_info and isinstance(background, PartitionedMesh):
        info = info.completed()
    return h, info


def _ranks_of(domain: AnyMesh | CartesianGrid | Octree) -> Communicator:
    """Return the ranks that share a domain."""
    return domain.ranks if isinstance(domain, PartitionedMesh) else SingleRank()


def _scheme_of(method: Scheme | str) -> Scheme | None:
    """Return the scheme of a method; None stands for the one that suits the problem."""
    if isinstance(method, Scheme):
        return method
    name = one_of("method", method, ("auto", *SCHEMES))
    return None if name == "auto" else SCHEMES[name]()


def _equal_on_ranks(
    given: Problem, g: tuple[npt.ArrayLike, GradientOfSize | None], **others: object
) -> Problem:
    """Return a problem on a mesh in parts whose ranks agree, with the limit there; collective."""
    part = given.part
    require_equal_arguments(part, given.h0, g, given.point_sources, **others)
    return replace(given, slope=slope_of_parts(part, g[0], given.slope))


def _transform_of(given: Problem, of_size: GradientOfSize | None) -> SizeTransform | None:
    """Return the change of variable for g(h), None for a limit that does not depend on the size.

    Collective.  Raises a ValueError if no bound is finite.
    """
    domain, ranks, extra = given.domain, _ranks_of(given.domain), given.point_sources
    bounds = given.h0 if extra is None else np.concatenate([given.h0.ravel(), extra.sizes])
    least = ranks.allreduce(float(bounds.min(initial=np.inf)), "min")
    if least == np.inf:
        raise ValueError("h0 must be finite at one node at least, got inf at all of them")
    if of_size is None:
        return None
    largest = float(bounds.max(where=np.isfinite(bounds), initial=0.0))
    ends = least, ranks.allreduce(largest, "max")
    if isinstance(domain, PartitionedMesh):
        require_equal_functions(domain, of_size, *ends)
    return ranks.agree(lambda: SizeTransform(of_size, *ends))


def _solved(problem: Problem, scheme: Scheme | None) -> tuple[Scheme, Solution]:
    """Return the solution by a scheme, or by that which suits the problem, and this one."""
    scheme = _automatic(problem) if scheme is None else scheme
    _refuse_unsupported(scheme, problem)
    try:
        try:
            return scheme, scheme.solve(problem)
        except TooManyCorners:  # on all ranks
            scheme, problem = FastMarching(), with_points_at_nodes(problem)
            return scheme, scheme.solve(problem)
    except NeedsWholeMesh:  # on all ranks
        return scheme, solve_on_whole(scheme, problem)


def _warn_of(solution: Solution, domain: AnyMesh | CartesianGrid, h: FloatArray) -> None:
    """Warn if a scheme did not converge, or nodes of cells, or active ones, get inf; collective."""
    ranks = _ranks_of(domain)
    if solution.unfinished and ranks.rank == 0:
        warn_caller(solution.unfinished, ConvergenceWarning)
    counted, total = np.ones(h.shape, np.bool_), domain.n_points
    if isinstance(domain, CartesianGrid):
        counted = counted if domain.active is None else domain.active
        total = int(counted.sum())
    elif isinstance(domain, PartitionedMesh):
        counted, total = domain.is_owned, domain.n_global_points
    else:
        counted = domain.in_a_cell
    free = np.isinf(h) & counted if h.max(initial=0.0) == np.inf else np.zeros(h.shape, np.bool_)
    n = int(ranks.allreduce(int(np.count_nonzero(free)), "sum"))
    if n > 0 and ranks.rank == 0:
        where = _components_text(domain, free)
        text = f"h0 is inf at all nodes of {where}: {n} of {total} nodes get the size inf"
        warn_caller(f"{text}; give these a bound, such as the largest size", InputWarning)


def _components_text(domain: AnyMesh | CartesianGrid, free: BoolArray) -> str:
    """Return how many components the nodes without a bound make up."""
    if isinstance(domain, PartitionedMesh):
        return "parts of the domain"
    if isinstance(domain, CartesianGrid):
        from scipy import ndimage

        count = int(ndimage.label(free)[1])
    else:
        label = components_of(domain.edges, domain.n_points)
        count = len(np.unique(label[free]))
    return "a component of the domain" if count == 1 else f"{count} components of the domain"


def _checked(
    background: AnyMesh | CartesianGrid | Octree,
    h0: npt.ArrayLike,
    g: npt.ArrayLike,
    initial: npt.ArrayLike | None,
    point_sources: tuple[npt.ArrayLike, npt.ArrayLike] | None,
    periodic: npt.ArrayLike | None,
) -> Problem:
    """Return the checked arguments, of which g is the factor that depends on the place."""
    background = as_mesh("background", background, PartitionedMesh, CartesianGrid, Octree)
    domain = background.mesh if isinstance(background, Octree) else background
    if isinstance(domain, PartitionedMesh) and (initial is not None or periodic is not None):
        raise ValueError("initial and periodic must be None for meshes in parts")
    kind = background.nodal_shape, getattr(background, "active", None)
    bound = as_nodal_sizes("h0", h0, *kind)
    if np.may_share_memory(bound, h0):
        bound = bound.copy()  # kept in the info
    extra = None if point_sources is None else as_point_bounds(point_sources, background.dim)
    start = cell = None
    if periodic is not None and not isinstance(domain, PartitionedMesh):
        cell = as_periodicity(domain, periodic)
        bound = cell.least(bound)
    if initial is not None:
        # Below h0 it is within the table of the transformation.
        start = np.minimum(as_nodal_sizes("initial", initial, *kind), bound)
    return Problem(domain, bound, in_space(domain, g), start, extra, cell)


def _transformed(problem: Problem, transform: SizeTransform) -> Problem:
    """Return the problem for transformed sizes."""
    extra, start = problem.point_sources, problem.initial
    if extra is not None:
        extra = extra._replace(sizes=transform.forward(extra.sizes))
    if start is not None:
        start = transform.forward(start)
    h0 = transform.forward(problem.h0)
    return replace(problem, h0=h0, initial=start, point_sources=extra)


def _automatic(problem: Problem) -> Scheme:
    """Return the exact method where it applies, else fast marching."""
    exact, cell = Exact(), problem.periodic
    applies = not (problem.slope.varies or exact.supports(problem.domain))
    return exact if applies and (cell is None or cell.is_convex) else FastMarching()


def _refuse_unsupported(scheme: Scheme, problem: Problem) -> None:
    """Raise a ValueError if a scheme does not support the background or an argument."""
    needed = scheme.supports(problem.domain)
    if needed:
        method = Message.name("method", repr(scheme.name))
        raise OptionError(Message("{} needs {}, got {!r}", method, needed, problem.domain))
    for name in ("initial", "point_sources", "periodic"):
        if getattr(problem, name) is not None and name not in scheme.optional:
            able = " or ".join(repr(s.name) for s in SCHEMES.values() if name in s.optional)
            raise ValueError(f"{name} is for method={able}, got method={scheme.name!r}")


def as_point_bounds(given: tuple[npt.ArrayLike, npt.ArrayLike], dim: int) -> PointBounds:
    """Return checked bounds at points."""
    if not isinstance(given, tuple | list) or len(given) != 2:
        raise ValueError(f"point_sources must be a pair (points, sizes), got {describe(given)}")
    points = as_points("point_sources[0]", given[0], dim)
    return PointBounds(points, as_sizes("point_sources[1]", given[1], (len(points),)))
