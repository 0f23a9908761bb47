"""What a size function is requested for, and the limiting of the upper bounds that follow."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_limits, as_sizes
from adaptsize._defaults import GRADIENT_LIMIT, MAX_ELEMENTS, TOLERANCE
from adaptsize._messages import Message
from adaptsize._progress import silent
from adaptsize._size_report import NONE, SizeReport, measure_dim
from adaptsize._workers import Workers
from adaptsize.background import AnyBackground, CartesianGrid, SimplexMesh
from adaptsize.domain_size.cost import as_bytes
from adaptsize.domain_size.parts import as_sizes_of_parts, sizes_of_parts
from adaptsize.errors import OptionError
from adaptsize.geometry.inside import Inside
from adaptsize.limiting import limit_gradient
from adaptsize.limiting.info import LimitingInfo
from adaptsize.limiting.inside import Aims, InnerSource, Limited, limit_inside
from adaptsize.options import BudgetOptions, SizeFunctionOptions
from adaptsize.sizes import PointSource, size_from_sources
from adaptsize.sizes.budget import ELEMENTS_PER_MEASURE, count_elements, nodal_measures
from adaptsize.sizes.curvature import CHORDS, size_of_chords
from adaptsize.sizes.sources import KNOWN, as_sources
from adaptsize.typing import FloatArray, IntArray, ProgressCallback

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
    they are tightened, for ``elements``, ``nodes`` or ``dofs``."""
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
        known = [] if sources is None else as_sources(sources)
        request = cls(options, known, h0, report, is_capped=is_capped)
        if options["size_of"] is not None:
            request.options["size_of"] = as_sizes_of_parts(options["size_of"])
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
        return GRADIENT_LIMIT * float(np.clip(np.sqrt(0.25 * self.relaxation), 1.0, 2.0))

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
        return max(4.0 / self.relaxation, 1.0) if given is None else given

    @property
    def per_radian_of_chords(self) -> float:
        """The same where chords are kept within a tolerance: fully relaxed, these are enough."""
        if self.options["elements_per_radian"] is not None or self.tolerance == np.inf:
            return self.per_radian
        return 4.0 / self.relaxation

    @property
    def across(self) -> float:
        """Elements across narrow regions.

        It is 1 where the other parameters are relaxed, and then falls to a quarter: cells four
        times as long as a plate is thick have angles of about 15 degrees.
        """
        given = self.options["elements_across"]
        if given is not None:
            return given
        return max(2.0 / self.relaxation, min(1.0, max(4.0 / self.relaxation, 0.25)))

    def between(self, is_rough: bool) -> float:
        """Return the elements between features that are close; by default none if it is rough."""
        given = self.options["elements_between"]
        if given is not None:
            return given
        # Relaxed, features may be closer than the size by up to a factor of 4.
        return 0.0 if is_rough else max(1.0 / self.relaxation, 0.25)

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
        chords, k = size_of_chords(radius, self.tolerance * diameter), self.per_radian_of_chords
        return np.minimum(radius / k, chords) if k else chords

    def on_features(self, separation: FloatArray, diameter: float, is_rough: bool) -> FloatArray:
        """Return sizes between features; those closer than the tolerance may be joined."""
        finite = np.isfinite(self.tolerance)
        least = (self.tolerance if finite else TOLERANCE) * diameter
        return np.maximum(separation, least) / self.between(is_rough)

    def limits(
        self, diameter: float, least: float = 0.0, *, of_chords: bool = False
    ) -> tuple[float, float]:
        """Return hmin and hmax; by default in proportion to the diameter of the domain.

        Where chords are kept within the tolerance, the default hmin is at most the smallest size
        that they may require, so that it overrides none of them.
        """
        high, low = self.options["hmax"], self.options["hmin"]
        if high is None:
            high = max(self.relaxation * (1.0 / 20.0) * diameter, low or 0.0, least)
        if low is None:
            low = self.relaxation * (1.0 / 1000.0) * diameter
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
    if goal is not None and goal[0] != "elements":
        if most is not None or memory is not None:
            other = "max_memory" if most is None else "max_elements"
            raise _exclusive(goal[0], other)
        return np.inf
    if elements is None:
        default = MAX_ELEMENTS if memory is None else np.inf
        return default if most is None else most
    if most is not None and elements > most:
        text = "{elements} must be at most {max_elements} = {:.6g}, got {:.6g}; omit {max_elements}"
        raise OptionError(Message(text, most, elements))
    return elements


def bound_at_nodes(h0: npt.ArrayLike | Implicit, background: AnyBackground) -> FloatArray:
    """Return upper bounds at the nodes of a background, from an array or a function of points."""
    if not callable(h0):
        return as_sizes("h0", h0, background.nodal_shape)
    if isinstance(background, CartesianGrid):
        return as_sizes("h0", background.sample(h0), background.shape)
    return as_sizes("h0", h0(background.points), background.nodal_shape)


@dataclass
class Bounds:
    """Upper bounds on the size by their causes, at the nodes of a background and between them."""

    background: AnyBackground
    nodal: dict[str, FloatArray]
    """Of the nodal shape; inf where there is no bound."""
    limits: tuple[float, float]
    """The smallest and the largest size, finite."""
    weights: FloatArray | None = None
    """Length, area or volume of the domain at each node, 0 outside; None: that of the cells."""
    points: PointBounds = field(default=())
    """Applied by the exact method at their positions; on surfaces, only inside a solid."""
    is_rough: bool = False
    """Whether the boundary of the domain is."""
    solid: tuple[Inside, FloatArray] | None = None
    """The solid that a surface encloses, inside of which sizes grow, and normals at the nodes."""
    inner: Sequence[InnerSource] = ()
    """Sources inside that solid."""
    aims: Aims | None = None
    """Out: of the sizes in a solid."""
    of_chords: bool = False
    """Whether the bound by curvature, if there is one, keeps edges within the tolerance."""

    def limited(self, request: Request, **options: Any) -> tuple[FloatArray, SizeReport]:
        """Return the minimum of the bounds, limited as requested, and its report.

        Where the exact method applies, the sources of the sizes determine the causes.  Elsewhere
        the bounds are limited separately by fast marching.  The limited size of a minimum is the
        minimum of the limited sizes, so the cause with the smallest limited size controls.

        Parameters
        ----------
        request : Request
        **options
            Of `limit_gradient`, where there are no points.
        """
        if request.options["size_of"]:
            freed = self._overridden(request.options["size_of"])
            fixed = replace(request, options={**request.options, "size_of": None})
            limited = freed.limited(fixed, **options)
            self.aims = freed.aims
            return limited
        if "sources" in self.nodal:
            self.limits = request.not_raised(self.limits, self.nodal["sources"])
        background, (low, high) = self.background, self.limits
        dim = background.dim
        points = [*self.points, *request.points(dim)] if self.solid is None else [*self.points]
        if measure_dim(background) < dim and self.solid is None:
            points = []  # point sources act at the nodes around them
        given = [*self.nodal, *(name for name, _, _ in points), *["sources"] * bool(self.inner)]
        names = (*dict.fromkeys(given), "hmin", "hmax")
        requested = np.full(background.nodal_shape, high)
        own = np.full(background.nodal_shape, len(names) - 1, dtype=np.int8)
        for k, bound in enumerate(self.nodal.values()):
            smaller = bound < requested
            requested[smaller], own[smaller] = bound[smaller], k
        own[requested < low] = len(names) - 2
        requested = np.maximum(requested, low)
        places = np.concatenate([np.empty((0, dim)), *(at for _, at, _ in points)])
        sizes = np.concatenate([np.empty(0), *(size for _, _, size in points)])
        of_points = np.repeat(
            np.array([names.index(name) for name, _, _ in points], np.int8),
            np.array([len(size) for _, _, size in points], np.intp),
        )
        of_points[sizes < low] = len(names) - 2
        kept = sizes < high  # others bound nothing
        places, sizes, of_points = places[kept], np.maximum(sizes[kept], low), of_points[kept]
        info: LimitingInfo | None = None
        roots: npt.NDArray[Any] | None = None
        if self.solid is not None:
            grown = self._limited_inside(request, requested, (places, sizes))
            h, roots = grown.h, grown.roots
            more = len(grown.places) - len(places)
            places = grown.places
            of_inner = names.index("sources") if self.inner else 0
            of_points = np.append(of_points, np.full(more, of_inner, np.int8))
        else:
            if len(sizes) > 0:
                options = {"point_sources": (places, sizes)}
            h, info = limit_gradient.with_info(
                background, requested, request.g, progress=request.report, **options
            )
            if info.sources is not None:
                roots = info.sources.roots().reshape(own.shape)
        if roots is not None:
            cause = np.append(np.concatenate([own.ravel(), of_points]), np.int8(NONE))[roots]
        else:
            cause = _by_separate_runs(background, requested, own, len(names) - 1, request.g)
        report, origin = self._report(request, names, cause, h), None
        if roots is not None and isinstance(background, SimplexMesh):
            origin = self._origin(roots.ravel(), cause.ravel(), places)
        return h, replace(report, info=info, origin=origin)

    def _limited_inside(
        self, request: Request, requested: FloatArray, points: tuple[FloatArray, FloatArray]
    ) -> Limited:
        """Return the sizes limited inside the solid."""
        assert isinstance(self.background, SimplexMesh)
        assert self.solid is not None
        inner = [source.clipped(self.limits[0], np.inf) for source in self.inner]
        workers = Workers.of(None, request.report)
        found = limit_inside(
            self.background, self.solid, requested, points, inner, request.g, workers
        )
        self.aims = found.aims
        return found

    def _overridden(self, size_of: Mapping[str, float]) -> Bounds:
        """Return the bounds without those of the shape on some parts, which have own sizes."""
        from scipy.spatial import cKDTree

        sizes = sizes_of_parts(self.background, size_of)
        own = np.isfinite(sizes)
        nodal = {
            name: bound if name in ("sources", "h0") else np.where(own, np.inf, bound)
            for name, bound in self.nodal.items()
        }
        tree, points = cKDTree(self.background.points), []
        for name, places, bound in self.points:
            kept = ~own[tree.query(places)[1]]
            points.append((name, places[kept], bound[kept]))
        return replace(self, nodal=nodal | {"size_of": sizes}, points=points)

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
        names: tuple[str, ...],
        cause: npt.NDArray[np.int8],
        h: FloatArray,
    ) -> SizeReport:
        """Return the report with the shares and the smallest size of each cause."""
        weights = nodal_measures(self.background) if self.weights is None else self.weights
        cause[weights <= 0.0] = NONE
        cause.flags.writeable = False
        inside = cause != NONE
        k, sizes, measure = cause[inside], h[inside], weights[inside]
        dim, count = measure_dim(self.background), len(names)
        elements = measure / sizes**dim
        domain = np.bincount(k, weights=measure, minlength=count) / max(measure.sum(), 1e-300)
        share = np.bincount(k, weights=elements, minlength=count) / max(elements.sum(), 1e-300)
        least = np.full(count, np.inf)
        np.minimum.at(least, k, sizes)
        n_elements = float(ELEMENTS_PER_MEASURE[dim] * elements.sum())
        if self.weights is None and isinstance(self.background, SimplexMesh):
            n_elements = count_elements(self.background, h)  # sizes are linear in cells
        tolerance = np.inf
        if self.of_chords and "curvature" in self.nodal:
            tolerance = request.tolerance
        return SizeReport(
            background=self.background,
            causes=names,
            cause=cause,
            domain_shares=dict(zip(names, domain.tolist(), strict=True)),
            element_shares=dict(zip(names, share.tolist(), strict=True)),
            smallest=dict(zip(names, least.tolist(), strict=True)),
            largest=float(sizes.max(initial=0.0)),
            bounds={n: self.nodal.get(n, np.full(cause.shape, np.inf)) for n in names[:-2]},
            info=None,
            g=request.g,
            hmin=self.limits[0],
            hmax=self.limits[1],
            n_elements=n_elements,
            elements_per_radian=(
                request.per_radian_of_chords if self.of_chords else request.per_radian
            ),
            elements_across=request.across,
            elements_between=request.between(self.is_rough) if "separation" in names else 0.0,
            tolerance=tolerance,
            is_rough=self.is_rough,
        )


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
