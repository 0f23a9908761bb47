"""The bounds that suit each kind of domain, limited: behind `size_function`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_number, as_sizes
from adaptsize._size_function import SizeFunction
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.domain_size.image_mask import Mask
from adaptsize.domain_size.on_surface import size_on_surface
from adaptsize.domain_size.report import SizeReport, limit_bounds, nodal_measures
from adaptsize.geometry.distance.api import signed_distance
from adaptsize.sizes import (
    PointSource,
    size_from_curvature,
    size_from_feature,
    size_from_sources,
)
from adaptsize.typing import FloatArray, ProgressCallback

Implicit: TypeAlias = Callable[[FloatArray], npt.ArrayLike]
AnyBackground: TypeAlias = SimplexMesh | CartesianGrid | Octree

_LARGEST_SHARE = 1.0 / 20.0  # hmax over the diagonal
_SMALLEST_SHARE = 1.0 / 1000.0  # hmin over the diagonal
#: The smallest size that an image tells of, in pixels: of what is smaller, nobody knows whether
#: it belongs to the object.
_PIXELS_IN_SMALLEST = 2.0
#: How often the distance is averaged for the curvature of the edge in an image.  Limiting goes on
#: from the smallest sizes, so that ripples count in full: of a disc of radius 40 pixels, edge
#: ragged by half a pixel, the smallest radius found is 8 with 2 rounds, 20 with 24, whereas
#: ends of bars of radius 3 and 6 keep theirs.
_CURVATURE_SMOOTHING = 24
#: Edges in an image have no corners sharper than the filters leave them.
_IMAGE_CREASE_ANGLE = 120.0
#: Boxes along the longest side of a grid laid around a closed line.
_BOXES_ALONG = 250
#: Boxes of such a grid around the domain: room for differences.
_BOXES_AROUND = 6


@dataclass(frozen=True)
class Wish:
    """What is asked of the sizes."""

    per_radian: float
    across: float
    g: float
    hmin: float | None
    hmax: float | None
    crease_angle: float
    sources: Any
    h0: npt.ArrayLike | Implicit | None
    report: ProgressCallback | None

    def limits(self, diagonal: float, least: float = 0.0) -> tuple[float, float]:
        """Return hmin and hmax; what is not given suits a domain of that diagonal."""
        high, low = self.hmax, self.hmin
        if high is None:
            high = max(_LARGEST_SHARE * diagonal, low or 0.0, least)
        if low is None:
            low = min(max(_SMALLEST_SHARE * diagonal, least), high)
            for source in self._point_sources():  # what is asked in so many words is not raised
                low = min(low, float(np.min(source.size)))
        return low, high

    def _point_sources(self) -> list[PointSource]:
        sources = self.sources if isinstance(self.sources, Iterable) else [self.sources]
        return [source for source in sources if isinstance(source, PointSource)]

    def points(self, dim: int) -> tuple[FloatArray, FloatArray] | None:
        """Return the places and sizes of the point sources among the sources; None without any."""
        rows = [source.rows(dim) for source in self._point_sources()]
        if not rows:
            return None
        places, sizes = zip(*rows, strict=True)
        return np.concatenate(places), np.concatenate(sizes)

    def external(self, background: AnyBackground) -> dict[str, FloatArray]:
        """Return the bounds that do not come from the shape."""
        bounds = {}
        if _is_given(self.sources):
            bounds["sources"] = size_from_sources(background, self.sources, g=self.g)
        if self.h0 is not None:
            bounds["h0"] = _at_nodes(self.h0, background)
        return bounds


def as_wish(
    *,
    elements_per_radian: float,
    elements_across: float,
    g: float,
    hmin: float | None,
    hmax: float | None,
    crease_angle: float = 40.0,
    sources: Any = (),
    h0: npt.ArrayLike | Implicit | None = None,
    report: ProgressCallback | None = None,
) -> Wish:
    """Return what is asked, checked."""
    for name, value in (("hmin", hmin), ("hmax", hmax)):
        if value is not None:
            as_number(name, value, lower=0.0, strict=True)
    return Wish(
        as_number("elements_per_radian", elements_per_radian, lower=0.0),
        as_number("elements_across", elements_across, lower=0.0),
        as_number("g", g, lower=0.0),
        hmin,
        hmax,
        crease_angle,
        sources,
        h0,
        report,
    )


def _is_given(sources: Any) -> bool:
    return sources is not None and not (isinstance(sources, Sequence) and len(sources) == 0)


def _at_nodes(h0: npt.ArrayLike | Implicit, background: AnyBackground) -> FloatArray:
    if not callable(h0):
        return as_sizes("h0", h0, background.nodal_shape)
    if isinstance(background, CartesianGrid):
        return as_sizes("h0", background.sample(h0), background.shape)
    return as_sizes("h0", h0(background.points), background.nodal_shape)


def of_level_set(
    grid: CartesianGrid,
    phi: FloatArray,
    wish: Wish,
    *,
    spacings_in_smallest: float = 1.0,
    smoothing: int = 0,
) -> tuple[SizeFunction, SizeReport]:
    """Return the sizes of what lies where a signed distance is negative.

    No size is below so many spacings, unless asked for; ``smoothing`` as in `size_from_curvature`.
    """
    inside = _inside(grid, phi)
    step = float(grid.spacing.max())
    corners = [
        axis[np.flatnonzero(inside.any(axis=_others(d, grid.dim)))[[0, -1]]]
        for d, axis in enumerate(grid.axes)
    ]
    diagonal = float(np.linalg.norm(np.ptp(np.array(corners), axis=1)))
    limits = wish.limits(diagonal, spacings_in_smallest * step)
    bounds = {}
    if wish.per_radian > 0.0:
        bounds["curvature"] = size_from_curvature(
            grid,
            phi,
            elements_per_radian=wish.per_radian,
            crease_angle=wish.crease_angle,
            smoothing=smoothing,
            g=wish.g,
        )
    if wish.across > 0.0:
        bounds["feature size"] = size_from_feature(
            grid, phi, elements_across=wish.across, progress=wish.report
        )
    return _on_grid(grid, phi, bounds, limits, wish)


def of_mask(mask: Mask, phi: FloatArray, wish: Wish) -> tuple[SizeFunction, SizeReport]:
    """Return the sizes of the objects of an image, whose edges ripple from pixel to pixel."""
    return of_level_set(
        mask.grid,
        phi,
        replace(wish, crease_angle=_IMAGE_CREASE_ANGLE),
        spacings_in_smallest=_PIXELS_IN_SMALLEST,
        smoothing=_CURVATURE_SMOOTHING,
    )


def _inside(grid: CartesianGrid, phi: FloatArray) -> npt.NDArray[np.bool_]:
    inside = phi < 0.0
    if grid.active is not None:
        inside &= grid.active
    if not inside.any():
        raise ValueError(
            f"domain must be negative at a node of the background, got none of {grid!r}"
        )
    if not (phi > 0.0).any():
        raise ValueError(
            f"domain must have its boundary in the background, got all of {grid!r} inside"
        )
    return inside


def _others(axis: int, dim: int) -> tuple[int, ...]:
    return tuple(d for d in range(dim) if d != axis)


def _on_grid(
    grid: CartesianGrid,
    phi: FloatArray,
    bounds: dict[str, FloatArray],
    limits: tuple[float, float],
    wish: Wish,
) -> tuple[SizeFunction, SizeReport]:
    """Limit on the nodes inside and around the boundary; go on outside with the nearest."""
    from scipy import ndimage

    around = phi <= float(np.linalg.norm(grid.spacing))  # all corners of the boxes at the boundary
    if grid.active is not None:
        around &= grid.active
    bounds |= wish.external(grid)
    inner = grid.with_active(around)
    share = np.clip(0.5 - phi / float(grid.spacing.mean()), 0.0, 1.0)
    h, report = limit_bounds(
        inner,
        bounds,
        wish.g,
        hmin=limits[0],
        hmax=limits[1],
        weights=share * nodal_measures(inner),
        points=wish.points(grid.dim),
        progress=wish.report,
    )
    nearest = ndimage.distance_transform_edt(
        ~around, sampling=grid.spacing, return_distances=False, return_indices=True
    )
    return SizeFunction(grid.with_active(None), h[tuple(nearest)]), report


def of_mesh(
    mesh: SimplexMesh, background: AnyBackground | None, wish: Wish
) -> tuple[SizeFunction, SizeReport]:
    """Return the sizes of a mesh, or of what a surface or a closed line encloses."""
    encloses = mesh.cell_dim == mesh.dim - 1
    if background is None and mesh.dim == 2 and mesh.cell_dim == 1 and _is_closed(mesh):
        spacing = float(np.ptp(mesh.points, axis=0).max()) / _BOXES_ALONG
        background = CartesianGrid.around(mesh.points, spacing, _BOXES_AROUND * spacing)
    if background is None:
        is_surface = mesh.dim == 3 and mesh.cell_dim == 2
        return _on_refined_surface(mesh, wish) if is_surface else _on_own_nodes(mesh, wish)
    if background.dim != mesh.dim:
        raise ValueError(f"background must be {mesh.dim}-D, got {background!r}")
    boundary = mesh if encloses else mesh.boundary().mesh
    bounds = _bounds_of_boundary(background, boundary, wish)
    limits = wish.limits(mesh.diagonal)
    if isinstance(background, SimplexMesh):
        bounds |= wish.external(background)
        return _limited(background, bounds, limits, wish)
    phi = signed_distance(background, boundary, progress=wish.report)
    if isinstance(background, CartesianGrid):
        _inside(background, phi)
        return _on_grid(background, phi, bounds, limits, wish)
    bounds |= wish.external(background)
    weights = np.where(phi <= 0.0, nodal_measures(background), 0.0)
    return _limited(background, bounds, limits, wish, weights)


def _is_closed(line: SimplexMesh) -> bool:
    ends = np.bincount(line.cells.ravel(), minlength=line.n_points)
    return bool(np.isin(ends, (0, 2)).all())


def _bounds_of_boundary(
    background: AnyBackground, boundary: SimplexMesh | None, wish: Wish
) -> dict[str, FloatArray]:
    bounds = {}
    if wish.per_radian > 0.0:
        bounds["curvature"] = size_from_curvature(
            background,
            boundary,
            elements_per_radian=wish.per_radian,
            crease_angle=wish.crease_angle,
        )
    if wish.across > 0.0:
        bounds["feature size"] = size_from_feature(
            background,
            boundary,
            elements_across=wish.across,
            crease_angle=wish.crease_angle,
            progress=wish.report,
        )
    return bounds


def _limited(
    background: AnyBackground,
    bounds: dict[str, FloatArray],
    limits: tuple[float, float],
    wish: Wish,
    weights: FloatArray | None = None,
) -> tuple[SizeFunction, SizeReport]:
    h, report = limit_bounds(
        background,
        bounds,
        wish.g,
        hmin=limits[0],
        hmax=limits[1],
        weights=weights,
        points=wish.points(background.dim),
        progress=wish.report,
    )
    return SizeFunction(background, h, sources=report.info.sources), report


def _on_own_nodes(mesh: SimplexMesh, wish: Wish) -> tuple[SizeFunction, SizeReport]:
    bounds = _bounds_of_boundary(mesh, None, wish)
    bounds |= wish.external(mesh)
    return _limited(mesh, bounds, wish.limits(mesh.diagonal), wish)


def _on_refined_surface(mesh: SimplexMesh, wish: Wish) -> tuple[SizeFunction, SizeReport]:
    low, high = wish.limits(mesh.diagonal)
    size, bounds = size_on_surface(
        mesh,
        elements_per_radian=wish.per_radian,
        elements_across=wish.across,
        g=wish.g,
        hmin=low,
        hmax=high,
        crease_angle=wish.crease_angle,
        sources=wish.sources if _is_given(wish.sources) else (),
        h0=None if wish.h0 is None else _at_nodes(wish.h0, mesh),
    )
    # Limited once more, now with the causes: a small part of what refining took.
    refined = size.background
    assert isinstance(refined, SimplexMesh)
    return _limited(refined, bounds, (low, high), wish)
