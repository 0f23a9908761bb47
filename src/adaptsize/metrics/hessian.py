"""Metrics from the second derivatives of a field."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from adaptsize._checks import NEAREST, as_aspect, as_number, as_values, check_type
from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import as_mesh
from adaptsize.metrics.algebra import refuse_skew
from adaptsize.metrics.metric import Metric
from adaptsize.sizes.budget import ELEMENTS_PER_MEASURE, as_goal, calibration
from adaptsize.sizes.recovery import recovered_hessian, second_derivatives_of_fits
from adaptsize.sizes.search import scale_to
from adaptsize.typing import BoolArray, FloatArray


def metric_from_hessian(
    mesh: SimplexMesh,
    values: npt.ArrayLike | None = None,
    *,
    hessian: npt.ArrayLike | None = None,
    tolerance: float | None = None,
    elements: float | None = None,
    norm: float = 2.0,
    hmin: float | None = None,
    hmax: float | None = None,
    max_aspect: float = 1000.0,
    backend: str | None = None,
) -> Metric:
    r"""Return the metric in which linear elements interpolate a field best for their number.

    With the second derivatives H of the field, :math:`|H| = R\,\mathrm{diag}(|\lambda_i|)\,R^T`,
    and the norm of :math:`L^q` of the error, the optimum is [1]_ [2]_

    .. math:: M = D \, (\det |H|)^{-1 / (2 q + d)} \, |H| .

    Elements are then stretched along directions in which the field changes linearly.  The smaller
    q, the more elements go to places with small second derivatives.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles in the plane, tetrahedra, or triangles in space.
    values : array_like of float, shape (n_points,), optional
        The field at the nodes, from which the second derivatives are recovered.
    hessian : array_like of float, shape (n_points, dim, dim), optional
        Second derivatives at the nodes, symmetric, instead of ``values``.
    tolerance : float, optional
        Error bound, in the unit of the field.  For a finite ``norm``, in that unit times the area
        or volume to the power of 1 / norm.  Either this or ``elements``.
    elements : float, optional
        Target number of elements, after all limits.
    norm : float, default 2
        q >= 1, or inf.
    hmin, hmax : float, optional
        Limits of the sizes.
    max_aspect : float, default 1000
        Limit of the aspect ratio, at least 1.
    backend : str, optional
        If given, ``elements`` is the number that this mesh generator makes, see
        `adaptsize.sizes.predict`.  Otherwise it is the number of simplices that are
        regular in the metric.

    Returns
    -------
    Metric
        At the nodes.  inf where the second derivatives are zero, unless ``hmax`` is given.
        On surfaces, the size along the normal is the larger one in the tangent plane.

    Raises
    ------
    ValueError
        If the mesh is of another kind, an array has another shape or is not finite, not exactly
        one target is given, or an option is out of range.

    See Also
    --------
    limit_metric : the next step, gradient limiting.
    size_from_hessian : the same with one size for all directions.

    Notes
    -----
    With :math:`\delta = \int (\det|H|)^{q/(2q + d)}\,dx`, a tolerance :math:`\varepsilon` is met
    with :math:`D = \delta^{1/q} / (2 \varepsilon)`, where an edge of unit length has the error
    :math:`e^T |H| e / 2`.  As in `size_from_hessian`, this is conservative by a factor of about 3.
    It applies before ``hmin``, ``hmax`` and limiting.  The integral is evaluated at the nodes.

    Before it is scaled, the smallest eigenvalue is raised to the largest one over
    ``max_aspect**2``.  Without this, the sizes would be zero where :math:`\det H = 0`.

    References
    ----------
    .. [1] L. Chen, P. Sun, J. Xu, "Optimal anisotropic meshes for minimizing interpolation
       errors in L^p-norm", Mathematics of Computation 76 (2007) 179-204.
    .. [2] A. Loseille, F. Alauzet, "Continuous mesh framework part I: well-posed continuous
       interpolation error", SIAM J. Numer. Anal. 49 (2011) 38-60.

    Examples
    --------
    The field 50 x^2 + y^2 / 2 needs edges that are ten times as long along y:

    >>> import numpy as np
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    >>> H = np.broadcast_to(np.diag([100.0, 1.0]), (3, 2, 2))
    >>> metric_from_hessian(mesh, hessian=H, tolerance=0.5, norm=np.inf).sizes[0]
    array([0.1, 1. ])
    """
    goal = optimal_metric(
        mesh, values, hessian=hessian, norm=norm, hmin=hmin, hmax=hmax, max_aspect=max_aspect,
        backend=backend,
    )  # fmt: skip
    return goal(tolerance, elements)


def optimal_metric(
    mesh: SimplexMesh,
    values: npt.ArrayLike | None = None,
    *,
    hessian: npt.ArrayLike | None = None,
    norm: float = 2.0,
    hmin: float | None = None,
    hmax: float | None = None,
    max_aspect: float = 1000.0,
    backend: str | None = None,
) -> Callable[[float | None, float | None], Metric]:
    """Return a function of tolerance and elements, one of them None, that returns the metric.

    The second derivatives are recovered once for all goals.  See `metric_from_hessian`.
    """
    mesh = as_mesh("mesh", mesh)
    frames = _tangents(mesh) if (mesh.cell_dim, mesh.dim) == (2, 3) else None
    second = _second_derivatives(mesh, values, hessian, frames)
    q = as_number("norm", norm, lower=1.0, allow_inf=True)
    aspect = as_aspect("max_aspect", max_aspect)
    d = mesh.cell_dim
    steepness, directions = _eigen(second, aspect, mesh.in_a_cell)
    if frames is not None:
        steepness, directions = _in_space(steepness, directions, frames)
    exponent = 0.0 if math.isinf(q) else 1.0 / (2.0 * q + d)
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = steepness[:, -d:].prod(axis=1)
        shape = (steepness * determinant[:, None] ** -exponent) ** -0.5
    shape[steepness[:, -1] == 0.0] = np.inf

    def metric(scale: float) -> Metric:
        return Metric.of(scale * shape, directions).clip(hmin, hmax, aspect)

    def for_goal(tolerance: float | None, elements: float | None) -> Metric:
        goal, wanted = as_goal(tolerance, elements)
        if goal == "tolerance":
            share = 1.0
            if not math.isinf(q):
                integral = mesh.measures * (determinant ** (q * exponent))[mesh.cells].mean(axis=1)
                share = float(integral.sum()) ** (1.0 / q)
            return metric(math.sqrt(2.0 * wanted / share) if share > 0.0 else 1.0)
        if not np.isfinite(shape).any():
            return metric(1.0)
        once = Metric.of(shape, directions).predicted_elements(mesh)
        start = (once / wanted) ** (1.0 / d) if once > 0.0 else 1.0
        wanted /= calibration(backend, d)
        return scale_to(wanted, metric, lambda m: m.predicted_elements(mesh), start, d)

    return for_goal


def predicted_elements(metric: Metric, mesh: SimplexMesh) -> float:
    """Return the number of simplices of unit edges in the metric that fill a mesh.

    See `Metric.predicted_elements`.
    """
    mesh = as_mesh("mesh", mesh)
    check_type("metric", metric, Metric)
    return ELEMENTS_PER_MEASURE[mesh.cell_dim] * metric.complexity(mesh)


def _second_derivatives(
    mesh: SimplexMesh,
    values: npt.ArrayLike | None,
    hessian: npt.ArrayLike | None,
    frames: FloatArray | None,
) -> FloatArray:
    """Return second derivatives at the nodes, given or recovered; on surfaces in the tangents."""
    if mesh.dim == 1 or mesh.cell_dim == 1:
        raise ValueError(f"mesh must consist of triangles or tetrahedra, got {mesh!r}")
    if values is not None and hessian is None:
        return _recovered(mesh, values, frames)
    if hessian is not None and values is None:
        return _given(mesh, hessian, frames)
    given = "none" if values is None else "both"
    raise ValueError(f"one of values and hessian must be given, got {given}")


def _recovered(mesh: SimplexMesh, values: npt.ArrayLike, frames: FloatArray | None) -> FloatArray:
    """Return second derivatives from nodal values."""
    if frames is None:
        found = recovered_hessian(mesh, values)
    else:
        nodal = as_values("values", values, (mesh.n_points,))
        found = second_derivatives_of_fits(mesh, nodal, frames)
    return as_values("second derivatives", found)


def _given(mesh: SimplexMesh, hessian: npt.ArrayLike, frames: FloatArray | None) -> FloatArray:
    """Return given second derivatives, on surfaces those in the tangents."""
    second = as_values("hessian", hessian, (mesh.n_points, mesh.dim, mesh.dim))
    refuse_skew("hessian", second)
    if frames is None:
        return second
    inside = frames.swapaxes(1, 2) @ second @ frames
    return np.asarray(0.5 * (inside + inside.swapaxes(1, 2)))


def _eigen(second: FloatArray, aspect: float, counts: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return absolute eigenvalues, ascending and limited in their ratio, and eigenvectors.

    Those far below the largest one in the domain, at nodes where ``counts`` is True, are rounding
    errors.
    """
    values, vectors = np.linalg.eigh(0.5 * (second + second.swapaxes(1, 2)))
    values = np.abs(values)
    order = np.argsort(values, axis=1, kind="stable")
    values = np.take_along_axis(values, order, axis=1)
    vectors = np.take_along_axis(vectors, order[:, None, :], axis=2)
    largest = values[:, -1:]
    # Second derivatives below this share of the largest one are rounding.
    values[largest[:, 0] <= max(1e-12 * largest[counts].max(initial=0.0), NEAREST)] = 0.0
    return np.maximum(values, largest / aspect**2), vectors


def _in_space(
    steepness: FloatArray, directions: FloatArray, frames: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return eigenvalues and eigenvectors in space; along the normal the least eigenvalue."""
    along = frames @ directions
    normals = np.cross(along[:, :, 0], along[:, :, 1])
    return np.hstack([steepness[:, :1], steepness]), np.dstack([normals, along])


def _tangents(surface: SimplexMesh) -> FloatArray:
    """Return two orthonormal tangents at the nodes, in any orientation of the triangles.

    The normal is the direction with the largest sum of squared cosines to the normals around the
    node, weighted by area.

    Returns
    -------
    float64[n_points, 3, 2]
    """
    a, b, c = (surface.points[v] for v in surface.cells.T)
    twice = np.cross(b - a, c - a)
    area = np.linalg.norm(twice, axis=1)
    unit = twice / np.where(area > 0.0, area, 1.0)[:, None]
    outer = (area[:, None, None] * unit[:, :, None] * unit[:, None, :]).reshape(-1, 9)
    total = np.zeros((surface.n_points, 9))
    for nodes in surface.cells.T:
        for k in range(9):
            total[:, k] += np.bincount(nodes, outer[:, k], surface.n_points)
    return np.asarray(np.linalg.eigh(total.reshape(-1, 3, 3))[1][:, :, :2])
