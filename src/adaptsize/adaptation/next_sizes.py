"""Sizes of the next mesh of an adaptive loop, and whether the present mesh has them already."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_number, describe, refuse_where
from adaptsize._size_function import SizeFunction
from adaptsize.adaptation.report import BUDGET_TOLERANCE
from adaptsize.background import SimplexMesh
from adaptsize.limiting import limit_gradient
from adaptsize.sizes import minimum, predicted_elements, size_from_error
from adaptsize.sizes.budget import scale_to
from adaptsize.typing import FloatArray, GradientLimit

#: What ``adapt`` takes as ``h0``.
BoundLike: TypeAlias = SizeFunction | Callable[[FloatArray], npt.ArrayLike] | npt.ArrayLike

#: Sizes are for this share of the tolerance: meshes miss their sizes by a few per cent.
_AIM = 0.95
#: An edge is good while neither halving nor doubling it would bring it nearer to its size.
_BAND = 0.5 * math.log(2.0)
#: No mesh that has an edge this many times too long is good enough.
_MUCH_TOO_LONG = 3.0
#: More elements than this times the present number are worth something if the error is too large.
_MORE = 1.02
#: Prediction and number asked for this close: the number is in reach of the limits.
_REACHED = 0.05


@dataclass(frozen=True)
class Wishes:
    """Arguments of ``adapt`` that say what is wanted, checked."""

    indicator: FloatArray | None
    h0: FloatArray | None
    order: float
    target_elements: float | None
    tolerance: float | None
    g: GradientLimit | None
    hmin: float | None
    hmax: float | None
    max_refine: float
    max_coarsen: float

    @property
    def error(self) -> float | None:
        """Estimated error on the present mesh."""
        return None if self.indicator is None else float(np.linalg.norm(self.indicator))


class NextSizes(NamedTuple):
    """Sizes of the next mesh."""

    h: FloatArray
    """float64[n_points]"""
    predicted: float
    """Elements to be expected of the generator."""
    in_reach: bool
    """Whether these are the number asked for (if one was), the limits allowing it."""
    capped: bool
    """Whether the tolerance would need more elements than asked for."""


class Verdict(NamedTuple):
    """Whether a new mesh is worth its while."""

    remesh: bool
    converged: bool
    reason: str
    in_band: float
    too_long: float
    too_short: float


def as_indicator(value: npt.ArrayLike | None, mesh: SimplexMesh) -> FloatArray | None:
    """Return checked indicators."""
    if value is None:
        return None
    eta = as_float_array("indicator", value, (mesh.n_cells,))
    refuse_where("indicator", ~(eta >= 0.0) | np.isinf(eta), eta, "must be finite and >= 0")
    return eta


def as_bound(h0: BoundLike | None, mesh: SimplexMesh) -> FloatArray | None:
    """Return upper bounds at the nodes of the mesh."""
    if h0 is None:
        return None
    if callable(h0):
        values = as_float_array("h0(points)", h0(mesh.points), mesh.nodal_shape)
    elif np.ndim(h0) == 0:
        values = np.full(mesh.nodal_shape, as_number("h0", h0, lower=0.0, strict=True))
    else:
        values = as_float_array("h0", h0, mesh.nodal_shape)
    refuse_where("h0", ~(values > 0.0), values, "must be positive (inf where nothing is asked)")
    return values


def check_goal(wishes: Wishes) -> None:
    """Raise a ValueError if the wishes do not say what is wanted."""
    if wishes.indicator is None and wishes.h0 is None:
        raise ValueError("indicator or h0 must be given, got neither")
    if wishes.indicator is None and wishes.tolerance is not None:
        raise ValueError("tolerance needs an indicator, got None")
    if wishes.indicator is not None and wishes.tolerance is None and wishes.target_elements is None:
        raise ValueError("an indicator needs tolerance or target_elements, got neither")
    if wishes.tolerance is not None:
        as_number("tolerance", wishes.tolerance, lower=0.0, strict=True)
    if wishes.target_elements is not None:
        as_number("target_elements", wishes.target_elements, lower=1.0)
    minimum(1.0, hmin=wishes.hmin, hmax=wishes.hmax)
    if isinstance(wishes.g, str) or (
        isinstance(wishes.g, int | float) and not 0.0 <= wishes.g < math.inf
    ):
        raise ValueError(f"g must be finite and >= 0, or None, got {describe(wishes.g)}")


def next_sizes(mesh: SimplexMesh, wishes: Wishes, factor: float) -> NextSizes:
    """Return the sizes for a goal, if a generator makes ``factor`` cells per cell predicted.

    Raises
    ------
    ValueError
        If the sizes are not finite where there are cells, or an option is out of range.
    """

    def finished(h: FloatArray) -> FloatArray:
        bounds = [h] if wishes.h0 is None or wishes.indicator is None else [h, wishes.h0]
        held = minimum(*bounds, hmin=wishes.hmin, hmax=wishes.hmax)
        if wishes.g is None:
            return held
        return limit_gradient(mesh, held, wishes.g)

    def from_error(tolerance: float | None, target: float | None) -> FloatArray:
        assert wishes.indicator is not None
        return size_from_error(
            mesh, wishes.indicator, order=wishes.order, max_refine=wishes.max_refine,
            max_coarsen=wishes.max_coarsen, hmin=wishes.hmin, hmax=wishes.hmax, limit=finished,
            tolerance=tolerance, target_elements=target,
        )  # fmt: skip

    target, capped = wishes.target_elements, False
    h: FloatArray | None = None
    if wishes.tolerance is not None:
        h = from_error(_AIM * wishes.tolerance, None)
        capped = target is not None and factor * predicted_elements(mesh, h) > target
    if target is not None and (h is None or capped):
        goal = max(target / factor, 1.0)
        if wishes.indicator is not None:
            h = from_error(None, goal)
        else:
            h = _scaled(mesh, wishes, finished, goal)
    elif h is None:
        assert wishes.h0 is not None
        h = finished(wishes.h0)
    _refuse_free(mesh, h)
    predicted = factor * predicted_elements(mesh, h)
    in_reach = target is not None and abs(predicted / target - 1.0) <= _REACHED
    return NextSizes(h, predicted, in_reach, capped)


def _scaled(
    mesh: SimplexMesh, wishes: Wishes, finished: Callable[[FloatArray], FloatArray], goal: float
) -> FloatArray:
    """Return the bounds h0 times a number that gives so many elements."""
    assert wishes.h0 is not None
    bound = wishes.h0
    start = predicted_elements(mesh, finished(bound))
    scale = scale_to(
        goal,
        lambda s: predicted_elements(mesh, finished(s * bound)),
        (start / goal) ** (1.0 / mesh.cell_dim) if start > 0.0 else 1.0,
    )
    return finished(scale * bound)


def _refuse_free(mesh: SimplexMesh, h: FloatArray) -> None:
    used = np.zeros(mesh.n_points, np.bool_)
    used[mesh.cells] = True
    refuse_where(
        "sizes", used & np.isinf(h), h,
        "must be finite after limiting, in each component of the mesh: give hmax",
    )  # fmt: skip


def verdict(
    mesh: SimplexMesh, found: NextSizes, wishes: Wishes, enough: float, coarsen_converged: bool
) -> Verdict:
    """Return whether the mesh should be made anew."""
    shares = _shares(mesh, found.h)
    error, tolerance = wishes.error, wishes.tolerance
    within = tolerance is not None and error is not None and error <= tolerance
    if within and not coarsen_converged:
        reason = f"estimated error {error:.3g} is within the tolerance {tolerance:.3g}"
        return Verdict(False, True, reason, *shares)
    ratio = found.predicted / mesh.n_cells
    same = shares[0] >= enough and abs(ratio - 1.0) <= BUDGET_TOLERANCE
    # A place that is much too coarse matters, however few cells it takes.
    same = same and _pieces(mesh, found.h).max() <= _MUCH_TOO_LONG
    finer = tolerance is not None and not within and ratio > _MORE
    if not same or finer:
        reason = (
            f"remeshed: {shares[1]:.0%} of the next mesh is too coarse in the old one, "
            f"{shares[2]:.0%} too fine"
        )
        return Verdict(True, False, reason, *shares)
    reason = f"not worth remeshing: {shares[0]:.0%} of the next mesh is there already"
    if tolerance is not None and not within:
        reason += (
            f"; the limits allow no better than the estimated error {error:.3g}, "
            f"above the tolerance {tolerance:.3g}"
        )
        return Verdict(False, False, reason, *shares)
    target = None if tolerance is not None else wishes.target_elements
    met = target is None or abs(mesh.n_cells / target - 1.0) <= BUDGET_TOLERANCE
    if not met:
        reason += f"; the limits do not allow {target:.0f} elements"
    return Verdict(False, met, reason, *shares)


def _pieces(mesh: SimplexMesh, h: FloatArray) -> FloatArray:
    """Return into how many pieces of the wanted size each edge should be cut, h linear in it."""
    i, j = mesh.edges.T
    mean = 0.5 * (h[i] + h[j])
    half = np.abs(h[i] - h[j]) / (2.0 * mean)  # below 1
    # The mean of 1/h over the mean's inverse is artanh(x) / x.
    near = half < 1e-4
    growth = np.where(near, 1.0, np.arctanh(half) / np.where(near, 1.0, half))
    return np.asarray(mesh.edge_lengths / mean * growth)


def _shares(mesh: SimplexMesh, h: FloatArray) -> tuple[float, float, float]:
    """Return the shares of the next mesh that are there, too long and too short.

    An edge that is to be cut into r counts as the r^d that come in its place: a few cells that
    are much too long at a singular point are most of the next mesh.
    """
    ratio = _pieces(mesh, h)
    weight = np.maximum(ratio, 1.0) ** mesh.cell_dim
    with np.errstate(divide="ignore"):
        off = np.log(ratio)
    total = weight.sum()
    too_long = float(weight[off > _BAND].sum() / total)
    too_short = float(weight[off < -_BAND].sum() / total)
    return 1.0 - too_long - too_short, too_long, too_short
