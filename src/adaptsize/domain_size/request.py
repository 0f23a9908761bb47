"""What a size function is requested for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._causes import H0, Cause
from adaptsize._checks import as_limits
from adaptsize._messages import Message
from adaptsize._progress import silent
from adaptsize.background import AnyBackground
from adaptsize.domain_size import tuning
from adaptsize.domain_size.goals import Goal, goal_of, largest_number
from adaptsize.domain_size.named_parts import as_sizes_of_parts
from adaptsize.domain_size.parameters import Parameters
from adaptsize.domain_size.prescribed import (
    BoundsByCause,
    Implicit,
    bound_at_nodes,
    bounds_at_points,
    bounds_by_sources,
    least_size,
)
from adaptsize.errors import OptionError
from adaptsize.options import SizeFunctionOptions
from adaptsize.sizes.curvature import CHORDS
from adaptsize.sizes.sources import SourcesLike, as_sources
from adaptsize.typing import FloatArray, ProgressCallback


@dataclass(frozen=True, kw_only=True)
class Request(Parameters):
    """Checked options of `size_function`, prescribed sizes, and the number that is allowed."""

    max_elements: float
    """Limit on the number of elements; ``elements`` if that is given."""
    sources: Sequence[Any] = ()
    h0: npt.ArrayLike | Implicit | None = None
    progress: ProgressCallback = silent
    is_capped: bool = False
    """Whether a largest number or memory is given, not only the default."""

    @classmethod
    def of(
        cls,
        options: SizeFunctionOptions,
        sources: SourcesLike | None = (),
        h0: npt.ArrayLike | Implicit | None = None,
        progress: ProgressCallback = silent,
    ) -> Request:
        """Return the request after the checks that concern several options."""
        as_limits(options["hmin"], options["hmax"])
        is_capped = any(options[name] is not None for name in ("max_elements", "max_memory"))
        if options["size_of"] is not None:
            options = {**options, "size_of": as_sizes_of_parts(options["size_of"])}
        known = [] if sources is None else as_sources(sources)
        request = cls(
            options=options, max_elements=largest_number(options), is_capped=is_capped,
            sources=known, h0=h0, progress=progress,
        )  # fmt: skip
        goal = request.goal
        if request.is_fixed and goal is not None:
            name = Message.name(goal[0])
            text = (
                "{} changes the parameters that are not given, but {elements_per_radian}, "
                "{elements_across}, {hmin} and {hmax} are all given: omit one of them, or {}"
            )
            raise OptionError(Message(text, name, name))
        return request

    def with_tolerance(self, tolerance: float) -> Request:
        """Return the request with another tolerance."""
        return replace(self, options={**self.options, "tolerance": tolerance})

    @property
    def goal(self) -> tuple[Goal, float] | None:
        """Which number is requested: of elements, nodes or unknowns; and how large."""
        return goal_of(self.options)

    @property
    def system(self) -> tuple[int, int]:
        """Degree and number of components of finite elements."""
        return self.options["degree"], self.options["components"]

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
            # None is raised.
            low = min(low, least_size(self.sources, self.options["size_of"]))
        return float(low), float(high)

    def not_raised(self, limits: tuple[float, float], sizes: FloatArray) -> tuple[float, float]:
        """Return hmin and hmax, the former lowered to the nodal sizes of functions if not given."""
        low, high = limits
        if self.options["hmin"] is None:
            low = min(low, float(sizes.min(initial=np.inf)))
        return low, high

    def points(self, dim: int) -> BoundsByCause:
        """Return the positions and sizes of the point sources."""
        return bounds_at_points(self.sources, dim)

    def from_sources(
        self, background: AnyBackground, sources: Sequence[Any] | None = None
    ) -> dict[Cause, FloatArray]:
        """Return the bounds from the sources, or from some of them."""
        return bounds_by_sources(background, self.sources if sources is None else sources, self.g)

    def external(
        self, background: AnyBackground, h0: FloatArray | None = None
    ) -> dict[Cause, FloatArray]:
        """Return the bounds that do not depend on the shape; ``h0``, if known on the background."""
        bounds = self.from_sources(background)
        if h0 is not None:
            bounds[H0] = h0
        elif self.h0 is not None:
            bounds[H0] = bound_at_nodes(self.h0, background)
        return bounds
