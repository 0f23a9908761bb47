"""Sizes of the next mesh of an adaptive loop, and the decision whether to remesh."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import (
    FARTHEST,
    NEAREST,
    as_float_array,
    as_limits,
    as_number,
    as_plain_array,
    describe,
    refuse_where,
)
from adaptsize._defaults import GRADIENT_LIMIT
from adaptsize._size_function import SizeFunction
from adaptsize.adaptation.need import Requested, present_of
from adaptsize.adaptation.report import BUDGET_TOLERANCE
from adaptsize.background import AnyMesh, PartitionedMesh
from adaptsize.limiting import limit_gradient
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.options import AdaptOptions, ErrorOptions
from adaptsize.sizes.budget import count_elements, scale_to
from adaptsize.sizes.combine import minimum
from adaptsize.sizes.curvature import radius_at_curves, size_of_chords
from adaptsize.sizes.error import scaled_by_error
from adaptsize.typing import FloatArray, GradientLimit

#: The limits allow a requested number if the prediction is this close to it.
REACHED = 0.05

#: Accepted relative error of a predicted number: generators miss it by per cents.
_ACCURACY = 3e-3

#: Types that ``adapt`` accepts as ``h0``.
BoundLike: TypeAlias = SizeFunction | Callable[[FloatArray], npt.ArrayLike] | npt.ArrayLike


@dataclass(frozen=True, kw_only=True)
class Request:
    """A checked request for the next mesh: of sizes, or of a metric."""

    options: AdaptOptions
    """Complete.  With ``nodes``, ``elements`` is the number expected with it."""
    error: float | None = None
    """Estimated error on the present mesh; None if it is not known."""

    @property
    def tolerance(self) -> float | None:
        """Target for this error."""
        return None

    def next(self, mesh: Any, factor: float) -> NextSizes:
        """Return the sizes for a generator that makes ``factor`` cells per predicted cell."""
        raise NotImplementedError

    def within(self, mesh: Any, tolerance: float) -> Request:
        """Return the request with a bound that leaves curved boundaries within a tolerance."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class SizeRequest(Request):
    """A request of sizes that do not depend on the direction."""

    indicator: FloatArray | None
    h0: FloatArray | None
    chords: FloatArray | None = None
    """Largest sizes that leave curved boundaries within the tolerance of the generator."""

    @property
    def tolerance(self) -> float | None:
        """Target for this error."""
        return self.options["tolerance"]

    @property
    def g(self) -> GradientLimit | None:
        """Gradient limit."""
        g = self.options["g"]
        return GRADIENT_LIMIT if isinstance(g, str) else g

    def next(self, mesh: AnyMesh, factor: float) -> NextSizes:
        """Return the sizes for a generator that makes ``factor`` cells per predicted cell."""
        return next_sizes(mesh, self, factor)

    def within(self, mesh: AnyMesh, tolerance: float) -> SizeRequest:
        """Return the request with the error, and a bound that leaves curves within a tolerance."""
        error = None
        if self.indicator is not None:
            squares = mesh.ranks.allreduce(float(self.indicator @ self.indicator), "sum")
            error = math.sqrt(squares)
        return replace(self, error=error, chords=bound_by_tolerance(mesh, tolerance))


class NextSizes(NamedTuple):
    """Sizes of the next mesh."""

    h: FloatArray
    """float64[n_points]"""
    predicted: float
    """Predicted number of elements for the generator."""
    in_reach: bool
    """Whether the limits allow the requested number of elements, if there is one."""
    capped: bool
    """Whether the tolerance would need more elements than requested."""
    simplices: float
    """Number of regular simplices of these sizes that fill the mesh."""
    metric: Metric | None = None
    """The metric, if the sizes depend on the direction; ``h`` are then its smallest sizes."""

    def requested(self, mesh: AnyMesh) -> SizeFunction | MetricFunction | FloatArray:
        """Return the sizes as a function of points, or at the nodes of a mesh in parts.

        The latter are finite, also at nodes in no cell, which may have no size.
        """
        if isinstance(mesh, PartitionedMesh):
            return np.where(np.isinf(self.h), 1.0, self.h)
        if self.metric is not None:
            return MetricFunction(mesh, self.metric)
        return SizeFunction(mesh, self.h)

    @property
    def at_nodes(self) -> Requested:
        """Return the metric, or the sizes that do not depend on the direction."""
        return self.h if self.metric is None else self.metric


class Decision(NamedTuple):
    """Whether to remesh."""

    remesh: bool
    converged: bool
    reason: str
    in_band: float
    too_long: float
    too_short: float


def as_bound(h0: BoundLike | None, mesh: AnyMesh) -> FloatArray | None:
    """Return upper bounds at the nodes of the mesh."""
    if h0 is None:
        return None
    if callable(h0):
        given = h0(mesh.points) if mesh.n_points else np.empty(0)
        values = as_float_array("h0(points)", given, mesh.nodal_shape)
    elif as_plain_array("h0", h0).ndim == 0:
        values = np.full(mesh.nodal_shape, as_number("h0", h0, lower=0.0, strict=True))
    else:
        values = as_float_array("h0", h0, mesh.nodal_shape)
    refuse_where("h0", ~(values > 0.0), values, "must be positive (inf where there is no bound)")
    far = np.isfinite(values) & ((values < NEAREST) | (values > FARTHEST))
    refuse_where("h0", far, values, f"must be from {NEAREST:g} to {FARTHEST:g}, or inf")
    return values


def bound_by_tolerance(mesh: AnyMesh, tolerance: float) -> FloatArray | None:
    """Return the largest sizes that leave curved boundaries within a share of the diagonal.

    In space, generators refine to stay within it.  In the plane they keep the nodes of polygons.
    """
    if mesh.dim < 3:
        return None
    radius = radius_at_curves(mesh)
    return size_of_chords(radius, tolerance * mesh.diagonal)


def refuse_two_numbers(options: AdaptOptions) -> None:
    """Raise a ValueError if a number of elements is given besides one of nodes."""
    if options["elements"] is not None and options["nodes"] is not None:
        raise ValueError("elements and nodes exclude each other: omit one")


def check_goal(request: SizeRequest) -> None:
    """Raise a ValueError if the request is incomplete or contradictory."""
    options, tolerance = request.options, request.tolerance
    if request.indicator is None and request.h0 is None:
        raise ValueError("indicator or h0 must be given, got neither")
    if request.indicator is None and tolerance is not None:
        raise ValueError("tolerance needs an indicator, got None")
    goals = (tolerance, options["elements"], options["nodes"])
    if request.indicator is not None and goals == (None, None, None):
        raise ValueError("an indicator needs tolerance or elements, got neither")
    as_limits(options["hmin"], options["hmax"], allow_inf=True)
    g = request.g
    if isinstance(g, int | float) and not 0.0 <= g < math.inf:
        raise ValueError(f"g must be finite and >= 0, or None, got {describe(g)}")


def next_sizes(mesh: AnyMesh, request: SizeRequest, factor: float) -> NextSizes:
    """Return the requested sizes for a generator that makes ``factor`` cells per predicted cell.

    Raises
    ------
    ValueError
        If the sizes are not finite where there are cells, or an option is out of range.
    """
    options = request.options

    def finished(h: FloatArray) -> FloatArray:
        further = [None if request.indicator is None else request.h0, request.chords]
        bounds = [bound for bound in further if bound is not None]
        held = minimum(h, *bounds, hmin=options["hmin"], hmax=options["hmax"])
        return held if request.g is None else limit_gradient(mesh, held, request.g)

    def count(h: FloatArray) -> float:
        return count_elements(mesh, h)

    def from_error(tolerance: float | None, target: float | None) -> FloatArray:
        assert request.indicator is not None
        given: ErrorOptions = {
            "tolerance": tolerance, "elements": target, "max_refine": options["max_refine"],
            "max_coarsen": options["max_coarsen"], "backend": None,
        }  # fmt: skip
        return scaled_by_error(
            mesh, request.indicator, options["order"], given, finished, _ACCURACY
        )

    def from_bound(goal: float) -> FloatArray:
        bound = request.h0
        assert bound is not None
        start = count(finished(bound))
        first = (start / goal) ** (1.0 / mesh.cell_dim) if start > 0.0 else 1.0
        return scale_to(goal, lambda s: finished(s * bound), count, first, mesh.cell_dim, _ACCURACY)

    target, capped = options["elements"], False
    h: FloatArray | None = None
    if request.tolerance is not None:
        # Meshes miss sizes by a few per cent.
        h = from_error(0.95 * request.tolerance, None)
        capped = target is not None and factor * count(h) > target
    if target is not None and (h is None or capped):
        goal = max(target / factor, 1.0)
        h = from_bound(goal) if request.indicator is None else from_error(None, goal)
    elif h is None:
        assert request.h0 is not None
        h = finished(request.h0)
    sizes = h
    mesh.ranks.agree(lambda: _refuse_free(mesh, sizes))
    simplices = count(sizes)
    predicted = factor * simplices
    in_reach = target is not None and abs(predicted / target - 1.0) <= REACHED
    return NextSizes(sizes, predicted, in_reach, capped, simplices)


def _refuse_free(mesh: AnyMesh, h: FloatArray) -> None:
    used = np.zeros(mesh.n_points, np.bool_)
    used[mesh.cells] = True
    refuse_where(
        "sizes", used & np.isinf(h), h,
        "must be finite after limiting, in each component of the mesh: pass hmax",
    )  # fmt: skip


def decide(mesh: AnyMesh, found: NextSizes, request: Request) -> Decision:
    """Return whether to remesh, and why; collective."""
    present = present_of(mesh, found.at_nodes)
    shares = present.shares
    error, tolerance = request.error, request.tolerance
    within = tolerance is not None and error is not None and error <= tolerance
    if within and not request.options["coarsen_converged"]:
        reason = f"estimated error {error:.3g} is within the tolerance {tolerance:.3g}"
        return Decision(False, True, reason, *shares)
    ratio = found.predicted / present.n_cells
    same = present.has_sizes(found.predicted, request.options["enough"])
    finer = tolerance is not None and not within and ratio > 1.02
    if not same or finer:
        return Decision(True, False, f"remeshed: {present.reason}", *shares)
    reason = f"not remeshed: the old mesh already has {shares[0]:.0%} of the next mesh"
    if tolerance is not None and not within:
        reason += (
            f"; the limits allow no better than the estimated error {error:.3g}, "
            f"above the tolerance {tolerance:.3g}"
        )
        return Decision(False, False, reason, *shares)
    target = None if tolerance is not None else request.options["elements"]
    met = target is None or abs(present.n_cells / target - 1.0) <= BUDGET_TOLERANCE
    if not met:
        goal = f"{target:.0f} elements"
        nodes = request.options["nodes"]
        if nodes is not None:
            goal = f"{nodes:.0f} nodes"
        reason += (
            f"; the limits do not allow {goal} (see hmin, hmax, g, max_refine, max_coarsen and "
            "boundary_tolerance)"
        )
    return Decision(False, met, reason, *shares)
