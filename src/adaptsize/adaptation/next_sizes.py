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
    as_limits,
    as_sizes_at,
    refusal,
    refuse_where,
)
from adaptsize._defaults import GRADIENT_LIMIT
from adaptsize._messages import Message
from adaptsize._size_function import SizeFunction
from adaptsize.adaptation import tuning
from adaptsize.adaptation.need import Requested, count_simplices, present_of, smallest
from adaptsize.background import AnyMesh, PartitionedMesh, SimplexMesh
from adaptsize.errors import OptionError
from adaptsize.limiting import limit_gradient
from adaptsize.limiting.periodic import Periodicity
from adaptsize.metrics import Metric, MetricFunction
from adaptsize.options import AdaptOptions, ErrorOptions
from adaptsize.quality.by_place import BAND
from adaptsize.sizes.budget import present_sizes
from adaptsize.sizes.combine import minimum
from adaptsize.sizes.curvature import radius_at_curves, size_of_chords
from adaptsize.sizes.error import scaled_by_error
from adaptsize.sizes.limited import Corrected, Limit, Limited, limited, sizes_for_number
from adaptsize.sizes.prediction import predict
from adaptsize.typing import BoolArray, FloatArray, GradientLimit

#: Types that ``adapt`` accepts as ``h0``.
BoundLike: TypeAlias = SizeFunction | Callable[[FloatArray], npt.ArrayLike] | npt.ArrayLike


@dataclass(frozen=True, kw_only=True)
class CycleRequest:
    """A checked request for the next mesh: of sizes, or of a metric."""

    options: AdaptOptions
    """Complete.  With ``nodes``, ``elements`` is the number expected with it."""
    error: float | None = None
    """Estimated error on the present mesh; None if it is not known."""
    cell: Periodicity | None = None
    """How the mesh is repeated, if it is."""

    @property
    def motions(self) -> FloatArray | None:
        """Translations or rotations by which the mesh is repeated, if it is."""
        return None if self.cell is None else self.cell.motions

    @property
    def n_states(self) -> int | None:
        """Number of states of which there are error indicators; None without these."""
        return None

    @property
    def tolerance(self) -> float | None:
        """Target for this error."""
        return None if self.error is None else self.options["tolerance"]

    @property
    def is_missed(self) -> bool:
        """Whether the error on the present mesh is above the tolerance."""
        return self.error is not None and self.tolerance is not None and self.error > self.tolerance

    @property
    def largest_step(self) -> float:
        """Largest factor by which the error is to fall in one cycle."""
        exponent = tuning.REFINED_ON_AVERAGE * self.options["order"]
        return min(tuning.LARGEST_STEP, float(self.options["max_refine"] ** exponent))

    @property
    def approaches(self) -> bool:
        """Whether the tolerance is too far for one cycle."""
        if self.tolerance is None or self.error is None:
            return False
        return self.error > self.largest_step * tuning.BELOW_TOLERANCE * self.tolerance

    def error_left(self, mesh: AnyMesh, sizes: Requested) -> float:
        """Return the share of the error that is left if cells that are too long are divided."""
        return 1.0

    def within(
        self, mesh: Any, tolerance: float, original: SimplexMesh | None = None
    ) -> CycleRequest:
        """Return the request with a bound that leaves curved boundaries within a tolerance.

        ``original`` is the mesh that has these boundaries; by default the present one.
        """
        raise NotImplementedError

    def for_boundary(self) -> CycleRequest:
        """Return the request that only curved boundaries bound, and not ``hmax`` either."""
        raise NotImplementedError

    def at_curves(self, mesh: SimplexMesh) -> BoolArray:
        """Return the nodes at which curved boundaries bound the sizes."""
        raise NotImplementedError

    def simplices(self, mesh: SimplexMesh) -> float:
        """Return the number of regular simplices of the sizes that are requested."""
        return count_simplices(mesh, self.without_number(mesh))

    def without_number(self, mesh: Any) -> Requested:
        """Return the sizes for the tolerance, or those that are requested."""
        raise NotImplementedError

    def of_number(
        self, mesh: Any, number: float, corrected: Callable[[Any, float], float] | None = None
    ) -> Requested:
        """Return the sizes for a number of regular simplices.

        ``corrected`` takes sizes of about this number, and theirs, and returns another one, which
        then counts.
        """
        raise NotImplementedError

    def next(
        self, mesh: AnyMesh, factor: float, made: Callable[[Requested], float] | None = None
    ) -> NextSizes:
        """Return the sizes for a generator that makes ``factor`` cells per predicted cell.

        ``made`` returns the number of cells that it makes of this mesh with sizes, if that is known
        better.

        Raises
        ------
        ValueError
            If the sizes are not finite where there are cells, or an option is out of range.
        """
        target, factors = self.options["elements"], [factor]
        if made is None or target is None:
            return _counted(mesh, self._for_goal(mesh, factor), factor)

        def corrected(sizes: Requested, number: float) -> float:
            factors.append(made(sizes) / number)
            return target / factors[-1]

        sizes = self._for_goal(mesh, factor, corrected)
        return _counted(mesh, sizes, factors[-1])

    def for_number(self, mesh: AnyMesh, number: float, factor: float) -> NextSizes:
        """Return the sizes for a number of regular simplices; see `next`."""
        return _counted(mesh, self.of_number(mesh, max(number, 1.0)), factor)

    def _for_goal(
        self, mesh: AnyMesh, factor: float, corrected: Callable[[Any, float], float] | None = None
    ) -> Requested:
        """Return the sizes for the tolerance, or those for the number if it allows no more."""
        target = self.options["elements"]
        if target is None or self.options["tolerance"] is not None:
            sizes = self.without_number(mesh)
            if target is None or factor * count_simplices(mesh, sizes) <= target:
                return sizes
        return self.of_number(mesh, max(target / factor, 1.0), corrected)


def _counted(mesh: AnyMesh, sizes: Requested, factor: float) -> NextSizes:
    """Return sizes that are finite where there are cells, with the numbers of cells."""

    def refuse_free() -> None:
        h = smallest(sizes)
        text = "must be finite after limiting, in each component of the mesh: pass {hmax}"
        refuse_where("sizes", mesh.in_a_cell & np.isinf(h), h, Message(text))

    mesh.ranks.agree(refuse_free)
    simplices = count_simplices(mesh, sizes)
    return NextSizes(sizes, factor * simplices, simplices)


@dataclass(frozen=True, kw_only=True)
class SizeRequest(CycleRequest):
    """A request of sizes that do not depend on the direction."""

    h0: FloatArray | None
    """Upper bounds at the nodes; None if there are none."""
    chords: FloatArray | None = None
    """Largest sizes that leave curved boundaries within the tolerance of the generator."""

    @property
    def g(self) -> GradientLimit | None:
        """Gradient limit."""
        g = self.options["g"]
        return GRADIENT_LIMIT if isinstance(g, str) else g

    def for_boundary(self) -> BoundRequest:
        """Return the request that only curved boundaries bound, and not ``hmax`` either."""
        options: AdaptOptions = {**self.options, "hmax": None}
        return BoundRequest(options=options, h0=None, chords=self.chords, cell=self.cell)

    def at_curves(self, mesh: SimplexMesh) -> BoolArray:
        """Return the nodes at which curved boundaries bound the sizes."""
        if self.chords is None:
            return np.zeros(mesh.n_points, np.bool_)
        return np.asarray(np.isfinite(self.chords))

    def _limit(self, mesh: AnyMesh) -> Limit:
        """Return what applies bounds and limits."""
        g, cell = self.g, self.cell

        def limit(bound: FloatArray) -> Limited:
            if g is not None:
                return limited(mesh, bound, g, self.motions)
            return Limited.free(bound if cell is None else cell.least(bound))

        return Limit(self._held, limit)

    def _held(self, h: FloatArray) -> FloatArray:
        """Apply bounds."""
        bounds = [bound for bound in (self.h0, self.chords) if bound is not None]
        return minimum(h, *bounds, hmin=self.options["hmin"], hmax=self.options["hmax"])


@dataclass(frozen=True, kw_only=True)
class BoundRequest(SizeRequest):
    """A request of the largest sizes within bounds."""

    def within(
        self, mesh: AnyMesh, tolerance: float, original: SimplexMesh | None = None
    ) -> BoundRequest:
        """Return the request with a bound that leaves curves within a tolerance."""
        return replace(self, chords=bound_by_tolerance(mesh, tolerance, original))

    def simplices(self, mesh: SimplexMesh) -> float:
        """Return the number of regular simplices of the requested sizes, also between the nodes."""
        if self.g is None or mesh.cell_dim < mesh.dim:
            return super().simplices(mesh)
        held = self._held(_free(mesh))
        h, info = limit_gradient.with_info(mesh, held, self.g, periodic=self.motions)
        return predict(mesh, SizeFunction(mesh, h, sources=info.sources)).cells

    def without_number(self, mesh: AnyMesh) -> FloatArray:
        """Return the sizes that are requested."""
        return self._limit(mesh)(_free(mesh))

    def of_number(
        self,
        mesh: AnyMesh,
        number: float,
        corrected: Corrected | None = None,
    ) -> FloatArray:
        """Return the sizes for a number of regular simplices: the bounds are scaled."""
        bound = _free(mesh) if self.h0 is None else self.h0
        limit = replace(self, h0=None)._limit(mesh)
        return sizes_for_number(
            mesh, number, lambda s: s * bound, limit, 1.0, tuning.ACCURACY, corrected=corrected
        )


@dataclass(frozen=True, kw_only=True)
class ErrorRequest(SizeRequest):
    """A request of sizes from errors."""

    indicator: FloatArray
    """float64[states, n_cells]"""

    @property
    def n_states(self) -> int:
        """Number of states of which there are indicators."""
        return len(self.indicator)

    def within(
        self, mesh: AnyMesh, tolerance: float, original: SimplexMesh | None = None
    ) -> ErrorRequest:
        """Return the request with the error, and a bound that leaves curves within a tolerance."""
        chords = bound_by_tolerance(mesh, tolerance, original)
        return replace(self, error=max(self._errors(mesh)), chords=chords)

    def _errors(self, mesh: AnyMesh, left: FloatArray | float = 1.0) -> list[float]:
        """Return the estimated error of each state, with a share left in each cell; collective."""
        squares = mesh.ranks.allreduce(((left * self.indicator) ** 2).sum(axis=1), "sum")
        return [math.sqrt(square) for square in squares.tolist()]

    def error_left(self, mesh: AnyMesh, sizes: Requested) -> float:
        """Return the share of the error that is left if cells that are too long are divided.

        Of several states, the one that gains most counts, among those that miss the tolerance.
        """
        present, tolerance = present_sizes(mesh), self.tolerance
        wanted = np.minimum(smallest(sizes)[mesh.cells].mean(axis=1), present)
        ratio = np.divide(wanted, present, out=np.ones_like(present), where=present > 0.0)
        after = self._errors(mesh, np.where(ratio < BAND[0], ratio, 1.0) ** self.options["order"])
        missed = [
            share / error
            for share, error in zip(after, self._errors(mesh), strict=True)
            if tolerance is not None and error > tolerance
        ]
        return min(missed, default=1.0)

    def without_number(self, mesh: AnyMesh) -> FloatArray:
        """Return the sizes for the tolerance."""
        tolerance = self.options["tolerance"]
        assert tolerance is not None, "without a number, there is a tolerance (`size_request`)"
        goal = tuning.BELOW_TOLERANCE * tolerance
        goals = [max(goal, error / self.largest_step) for error in self._errors(mesh)]
        return self._from_error(mesh, {"tolerance": goal}, goals)

    def of_number(
        self,
        mesh: AnyMesh,
        number: float,
        corrected: Corrected | None = None,
    ) -> FloatArray:
        """Return the sizes for a number of regular simplices."""
        return self._from_error(mesh, {"elements": number}, corrected=corrected)

    def _from_error(
        self,
        mesh: AnyMesh,
        goal: ErrorOptions,
        goals: list[float] | None = None,
        corrected: Corrected | None = None,
    ) -> FloatArray:
        given: ErrorOptions = {
            "tolerance": None, "elements": None, "max_refine": self.options["max_refine"],
            "max_coarsen": self.options["max_coarsen"], "backend": None, **goal,
        }  # fmt: skip
        return scaled_by_error(
            mesh, self.indicator, self.options["order"], given, self._limit(mesh), tuning.ACCURACY,
            goals=goals, corrected=corrected,
        )  # fmt: skip


def _free(mesh: AnyMesh) -> FloatArray:
    """Return sizes that request nothing."""
    return np.full(mesh.n_points, np.inf)


class NextSizes(NamedTuple):
    """Sizes of the next mesh."""

    at_nodes: Requested
    """Sizes at the nodes, or the metric if they depend on the direction."""
    predicted: float
    """Predicted number of elements for the generator."""
    simplices: float
    """Number of regular simplices of these sizes that fill the mesh."""

    def requested(self, mesh: AnyMesh) -> SizeFunction | MetricFunction | FloatArray:
        """Return the sizes as a function of points, or at the nodes of a mesh in parts.

        The latter are finite, also at nodes in no cell, which may have no size.
        """
        if isinstance(mesh, PartitionedMesh):
            h = smallest(self.at_nodes)
            return np.where(np.isinf(h), 1.0, h)
        if isinstance(self.at_nodes, Metric):
            return MetricFunction(mesh, self.at_nodes)
        return SizeFunction(mesh, self.at_nodes)


class Decision(NamedTuple):
    """Whether to remesh."""

    remesh: bool
    converged: bool
    reason: str
    in_band: float
    too_long: float
    too_short: float

    def without_division(self) -> Decision:
        """Return the decision if no cell is to be bisected."""
        reason = (
            f"not remeshed: no cell is more than {tuning.LONGEST_OVER_SIZE:g} times as long as its "
            "size, and bisection does not coarsen"
        )
        return self._replace(remesh=False, converged=False, reason=reason)


def as_bound(h0: BoundLike, mesh: AnyMesh) -> FloatArray:
    """Return upper bounds at the nodes of the mesh."""
    values = as_sizes_at("h0", h0, mesh.points)
    far = np.isfinite(values) & ((values < NEAREST) | (values > FARTHEST))
    refuse_where("h0", far, values, f"must be from {NEAREST:g} to {FARTHEST:g}, or inf")
    return values


def bound_by_tolerance(
    mesh: AnyMesh, tolerance: float, original: SimplexMesh | None = None
) -> FloatArray | None:
    """Return the largest sizes that leave curved boundaries within a share of the diagonal.

    In space, generators refine to stay within it.  In the plane they keep the nodes of polygons.
    ``original`` is the mesh that has these boundaries; by default this one.
    """
    if mesh.dim < 3:
        return None
    allowed = tolerance * mesh.diagonal
    # Nodes of a loop move by up to the tolerance in each cycle.
    radius = radius_at_curves(mesh, original=original, within=2.0 * allowed)
    return size_of_chords(radius, allowed)


def size_request(
    options: AdaptOptions,
    indicator: FloatArray | None,
    h0: FloatArray | None,
    cell: Periodicity | None = None,
) -> SizeRequest:
    """Return a request; raise a ValueError if it is incomplete or contradictory."""
    tolerance = options["tolerance"]
    if indicator is None and h0 is None:
        raise ValueError("indicator or h0 must be given, got neither")
    if indicator is None and tolerance is not None:
        raise refusal("tolerance", "needs an indicator, got None")
    goals = (tolerance, options["elements"], options["nodes"])
    if indicator is not None and goals == (None, None, None):
        raise OptionError(
            Message("an indicator needs {tolerance}, {elements} or {nodes}, got none")
        )
    as_limits(options["hmin"], options["hmax"], allow_inf=True)
    if indicator is None:
        return BoundRequest(options=options, h0=h0, cell=cell)
    return ErrorRequest(options=options, h0=h0, indicator=indicator, cell=cell)


def decide(mesh: AnyMesh, found: NextSizes, request: CycleRequest) -> Decision:
    """Return whether to remesh, and why; collective."""
    present = present_of(mesh, found.at_nodes)
    shares = present.shares
    error, tolerance = request.error, request.tolerance
    within = tolerance is not None and not request.is_missed
    if within and not request.options["coarsen_converged"]:
        reason = f"estimated error {error:.3g} is within the tolerance {tolerance:.3g}"
        return Decision(False, True, reason, *shares)
    ratio = found.predicted / present.n_cells
    same = present.has_sizes(found.predicted, request.options["enough"])
    finer = request.is_missed and (
        ratio > tuning.FINER or request.error_left(mesh, found.at_nodes) < 1.0 / tuning.FINER
    )
    if not same or finer:
        reason = f"remeshed: {present.reason}"
        if request.approaches:
            reason += (
                f"; this cycle approaches the tolerance {tolerance:.3g} by a factor of at "
                f"most {request.largest_step:.3g} in the error {error:.3g}"
            )
        return Decision(True, False, reason, *shares)
    reason = f"not remeshed: the old mesh already has {shares[0]:.0%} of the next mesh"
    if tolerance is not None and not within:
        reason += (
            f"; the limits allow no better than the estimated error {error:.3g}, "
            f"above the tolerance {tolerance:.3g}"
        )
        return Decision(False, False, reason, *shares)
    target = None if tolerance is not None else request.options["elements"]
    met = target is None or abs(present.n_cells / target - 1.0) <= tuning.BUDGET
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
