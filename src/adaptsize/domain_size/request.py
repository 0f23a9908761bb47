"""The parameters of a size function and their defaults."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_angle, as_limits, as_number, as_sizes
from adaptsize._defaults import CREASE_ANGLE, MAX_ELEMENTS, TOLERANCE
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.domain_size.report import (
    PointBounds,
    SizeReport,
    limit_bounds,
    measure_dim,
    nodal_measures,
)
from adaptsize.sizes import PointSource, size_from_sources
from adaptsize.sizes.curvature import size_of_chords
from adaptsize.sizes.sources import as_sources
from adaptsize.typing import FloatArray, ProgressCallback

Implicit: TypeAlias = Callable[[FloatArray], npt.ArrayLike]
AnyBackground: TypeAlias = SimplexMesh | CartesianGrid | Octree

#: Defaults of `size_function`, of images and of the command line; see also `_defaults`.
ELEMENTS_PER_RADIAN = 4.0
ELEMENTS_ACROSS = 2.0
ELEMENTS_BETWEEN = 1.0
#: Features may be closer than this share of the size, if it is relaxed.
_LEAST_BETWEEN = 0.25

_LARGEST_SHARE = 1.0 / 20.0  # hmax over the diameter
_SMALLEST_SHARE = 1.0 / 1000.0  # hmin over the diameter
#: A relaxed tolerance is that of this share of the elements at curved boundaries.
_KEPT = 0.95


@dataclass(frozen=True)
class Request:
    """The requested parameters.  None means not given: chosen from the domain."""

    elements_per_radian: float | None
    elements_across: float | None
    elements_between: float | None
    g: float
    hmin: float | None
    hmax: float | None
    crease_angle: float
    sources: Sequence[Any]
    h0: npt.ArrayLike | Implicit | None
    max_elements: float
    report: ProgressCallback | None
    tolerance: float | None = None
    elements: float | None = None
    """Number of elements to reach; ``max_elements`` is not less."""
    nodes: float | None = None
    """Number of nodes to reach."""
    relaxation: float = 1.0
    """Factor by which parameters that are not given are relaxed, for ``max_elements``; below 1
    they are tightened, for ``elements`` or ``nodes``."""

    @property
    def is_fixed(self) -> bool:
        """Whether all parameters that could be relaxed for any domain are given."""
        return None not in (self.elements_per_radian, self.elements_across, self.hmin, self.hmax)

    @property
    def per_radian(self) -> float:
        """Elements per radian of curved boundaries."""
        if self.elements_per_radian is not None:
            return self.elements_per_radian
        return max(ELEMENTS_PER_RADIAN / self.relaxation, 1.0)

    @property
    def across(self) -> float:
        """Elements across narrow regions."""
        if self.elements_across is not None:
            return self.elements_across
        return max(ELEMENTS_ACROSS / self.relaxation, 1.0)

    def between(self, is_rough: bool) -> float:
        """Return the elements between features that are close; by default none if it is rough."""
        if self.elements_between is not None:
            return self.elements_between
        return 0.0 if is_rough else max(ELEMENTS_BETWEEN / self.relaxation, _LEAST_BETWEEN)

    @property
    def least_separation(self) -> float:
        """Least separation over the diameter that counts: closer features may be joined."""
        return self.chord_tolerance if np.isfinite(self.chord_tolerance) else TOLERANCE

    @property
    def chord_tolerance(self) -> float:
        """Distance of chords from curved boundaries, over the diameter; inf if not limited."""
        if self.tolerance is not None:
            return self.tolerance
        return TOLERANCE * self.relaxation**2  # sizes are in proportion to its square root

    @property
    def bounds_curvature(self) -> bool:
        """Whether sizes at curved boundaries are bounded, if these carry the sizes."""
        return self.per_radian > 0.0 or self.chord_tolerance < np.inf

    def on_curves(self, radius: FloatArray, diameter: float) -> FloatArray:
        """Return sizes that resolve curves of given radii and leave a mesh within the tolerance."""
        chords = size_of_chords(radius, self.chord_tolerance * diameter)
        return np.minimum(radius / self.per_radian, chords) if self.per_radian else chords

    def relaxed(self, relaxation: float) -> Request:
        """Return the same request with another relaxation factor."""
        return replace(self, relaxation=relaxation)

    def limits(self, diameter: float, least: float = 0.0) -> tuple[float, float]:
        """Return hmin and hmax; by default in proportion to the diameter of the domain."""
        high, low = self.hmax, self.hmin
        if high is None:
            high = max(self.relaxation * _LARGEST_SHARE * diameter, low or 0.0, least)
        if low is None:
            low = min(max(self.relaxation * _SMALLEST_SHARE * diameter, least), high)
            for source in self._point_sources():  # prescribed sizes are not raised
                low = min(low, float(np.min(source.size)))
        return low, high

    def _point_sources(self) -> list[PointSource]:
        return [source for source in self.sources if isinstance(source, PointSource)]

    def points(self, dim: int) -> list[tuple[str, FloatArray, FloatArray]]:
        """Return the positions and sizes of the point sources."""
        return [("sources", *source.rows(dim)) for source in self._point_sources()]

    def external(self, background: AnyBackground) -> dict[str, FloatArray]:
        """Return the bounds that do not depend on the shape."""
        bounds = self.from_sources(background)
        if self.h0 is not None:
            bounds["h0"] = bound_at_nodes(self.h0, background)
        return bounds

    def from_sources(self, background: AnyBackground) -> dict[str, FloatArray]:
        """Return the bounds from the sources."""
        if len(self.sources) == 0:
            return {}
        return {"sources": size_from_sources(background, self.sources, g=self.g)}


def as_request(
    *,
    elements_per_radian: float | None,
    elements_across: float | None,
    elements_between: float | None = None,
    g: float,
    hmin: float | None,
    hmax: float | None,
    crease_angle: float = CREASE_ANGLE,
    sources: Any = (),
    h0: npt.ArrayLike | Implicit | None = None,
    max_elements: float | None = None,
    elements: float | None = None,
    nodes: float | None = None,
    report: ProgressCallback | None = None,
    tolerance: float | None = None,
) -> Request:
    """Return a request after checking its values."""
    most = check_elements(elements, max_elements, nodes)
    # As floats: arrays that are filled with an integer would hold integers.
    low, high = as_limits(hmin, hmax)
    hmin, hmax = None if hmin is None else low, None if hmax is None else high
    if tolerance is not None:
        tolerance = as_number("tolerance", tolerance, lower=0.0, strict=True, allow_inf=True)
    if elements_per_radian is not None:
        elements_per_radian = as_number("elements_per_radian", elements_per_radian, lower=0.0)
    if elements_across is not None:
        elements_across = as_number("elements_across", elements_across, lower=0.0)
    if elements_between is not None:
        elements_between = as_number("elements_between", elements_between, lower=0.0)
    request = Request(
        elements_per_radian,
        elements_across,
        elements_between,
        as_number("g", g, lower=0.0),
        hmin,
        hmax,
        as_angle("crease_angle", crease_angle),
        [] if sources is None else as_sources(sources),
        h0,
        most,
        report,
        tolerance,
        None if elements is None else float(elements),
        None if nodes is None else float(nodes),
    )
    if (elements is not None or nodes is not None) and request.is_fixed:
        name = "nodes" if elements is None else "elements"
        raise ValueError(
            f"{name} changes the parameters that are not given, but elements_per_radian, "
            f"elements_across, hmin and hmax are all given: omit one of them, or {name}"
        )
    return request


def check_elements(
    elements: float | None, max_elements: float | None, nodes: float | None = None
) -> float:
    """Return the limit on the number of elements, after checking all numbers."""
    most = MAX_ELEMENTS
    if max_elements is not None:
        most = as_number("max_elements", max_elements, lower=1.0, allow_inf=True)
    if nodes is not None:
        if elements is not None or max_elements is not None:
            other = "max_elements" if elements is None else "elements"
            raise ValueError(f"nodes and {other} exclude each other: omit one of them")
        as_number("nodes", nodes, lower=1.0)
        return np.inf
    if elements is None:
        return most
    wanted = as_number("elements", elements, lower=1.0)
    if max_elements is not None and wanted > most:
        raise ValueError(
            f"elements must be at most max_elements = {most:.6g}, got {wanted:.6g}; "
            "omit max_elements"
        )
    return wanted


def limit_requested(
    background: AnyBackground,
    bounds: dict[str, FloatArray],
    limits: tuple[float, float],
    request: Request,
    weights: FloatArray | None = None,
    *,
    points: PointBounds = (),
    through_space: bool = False,
    options: Mapping[str, Any] | None = None,
    with_tolerance: bool = False,
    is_rough: bool = False,
) -> tuple[FloatArray, SizeReport]:
    """Return the minimum of several bounds, limited as requested, and its report.

    ``points`` and the further arguments are those of `limit_bounds`; point sources are added.  With
    ``with_tolerance``, the bound from curvature is within the tolerance.  ``is_rough``: whether the
    boundary is.
    """
    has_features = "separation" in (*bounds, *(name for name, _, _ in points))
    h, report = limit_bounds(
        background,
        bounds,
        request.g,
        hmin=limits[0],
        hmax=limits[1],
        weights=weights,
        points=[*points, *request.points(background.dim)],
        through_space=through_space,
        options=options,
        progress=request.report,
    )
    tolerance = np.inf
    if with_tolerance:
        assert isinstance(background, SimplexMesh)
        tolerance = _tolerance_of(h, bounds, background, request)
    return h, replace(
        report,
        elements_per_radian=request.per_radian,
        elements_across=request.across,
        elements_between=request.between(is_rough) if has_features else 0.0,
        is_rough=is_rough,
        tolerance=tolerance,
    )


def _tolerance_of(
    h: FloatArray, bounds: dict[str, FloatArray], background: SimplexMesh, request: Request
) -> float:
    """Return the tolerance for a mesh of these sizes.

    Where it is relaxed, other bounds may keep the sizes smaller than it requires.  Then it is the
    one that they require at all but a twentieth of the elements at curved boundaries.
    """
    largest = request.chord_tolerance
    if request.tolerance is not None or largest <= TOLERANCE:
        return largest
    bound, diameter = bounds["curvature"], background.diameter
    curved = np.isfinite(bound) & np.isfinite(h)
    if not curved.any():
        return TOLERANCE
    bound, size = bound[curved], h[curved]
    # The bound is the smaller one of radius / K and the size of chords.
    radius = np.maximum(request.per_radian * bound, np.square(bound) / (4.0 * largest * diameter))
    required = np.square(size) / (4.0 * radius * diameter)
    order = np.argsort(required)
    per_node = nodal_measures(background)[curved] / size ** measure_dim(background)
    elements = np.cumsum(per_node[order])
    most = required[order[np.searchsorted(elements, _KEPT * elements[-1])]]
    return float(np.clip(most, TOLERANCE, largest))


def bound_at_nodes(h0: npt.ArrayLike | Implicit, background: AnyBackground) -> FloatArray:
    """Return upper bounds at the nodes of a background, from an array or a function of points."""
    if not callable(h0):
        return as_sizes("h0", h0, background.nodal_shape)
    if isinstance(background, CartesianGrid):
        return as_sizes("h0", background.sample(h0), background.shape)
    return as_sizes("h0", h0(background.points), background.nodal_shape)
