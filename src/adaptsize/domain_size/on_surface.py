"""Sizes for a part of which nothing is said: chosen from its curvature and extent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_number, as_sizes
from adaptsize._progress import reporting
from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.background.flipping import flip_edges
from adaptsize.background.folds import Folds, are_among, folds_of
from adaptsize.background.splitting import split_edges
from adaptsize.domain_size.report import SizeReport, limit_bounds
from adaptsize.geometry.medial.inscribed_spheres import SphereFinder
from adaptsize.limiting import limit_gradient
from adaptsize.sizes import (
    minimum,
    size_from_curvature,
    size_from_feature,
    size_from_sources,
)
from adaptsize.typing import FloatArray, ProgressCallback

_ELEMENTS_PER_RADIAN = 4.0
_ELEMENTS_ACROSS = 2.0
_LARGEST_SHARE = 1.0 / 20.0  # hmax over the diagonal
_SMALLEST_SHARE = 1.0 / 1000.0  # hmin over the diagonal
_MAX_ROUNDS = 8
#: The background of a surface is refined until no edge is longer than this many sizes ...
_EDGE_OVER_SIZE = 2.0
#: ... or it would have more nodes than this,
_MAX_NODES = 400_000
#: or than this share of the elements allowed.  A layer of tetrahedra alone takes about 4.5 per
#: node of such a surface, a solid of some thickness more than 10; what has more nodes
#: consists of slivers much narrower than the size, on which it need not be known better.
_NODES_PER_ELEMENT = 1.0 / 10.0


@dataclass(frozen=True)
class ChosenSize:
    """Sizes for `remesh`, and the numbers behind them."""

    size: SizeFunction
    elements_per_radian: float
    """0 where curvature does not count."""
    elements_across: float
    """0 where the feature size does not count."""
    g: float
    hmin: float
    hmax: float
    n_estimated: float
    """Number of elements that a mesh of these sizes has, roughly."""
    n_rounds: int
    """How often the sizes were made larger to stay within ``max_elements``."""
    bounds: dict[str, FloatArray]
    """What each cause asks for at the nodes of the background of ``size``, inf where nothing."""

    def report(self) -> SizeReport:
        """Return which cause controls which part; takes as long as limiting does."""
        background = self.size.background
        assert isinstance(background, SimplexMesh)
        return limit_bounds(background, self.bounds, self.g, hmin=self.hmin, hmax=self.hmax)[1]

    def on(self, mesh: SimplexMesh) -> FloatArray:
        """Return the sizes at the nodes of another mesh of the same part.

        Where they are known on the surface only, they grow from the boundary of ``mesh``
        inwards, by ``g`` per length, up to ``hmax``.
        """
        size = self.size(mesh.points)
        background = self.size.background
        if not isinstance(background, SimplexMesh) or mesh.cell_dim <= background.cell_dim:
            return size
        nodes = mesh.boundary().nodes
        bound = np.full(mesh.n_points, self.hmax)
        bound[nodes] = size[nodes]
        return limit_gradient(mesh, bound, self.g)

    def __str__(self) -> str:
        """Say in one line what was chosen."""
        kappa = f"{self.elements_per_radian:.3g} elements per radian, "
        across = f"{self.elements_across:.3g} across, "
        return (
            f"{kappa if self.elements_per_radian > 0.0 else ''}"
            f"{across if self.elements_across > 0.0 else ''}g = {self.g:.3g}, "
            f"h from {self.size.values.min():.3g} to {self.size.values.max():.3g} "
            f"(hmin = {self.hmin:.3g}, hmax = {self.hmax:.3g}), "
            f"about {self.n_estimated:.2g} elements"
        )


def choose_size(
    mesh: SimplexMesh,
    *,
    elements_per_radian: float | None = None,
    elements_across: float | None = None,
    g: float = 0.25,
    hmin: float | None = None,
    hmax: float | None = None,
    crease_angle: float = 40.0,
    sources: Sequence[Any] = (),
    h0: npt.ArrayLike | None = None,
    max_elements: float = 300_000.0,
    progress: ProgressCallback | bool | None = None,
) -> ChosenSize:
    """Return limited sizes for remeshing a part; what is not given is chosen from the part.

    The sizes are the smallest of what curvature, feature size, ``sources`` and ``h0`` ask for,
    between ``hmin`` and ``hmax``, limited with ``g``.  On a surface in space they live on a refined
    copy of it, because triangulations of CAD programs have no nodes in their large facets.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles or tetrahedra.
    elements_per_radian : float, optional
        4 unless given; 0: curvature does not count.
    elements_across : float, optional
        Elements across narrow places, as in `size_from_feature`; 2 unless given; 0: the feature
        size does not count.  On a surface in space, sizes are made smaller by as much as they
        grow from there to the middle.
    g : float, default 0.25
        Gradient limit, >= 0.
    hmin, hmax : float, optional
        Limits of the size, in the unit of the coordinates; 1/1000 and 1/20 of the diagonal of
        the bounding box unless given.
    crease_angle : float, default 40
        As in `size_from_curvature`, degrees.
    sources : sequence
        As in `size_from_sources`.  On a surface, those in the volume act through the
        surface near them only.
    h0 : array_like of float, shape (n_points,), optional
        Further upper bounds at the nodes of ``mesh``.
    max_elements : float
        While a mesh would have more elements, as estimated, those of
        ``elements_per_radian`` and ``elements_across`` (down to 1), ``hmin`` and ``hmax`` that
        are not given are relaxed.
    progress : callable, bool or None
        As in `limit_gradient`.

    Returns
    -------
    ChosenSize

    Raises
    ------
    ValueError
        If an argument is bad, ``hmin`` above ``hmax``, or ``mesh`` consists of segments.

    Notes
    -----
    The estimate of a volume of which only the surface is known takes the size at a point
    inside from the closest point of the surface; it is good to a factor of two.

    Examples
    --------
    >>> points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> chosen = choose_size(SimplexMesh(points, [[0, 1, 2, 3]]), hmax=0.25)
    >>> chosen.size([[0.2, 0.2, 0.2]])
    array([0.25])
    """
    if mesh.cell_dim == 1:
        raise ValueError(f"mesh must consist of triangles or tetrahedra, got {mesh!r}")
    limit = as_number("max_elements", max_elements, lower=1.0, allow_inf=True)
    if elements_per_radian is not None:
        as_number("elements_per_radian", elements_per_radian, lower=0.0)
    if elements_across is not None:
        as_number("elements_across", elements_across, lower=0.0)
    if h0 is not None:
        h0 = as_sizes("h0", h0, mesh.nodal_shape)
    is_open = None in (elements_per_radian, elements_across, hmin, hmax)
    widths = _Widths(mesh, crease_angle)
    relax, before = 1.0, np.inf
    with reporting(progress) as report:
        for n_rounds in range(_MAX_ROUNDS + 1):
            report("choosing sizes", n_rounds / _MAX_ROUNDS)
            wish = _Wish(
                _given(elements_per_radian, max(_ELEMENTS_PER_RADIAN / relax, 1.0)),
                _given(elements_across, max(_ELEMENTS_ACROSS / relax, 1.0)),
                as_number("g", g, lower=0.0),
                _given(hmin, min(relax * _SMALLEST_SHARE * mesh.diagonal, hmax or np.inf)),
                _given(hmax, max(relax * _LARGEST_SHARE * mesh.diagonal, hmin or 0.0)),
                crease_angle,
                sources,
                h0,
                _NODES_PER_ELEMENT * limit if is_open else _MAX_NODES,
                widths,
            )
            size, bounds = wish.size_on(mesh)
            estimate = _estimate(mesh, size, wish)
            if estimate <= limit or not is_open:
                break
            if estimate > 0.95 * before:  # what is given asks for so many
                break
            before = estimate
            relax *= max(1.2, (estimate / limit) ** (1.0 / mesh.dim))
    asked = (wish.elements_per_radian, wish.elements_across, wish.g, wish.hmin, wish.hmax)
    return ChosenSize(size, *asked, estimate, n_rounds, bounds)


def size_on_surface(
    mesh: SimplexMesh,
    *,
    elements_per_radian: float,
    elements_across: float,
    g: float,
    hmin: float,
    hmax: float,
    crease_angle: float,
    sources: Sequence[Any],
    h0: npt.ArrayLike | None,
) -> tuple[SizeFunction, dict[str, FloatArray]]:
    """Return limited sizes on a refined copy of a surface, and the bounds there by cause.

    Arguments are those of `choose_size`, all given; ``h0`` is of the nodal shape.
    """
    wish = _Wish(
        elements_per_radian,
        elements_across,
        g,
        hmin,
        hmax,
        crease_angle,
        sources,
        h0,
        _MAX_NODES,
        _Widths(mesh, crease_angle),
    )
    return wish.size_on(mesh)


def _given(value: float | None, otherwise: float) -> float:
    return otherwise if value is None else value


class _Widths:
    """Local feature sizes of a part, found when they are asked for and kept."""

    def __init__(self, mesh: SimplexMesh, crease_angle: float) -> None:
        self._mesh = mesh
        self._crease_angle = crease_angle

    @cached_property
    def at_nodes(self) -> FloatArray:
        """At the nodes of the part."""
        # h0 = 2 lfs / elements_across
        return size_from_feature(self._mesh, elements_across=2.0, crease_angle=self._crease_angle)

    @cached_property
    def _finder(self) -> SphereFinder:
        return SphereFinder(self._mesh, crease_angle=self._crease_angle)

    def on_surface(self, points: FloatArray) -> FloatArray:
        """At points of a surface."""
        return self._finder.near(points).smallest()


@dataclass(frozen=True)
class _Wish:
    """What is asked of the sizes; nothing left open."""

    elements_per_radian: float
    elements_across: float
    g: float
    hmin: float
    hmax: float
    crease_angle: float
    sources: Sequence[Any]
    h0: npt.ArrayLike | None
    max_nodes: float
    """Of the refined copy of a surface."""
    widths: _Widths

    def size_on(self, mesh: SimplexMesh) -> tuple[SizeFunction, dict[str, FloatArray]]:
        """Return the limited sizes, on the mesh or on a refined copy of a surface, and the bounds.

        The latter by cause, at the nodes of the background of the sizes.
        """
        bounds = {}
        if self.elements_per_radian > 0.0:
            bounds["curvature"] = size_from_curvature(
                mesh,
                elements_per_radian=self.elements_per_radian,
                crease_angle=self.crease_angle,
            )
        if self.h0 is not None:
            bounds["h0"] = np.asarray(self.h0, dtype=np.float64)
        if mesh.dim == 3 and mesh.cell_dim == 2:
            folds = folds_of(mesh, np.deg2rad(self.crease_angle))
            return _size_on_surface(mesh, bounds, folds, self)
        if self.elements_across > 0.0:
            bounds["feature size"] = 2.0 / self.elements_across * self.widths.at_nodes
        return self.finished(mesh, bounds)

    def across_surface(self, lfs: FloatArray) -> FloatArray:
        """Return the size on a surface with so many elements between it and the other side.

        From there to the middle, at a distance lfs, sizes grow to h + g lfs; the integral of 1 / h
        along that way is to be half the number of elements.
        """
        if self.g == 0.0:
            return 2.0 / self.elements_across * lfs
        share: float = self.g / np.expm1(0.5 * self.g * self.elements_across)
        return share * lfs

    def finished(
        self, mesh: SimplexMesh, bounds: dict[str, FloatArray]
    ) -> tuple[SizeFunction, dict[str, FloatArray]]:
        """Return sizes below ``bounds`` and those of the sources, limited, and all the bounds."""
        if self.sources:
            bounds = bounds | {"sources": size_from_sources(mesh, self.sources, g=self.g)}
        free = np.full(mesh.n_points, np.inf)
        bound = minimum(free, *bounds.values(), hmin=self.hmin, hmax=self.hmax)
        return SizeFunction(mesh, limit_gradient(mesh, bound, self.g)), bounds


def _size_on_surface(
    mesh: SimplexMesh,
    bounds: dict[str, FloatArray],
    folds: Folds,
    wish: _Wish,
) -> tuple[SizeFunction, dict[str, FloatArray]]:
    """Return sizes on a copy of a surface that is refined where its edges are long.

    A new node on an edge along which the surface bends gets the mean of the
    curvatures at the ends; one in a flat facet, or on a sharp edge, none: there the sizes
    may grow from the nodes of the file, however far those are apart.  Edges in flat facets
    are flipped, as sizes are limited faster, and better, without slivers.
    """
    across = wish.across_surface(wish.widths.at_nodes) if wish.elements_across > 0.0 else None
    while True:
        mesh = flip_edges(mesh, np.concatenate([folds.bent, folds.sharp]))
        all_bounds = bounds if across is None else bounds | {"feature size": across}
        size, all_bounds = wish.finished(mesh, all_bounds)
        ends = size.values[mesh.edges].min(axis=1)
        long = mesh.edge_lengths > _EDGE_OVER_SIZE * ends
        if not long.any() or mesh.n_points + int(long.sum()) > wish.max_nodes:
            return size, all_bounds
        split = split_edges(mesh, long)
        parents = mesh.edges[split.split_edges]
        curved = are_among(parents, folds.bent)
        for name, h0 in bounds.items():
            at_middle = np.full(len(parents), np.inf)
            at_middle[curved] = 2.0 / (1.0 / h0[parents[curved]]).sum(axis=1).clip(1e-300)
            bounds = bounds | {name: np.concatenate([h0, at_middle])}
        folds = folds.split(parents, mesh.n_points)
        if across is not None:
            lfs = wish.widths.on_surface(split.mesh.points[mesh.n_points :])
            across = np.concatenate([across, wish.across_surface(lfs)])
        mesh = split.mesh


def _estimate(mesh: SimplexMesh, size: SizeFunction, wish: _Wish) -> float:
    """Return about how many elements a mesh of these sizes has."""
    from adaptsize.remeshing.estimate import estimate_n_cells, estimate_n_enclosed

    if not (mesh.dim == 3 and mesh.cell_dim == 2):
        return estimate_n_cells(mesh, size)
    surface = size.background

    def inside(points: FloatArray) -> FloatArray:
        values, distances = surface.locator.interpolate(size.values, points)
        return np.minimum(values + wish.g * distances, wish.hmax)

    return estimate_n_enclosed(mesh, inside)
