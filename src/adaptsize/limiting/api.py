"""`limit_gradient`: picks the scheme, checks, reports."""

from __future__ import annotations

from typing import Literal, overload

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_number, as_sizes, describe, one_of
from adaptsize._progress import reporting
from adaptsize.background import SimplexMesh
from adaptsize.limiting import gradient_limit
from adaptsize.limiting.exact import solve_exact
from adaptsize.limiting.fast_marching import solve_edge_based, solve_fast_marching
from adaptsize.limiting.gradient_limit import SizeTransform, Slope
from adaptsize.limiting.positive_coefficient import solve_positive_coefficient
from adaptsize.limiting.solution import LimitingInfo, Solution, describe_solution
from adaptsize.typing import FloatArray, GradientLimit, ProgressCallback

METHODS = ("auto", "fast-marching", "positive-coefficient", "edge-based", "exact")
# Products of four lengths and two g must stay in the range of float64.
_FARTHEST = 1e60
_MARCHING = {
    "fast-marching": solve_fast_marching,
    "edge-based": solve_edge_based,
    "exact": solve_exact,
}


@overload
def limit_gradient(
    background: SimplexMesh,
    h0: npt.ArrayLike,
    g: GradientLimit,
    *,
    method: str = ...,
    floor: Literal["hopf-lax"] | None = ...,
    initial: npt.ArrayLike | None = ...,
    tol: float = ...,
    max_iter: int | None = ...,
    full_output: Literal[False] = ...,
    progress: ProgressCallback | bool | None = ...,
) -> FloatArray: ...
@overload
def limit_gradient(
    background: SimplexMesh,
    h0: npt.ArrayLike,
    g: GradientLimit,
    *,
    method: str = ...,
    floor: Literal["hopf-lax"] | None = ...,
    initial: npt.ArrayLike | None = ...,
    tol: float = ...,
    max_iter: int | None = ...,
    full_output: Literal[True],
    progress: ProgressCallback | bool | None = ...,
) -> tuple[FloatArray, LimitingInfo]: ...
def limit_gradient(
    background: SimplexMesh,
    h0: npt.ArrayLike,
    g: GradientLimit,
    *,
    method: str = "auto",
    floor: Literal["hopf-lax"] | None = "hopf-lax",
    initial: npt.ArrayLike | None = None,
    tol: float = 1e-3,
    max_iter: int | None = None,
    full_output: bool = False,
    progress: ProgressCallback | bool | None = None,
) -> FloatArray | tuple[FloatArray, LimitingInfo]:
    r"""Return the largest mesh size below ``h0`` whose gradient is at most ``g``.

    Solves the gradient limiting equation [1]_

    .. math:: h_t + |\nabla h| = \min(|\nabla h|, g), \qquad h(x, 0) = h_0(x),

    to steady state on the nodes of the background.  Sizes travel inside the mesh
    only: two regions separated by a slit, a hole or a gap between two sheets do not
    see each other, however close they are.

    Parameters
    ----------
    background : SimplexMesh
        Segments, triangles in the plane or in space, or tetrahedra; obtuse, sliver
        and degenerate cells are allowed.
    h0 : array_like of float, shape (n_points,)
        Upper bound on the size, in the unit of the coordinates.  Positive; inf
        where nothing is asked; finite at one node at least.
    g : float, array_like, callable, or tuple (array_like, callable)
        Gradient limit (length per length), finite and >= 0; neighbouring elements
        then differ by a factor of about ``1 + g``, and 0.2 to 0.3 is usual.  One
        number; or one per node or per cell (an array of ``n_points`` entries is per node,
        and its mean is taken in each cell; a limit that jumps must be given per
        cell); or ``g(h)``, which takes an array of sizes and returns positive
        bounded limits; or ``(a, b)`` for the product a(x) b(h).
    method : str, optional
        ``"fast-marching"`` (what ``"auto"`` takes): first order, O(n log n).
        ``"positive-coefficient"``: the iteration of Barth and Sethian [2]_.
        ``"edge-based"``: shortest paths along edges; does not converge, for
        comparison only.  ``"exact"``: formula (11) of [1]_, for convex domains and
        one g or g(h); quadratic cost.
    floor : "hopf-lax" or None, optional
        Of the positive coefficient scheme: keep it above the Hopf-Lax updates, or
        leave it as published, which undershoots at point sources.
    initial : array_like of float, shape (n_points,), optional
        Start of the positive coefficient scheme; the fast marching solution if
        not given.  It is lowered to ``h0`` where it is above.
    tol : float, optional
        Of the positive coefficient scheme: stop when no node changes faster than
        ``tol * g``.
    max_iter : int, optional
        Most steps of the positive coefficient scheme.
    full_output : bool, optional
        Also return a `LimitingInfo`.
    progress : callable or bool, optional
        Called with a text and the share done; True shows a bar on a terminal.
        Raising in it (or Ctrl-C) stops the work.

    Returns
    -------
    h : ndarray of float64, shape (n_points,)
        ``h <= h0`` everywhere.  Along every edge ``h[i] - h[j]`` is at most the
        least g of the cells at the edge times its length, to rounding (with g(h):
        in the variable Phi of the notes).  inf only in components of the mesh on which all of
        ``h0`` is inf; nodes in no cell keep ``h0``.
    info : LimitingInfo
        Only with ``full_output``.

    Raises
    ------
    ValueError
        If a shape is wrong, ``h0`` is NaN, zero, negative or inf throughout, g is
        negative, NaN or above 1e30, the largest coordinate is outside 1e-60 to 1e60, or the
        method does not support the g or mesh given.

    Warns
    -----
    ConvergenceWarning
        If the positive coefficient scheme does not meet ``tol`` in ``max_iter`` steps.

    Notes
    -----
    g(h) is handled by the change of variable :math:`\Phi(h) = \int dh/g(h)`, in which
    the limit is 1: the solution exists, is unique, and needs no monotone g.

    The bound holds for *nodal differences*.  The gradient of the linear interpolant
    may exceed g around point sources and where fronts meet, by up to
    :math:`1/\cos(\theta/2)` for a cell with angle :math:`\theta` at its upstream
    vertex; so does that of the exact nodal values, at every mesh size.

    References
    ----------
    .. [1] P.-O. Persson, "Mesh size functions for implicit geometries and PDE-based
       gradient limiting", Engineering with Computers 22 (2006) 95-109.
    .. [2] T. J. Barth, J. A. Sethian, "Numerical schemes for the Hamilton-Jacobi and
       level set equations on triangulated domains", J. Comput. Phys. 145 (1998) 1-40.

    Examples
    --------
    A size of 0.1 asked for at one corner of the unit square:

    >>> import numpy as np
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> h = limit_gradient(mesh, [0.1, np.inf, np.inf, np.inf], 0.3)
    >>> h.round(3)
    array([0.1  , 0.4  , 0.524, 0.4  ])
    """
    if not isinstance(background, SimplexMesh):
        raise ValueError(f"background must be a SimplexMesh, got {describe(background)}")
    mesh = background
    method = one_of("method", method, METHODS)
    if method == "auto":
        method = "fast-marching"
    farthest = max(float(mesh.points.max()), -float(mesh.points.min()))
    if farthest != 0.0 and not 1.0 / _FARTHEST <= farthest <= _FARTHEST:
        raise ValueError(
            f"background must have coordinates of {1.0 / _FARTHEST:g} to {_FARTHEST:g} in size, "
            f"got {farthest:g} as the largest: choose another unit of length"
        )
    bound = as_sizes("h0", h0, mesh.nodal_shape)
    if np.isinf(bound).all():
        raise ValueError("h0 must be finite at one node at least, got inf at all of them")
    if initial is not None and method != "positive-coefficient":
        raise ValueError(f"initial is for method='positive-coefficient', got method={method!r}")
    slope, transform = gradient_limit.resolve(mesh, g, bound)
    u0 = bound if transform is None else transform.forward(bound)

    with reporting(progress) as report:
        if method == "positive-coefficient":
            solution = _iterate(mesh, u0, slope, transform, floor, initial, tol, max_iter, report)
        else:
            solve = _MARCHING[method]
            solution = solve(mesh, u0, slope, residual=full_output, report=report)
    h = solution.h if transform is None else transform.backward(solution.h)
    h = np.minimum(h, bound)  # the way back from Phi rounds
    if not full_output:
        return h
    return h, describe_solution(mesh, method, slope, u0, solution.h, solution)


def _iterate(
    mesh: SimplexMesh,
    u0: FloatArray,
    slope: Slope,
    transform: SizeTransform | None,
    floor: str | None,
    initial: npt.ArrayLike | None,
    tol: float,
    max_iter: int | None,
    report: ProgressCallback,
) -> Solution:
    """Run the positive coefficient scheme from ``initial`` or from fast marching."""
    if floor not in ("hopf-lax", None):
        raise ValueError(f"floor must be 'hopf-lax' or None, got {floor!r}")
    tol = as_number("tol", tol, lower=0.0, strict=True)
    if max_iter is not None and (not isinstance(max_iter, int | np.integer) or max_iter < 1):
        raise ValueError(f"max_iter must be an integer >= 1 or None, got {max_iter!r}")
    start = solve_fast_marching(mesh, u0, slope, residual=False, report=report).h
    if initial is not None:
        given = as_sizes("initial", initial, mesh.nodal_shape)
        given = np.minimum(given, u0) if transform is None else transform.forward(given)
        if np.isinf(given[np.isfinite(start)]).any():
            raise ValueError("initial must be finite in every component with a finite h0")
        start = np.where(np.isinf(start), np.inf, given)
    return solve_positive_coefficient(
        mesh,
        u0,
        slope,
        start=start,
        floor=floor is not None,
        tol=tol,
        max_iter=max_iter,
        report=report,
    )
