"""What a size function is requested for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_limits, as_sizes
from adaptsize._defaults import GRADIENT_LIMIT, MAX_ELEMENTS, TOLERANCE
from adaptsize._messages import Message
from adaptsize._progress import silent
from adaptsize.background import AnyBackground, CartesianGrid
from adaptsize.domain_size import tuning
from adaptsize.domain_size.named_parts import as_sizes_of_parts
from adaptsize.domain_size.unknowns import as_bytes
from adaptsize.errors import OptionError
from adaptsize.options import BudgetOptions, SizeFunctionOptions
from adaptsize.sizes import PointSource, size_from_sources
from adaptsize.sizes.curvature import CHORDS, LONGEST_CHORDS, size_of_chords
from adaptsize.sizes.sources import KNOWN, as_sources
from adaptsize.typing import FloatArray, ProgressCallback

#: What a mesh may have a requested number of; "dofs" are the unknowns of finite elements.
Goal: TypeAlias = Literal["elements", "nodes", "dofs"]
Implicit: TypeAlias = Callable[[FloatArray], npt.ArrayLike]
#: Bounds at points between the nodes: the name of their cause, float64[k, dim] and float64[k].
PointBounds: TypeAlias = Sequence[tuple[str, FloatArray, FloatArray]]


@dataclass(frozen=True)
class Request:
    """Checked options of `size_function`; those that are None are chosen from the domain."""

    options: SizeFunctionOptions
    sources: Sequence[Any] = ()
    h0: npt.ArrayLike | Implicit | None = None
    report: ProgressCallback = silent
    relaxation: float = 1.0
    """Factor by which parameters that are not given are relaxed, for ``max_elements``; below 1
    they are tightened, for ``elements``, ``nodes`` or ``dofs``.  Above `tuning.FULLY`, only the
    elements between features change."""
    is_capped: bool = False
    """Whether a largest number or memory is given, not only the default."""

    @classmethod
    def of(
        cls,
        options: SizeFunctionOptions,
        sources: Any = (),
        h0: npt.ArrayLike | Implicit | None = None,
        report: ProgressCallback = silent,
    ) -> Request:
        """Return the request after the checks that concern several options."""
        as_limits(options["hmin"], options["hmax"])
        is_capped = any(options[name] is not None for name in ("max_elements", "max_memory"))
        options = {**options, "max_elements": largest_number(options)}
        if options["size_of"] is not None:
            options["size_of"] = as_sizes_of_parts(options["size_of"])
        known = [] if sources is None else as_sources(sources)
        request = cls(options, known, h0, report, is_capped=is_capped)
        goal = request.goal
        if request.is_fixed and goal is not None:
            name = Message.name(goal[0])
            text = (
                "{} changes the parameters that are not given, but {elements_per_radian}, "
                "{elements_across}, {hmin} and {hmax} are all given: omit one of them, or {}"
            )
            raise OptionError(Message(text, name, name))
        return request

    def with_options(self, **options: float) -> Request:
        """Return the request with other values of some options."""
        return replace(self, options=cast(SizeFunctionOptions, {**self.options, **options}))

    @property
    def g(self) -> float:
        """Gradient limit; fully relaxed, it is twice the default."""
        given = self.options["g"]
        if given is not None:
            return given
        steeper = np.clip(np.sqrt(0.25 * self._usual), 1.0, tuning.GRADIENT_OVER_DEFAULT)
        return GRADIENT_LIMIT * float(steeper)

    @property
    def _usual(self) -> float:
        """The relaxation of all but the elements between features."""
        return min(self.relaxation, tuning.FULLY)

    @property
    def crease_angle(self) -> float:
        """Angle of feature edges in degrees."""
        return self.options["crease_angle"]

    @property
    def goal(self) -> tuple[Goal, float] | None:
        """Which number is requested: of elements, nodes or unknowns; and how large."""
        return goal_of(self.options)

    @property
    def system(self) -> tuple[int, int]:
        """Degree and number of components of finite elements."""
        return self.options["degree"], self.options["components"]

    @property
    def max_elements(self) -> float:
        """Limit on the number of elements; ``elements`` if that is given."""
        most = self.options["max_elements"]
        assert most is not None
        return most

    @property
    def is_fixed(self) -> bool:
        """Whether all parameters that could be relaxed for any domain are given."""
        given = self.options
        return None not in (
            given["elements_per_radian"], given["elements_across"], given["hmin"], given["hmax"]
        )  # fmt: skip

    @property
    def per_radian(self) -> float:
        """Elements per radian of curved boundaries."""
        given = self.options["elements_per_radian"]
        if given is not None:
            return given
        return max(tuning.PER_RADIAN / self._usual, tuning.LEAST_PER_RADIAN)

    @property
    def per_radian_of_chords(self) -> float:
        """The same where chords are kept within a tolerance: fully relaxed, these are enough."""
        if self.options["elements_per_radian"] is not None or self.tolerance == np.inf:
            return self.per_radian
        return tuning.PER_RADIAN / self._usual

    @property
    def across(self) -> float:
        """Elements across narrow regions.

        It is 1 where the other parameters are relaxed, and then falls to a quarter: cells four
        times as long as a plate is thick have angles of about 15 degrees.
        """
        given = self.options["elements_across"]
        if given is not None:
            return given
        later = max(2.0 * tuning.ACROSS / self._usual, tuning.LEAST_ACROSS)
        return max(tuning.ACROSS / self._usual, min(1.0, later))

    def between(self, is_rough: bool) -> float:
        """Return the elements between features that are close; by default none if it is rough."""
        given = self.options["elements_between"]
        if given is not None:
            return given
        if is_rough:
            return 0.0
        # Relaxed, features may be closer than the size by up to a factor of 4; by more only if
        # everything else is relaxed, since cells between them then have small angles.
        beyond = self.relaxation / self._usual
        return max(tuning.BETWEEN / self._usual, tuning.LEAST_ACROSS) / beyond

    @property
    def tolerance(self) -> float:
        """Distance of chords from curved boundaries, over the diameter; inf if not limited.

        It is never relaxed.
        """
        given = self.options["tolerance"]
        return TOLERANCE if given is None else given

    @property
    def bounds_curvature(self) -> bool:
        """Whether sizes at curved boundaries are bounded, if these carry the sizes."""
        return self.per_radian > 0.0 or self.tolerance < np.inf

    def on_curves(self, radius: FloatArray, diameter: float) -> FloatArray:
        """Return sizes that resolve curves of given radii and leave a mesh within the tolerance."""
        chords = size_of_chords(radius, self.tolerance * diameter, chords_of(self.relaxation))
        k = self.per_radian_of_chords
        return np.minimum(radius / k, chords) if k else chords

    def on_features(self, separation: FloatArray, diameter: float, is_rough: bool) -> FloatArray:
        """Return sizes between features; those closer than the tolerance may be joined."""
        finite = np.isfinite(self.tolerance)
        least = (self.tolerance if finite else TOLERANCE) * diameter
        return np.maximum(separation, least) / self.between(is_rough)

    def across_walls(self, width: FloatArray, diameter: float) -> FloatArray:
        """Return the widths that count: walls thinner than the tolerance may be lost within it."""
        is_given = self.options["elements_across"] is not None
        if is_given or self.relaxation <= 1.0 or self.tolerance == np.inf:
            return width
        return np.maximum(width, self.tolerance * diameter)

    def limits(
        self, diameter: float, least: float = 0.0, *, of_chords: bool = False
    ) -> tuple[float, float]:
        """Return hmin and hmax; by default in proportion to the diameter of the domain.

        Where chords are kept within the tolerance, the default hmin is at most the smallest size
        that they may require, so that it overrides none of them.
        """
        high, low = self.options["hmax"], self.options["hmin"]
        if high is None:
            high = max(self._usual * tuning.HMAX_SHARE * diameter, low or 0.0, least)
        if low is None:
            low = self._usual * tuning.HMIN_SHARE * diameter
            if of_chords:
                low = min(low, np.sqrt(CHORDS) * self.tolerance * diameter)
            low = min(max(low, least), high)
            sizes = [source.size for source in self.sources if isinstance(source, KNOWN)]
            sizes += (self.options["size_of"] or {}).values()
            low = min([low, *(np.min(size, initial=low) for size in sizes)])  # none is raised
        return float(low), float(high)

    def not_raised(self, limits: tuple[float, float], sizes: FloatArray) -> tuple[float, float]:
        """Return hmin and hmax, the former lowered to the nodal sizes of functions if not given."""
        low, high = limits
        if self.options["hmin"] is None:
            low = min(low, float(sizes.min(initial=np.inf)))
        return low, high

    def points(self, dim: int) -> list[tuple[str, FloatArray, FloatArray]]:
        """Return the positions and sizes of the point sources."""
        given = [source for source in self.sources if isinstance(source, PointSource)]
        return [("sources", *source.rows(dim)) for source in given]

    def external(
        self, background: AnyBackground, h0: FloatArray | None = None
    ) -> dict[str, FloatArray]:
        """Return the bounds that do not depend on the shape; ``h0``, if known on the background."""
        bounds = self.from_sources(background)
        if h0 is not None:
            bounds["h0"] = h0
        elif self.h0 is not None:
            bounds["h0"] = bound_at_nodes(self.h0, background)
        return bounds

    def from_sources(
        self, background: AnyBackground, sources: Sequence[Any] | None = None
    ) -> dict[str, FloatArray]:
        """Return the bounds from the sources, or from some of them."""
        sources = self.sources if sources is None else sources
        if len(sources) == 0:
            return {}
        return {"sources": size_from_sources(background, sources, g=self.g)}


def chords_of(relaxation: float) -> float:
    """Return the squared size over the radius and the tolerance of relaxed parameters."""
    return min(CHORDS * max(relaxation, 1.0), LONGEST_CHORDS)


def goal_of(options: BudgetOptions) -> tuple[Goal, float] | None:
    """Return which number is requested, and how large; refuse several of them."""
    names: tuple[Goal, ...] = ("elements", "nodes", "dofs")
    given = [(name, value) for name in names if (value := options[name]) is not None]
    if len(given) > 1:
        raise _exclusive(given[1][0], given[0][0])
    return given[0] if given else None


def _exclusive(one: str, other: str) -> OptionError:
    text = "{} and {} exclude each other: omit one of them"
    return OptionError(Message(text, Message.name(one), Message.name(other)))


def largest_number(options: BudgetOptions) -> float:
    """Return the limit on the number of elements; refuse numbers that contradict each other."""
    elements, most = options["elements"], options["max_elements"]
    goal, memory = goal_of(options), options["max_memory"]
    if memory is not None:
        as_bytes(memory)
    if goal is not None:
        if most is not None or memory is not None:
            raise _exclusive(goal[0], "max_memory" if most is None else "max_elements")
        return np.inf if elements is None else elements
    if most is not None:
        return most
    return MAX_ELEMENTS if memory is None else np.inf


def bound_at_nodes(h0: npt.ArrayLike | Implicit, background: AnyBackground) -> FloatArray:
    """Return upper bounds at the nodes of a background, from an array or a function of points."""
    if not callable(h0):
        return as_sizes("h0", h0, background.nodal_shape)
    if isinstance(background, CartesianGrid):
        return as_sizes("h0", background.sample(h0), background.shape)
    return as_sizes("h0", h0(background.points), background.nodal_shape)
