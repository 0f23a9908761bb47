"""`limit_gradient`: check the arguments, choose a scheme and report on the result."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_flag, as_number, as_whole_number, describe, one_of
from adaptsize._progress import reporting, silent
from adaptsize._with_info import with_info
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.errors import ConvergenceWarning
from adaptsize.limiting import gradient_limit, on_grids, on_simplices
from adaptsize.limiting.arguments import as_bound, as_count, as_domain, as_point_bounds
from adaptsize.limiting.gradient_limit import SizeTransform
from adaptsize.limiting.info import LimitingInfo, Record
from adaptsize.limiting.options import refuse_idle
from adaptsize.limiting.periodic import as_periodicity
from adaptsize.limiting.problem import Problem
from adaptsize.limiting.warm_start import refuse_background, refuse_others, resume, with_start
from adaptsize.typing import FloatArray, GradientLimit, ProgressCallback

_TOL = 1e-3


@with_info
def limit_gradient(
    background: SimplexMesh | CartesianGrid | Octree,
    h0: npt.ArrayLike,
    g: GradientLimit,
    *,
    method: str = "auto",
    order: int = 1,
    floor: Literal["hopf-lax"] | None = "hopf-lax",
    initial: npt.ArrayLike | LimitingInfo | None = None,
    tol: float = _TOL,
    max_iter: int | None = None,
    face_sources: bool = True,
    threads: int | None = None,
    point_sources: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    periodic: npt.ArrayLike | None = None,
    progress: ProgressCallback | bool | None = None,
) -> tuple[FloatArray, LimitingInfo]:
    r"""Return the largest mesh size below ``h0`` whose gradient is at most ``g``.

    This is the steady state of the gradient limiting equation [1]_

    .. math:: h_t + |\nabla h| = \min(|\nabla h|, g), \qquad h(x, 0) = h_0(x),

    on the nodes of the background.  Sizes propagate inside the domain only.  Two regions
    that are separated by a slit, a hole, inactive nodes or a gap between two sheets do not
    affect each other directly, however close they are.

    Parameters
    ----------
    background : SimplexMesh, CartesianGrid or Octree
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
          ``n_points`` entries is always read as per node,
        * a function ``g(h)`` that takes an array of sizes and returns positive bounded
          limits,
        * a pair ``(a, b)`` for the product a(x) b(h).
    method : str, optional
        * ``"exact"`` computes each size directly from the bounds visible from the node.  It
          needs a flat domain and a single number g or a function g(h).  The result is exact
          to rounding in convex domains and in the plane; see the notes.
        * ``"fast-marching"`` is of first order and monotone, and works on every background.
        * ``"auto"`` takes the exact method where it applies, else fast marching.
        * ``"positive-coefficient"``, on meshes, is the iteration of Barth and Sethian [2]_.
        * ``"hamilton-jacobi"``, on grids, is the upwind iteration of [1]_.
        * ``"edge-based"`` computes shortest paths along edges.  It does not converge and is
          meant for comparison only.
    order : int, optional
        Order of accuracy: 1, or 2 on grids with fast marching (which ``"auto"`` then takes)
        or the Hamilton-Jacobi iteration.
    floor : "hopf-lax" or None, optional
        Option of the positive coefficient scheme.  ``"hopf-lax"`` keeps the sizes above the
        Hopf-Lax updates.  None is the scheme as published, which undershoots at point
        sources.
    initial : LimitingInfo, float, or array_like of float of the nodal shape, optional
        Either the info of an earlier call with the same background, g and method.  The exact
        method on meshes then recomputes only the nodes whose size may change, if the bounds
        are at isolated nodes or ``face_sources=False``.  See the notes.
        Or an array with the start values of an iteration; the default is the fast marching
        solution.  The values are lowered to ``h0`` where they exceed it.  The Hamilton-Jacobi
        iteration converges from any start, and fastest from the solution for a slightly
        different ``h0``.  The positive coefficient scheme can only lower its start values.
    tol : float, optional
        Tolerance of an iteration: it stops when no node changes faster than ``tol * g``.
    max_iter : int, optional
        Largest number of steps of an iteration.
    face_sources : bool, optional
        Option of the exact method.  True: ``h0`` also bounds the size inside the cells, where
        it is interpolated linearly.  False: ``h0`` is a bound at the nodes only; limiting is
        then idempotent.  The boxes of a plane grid are split along both diagonals, those in
        space as in ``grid.mesh``.
    threads : int, optional
        Option of the exact method: the number of threads, by default that of numba
        (``numba.set_num_threads``).  The result does not depend on it, bit for bit.
    point_sources : tuple of (array_like, array_like), optional
        Option of the exact method: points of shape (k, dim) and the bounds there, of shape
        (k,).  The points need not be nodes.  Points outside the domain have no effect.  A point
        where components of the domain touch acts in all of them.
    periodic : array_like of float, shape (k, dim), optional
        Option of the exact method and of fast marching of first order: translations by which
        the domain is repeated, such as ``[[a, 0], [0, b]]``.  The result is that on the domain
        with all of its images.  Nodes on opposite sides must come in pairs; both get the same
        size.  See the notes.
    progress : callable or bool, optional
        Called with a text and the fraction completed; True shows a progress bar on a
        terminal.  An exception raised in it (or Ctrl-C) stops the computation.

    Returns
    -------
    h : ndarray of float64, of the nodal shape
        ``h <= h0`` everywhere.  Along every edge, ``h[i] - h[j]`` is at most g times the
        length of the edge, to rounding.  With g(h) this holds in the variable Phi of the
        notes; for an iteration from ``initial`` it holds to ``tol``.  On meshes, g is the
        smallest of the cells at the edge; on grids, that at the end of larger size.
        The size is inf only at inactive nodes and in components of the domain where all of
        ``h0`` is inf.  Mesh nodes that belong to no cell keep ``h0``.
        ``limit_gradient.with_info``, with the same arguments, returns the pair ``(h, info)`` with
        a `LimitingInfo`, whose attributes are computed on first access.

    Raises
    ------
    ValueError
        If a shape is wrong; if ``h0`` is NaN, zero, negative or inf throughout; if g is
        negative, NaN or above 1e30; if the method does not support the background, order or g;
        if an option that the method does not use differs from its default; or if ``initial`` is
        the info of a call with another background, g, method or option.

    Warns
    -----
    ConvergenceWarning
        If an iteration does not meet ``tol`` in ``max_iter`` steps, or if another loop reaches
        its limit.  ``info.converged`` is then False.

    Notes
    -----
    *g(h).*  The change of variable :math:`\Phi(h) = \int dh/g(h)` turns the limit into 1.
    Hence the solution exists and is unique, and g need not be monotone.

    *Interpolation.*  The bound holds for *nodal differences*.  The gradient of the linear
    interpolant may exceed g around point sources and where fronts meet, by a factor of up to
    :math:`1/\cos(\theta/2)` for a cell with angle :math:`\theta` at its upstream vertex.
    This also happens with exact nodal values, at every mesh size.

    *Exact method.*  In convex domains and in the plane the result is
    :math:`\min_y h_0(y) + g\,d(x, y)` to rounding, where d is the length of the shortest path
    in the domain.  In solids the same holds at each x from which the minimising point y is
    visible.  Elsewhere d is the length of a path over edges of the boundary, so that the
    result is an upper bound; no size is too small.  ``info.n_proved`` counts the nodes with a
    proof, and ``info.largest_gap`` bounds the error at the others.

    *Periodic domains.*  Sizes propagate through a side of the cell to its opposite one.  Where
    cell and images make up a convex domain, the exact method adds the images of the sources,
    and the result is exact to rounding.  Elsewhere fast marching identifies the nodes.

    *Warm start.*  With ``initial``, the exact method returns the same sizes as without it, bit
    for bit.  The Hamilton-Jacobi iteration starts from the earlier sizes.  All other methods
    and cases are solved from scratch.  The arrays given to the earlier call may have been
    modified in the meantime.

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

    Another bound at one node, with a warm start from the earlier result:

    >>> h, info = limit_gradient.with_info(grid, h0, 0.3)
    >>> h0[2, 2] = 0.4
    >>> limit_gradient(grid, h0, 0.3, initial=info).round(3)
    array([[0.1  , 0.25 , 0.4  ],
           [0.25 , 0.312, 0.435],
           [0.4  , 0.435, 0.4  ]])
    """
    domain = as_domain(background)
    schemes = on_grids if isinstance(domain, CartesianGrid) else on_simplices
    method = one_of("method", method, ("auto", *schemes.METHODS))
    bound = as_bound("h0", h0, background)
    if np.may_share_memory(bound, h0):
        bound = bound.copy()  # kept for comparison in the next call
    extra = None if point_sources is None else as_point_bounds(point_sources, background.dim)
    if bound.min() == np.inf and (extra is None or extra.sizes.min(initial=np.inf) == np.inf):
        raise ValueError("h0 must be finite at one node at least, got inf at all of them")
    earlier, guess = (initial, None) if isinstance(initial, LimitingInfo) else (None, initial)
    order = as_whole_number("order", order, lower=1, upper=2)
    if floor is not None and not (isinstance(floor, str) and floor == "hopf-lax"):
        raise ValueError(f"floor must be 'hopf-lax' or None, got {describe(floor)}")
    face_sources = as_flag("face_sources", face_sources)
    tol = as_number("tol", tol, lower=0.0, strict=True)
    max_iter, threads = as_count("max_iter", max_iter), as_count("threads", threads)
    given = {
        "order": order != 1,
        "floor": floor is None,
        "initial": guess is not None,
        "tol": tol != _TOL,
        "max_iter": max_iter is not None,
        "face_sources": not face_sources,
        "threads": threads is not None,
        "point_sources": extra is not None,
        "periodic": periodic is not None,
    }
    refuse_idle(method, schemes.METHODS, given)
    cell = None if periodic is None else as_periodicity(domain, periodic, initial, order)
    bound = bound if cell is None else cell.least(bound)
    record = None if earlier is None else earlier.record
    # A record of another background is refused below, when all else is known.
    if record is not None and record.bound.shape != bound.shape:
        refuse_background(record, background)
    bounds = bound if extra is None else np.concatenate([bound.ravel(), extra.sizes])
    slope, transform = gradient_limit.resolve(
        domain, g, bounds, None if record is None else record.transform
    )
    if extra is not None and transform is not None:
        extra = extra._replace(sizes=transform.forward(extra.sizes))
    start = None if guess is None else as_bound("initial", guess, background)
    with reporting(progress) as report:
        problem = Problem(
            h0=_forward(bound, transform, record),
            slope=slope,
            order=order,
            floor=floor is not None,
            # Below h0 it is within the table of the transformation.
            initial=None if start is None else _forward(np.minimum(start, bound), transform),
            tol=tol,
            max_iter=max_iter,
            face_sources=face_sources,
            threads=threads,
            point_sources=extra,
            report=report,
            periodicity=cell,
        )
        if method == "auto":
            method = schemes.choose_method(domain, problem)
        if extra is not None and method != "exact":
            raise ValueError(f"point_sources is for method='exact', got method={method!r}")
        solution = None
        if earlier is not None:
            refuse_others(earlier, background, method, problem, transform)
            solution = resume(earlier.record, method, problem, transform)
        if solution is None:
            solution = schemes.solve(domain, method, with_start(record, method, problem))
    if solution.unfinished:
        warnings.warn(solution.unfinished, ConvergenceWarning, stacklevel=3)
    # The back transformation rounds.
    h = np.minimum(_backward(solution.h, transform, record), bound)
    problem = replace(problem, report=silent, initial=None)
    own = solution.h if transform is None else h.copy()
    found = Record(background, domain, bound, own, transform, problem, solution)
    return h, LimitingInfo(method, solution.iterations, solution.converged, found)


def _forward(
    sizes: FloatArray, transform: SizeTransform | None, record: Record | None = None
) -> FloatArray:
    """Return transformed bounds; those in the record are not recomputed."""
    if transform is None:
        return sizes
    if record is None or record.transform is not transform:
        return transform.forward(sizes)
    transformed = record.problem.h0.copy()
    changed = sizes != record.bound
    transformed[changed] = transform.forward(sizes[changed])
    return transformed


def _backward(u: FloatArray, transform: SizeTransform | None, record: Record | None) -> FloatArray:
    """Return the sizes of a solution; those in the record are not recomputed."""
    if transform is None:
        return u
    if record is None or record.transform is not transform:
        return transform.backward(u)
    h = record.h.copy()
    changed = u != record.solution.h
    h[changed] = transform.backward(u[changed])
    return h
