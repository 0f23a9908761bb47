"""Metrics of the next mesh, from the second derivatives of fields and from bounds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import describe
from adaptsize._defaults import METRIC_GRADIENT_LIMIT
from adaptsize._messages import Message
from adaptsize._pickling import once
from adaptsize.adaptation import tuning
from adaptsize.adaptation.next_sizes import BoundLike, CycleRequest, as_bound
from adaptsize.background import SimplexMesh
from adaptsize.background.interfaces import interfaces
from adaptsize.errors import OptionError
from adaptsize.metrics import (
    Metric,
    MetricFunction,
    limit_metric,
    metric_from_curvature,
)
from adaptsize.metrics.hessian import optimal_metric
from adaptsize.metrics.limit import as_one_slope
from adaptsize.options import AdaptOptions
from adaptsize.quality.conformity import nodal_metric
from adaptsize.sizes.curvature import curves_of, radius_at_curves, size_of_chords
from adaptsize.sizes.search import scale_to
from adaptsize.typing import BoolArray, FloatArray


@dataclass(frozen=True, kw_only=True)
class MetricRequest(CycleRequest):
    """A request of sizes that depend on the direction.  The present error is not estimated."""

    fields: tuple[FloatArray, ...]
    """Nodal fields that linear elements shall interpolate well."""
    bound: Metric | None
    g: float | None
    chords: Metric | None = None
    """Largest sizes that leave curved boundaries within the tolerance of the generator."""

    def within(
        self, mesh: SimplexMesh, tolerance: float, original: SimplexMesh | None = None
    ) -> MetricRequest:
        """Return the request with a bound that leaves curved boundaries within a tolerance."""
        return replace(self, chords=metric_by_tolerance(mesh, tolerance, original))

    def for_boundary(self) -> MetricRequest:
        """Return the request that only curved boundaries bound, and not ``hmax`` either."""
        options: AdaptOptions = {**self.options, "hmax": None}
        return replace(self, options=options, fields=(), bound=None)

    def at_curves(self, mesh: SimplexMesh) -> BoolArray:
        """Return the nodes at which curved boundaries bound the sizes."""
        if self.chords is None:
            return np.zeros(mesh.n_points, np.bool_)
        return np.asarray(np.isfinite(self.chords.sizes[:, 0]))

    def without_number(self, mesh: SimplexMesh) -> Metric:
        """Return the metric for the tolerance, or the one that is requested."""
        return self._finished(mesh, self._wanted(mesh, None))

    def of_number(
        self,
        mesh: SimplexMesh,
        number: float,
        corrected: Callable[[Metric, float], float] | None = None,
    ) -> Metric:
        """Return the metric scaled such that the number of simplices is ``number``, within 3 %.

        Each time the scale is corrected, the metric is limited anew.
        """
        wanted = self._wanted(mesh, number)
        return scale_to(
            number, lambda s: self._finished(mesh, wanted.scaled(s)),
            lambda metric: metric.predicted_elements(mesh), 1.0, mesh.cell_dim,
            tuning.ACCURACY_OF_METRIC, most=tuning.MOST_SCALES,
        )  # fmt: skip

    def _wanted(self, mesh: SimplexMesh, number: float | None) -> Metric:
        """Return the metric before limits, for the tolerance or about a number of elements."""
        if not self.fields:
            free = np.full(mesh.n_points, np.inf)
            return Metric.isotropic(free, mesh.dim) if self.bound is None else self.bound
        norm, aspect = self.options["norm"], self.options["max_aspect"]
        # Of the present mesh, to which the fields belong.
        of_goal = once(
            self, "_of_goal",
            lambda: [optimal_metric(mesh, v, norm=norm, max_aspect=aspect) for v in self.fields],
        )  # fmt: skip
        tolerance = None if number is not None else self.options["tolerance"]
        return reduce(Metric.intersect, [metric(tolerance, number) for metric in of_goal])

    def _finished(self, mesh: SimplexMesh, metric: Metric) -> Metric:
        """Apply bounds and limits."""
        if self.bound is not None and self.fields:
            metric = metric.intersect(self.bound)
        if self.chords is not None:
            metric = metric.intersect(self.chords)
        metric = metric.clip(self.options["hmin"], self.options["hmax"])
        return metric if self.g is None else limit_metric(mesh, metric, self.g)


def metric_request(
    mesh: SimplexMesh,
    h0: BoundLike | Metric | MetricFunction | None,
    fields: Mapping[str, npt.NDArray[Any]],
    options: AdaptOptions,
) -> MetricRequest:
    """Return the checked request, with the nodal ``fields`` named by ``anisotropic``."""
    bound = nodal_metric(mesh, h0, finite=False)
    if bound is None and h0 is not None:
        sizes = as_bound(h0, mesh)  # type: ignore[arg-type]
        bound = Metric.isotropic(sizes, mesh.dim)
    anisotropic = as_anisotropic(options["anisotropic"])
    chosen = tuple(fields[name] for name in _names(anisotropic, fields))
    accuracy = options["tolerance"]
    if not chosen and bound is None:
        raise ValueError("anisotropic needs a field in fields, or a Metric as h0, got neither")
    if chosen and (accuracy, options["elements"], options["nodes"]) == (None, None, None):
        raise OptionError(Message("fields need {tolerance}, {elements} or {nodes}, got none"))
    if not chosen and accuracy is not None:
        raise OptionError(Message("{tolerance} needs fields whose error it limits, got none"))
    g = METRIC_GRADIENT_LIMIT if isinstance(options["g"], str) else options["g"]
    g = None if g is None else as_one_slope(g)
    return MetricRequest(options=options, fields=chosen, bound=bound, g=g)


def as_anisotropic(value: Any) -> bool | list[str]:
    """Return True, False, or names, which need not be those of fields yet."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    is_array = isinstance(value, np.ndarray) and value.ndim == 1
    is_list = isinstance(value, Sequence) and not isinstance(value, str)
    names = list(value) if is_list or is_array else [value]
    if not all(isinstance(name, str) for name in names):
        raise ValueError(
            f"anisotropic must be True, False or names of fields, got {describe(value)}"
        )
    return names


def _names(anisotropic: bool | list[str], fields: Mapping[str, npt.NDArray[Any]]) -> list[str]:
    """Return the names of the fields whose second derivatives count."""
    if anisotropic is False:
        return []
    usable = [name for name, v in fields.items() if v.ndim == 1 and v.dtype.kind == "f"]
    if anisotropic is True:
        return usable
    for name in anisotropic:
        if name not in usable:
            listed = ", ".join(usable) or "none"
            raise ValueError(
                f"anisotropic must name fields with one float per node ({listed}), "
                f"got {describe(name)}"
            )
    return anisotropic


def metric_by_tolerance(
    mesh: SimplexMesh, tolerance: float, original: SimplexMesh | None = None
) -> Metric | None:
    """Return the largest metric that leaves curved boundaries within a share of the diagonal.

    Edges along a cylinder may be 10 times as long as those around it.  See
    `bound_by_tolerance` for sizes.
    """
    if mesh.dim < 3:
        return None
    allowed = tolerance * mesh.diagonal
    if original is not None:
        radii = _radii_of_original(mesh, original, 2.0 * allowed)
        return Metric.of(size_of_chords(radii.sizes, allowed), radii.directions)
    radii = _radii(mesh)
    inner = interfaces(mesh) if mesh.cell_dim == mesh.dim else None
    if inner is not None:
        facets, nodes = inner
        sizes, directions = np.full_like(radii.sizes, np.inf), np.array(radii.directions)
        of_facets = _radii(facets)
        sizes[nodes], directions[nodes] = of_facets.sizes, of_facets.directions
        radii = radii.intersect(Metric.of(sizes, directions))
    return Metric.of(size_of_chords(radii.sizes, allowed), radii.directions)


def _radii_of_original(mesh: SimplexMesh, original: SimplexMesh, within: float) -> Metric:
    """Return the radii of curvature of an original boundary and interfaces, as a metric.

    The smallest radius is that of the closest point.  The ratios and directions are those of the
    nearest corner there that has them.
    """
    radius = radius_at_curves(mesh, original=original, within=within)
    nodes = np.flatnonzero(np.isfinite(radius))
    ratios = np.ones((mesh.n_points, 3))
    directions = np.tile(np.eye(3), (mesh.n_points, 1, 1))
    least = np.full(len(nodes), np.inf)
    for curve in curves_of(original):
        if curve is None:
            continue
        radii = _radii(curve[0])
        facets, weights, distances = curve[0].locator.nearest(mesh.points[nodes])
        corners = curve[0].cells[facets]
        known = np.where(np.isfinite(radii.sizes[corners, 0]), weights, -1.0)
        corner = corners[np.arange(len(corners)), known.argmax(axis=1)]
        nearer = (distances < least) & (known.max(axis=1) >= 0.0)
        at, corner = nodes[nearer], corner[nearer]
        ratios[at] = radii.sizes[corner] / radii.sizes[corner, :1]
        directions[at] = radii.directions[corner]
        least[nearer] = distances[nearer]
    return Metric.of(radius[:, None] * ratios, directions)


def _radii(mesh: SimplexMesh) -> Metric:
    """Return the radii of curvature as a metric."""
    return metric_from_curvature(
        mesh, elements_per_radian=1.0, max_aspect=tuning.MOST_ASPECT_OF_CURVATURE
    )
