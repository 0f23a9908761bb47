"""The size function of each kind of domain: bounds from its shape, then gradient limiting."""

from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np

from adaptsize._causes import CURVATURE, H0, SEPARATION, WIDTH, Cause
from adaptsize._defaults import CORNER_ANGLE
from adaptsize._size_function import SizeFunction
from adaptsize.background import AnyBackground, CartesianGrid, SimplexMesh
from adaptsize.background.enclosing import enclosing_diameter
from adaptsize.background.interfaces import skin_of
from adaptsize.domain_size.bounds import Bounds
from adaptsize.domain_size.on_surface import SurfaceDomain
from adaptsize.domain_size.prescribed import BoundsByCause, bound_at_nodes
from adaptsize.domain_size.request import Request
from adaptsize.domain_size.resolution import with_sources_resolved
from adaptsize.geometry.distance.signed_distance import signed_distance
from adaptsize.geometry.faces import Faces
from adaptsize.geometry.separation import Separation
from adaptsize.geometry.walls import WallTree
from adaptsize.limiting.problem import Scheme
from adaptsize.quality.elements import refuse_folded
from adaptsize.remeshing.meshed_surface import surface_to_fill
from adaptsize.remeshing.preparation import repair_mesh
from adaptsize.sizes import size_from_curvature, size_from_feature
from adaptsize.sizes.budget import nodal_measures
from adaptsize.sizes.curvature import radius_at_curves
from adaptsize.sizes.feature import width_in_regions
from adaptsize.typing import BoolArray, FloatArray


class SizedDomain(Protocol):
    """A domain whose size function can be made for several requests."""

    def size_for(self, request: Request) -> SizeFunction:
        """Return the limited sizes, with a report on which cause controls them where."""
        ...


@dataclass
class LevelSet:
    """The region where a signed distance on a grid is negative."""

    grid: CartesianGrid
    phi: FloatArray
    _width: FloatArray | None = None
    """Found once: it does not depend on the request."""

    def size_for(self, request: Request) -> SizeFunction:
        """Return the limited sizes, with a report on which cause controls them where.

        The smallest size by default is one spacing.
        """
        grid, phi = self.grid, self.phi
        inside = _inside(grid, phi)
        bounds: dict[Cause, FloatArray] = {}
        if request.per_radian > 0.0:
            bounds[CURVATURE] = size_from_curvature(
                grid,
                phi,
                elements_per_radian=request.per_radian,
                crease_angle=request.crease_angle,
                g=request.g,
            )
        if request.across > 0.0:
            if self._width is None:
                self._width = size_from_feature(
                    grid, phi, elements_across=1.0, progress=request.progress
                )
            bounds[WIDTH] = self._width / request.across
        limits = request.limits(diameter_of(grid, inside), float(grid.spacing.max()))
        return limited_on_grid(phi, Bounds(grid, bounds, limits), request)


def _inside(grid: CartesianGrid, phi: FloatArray) -> BoolArray:
    inside = phi < 0.0
    if grid.active is not None:
        inside &= grid.active
    check_signs(inside, phi, grid)
    return inside


def diameter_of(grid: CartesianGrid, inside: BoolArray) -> float:
    """Return the diameter of the smallest ball around the inside nodes."""
    lines = np.argwhere(inside.any(axis=0))
    along = inside[(slice(None), *lines.T)]
    ends = along.argmax(axis=0), len(along) - 1 - along[::-1].argmax(axis=0)
    index = np.concatenate([np.column_stack([end, lines]) for end in ends])
    return enclosing_diameter(grid.origin + grid.spacing * index)


def check_signs(inside: BoolArray, phi: FloatArray, background: AnyBackground) -> None:
    """Raise a ValueError unless a domain has nodes inside and outside."""
    if not inside.any():
        raise ValueError(
            f"domain must be negative at a node of the background, got none of {background!r}"
        )
    if not (phi > 0.0).any():
        raise ValueError(
            f"domain must have its boundary in the background, got all of {background!r} inside"
        )


def limited_on_grid(
    phi: FloatArray,
    bounds: Bounds,
    request: Request,
    counted: BoolArray | None = None,
    scheme: Scheme | None = None,
) -> SizeFunction:
    """Limit at the nodes inside and around the boundary.  Outside, take the nearest size.

    ``counted`` are the nodes of the domain that the report counts, by default all; ``scheme`` is
    that of `limit_gradient`.
    """
    from scipy import ndimage

    grid = bounds.background
    assert isinstance(grid, CartesianGrid), "bounds of images and level sets are on grids"
    around = phi <= float(np.linalg.norm(grid.spacing))  # all corners of the boxes at the boundary
    if grid.active is not None:
        around &= grid.active
    inner = grid.with_active(around)
    share = np.clip(0.5 - phi / float(grid.spacing.mean()), 0.0, 1.0)
    if counted is not None:
        share = np.where(counted, share, 0.0)
    of_inner = replace(
        bounds,
        background=inner,
        nodal={**bounds.nodal, **request.external(grid)},
        weights=share * nodal_measures(inner),
    )
    limited = of_inner.limited(request, scheme)
    nearest = ndimage.distance_transform_edt(
        ~around, sampling=grid.spacing, return_distances=False, return_indices=True
    )
    return SizeFunction(grid.with_active(None), limited.h[tuple(nearest)], report=limited.report)


def mesh_domain(
    mesh: SimplexMesh,
    background: AnyBackground | None,
    crease_angle: float,
    *,
    tolerance: float = np.inf,
    is_filled: bool = True,
) -> SizedDomain:
    """Return the domain of a mesh, or the domain that a surface or closed polyline encloses.

    That of a surface is bounded by what `remesh` fills within the tolerance.  Where it is not
    filled, all facets count.
    """
    if background is None and mesh.dim == 2 and mesh.cell_dim == 1:
        ends = np.bincount(mesh.cells.ravel(), minlength=mesh.n_points)
        if np.isin(ends, (0, 2)).all():  # closed: 250 boxes along the longest side, 6 around it
            spacing = float(np.ptp(mesh.points, axis=0).max()) / 250
            background = CartesianGrid.around(mesh.points, spacing, 6 * spacing)
    if mesh.dim == 3 and mesh.cell_dim == 2:
        sound = surface_to_fill(mesh, tolerance).sound if is_filled else repair_mesh(mesh)
        if background is None:
            return SurfaceDomain.of(sound.mesh, crease_angle, sound.node_map)
        mesh = sound.mesh
    if background is not None and background.dim != mesh.dim:
        raise ValueError(f"background must be {mesh.dim}-D, got {background!r}")
    if mesh.dim == mesh.cell_dim == 2:
        refuse_folded(mesh)
    return MeshDomain(mesh, background)


class _Features(NamedTuple):
    """Points on the features of a boundary, and the separations there."""

    places: FloatArray
    distances: FloatArray
    is_rough: bool
    diameter: float
    """Of the boundary."""


@dataclass
class MeshDomain:
    """A mesh with its own nodes as background, or with another background."""

    mesh: SimplexMesh
    background: AnyBackground | None
    # Found once: they do not depend on the request.
    _radius: FloatArray | None = None
    _width: FloatArray | None = None
    _features: _Features | None = None

    def size_for(self, request: Request) -> SizeFunction:
        """Return the limited sizes, with a report on which cause controls them where.

        If the mesh is the background, its cells are divided at sources that are smaller; bounds
        from the shape are found at the given nodes, and are linear between them.
        """
        mesh, background = self.mesh, self.background or self.mesh
        limits = request.limits(mesh.diameter, of_chords=self.background is None)
        bounds = Bounds(background, {}, limits)
        bounds.points, bounds.is_rough = self._separated(request)
        if self.background is None:
            bounds.nodal = self._bounds(mesh, None, request)
            if request.h0 is not None and not callable(request.h0):
                bounds.nodal[H0] = bound_at_nodes(request.h0, mesh)
            finer = with_sources_resolved(mesh, request)
            if finer is not None:
                bounds.background = finer.mesh
                bounds.nodal = {k: finer.extended(bound) for k, bound in bounds.nodal.items()}
            # Sources come before the function or the array that is given as a bound.
            given = bounds.nodal.pop(H0, None)
            bounds.nodal |= request.external(bounds.background, given)
            bounds.of_chords = True
            return _sized(bounds, request)
        boundary = skin_of(mesh)[0]
        bounds.nodal = self._bounds(background, boundary, request)
        if not isinstance(background, SimplexMesh):
            phi = signed_distance(background, boundary, progress=request.progress)
            if isinstance(background, CartesianGrid):
                _inside(background, phi)
                return limited_on_grid(phi, bounds, request)
            bounds.weights = np.where(phi <= 0.0, nodal_measures(background), 0.0)
        bounds.nodal |= request.external(background)
        return _sized(bounds, request)

    def _separated(self, request: Request) -> tuple[BoundsByCause, bool]:
        """Return the bounds by the separation of features, and whether the boundary is rough."""
        mesh = self.mesh
        disabled = request.options["elements_between"] == 0.0
        if disabled or mesh.dim == 1 or mesh.cell_dim < mesh.dim - 1:
            return [], False
        if self._features is None:
            boundary = skin_of(mesh)[0]
            faces = Faces.of(boundary, request.crease_angle)
            found = Separation(faces, CORNER_ANGLE, WallTree.of(faces))
            sampled = found.at_nodes if self.background is None else found.sampled
            self._features = _Features(
                *sampled(request.progress), faces.is_rough, boundary.diameter
            )
        places, distances, is_rough, diameter = self._features
        if request.between(is_rough) == 0.0:
            return [], is_rough
        sizes = request.on_features(distances, diameter, is_rough)
        return [(SEPARATION, places, sizes)], is_rough

    def _bounds(
        self, background: AnyBackground, boundary: SimplexMesh | None, request: Request
    ) -> dict[Cause, FloatArray]:
        mesh, angle = self.mesh, request.crease_angle
        bounds: dict[Cause, FloatArray] = {}
        if boundary is None and request.bounds_curvature:
            if self._radius is None:
                self._radius = radius_at_curves(mesh, angle)
            bounds[CURVATURE] = request.on_curves(self._radius, mesh.diameter)
        elif request.per_radian > 0.0:  # not the size on the boundary alone: no tolerance
            bounds[CURVATURE] = size_from_curvature(
                background, boundary, elements_per_radian=request.per_radian, crease_angle=angle
            )
        if request.across > 0.0:
            if self._width is None:
                self._width = self._widths(background, boundary, request)
            bounds[WIDTH] = self._width / request.across
        return bounds

    def _widths(
        self, background: AnyBackground, boundary: SimplexMesh | None, request: Request
    ) -> FloatArray:
        """Return the width of the domain, and of each of its regions."""
        angle = request.crease_angle
        width = size_from_feature(
            background, boundary, elements_across=1.0, progress=request.progress, crease_angle=angle
        )
        if boundary is not None or self.mesh.cell_dim < self.mesh.dim:
            return width
        return np.minimum(width, width_in_regions(self.mesh, angle, request.progress))


def _sized(bounds: Bounds, request: Request) -> SizeFunction:
    """Return the limited minimum of the bounds as a size function, with a report."""
    limited = bounds.limited(request)
    info, report = limited.sizes.info, limited.report
    sources = None if info is None else info.sources
    return SizeFunction(bounds.background, limited.h, sources=sources, report=report)
