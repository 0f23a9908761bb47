"""The size function of each kind of domain: bounds from its shape, then gradient limiting."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from adaptsize._checks import check_type
from adaptsize._defaults import CORNER_ANGLE
from adaptsize._progress import silent
from adaptsize._size_function import SizeFunction
from adaptsize.background import CartesianGrid, Octree, SimplexMesh
from adaptsize.domain_size.image_mask import Mask
from adaptsize.domain_size.on_surface import SurfaceDomain
from adaptsize.domain_size.report import PointBounds, SizeReport, nodal_measures
from adaptsize.domain_size.request import AnyBackground, Request, limit_requested
from adaptsize.geometry.distance.signed_distance import signed_distance
from adaptsize.geometry.faces import Faces
from adaptsize.geometry.separation import Separation
from adaptsize.geometry.width import Walls
from adaptsize.sizes import size_from_curvature, size_from_feature
from adaptsize.sizes.curvature import radius_at_curves
from adaptsize.sizes.feature import width_in_regions
from adaptsize.typing import FloatArray

#: The smallest size for an image, in pixels.  Smaller details may not belong to the object.
_PIXELS_IN_SMALLEST = 2.0
#: Rounds of averaging of the distance for the curvature of the boundary in an image.  Gradient
#: limiting propagates the smallest sizes, so ripples of the boundary must be removed.  For a disc
#: of radius 40 pixels with a boundary ragged by half a pixel, the smallest radius found is 8 with
#: 2 rounds and 20 with 24.  The ends of bars of radius 3 and 6 keep their radius.
_CURVATURE_SMOOTHING = 24
#: The filters leave no sharper corners on boundaries in an image.
_IMAGE_CREASE_ANGLE = 120.0
#: Options of gradient limiting for images in space.
_IN_SPACE = {"method": "fast-marching", "order": 2}
#: Boxes along the longest side of the grid around a closed polyline.
_BOXES_ALONG = 250
#: Margin of such a grid around the domain in boxes, for finite differences.
_BOXES_AROUND = 6


class SizedDomain(Protocol):
    """A domain whose size function can be made for several requests."""

    @property
    def dim(self) -> int:
        """Number of coordinates."""
        ...

    def limited(self, request: Request) -> tuple[SizeFunction, SizeReport]:
        """Return the limited sizes and which cause controls them where."""
        ...


@dataclass
class _Kept:
    """An expensive result that does not depend on the request, computed once."""

    value: FloatArray | None = None

    def get(self, compute: Callable[[], FloatArray]) -> FloatArray:
        if self.value is None:
            self.value = compute()
        return self.value


@dataclass
class LevelSet:
    """The region where a signed distance on a grid is negative."""

    grid: CartesianGrid
    phi: FloatArray
    spacings_in_smallest: float = 1.0
    """The default ``hmin`` is at least this number of spacings."""
    smoothing: int = 0
    """As in `size_from_curvature`."""
    crease_angle: float | None = None
    """Replaces the one of the request."""
    options: Mapping[str, Any] | None = None
    """Of `limit_gradient`."""
    _width: _Kept = field(default_factory=_Kept)

    @property
    def dim(self) -> int:
        """Number of axes."""
        return self.grid.dim

    def limited(self, request: Request) -> tuple[SizeFunction, SizeReport]:
        """Return the limited sizes and which cause controls them where."""
        grid, phi = self.grid, self.phi
        inside = _inside(grid, phi)
        step = float(grid.spacing.max())
        corners = [
            axis[np.flatnonzero(inside.any(axis=_others(d, grid.dim)))[[0, -1]]]
            for d, axis in enumerate(grid.axes)
        ]
        diagonal = float(np.linalg.norm(np.ptp(np.array(corners), axis=1)))
        limits = request.limits(diagonal, self.spacings_in_smallest * step)
        bounds = {}
        if request.per_radian > 0.0:
            bounds["curvature"] = size_from_curvature(
                grid,
                phi,
                elements_per_radian=request.per_radian,
                crease_angle=self.crease_angle or request.crease_angle,
                smoothing=self.smoothing,
                g=request.g,
            )
        if request.across > 0.0:
            width = self._width.get(
                lambda: size_from_feature(grid, phi, elements_across=1.0, progress=request.report)
            )
            bounds["width"] = width / request.across
        return _on_grid(grid, phi, bounds, limits, request, self.options)


def mask_domain(mask: Mask, phi: FloatArray) -> LevelSet:
    """Return the domain of the objects of an image, whose boundaries ripple with the pixels.

    The bounds from such boundaries are less accurate than fast marching.  In space, the exact
    method takes longer than all other steps together.
    """
    return LevelSet(
        mask.grid,
        phi,
        spacings_in_smallest=_PIXELS_IN_SMALLEST,
        smoothing=_CURVATURE_SMOOTHING,
        crease_angle=_IMAGE_CREASE_ANGLE,
        options=_IN_SPACE if mask.grid.dim == 3 else None,
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
    request: Request,
    options: Mapping[str, Any] | None = None,
    features: _Features | None = None,
) -> tuple[SizeFunction, SizeReport]:
    """Limit at the nodes inside and around the boundary.  Outside, take the nearest size."""
    from scipy import ndimage

    around = phi <= float(np.linalg.norm(grid.spacing))  # all corners of the boxes at the boundary
    if grid.active is not None:
        around &= grid.active
    bounds |= request.external(grid)
    inner = grid.with_active(around)
    share = np.clip(0.5 - phi / float(grid.spacing.mean()), 0.0, 1.0)
    weights = share * nodal_measures(inner)
    found = features or _Features()
    h, report = limit_requested(
        inner,
        bounds,
        limits,
        request,
        weights,
        points=found.bounds(request),
        options=options,
        is_rough=found.is_rough,
    )
    nearest = ndimage.distance_transform_edt(
        ~around, sampling=grid.spacing, return_distances=False, return_indices=True
    )
    return SizeFunction(grid.with_active(None), h[tuple(nearest)]), report


def mesh_domain(mesh: SimplexMesh, background: AnyBackground | None) -> SizedDomain:
    """Return the domain of a mesh, or the domain that a surface or closed polyline encloses."""
    if background is not None:
        check_type("background", background, SimplexMesh, CartesianGrid, Octree)
    if background is None and mesh.dim == 2 and mesh.cell_dim == 1 and _is_closed(mesh):
        spacing = float(np.ptp(mesh.points, axis=0).max()) / _BOXES_ALONG
        background = CartesianGrid.around(mesh.points, spacing, _BOXES_AROUND * spacing)
    if background is None and mesh.dim == 3 and mesh.cell_dim == 2:
        return SurfaceDomain.of(mesh)
    if background is not None and background.dim != mesh.dim:
        raise ValueError(f"background must be {mesh.dim}-D, got {background!r}")
    return MeshDomain(mesh, background)


def _is_closed(line: SimplexMesh) -> bool:
    ends = np.bincount(line.cells.ravel(), minlength=line.n_points)
    return bool(np.isin(ends, (0, 2)).all())


@dataclass
class MeshDomain:
    """A mesh with its own nodes as background, or with another background."""

    mesh: SimplexMesh
    background: AnyBackground | None
    _radius: _Kept = field(default_factory=_Kept)
    _width: _Kept = field(default_factory=_Kept)
    _features: _Features | None = None

    @property
    def dim(self) -> int:
        """Number of coordinates."""
        return self.mesh.dim

    def limited(self, request: Request) -> tuple[SizeFunction, SizeReport]:
        """Return the limited sizes and which cause controls them where."""
        mesh, background = self.mesh, self.background
        limits = request.limits(mesh.diameter)
        features = self._separated(request)
        if background is None:
            bounds = self._bounds(mesh, None, request) | request.external(mesh)
            return limited_on(mesh, bounds, limits, request, features, with_tolerance=True)
        encloses = mesh.cell_dim == mesh.dim - 1
        boundary = mesh if encloses else mesh.boundary().mesh
        bounds = self._bounds(background, boundary, request)
        if isinstance(background, SimplexMesh):
            bounds |= request.external(background)
            return limited_on(background, bounds, limits, request, features)
        phi = signed_distance(background, boundary, progress=request.report)
        if isinstance(background, CartesianGrid):
            _inside(background, phi)
            return _on_grid(background, phi, bounds, limits, request, features=features)
        bounds |= request.external(background)
        weights = np.where(phi <= 0.0, nodal_measures(background), 0.0)
        return limited_on(background, bounds, limits, request, features, weights)

    def _separated(self, request: Request) -> _Features:
        """Return the features of the boundary, if they count, and the separations there."""
        mesh = self.mesh
        if request.elements_between == 0.0 or mesh.dim == 1 or mesh.cell_dim < mesh.dim - 1:
            return _Features()
        if self._features is None:
            boundary = mesh if mesh.cell_dim < mesh.dim else mesh.boundary().mesh
            faces = Faces.of(boundary, request.crease_angle)
            found = Separation(faces, CORNER_ANGLE, Walls.of(faces))
            report = request.report or silent
            at_nodes = self.background is None
            places, distances = found.at_nodes(report) if at_nodes else found.sampled(report)
            self._features = _Features(places, distances, faces.is_rough, boundary.diameter)
        return self._features

    def _bounds(
        self, background: AnyBackground, boundary: SimplexMesh | None, request: Request
    ) -> dict[str, FloatArray]:
        bounds = {}
        if boundary is None and request.bounds_curvature:
            radius = self._radius.get(lambda: radius_at_curves(self.mesh, request.crease_angle))
            bounds["curvature"] = request.on_curves(radius, self.mesh.diameter)
        elif request.per_radian > 0.0:  # not the size on the boundary alone: no tolerance
            bounds["curvature"] = size_from_curvature(
                background,
                boundary,
                elements_per_radian=request.per_radian,
                crease_angle=request.crease_angle,
            )
        if request.across > 0.0:
            width = self._width.get(lambda: self._widths(background, boundary, request))
            bounds["width"] = width / request.across
        return bounds

    def _widths(
        self, background: AnyBackground, boundary: SimplexMesh | None, request: Request
    ) -> FloatArray:
        """Return the width of the domain, and of each of its regions."""
        angle = request.crease_angle
        width = size_from_feature(
            background, boundary, elements_across=1.0, progress=request.report, crease_angle=angle
        )
        if boundary is not None or self.mesh.cell_dim < self.mesh.dim:
            return width
        return np.minimum(width, width_in_regions(self.mesh, angle, request.report or silent))


class _Features(NamedTuple):
    """Points on the features of a boundary, and the separations there; None: they do not count."""

    places: FloatArray | None = None
    distances: FloatArray | None = None
    is_rough: bool = False
    diameter: float = 0.0
    """Of the boundary."""

    def bounds(self, request: Request) -> PointBounds:
        """Return the sizes that a request asks for at the points."""
        between = request.between(self.is_rough)
        if self.places is None or self.distances is None or between == 0.0:
            return []
        sizes = np.maximum(self.distances, request.least_separation * self.diameter) / between
        return [("separation", self.places, sizes)]


def limited_on(
    background: AnyBackground,
    bounds: dict[str, FloatArray],
    limits: tuple[float, float],
    request: Request,
    features: _Features,
    weights: FloatArray | None = None,
    *,
    with_tolerance: bool = False,
) -> tuple[SizeFunction, SizeReport]:
    """Return the limited minimum of several bounds as a size function, and its report."""
    h, report = limit_requested(
        background,
        bounds,
        limits,
        request,
        weights,
        points=features.bounds(request),
        is_rough=features.is_rough,
        with_tolerance=with_tolerance and "curvature" in bounds,
    )
    sources = None if report.info is None else report.info.sources
    return SizeFunction(background, h, sources=sources), report
