"""Sizes from the results of a solver: error indicators, or second derivatives of a field."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from adaptsize._calls import recorded
from adaptsize._checks import as_number, as_values, refuse_where
from adaptsize.background import AnyMesh, PartitionedMesh
from adaptsize.background.interpolation import nodes_in_domain
from adaptsize.background.simplex import as_mesh
from adaptsize.limiting import limit_gradient
from adaptsize.options import ErrorOptions, HessianOptions, checked, with_options
from adaptsize.options.bounds import ScaleOptions
from adaptsize.sizes.budget import (
    as_goal,
    calibration,
    count_elements,
    nodal_measures,
    present_sizes,
)
from adaptsize.sizes.combine import minimum
from adaptsize.sizes.limited import Corrected, Limit, Limited, sizes_for_number
from adaptsize.sizes.recovery import as_nodal_field, second_derivatives
from adaptsize.sizes.search import ACCURACY_OF_SCALE, scale_to
from adaptsize.typing import FloatArray, Unpack


@recorded("size_from_error")
@with_options(ErrorOptions)
def size_from_error(
    mesh: AnyMesh, indicator: npt.ArrayLike, *, order: float, **options: Unpack[ErrorOptions]
) -> FloatArray:
    r"""Return the size that gives all elements of the next mesh the same share of the error.

    The indicators :math:`\eta_K` estimate an error proportional to :math:`h^p` in cells K of
    dimension d.  :math:`h_K` is the edge of the regular simplex of the same measure.  The size is

    .. math:: h = s\, h_K\, \eta_K^{-1 / (p + d/2)},

    which gives the fewest elements for a given error, and the smallest error for a given number
    of elements [1]_.  The factor s is determined such that the predicted error or number of
    elements is the requested one, after all limits.

    Parameters
    ----------
    mesh : SimplexMesh or PartitionedMesh
        The present mesh: triangles, also in space, tetrahedra or segments.
    indicator : array_like of float, shape (n_cells,)
        Error of each cell, >= 0.  The total error is ``sqrt(sum(indicator**2))``, in a norm that
        is the root of an integral of squares.  ``tolerance`` is the target for it.
    order : float
        Order of convergence p > 0 of that norm for smooth solutions: the degree of the
        elements for energy norms, one more for the L2 norm.
    **options

    Returns
    -------
    ndarray of float64, shape (n_points,)
        Sizes, limited if ``g`` is given.  ``inf`` at nodes in no cell of positive
        measure, unless ``hmax`` is given.  If the limits do not allow the target, the sizes come
        as close as possible.

    Raises
    ------
    ValueError
        If the indicators are negative, not finite or of another shape, not exactly one target is
        given, or an option is out of range.

    See Also
    --------
    zz_indicator : an indicator, if the solver has none.
    limit_gradient : the next step if ``g`` is not given.

    Notes
    -----
    Cell values are transferred to nodes by averaging the number of elements per volume, weighted
    by volume, so that the total number is preserved.  Errors are predicted as
    :math:`\eta_K (h / h_K)^p` in each cell, before this averaging and before limiting.  The
    prediction is unreliable where the solution is singular.  The cost is O(n) for each of
    about ten trials of s.

    References
    ----------
    .. [1] O. C. Zienkiewicz, J. Z. Zhu, "A simple error estimator and adaptive procedure
       for practical engineering analysis", Int. J. Numer. Methods Eng. 24 (1987) 337-357.

    Examples
    --------
    Two triangles of a square, one with 8 times the error of the other.  With p = 1 and d = 2, the
    sizes are proportional to the inverse root of the error:

    >>> from adaptsize import SimplexMesh
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> size_from_error(mesh, [0.8, 0.1], order=1, elements=9).round(3)
    array([0.48 , 0.36 , 0.48 , 1.018])

    One step of an adaptive loop, with 5000 elements after limiting::

        h = ads.size_from_error(mesh, eta, order=1, elements=5000, g=0.25)
        mesh = ads.remesh(mesh, ads.SizeFunction(mesh, h))
    """
    mesh = as_mesh("mesh", mesh, PartitionedMesh)

    def check() -> tuple[FloatArray, float, ErrorOptions]:
        given = checked(ErrorOptions, options)
        _check_goal(given)
        eta = as_indicator(indicator, mesh)
        return eta, as_number("order", order, lower=0.0, strict=True), given

    eta, p, given = mesh.ranks.agree(check)
    mesh.ranks.require_equal(order=p, **given)
    return scaled_by_error(mesh, eta, p, given, _limit_of(mesh, given))


def as_indicator(value: npt.ArrayLike, mesh: AnyMesh) -> FloatArray:
    """Return checked indicators of the error in each cell."""
    eta = as_values("indicator", value, (mesh.n_cells,))
    refuse_where("indicator", eta < 0.0, eta, "must be finite and >= 0")
    return eta


def scaled_by_error(
    mesh: AnyMesh,
    states: FloatArray,
    order: float,
    given: ErrorOptions,
    limit: Limit,
    accuracy: float = ACCURACY_OF_SCALE,
    *,
    goals: Sequence[float] | None = None,
    corrected: Corrected | None = None,
) -> FloatArray:
    """Return the sizes of `size_from_error`, with limits by a function; collective.

    Of several states, float64[n, n_cells], these are the smallest that any of them requests: for
    the tolerance, or the ``goals`` of the states.  For a number of elements, they are the sizes
    that each state requests for it alone, before ``limit``, multiplied by one factor.

    ``accuracy`` is the relative error of the number of elements that is accepted, and ``corrected``
    returns another number, see `sizes_for_number`.
    """
    d, goal, wanted = mesh.cell_dim, *as_goal(given["tolerance"], given["elements"])
    every = [_Ratios(mesh, eta, order, given) for eta in np.atleast_2d(states)]
    now = present_sizes(mesh)
    bounds = min(of.bounds[0] for of in every), max(of.bounds[1] for of in every)

    def single(of: _Ratios, scale: float) -> FloatArray:
        return _nodal_sizes(mesh, now * of(scale))

    def sizes(scales: Sequence[float]) -> FloatArray:
        by_state = [single(*one) for one in zip(every, scales, strict=True)]
        return np.asarray(np.minimum.reduce(by_state))

    def alone(of: _Ratios) -> float:
        start = of.for_number(wanted)
        if len(every) == 1:
            return start
        return scale_to(
            wanted, float, lambda scale: count_elements(mesh, single(of, scale)), start, d,
            accuracy, bounds=of.bounds,
        )  # fmt: skip

    if goal == "tolerance":
        goals = [wanted] * len(every) if goals is None else goals
        return limit(sizes([of.for_error(own) for of, own in zip(every, goals, strict=True)]))
    wanted /= calibration(given["backend"], d)
    starts = [alone(of) for of in every]
    shares = [start / starts[0] for start in starts]  # all change by one factor
    return sizes_for_number(
        mesh, wanted, lambda scale: sizes([scale * share for share in shares]), limit, starts[0],
        accuracy, bounds=(bounds[0] / max(shares), bounds[1] / min(shares)), corrected=corrected,
    )  # fmt: skip


class _Ratios:
    """The ratios of next to present sizes of a state for a scale, within limits; collective."""

    def __init__(self, mesh: AnyMesh, eta: FloatArray, order: float, given: ErrorOptions) -> None:
        self._ranks, self._dim, self._eta, self._order = mesh.ranks, mesh.cell_dim, eta, order
        self._limits = 1.0 / given["max_refine"], given["max_coarsen"]
        with np.errstate(divide="ignore"):
            largest = self._ranks.allreduce(float(eta.max(initial=0.0)), "max")
            shape = (eta / max(largest, np.finfo(float).tiny)) ** (-1.0 / (order + 0.5 * self._dim))
        # Beyond these scales, all cells have their least or their largest ratio.
        widest = float(np.max(shape, where=np.isfinite(shape), initial=1.0))
        widest = self._ranks.allreduce(widest, "max")
        self._shape = shape
        self.bounds = self._limits[0] / widest, self._limits[1]

    def __call__(self, scale: float) -> FloatArray:
        return np.asarray(np.clip(scale * self._shape, *self._limits))

    def for_error(self, wanted: float) -> float:
        """Return the scale for an error that is to be expected."""
        moving = self._eta > 0.0

        def gain(scale: float) -> float:
            errors = self._eta[moving] * self(scale)[moving] ** self._order
            error = math.sqrt(self._ranks.allreduce(float((errors**2).sum()), "sum"))
            return math.inf if error == 0.0 else 1.0 / float(error)

        return scale_to(1.0 / wanted, float, gain, 1.0, self._order, bounds=self.bounds)

    def for_number(self, wanted: float) -> float:
        """Return the scale for a number of elements, before other limits."""
        d = self._dim

        def unlimited(scale: float) -> float:
            return float(self._ranks.allreduce(float((self(scale) ** -d).sum()), "sum"))

        return scale_to(wanted, float, unlimited, 1.0, d, bounds=self.bounds)


@recorded("size_from_hessian")
@with_options(HessianOptions)
def size_from_hessian(
    mesh: AnyMesh, values: npt.ArrayLike, **options: Unpack[HessianOptions]
) -> FloatArray:
    r"""Return the size at which linear elements interpolate a field equally well everywhere.

    Let :math:`\lambda` be the largest modulus of a second derivative in any direction.  The error
    of linear interpolation with edges h is less than :math:`\lambda h^2 / 2`.  In the
    maximum norm, the fewest elements for an error :math:`\varepsilon`, and the smallest error
    for a number of elements, are obtained with

    .. math:: h = \sqrt{2 \varepsilon / \lambda}.

    In the norm of :math:`L^q`, the optimum is :math:`h = s\, \lambda^{-q / (2 q + d)}`, where d is
    the dimension.  It puts fewer elements where the second derivatives are largest [1]_.

    Parameters
    ----------
    mesh : SimplexMesh or PartitionedMesh
        Triangles in the plane or tetrahedra.
    values : array_like of float, shape (n_points,)
        The field at the nodes, finite, for instance the density in a flow.  ``tolerance`` is in
        the unit of the field; for a finite ``norm``, in that unit times the area or volume to the
        power of 1 / norm.  Where the field jumps, its derivatives grow as the mesh is refined, and
        only ``hmin`` or ``elements`` stops this.
    **options

    Returns
    -------
    ndarray of float64, shape (n_points,)
        Sizes, limited if ``g`` is given; ``inf`` where the second derivatives of the
        field are zero, unless ``hmax`` is given.

    Raises
    ------
    ValueError
        If the cells do not have the dimension of the space, 2 or 3, the values are not finite or
        of another shape, not exactly one target is given, or an option is out of range.

    See Also
    --------
    adaptsize.sizes.recovered_hessian : the second derivatives, and their accuracy.

    Notes
    -----
    The bound is conservative.  At a point with barycentric coordinates :math:`b_i` the error
    is at most :math:`\lambda / 2 \sum_{i<j} b_i b_j |x_i - x_j|^2
    \le \lambda h^2 d / (4 (d + 1))` for edges up to h: a third of the tolerance in the plane and
    3/8 in space.  Edges may therefore be 1.7 or 1.6 times as long as requested, and generators
    rarely exceed the root of 2.  ``tolerance`` applies to sizes before ``hmin``, ``hmax`` and
    ``g``.

    References
    ----------
    .. [1] L. Chen, P. Sun, J. Xu, "Optimal anisotropic meshes for minimizing interpolation
       errors in L^p-norm", Mathematics of Computation 76 (2007) 179-204.

    Examples
    --------
    The field x^2 has the second derivative 2 everywhere:

    >>> import numpy as np
    >>> x, y = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 5))
    >>> from adaptsize import SimplexMesh
    >>> from scipy.spatial import Delaunay
    >>> points = np.column_stack([x.ravel(), y.ravel()])
    >>> mesh = SimplexMesh(points, Delaunay(points).simplices)
    >>> np.unique(size_from_hessian(mesh, points[:, 0] ** 2, tolerance=0.01).round(6))
    array([0.1])
    """
    mesh = as_mesh("mesh", mesh, PartitionedMesh)

    def check() -> tuple[FloatArray, HessianOptions]:
        given = checked(HessianOptions, options)
        _check_goal(given)
        return as_nodal_field(values, mesh), given

    nodal, given = mesh.ranks.agree(check)
    mesh.ranks.require_equal(**given)
    if isinstance(mesh, PartitionedMesh):
        mesh.require_equal_values("values", nodal)
    counted = nodal[nodes_in_domain(mesh)]
    ends = np.array([counted.min(initial=np.inf), -counted.max(initial=-np.inf)])
    low, minus_high = mesh.ranks.allreduce(ends, "min").tolist()
    hessian, diagonal = second_derivatives(mesh, nodal), mesh.diagonal
    steepest = np.abs(np.linalg.eigvalsh(hessian)).max(axis=1, initial=0.0)
    # Smaller values are rounding errors of values and coordinates.  If all nodes coincide, all are.
    noise = 1e-9 * -(minus_high + low) / diagonal**2 if diagonal > 0.0 else np.inf
    steepest[steepest <= noise] = 0.0
    return _scaled_by_derivative(mesh, np.asarray(steepest), given)


def _scaled_by_derivative(mesh: AnyMesh, steepest: FloatArray, given: HessianOptions) -> FloatArray:
    """Return the sizes of `size_from_hessian`, given the largest derivatives; collective."""
    d, q = mesh.cell_dim, given["norm"]
    goal, wanted = as_goal(given["tolerance"], given["elements"])
    factor, limit = calibration(given["backend"], d), _limit_of(mesh, given)
    exponent = 0.5 if math.isinf(q) else q / (2.0 * q + d)
    with np.errstate(divide="ignore"):
        shape = steepest**-exponent

    def sizes(scale: float) -> FloatArray:
        return scale * shape

    if goal == "tolerance":
        share = 1.0
        if not math.isinf(q):
            own = float((nodal_measures(mesh) * steepest ** (exponent * d)).sum())
            share = mesh.ranks.allreduce(own, "sum") ** (1.0 / q)
        return limit(sizes(math.sqrt(2.0 * wanted / share) if share > 0.0 else 1.0))
    largest = mesh.ranks.allreduce(float(shape[np.isfinite(shape)].max(initial=0.0)), "max")
    if largest == 0.0:  # the field is linear
        return limit(sizes(1.0))
    # A feasible initial value: cells with an inf node count only after limiting.
    once = count_elements(mesh, np.minimum(shape, largest))
    start = (once / wanted) ** (1.0 / d)
    return sizes_for_number(mesh, wanted / factor, sizes, limit, start)


def _check_goal(given: ScaleOptions) -> None:
    """Raise a ValueError if not exactly one target is given, or ``hmin`` exceeds ``hmax``."""
    as_goal(given["tolerance"], given["elements"])
    minimum(1.0, hmin=given["hmin"], hmax=given["hmax"])


def _limit_of(mesh: AnyMesh, given: ScaleOptions) -> Limit:
    """Return what clips sizes to two limits, and limits their gradient; collective."""
    g = given["g"]

    def clipped(h: FloatArray) -> FloatArray:
        return minimum(h, hmin=given["hmin"], hmax=given["hmax"])

    def limited(h: FloatArray) -> Limited:
        if g is None:
            return Limited.free(h)
        # Paths are not used: they are not known in parts, whose sizes are those of the whole mesh.
        return Limited(h, limit_gradient(mesh, h, g), None)

    return Limit(clipped, limited)


def _nodal_sizes(mesh: AnyMesh, size: FloatArray) -> FloatArray:
    """Return nodal sizes with the same number of elements as cell sizes, averaged by density."""
    d = mesh.cell_dim
    volume = mesh.shared.merge(nodal_measures(mesh), np.add)
    with np.errstate(divide="ignore", invalid="ignore"):
        number = np.where(mesh.measures > 0.0, mesh.measures * size**-d, 0.0) / (d + 1)
        counts = np.bincount(mesh.cells.ravel(), np.repeat(number, d + 1), mesh.n_points)
        nodal = mesh.shared.merge(counts.astype(np.float64), np.add)
        return np.asarray(np.where(nodal > 0.0, volume / nodal, np.inf) ** (1.0 / d))
