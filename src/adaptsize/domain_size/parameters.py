"""The parameters of the bounds: as given, or relaxed where they are not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptsize._defaults import GRADIENT_LIMIT, TOLERANCE
from adaptsize.domain_size import tuning
from adaptsize.options import SizeFunctionOptions
from adaptsize.sizes import tuning as of_sizes
from adaptsize.sizes.curvature import CHORDS, size_of_chords
from adaptsize.typing import FloatArray


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What follows from the options; those that are None are chosen."""

    options: SizeFunctionOptions
    relaxation: float = 1.0
    """Factor by which parameters that are not given are relaxed, for ``max_elements``; below 1
    they are tightened, for ``elements``, ``nodes`` or ``dofs``.  Above `tuning.FULLY`, only the
    elements between features change."""

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


def chords_of(relaxation: float) -> float:
    """Return the squared size over the radius and the tolerance of relaxed parameters."""
    return min(CHORDS * max(relaxation, 1.0), of_sizes.LONGEST_CHORDS)
