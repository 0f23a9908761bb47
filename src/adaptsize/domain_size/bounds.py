"""Upper bounds of one size function by their causes, and the sizes limited from all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._causes import CURVATURE, HMAX, HMIN, SEPARATION, SIZE_OF, SOURCES, Cause
from adaptsize._size_report import NONE, SizeReport, measure_dim
from adaptsize._workers import Workers
from adaptsize.background import AnyBackground, SimplexMesh
from adaptsize.domain_size.named_parts import sizes_of_parts
from adaptsize.domain_size.prescribed import BoundsByCause
from adaptsize.domain_size.request import Request
from adaptsize.geometry.inside import Inside
from adaptsize.limiting import limit_gradient
from adaptsize.limiting.info import LimitingInfo
from adaptsize.limiting.inside import Aims, InnerSource, limit_inside
from adaptsize.limiting.problem import Scheme
from adaptsize.sizes import PointSource, size_from_sources
from adaptsize.sizes.budget import ELEMENTS_PER_MEASURE, count_elements, nodal_measures
from adaptsize.typing import FloatArray, IntArray


class _Requested(NamedTuple):
    """The least bound at each node, and bounds between the nodes, each with its cause."""

    causes: tuple[Cause, ...]
    """The last two are the limits, hmin and hmax."""
    nodal: FloatArray
    cause: npt.NDArray[np.int8]
    """Of the nodal shape."""
    places: FloatArray
    sizes: FloatArray
    cause_at_places: npt.NDArray[np.int8]


class _Sizes(NamedTuple):
    """Limited sizes, and from where they grow."""

    h: FloatArray
    roots: npt.NDArray[Any] | None
    """The node or place from which each size grows, places after the nodes; None if not known."""
    places: FloatArray
    cause_at_places: npt.NDArray[np.int8]
    info: LimitingInfo | None = None
    aims: Aims | None = None


@dataclass
class Bounds:
    """Upper bounds on the size by their causes, at the nodes of a background and between them."""

    background: AnyBackground
    nodal: dict[Cause, FloatArray]
    """Of the nodal shape; inf where there is no bound."""
    limits: tuple[float, float]
    """The smallest and the largest size, finite."""
    weights: FloatArray | None = None
    """Length, area or volume of the domain at each node, 0 outside; None: that of the cells."""
    points: BoundsByCause = field(default=())
    """Applied by the exact method at their positions; on surfaces, only inside a solid."""
    is_rough: bool = False
    """Whether the boundary of the domain is."""
    solid: tuple[Inside, FloatArray] | None = None
    """The solid that a surface encloses, inside of which sizes grow, and normals at the nodes."""
    inner: Sequence[InnerSource] = ()
    """Sources inside that solid."""
    of_chords: bool = False
    """Whether the bound by curvature, if there is one, keeps edges within the tolerance."""

    def limited(self, request: Request, scheme: Scheme | None = None) -> LimitedBounds:
        """Return the minimum of the bounds, limited as requested.

        Where the exact method applies, the sources of the sizes determine the causes.  Elsewhere
        the bounds are limited separately by fast marching.  The limited size of a minimum is the
        minimum of the limited sizes, so the cause with the smallest limited size controls.

        Parameters
        ----------
        request : Request
        scheme : Scheme, optional
            Of `limit_gradient`.  If it takes no sources between the nodes, these act on the nodes
            around them.
        """
        bounds = self._with_sizes_of_parts(request)._with_low_sources(request)
        asked = bounds._requested(request, scheme)
        if bounds.solid is not None and isinstance(bounds.background, SimplexMesh):
            sizes = bounds._limited_inside(bounds.background, bounds.solid, request, asked)
        else:
            sizes = bounds._limited_on_background(request, asked, scheme)
        return LimitedBounds(bounds, request, asked, sizes)

    def _with_sizes_of_parts(self, request: Request) -> Bounds:
        size_of = request.options["size_of"]
        return self._overridden(size_of) if size_of else self

    def _with_low_sources(self, request: Request) -> Bounds:
        """Return the bounds with the default hmin lowered to the sizes of functions."""
        if SOURCES not in self.nodal:
            return self
        return replace(self, limits=request.not_raised(self.limits, self.nodal[SOURCES]))

    def _between_nodes(
        self, request: Request, scheme: Scheme | None
    ) -> tuple[Bounds, BoundsByCause]:
        """Return the bounds that the scheme applies at places between the nodes.

        On surfaces, and with schemes that know nodes only, those from the shape are bounds at the
        nodes around them; those from sources are already.
        """
        background = self.background
        if self.solid is not None:
            return self, self.points
        if scheme is not None and "point_sources" not in scheme.optional:
            nodal = dict(self.nodal)
            for cause, places, sizes in self.points:
                found = size_from_sources(background, [PointSource(places, sizes)], g=request.g)
                nodal[cause] = np.minimum(nodal.get(cause, np.inf), found)
            return replace(self, nodal=nodal), ()
        if measure_dim(background) < background.dim:
            return self, ()  # point sources act at the nodes around them
        return self, [*self.points, *request.points(background.dim)]

    def _requested(self, request: Request, scheme: Scheme | None) -> _Requested:
        """Return the least bounds with their causes, within the smallest and the largest size."""
        bounds, points = self._between_nodes(request, scheme)
        shape, dim, (low, high) = bounds.background.nodal_shape, bounds.background.dim, self.limits
        given = [*bounds.nodal, *(own for own, _, _ in points), *[SOURCES] * bool(self.inner)]
        causes = (*dict.fromkeys(given), HMIN, HMAX)
        nodal = np.full(shape, high)
        cause = np.full(shape, len(causes) - 1, dtype=np.int8)
        for own, bound in bounds.nodal.items():
            smaller = bound < nodal
            nodal[smaller], cause[smaller] = bound[smaller], causes.index(own)
        cause[nodal < low] = len(causes) - 2
        places = np.concatenate([np.empty((0, dim)), *(at for _, at, _ in points)])
        sizes = np.concatenate([np.empty(0), *(size for _, _, size in points)])
        of_points = np.repeat(
            np.array([causes.index(own) for own, _, _ in points], np.int8),
            np.array([len(size) for _, _, size in points], np.intp),
        )
        of_points[sizes < low] = len(causes) - 2
        kept = sizes < high  # others bound nothing
        return _Requested(
            causes, np.maximum(nodal, low), cause,
            places[kept], np.maximum(sizes[kept], low), of_points[kept],
        )  # fmt: skip

    def _limited_on_background(
        self, request: Request, asked: _Requested, scheme: Scheme | None
    ) -> _Sizes:
        """Return the sizes limited on the background."""
        points = None if len(asked.sizes) == 0 else (asked.places, asked.sizes)
        h, info = limit_gradient.with_info(
            self.background, asked.nodal, request.g, method="auto" if scheme is None else scheme,
            point_sources=points, progress=request.progress,
        )  # fmt: skip
        roots = None
        if info.sources is not None:
            roots = info.sources.roots().reshape(asked.cause.shape)
        return _Sizes(h, roots, asked.places, asked.cause_at_places, info)

    def _limited_inside(
        self,
        surface: SimplexMesh,
        solid: tuple[Inside, FloatArray],
        request: Request,
        asked: _Requested,
    ) -> _Sizes:
        """Return the sizes limited inside the solid."""
        inner = [source.clipped(self.limits[0], np.inf) for source in self.inner]
        grown = limit_inside(
            surface, solid, asked.nodal, (asked.places, asked.sizes), inner, request.g,
            Workers.of(None, request.progress),
        )  # fmt: skip
        of_inner = asked.causes.index(SOURCES) if self.inner else 0
        more = np.full(len(grown.places) - len(asked.places), of_inner, np.int8)
        causes = np.append(asked.cause_at_places, more)
        return _Sizes(grown.h, grown.roots, grown.places, causes, aims=grown.aims)

    def _overridden(self, size_of: Mapping[str, float]) -> Bounds:
        """Return the bounds without those of the shape on some parts, which have own sizes."""
        from scipy.spatial import cKDTree

        sizes = sizes_of_parts(self.background, size_of)
        own = np.isfinite(sizes)
        nodal = {
            cause: np.where(own, np.inf, bound) if cause.is_of_shape else bound
            for cause, bound in self.nodal.items()
        }
        tree, points = cKDTree(self.background.points), []
        for cause, places, bound in self.points:
            kept = ~own[tree.query(places)[1]]
            points.append((cause, places[kept], bound[kept]))
        return replace(self, nodal=nodal | {SIZE_OF: sizes}, points=points)

    def _origin(
        self, roots: npt.NDArray[Any], cause: npt.NDArray[np.int8], places: FloatArray
    ) -> IntArray:
        """Return the nodes from which sizes grow, or those nearest to places between nodes."""
        from scipy.spatial import cKDTree

        n = self.background.n_points
        between = np.unique(roots[roots >= n])
        node = np.arange(n + len(places), dtype=np.int32)
        if len(between):
            node[between] = cKDTree(self.background.points).query(places[between - n])[1]
        return np.where(cause == NONE, np.int32(-1), node[roots])

    def _report(
        self,
        request: Request,
        causes: tuple[Cause, ...],
        cause: npt.NDArray[np.int8],
        h: FloatArray,
    ) -> SizeReport:
        """Return the report with the shares and the smallest size of each cause."""
        weights = nodal_measures(self.background) if self.weights is None else self.weights
        cause[weights <= 0.0] = NONE
        cause.flags.writeable = False
        inside = cause != NONE
        k, sizes, measure = cause[inside], h[inside], weights[inside]
        dim, count = measure_dim(self.background), len(causes)
        elements = measure / sizes**dim
        domain = np.bincount(k, weights=measure, minlength=count) / max(measure.sum(), 1e-300)
        share = np.bincount(k, weights=elements, minlength=count) / max(elements.sum(), 1e-300)
        least = np.full(count, np.inf)
        np.minimum.at(least, k, sizes)
        n_elements = float(ELEMENTS_PER_MEASURE[dim] * elements.sum())
        if self.weights is None and isinstance(self.background, SimplexMesh):
            n_elements = count_elements(self.background, h)  # sizes are linear in cells
        tolerance = np.inf
        if self.of_chords and CURVATURE in self.nodal:
            tolerance = request.tolerance
        names = tuple(own.name for own in causes)
        return SizeReport(
            background=self.background,
            causes=names,
            cause=cause,
            domain_shares=dict(zip(names, domain.tolist(), strict=True)),
            element_shares=dict(zip(names, share.tolist(), strict=True)),
            smallest=dict(zip(names, least.tolist(), strict=True)),
            largest=float(sizes.max(initial=0.0)),
            bounds={
                own.name: self.nodal.get(own, np.full(cause.shape, np.inf)) for own in causes[:-2]
            },
            info=None,
            g=request.g,
            hmin=self.limits[0],
            hmax=self.limits[1],
            n_elements=n_elements,
            elements_per_radian=(
                request.per_radian_of_chords if self.of_chords else request.per_radian
            ),
            elements_across=request.across,
            elements_between=request.between(self.is_rough) if SEPARATION in causes else 0.0,
            tolerance=tolerance,
            is_rough=self.is_rough,
        )


@dataclass(frozen=True, eq=False)
class LimitedBounds:
    """Sizes from all bounds, and, where it is asked for, their report."""

    bounds: Bounds
    request: Request
    asked: _Requested
    sizes: _Sizes

    @property
    def h(self) -> FloatArray:
        """The sizes, of the nodal shape."""
        return self.sizes.h

    @property
    def aims(self) -> Aims | None:
        """Those of the sizes in a solid."""
        return self.sizes.aims

    @cached_property
    def report(self) -> SizeReport:
        """The report of the sizes, with the cause of each."""
        bounds, asked, sizes = self.bounds, self.asked, self.sizes
        background, origin = bounds.background, None
        if sizes.roots is not None:
            causes = np.concatenate([asked.cause.ravel(), sizes.cause_at_places])
            cause = np.append(causes, np.int8(NONE))[sizes.roots]
        else:
            constant, g = asked.causes.index(HMAX), self.request.g
            cause = _by_separate_runs(background, asked.nodal, asked.cause, constant, g)
        report = bounds._report(self.request, asked.causes, cause, sizes.h)
        if sizes.roots is not None and isinstance(background, SimplexMesh):
            origin = bounds._origin(sizes.roots.ravel(), cause.ravel(), sizes.places)
        return replace(report, info=sizes.info, origin=origin)


def _by_separate_runs(
    background: AnyBackground,
    requested: FloatArray,
    own: npt.NDArray[np.int8],
    constant: int,
    g: float,
) -> npt.NDArray[np.int8]:
    """Return the cause whose bounds alone give the smallest limited size at each node.

    The cause of number ``constant`` prescribes the same size everywhere.  Fast marching is accurate
    enough to distinguish the causes.
    """
    cause = np.full(own.shape, NONE, dtype=np.int8)
    best = np.full(own.shape, np.inf)
    for k in np.unique(own):
        # Finite everywhere: components without this cause are no reason for a warning.
        limited = np.where(own == k, requested, 2.0 * requested.max())
        if k == constant:
            limited[...] = requested[own == k][0]
        else:
            limited = limit_gradient(background, limited, g, method="fast-marching")
        better = limited < best
        cause[better], best[better] = k, limited[better]
    return cause
