"""Gradient limiting of several upper bounds, and which of them controls which part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_limits
from adaptsize._progress import reporting
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.limiting import LimitingInfo, limit_gradient
from adaptsize.limiting.exact import limit_points
from adaptsize.sizes.budget import ELEMENTS_PER_MEASURE
from adaptsize.typing import BoolArray, FloatArray, ProgressCallback

#: Bounds at points between the nodes: the name of their cause, float64[k, dim] and float64[k].
PointBounds: TypeAlias = Sequence[tuple[str, FloatArray, FloatArray]]

#: Cause of nodes outside the domain, and of nodes that no bound reaches.
NONE = -1


@dataclass(frozen=True, eq=False, repr=False)
class SizeReport:
    """Which cause controls the size where, and how much of the domain.

    A cause controls a node if the size there is its own bound, or if the size has grown, by the
    gradient limit, from a node where it is.
    """

    background: SimplexMesh | CartesianGrid | Octree
    causes: tuple[str, ...]
    """Names, such as ``"curvature"``.  ``"hmin"`` controls where a bound is smaller than that,
    ``"hmax"`` where there is no other bound."""
    cause: npt.NDArray[np.int8]
    """Index into ``causes`` at each node, of the nodal shape; -1 outside the domain."""
    domain_shares: dict[str, float]
    """Share of the length, area or volume of the domain that each cause controls."""
    element_shares: dict[str, float]
    """Estimated share of the elements of a mesh with these sizes."""
    smallest: dict[str, float]
    """Smallest size in the part that each cause controls."""
    largest: float
    """Largest size in the domain."""
    bounds: dict[str, FloatArray]
    """Upper bounds of each cause at the nodes, of the nodal shape; inf where there is none."""
    info: LimitingInfo | None
    """Information on the limiting of all bounds together; None for surfaces in space, from which
    sizes grow through the space around."""
    g: float
    hmin: float
    hmax: float
    n_elements: float
    """Predicted number of elements of a mesh with these sizes."""
    n_nodes: float = np.nan
    """Predicted number of nodes; nan if the domain is not given as a mesh."""
    elements_per_radian: float = 0.0
    """Elements per radian of curved boundaries; 0 if curvature is disabled."""
    elements_across: float = 0.0
    """Elements across narrow regions; 0 if the width is disabled."""
    elements_between: float = 0.0
    """Elements between features that do not meet; 0 if the separation is disabled."""
    is_rough: bool = False
    """Whether the boundary is rough, so that the separation is disabled unless requested."""
    tolerance: float = np.inf
    """Allowed distance of chords from curved boundaries, over the diameter; inf if not limited."""
    relaxation: float = 1.0
    """Factor by which parameters that were not given were relaxed.  Below 1 they were tightened."""

    @property
    def choices(self) -> str:
        """The parameters requested or chosen, and the resulting sizes, in one line."""
        parts = []
        if self.elements_per_radian > 0.0:
            parts.append(f"{self.elements_per_radian:.3g} elements per radian")
        if self.elements_across > 0.0:
            parts.append(f"{self.elements_across:.3g} across")
        if self.elements_between > 0.0:
            parts.append(f"{self.elements_between:.3g} between features")
        elif self.is_rough:
            parts.append("no separation of features (rough surface)")
        if np.isfinite(self.tolerance):
            parts.append(f"tolerance {self.tolerance:.3g}")
        least = min(self.smallest.values())
        limits = f"(hmin = {self.hmin:.3g}, hmax = {self.hmax:.3g})"
        return ", ".join(
            [
                *parts,
                f"g = {self.g:.3g}",
                f"h from {least:.3g} to {self.largest:.3g} {limits}",
                f"about {float(f'{self.n_elements:.2g}'):.0f} elements",
            ]
        )

    @property
    def codes(self) -> range:
        """Possible values of `cause` inside the domain."""
        return range(len(self.causes))

    def __repr__(self) -> str:
        """Return the causes with their shares."""
        shares = ", ".join(f"{name} {share:.1%}" for name, share in self._by_share())
        return f"SizeReport({shares})"

    def __str__(self) -> str:
        """Return one line per cause, with the share it controls."""
        what = {1: "length", 2: "area", 3: "volume"}[measure_dim(self.background)]
        by_share = self._by_share()
        width = max(len(name) for name, _ in by_share)
        lines = [
            f"{name:{width}}  controls {share:6.1%} of the {what}, "
            f"{self.element_shares[name]:6.1%} of the elements, h from {self.smallest[name]:.4g}"
            for name, share in by_share
        ]
        return "\n".join(lines)

    def _by_share(self) -> list[tuple[str, float]]:
        """Return the causes that control some part, the largest share first."""
        shares = [item for item in self.domain_shares.items() if item[1] > 0.0]
        return sorted(shares, key=lambda item: -item[1])


def limit_bounds(
    background: SimplexMesh | CartesianGrid | Octree,
    bounds: Mapping[str, FloatArray],
    g: float,
    *,
    hmin: float,
    hmax: float,
    weights: FloatArray | None = None,
    points: PointBounds = (),
    through_space: bool = False,
    options: Mapping[str, Any] | None = None,
    progress: ProgressCallback | bool | None = None,
) -> tuple[FloatArray, SizeReport]:
    """Return the limited minimum of several bounds, and which of them controls what.

    Parameters
    ----------
    background : SimplexMesh, CartesianGrid or Octree
    bounds : mapping of str to array
        Upper bounds of each cause, of the nodal shape; inf where there is none.
    g : float
        Gradient limit, >= 0.
    hmin, hmax : float
        Limits of the size, ``0 < hmin <= hmax``, finite.
    weights : ndarray of float64, of the nodal shape, optional
        Length, area or volume of the domain that belongs to each node, 0 outside.  By default
        that of the cells of the background.
    points : sequence of tuples (name, places, sizes), optional
        Bounds at points, float64[k, dim] and float64[k], of the cause with this name.  The exact
        method applies them at their exact positions; on surfaces they need ``through_space``.
    through_space : bool, optional
        Whether sizes grow through the space around a surface, not along it.
    options : mapping of str to object, optional
        Options of `limit_gradient`, such as ``method``.  Not used with points.
    progress : callable, bool or None
        As in `limit_gradient`.

    Returns
    -------
    h : ndarray of float64, of the nodal shape
        As of `limit_gradient`.
    report : SizeReport

    Raises
    ------
    ValueError
        If ``hmin`` is above ``hmax``, or as in `limit_gradient`.

    Notes
    -----
    Where the exact method applies, the sources of the sizes determine the causes.  Elsewhere the
    bounds are limited separately by fast marching.  The limited size of a minimum is the minimum
    of the limited sizes, so the cause with the smallest limited size controls.

    Examples
    --------
    >>> line = SimplexMesh([[0.0], [1.0], [2.0], [3.0]], [[0, 1], [1, 2], [2, 3]])
    >>> curved = np.array([0.5, np.inf, np.inf, np.inf])
    >>> narrow = np.array([np.inf, np.inf, np.inf, 0.2])
    >>> h, report = limit_bounds(
    ...     line, {"curvature": curved, "width": narrow}, 0.3, hmin=0.1, hmax=0.75
    ... )
    >>> h
    array([0.5 , 0.75, 0.5 , 0.2 ])
    >>> [report.causes[k] for k in report.cause]
    ['curvature', 'hmax', 'width', 'width']
    """
    low, high = as_limits(hmin, hmax)
    if measure_dim(background) < background.dim and not through_space:
        points = ()  # point sources act at the nodes around them
    names = tuple(dict.fromkeys([*bounds, *(name for name, _, _ in points), "hmin", "hmax"]))
    requested = np.full(background.nodal_shape, high)
    own = np.full(background.nodal_shape, len(names) - 1, dtype=np.int8)
    for k, bound in enumerate(bounds.values()):
        smaller = bound < requested
        requested[smaller], own[smaller] = bound[smaller], k
    own[requested < low] = len(names) - 2
    requested = np.maximum(requested, low)
    places, sizes, of_points = _joined(points, names, low, high, background.dim)
    info, roots = None, None
    if through_space:
        assert isinstance(background, SimplexMesh)
        every = np.concatenate([background.points, places])
        bound = np.concatenate([requested, sizes])
        with reporting(progress) as callback:
            h, roots = limit_points(every, bound, len(own), g, callback)
    else:
        if len(sizes) > 0:
            options = {"point_sources": (places, sizes)}
        h, info = limit_gradient.with_info(
            background, requested, g, progress=progress, **(options or {})
        )
        if info.sources is not None:
            roots = info.sources.roots().reshape(own.shape)
    if roots is not None:
        causes = np.append(np.concatenate([own.ravel(), of_points]), np.int8(NONE))
        cause = causes[roots]
    else:
        cause = _by_separate_runs(background, requested, own, len(names) - 1, g)
    weights = nodal_measures(background) if weights is None else weights
    cause[weights <= 0.0] = NONE
    every_bound = {name: bounds.get(name, np.full(own.shape, np.inf)) for name in names[:-2]}
    report = _report(background, names, cause, h, weights, every_bound, info)
    return h, replace(report, g=g, hmin=low, hmax=high)


def _joined(
    points: PointBounds, names: tuple[str, ...], low: float, high: float, dim: int
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.int8]]:
    """Return the places of all points, their sizes within the limits, and their causes."""
    if len(points) == 0:
        return np.empty((0, dim)), np.empty(0), np.empty(0, np.int8)
    places = np.concatenate([at for _, at, _ in points])
    sizes = np.concatenate([size for _, _, size in points])
    causes = np.repeat([names.index(name) for name, _, _ in points], [len(s) for _, _, s in points])
    causes[sizes < low] = len(names) - 2
    kept = sizes < high  # others bound nothing
    return places[kept], np.maximum(sizes[kept], low), causes[kept].astype(np.int8)


def _by_separate_runs(
    background: SimplexMesh | CartesianGrid | Octree,
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
        alone = np.where(own == k, requested, np.inf)
        if k == constant:
            alone[...] = requested[own == k][0]
        else:
            alone = limit_gradient(background, alone, g, method="fast-marching")
        better = alone < best
        cause[better], best[better] = k, alone[better]
    return cause


def nodal_measures(background: SimplexMesh | CartesianGrid | Octree) -> FloatArray:
    """Return the length, area or volume around each node, of the nodal shape.

    A cell gives the same share to each of its nodes.  Inactive nodes have none.
    """
    if isinstance(background, CartesianGrid):
        return _grid_measures(background)
    mesh = background.mesh if isinstance(background, Octree) else background
    shares = np.repeat(mesh.measures / mesh.cells.shape[1], mesh.cells.shape[1])
    measures = np.zeros(mesh.n_points)
    np.add.at(measures, mesh.cells.ravel(), shares)
    return measures


def _grid_measures(grid: CartesianGrid) -> FloatArray:
    measures = np.full(grid.shape, float(np.prod(grid.spacing)))
    for d in range(grid.dim):
        ends = np.moveaxis(measures, d, 0)
        ends[0] *= 0.5
        ends[-1] *= 0.5
    if grid.active is not None:
        measures[~grid.active] = 0.0
    return measures


def measure_dim(background: SimplexMesh | CartesianGrid | Octree) -> int:
    """Return the dimension of the measure of the cells of a background."""
    return background.cell_dim if isinstance(background, SimplexMesh) else background.dim


def _report(
    background: SimplexMesh | CartesianGrid | Octree,
    names: tuple[str, ...],
    cause: npt.NDArray[np.int8],
    h: FloatArray,
    weights: FloatArray,
    bounds: dict[str, FloatArray],
    info: LimitingInfo | None,
) -> SizeReport:
    """Return the report with the shares and the smallest size of each cause."""
    inside: BoolArray = cause != NONE
    k, sizes, measure = cause[inside], h[inside], weights[inside]
    elements = measure / sizes ** measure_dim(background)
    count = len(names)
    domain = np.bincount(k, weights=measure, minlength=count) / max(measure.sum(), 1e-300)
    share = np.bincount(k, weights=elements, minlength=count) / max(elements.sum(), 1e-300)
    least = np.full(count, np.inf)
    np.minimum.at(least, k, sizes)
    return SizeReport(
        background=background,
        causes=names,
        cause=locked(cause),
        domain_shares=dict(zip(names, domain.tolist(), strict=True)),
        element_shares=dict(zip(names, share.tolist(), strict=True)),
        smallest=dict(zip(names, least.tolist(), strict=True)),
        largest=float(sizes.max(initial=0.0)),
        bounds=bounds,
        info=info,
        g=0.0,
        hmin=0.0,
        hmax=np.inf,
        n_elements=float(ELEMENTS_PER_MEASURE[measure_dim(background)] * elements.sum()),
    )


def locked(array: npt.NDArray[np.int8]) -> npt.NDArray[np.int8]:
    """Return the array itself, made read-only."""
    array.flags.writeable = False
    return array
