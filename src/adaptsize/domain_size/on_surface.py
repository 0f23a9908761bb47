"""Sizes of the solid that a surface encloses, on a refined copy of the surface."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.background.flipping import flip_edges
from adaptsize.background.folds import Folds, folds_of
from adaptsize.background.splitting import split_edges
from adaptsize.background.topology import are_among
from adaptsize.domain_size.report import SizeReport
from adaptsize.domain_size.request import Request, bound_at_nodes, limit_requested
from adaptsize.errors import OpenSurfaceWarning
from adaptsize.geometry.distance.orientation import oriented
from adaptsize.geometry.distance.winding import WindingNumber
from adaptsize.geometry.medial.inscribed_spheres import InscribedSpheres, SphereFinder
from adaptsize.remeshing.overlaps import overlapping_bodies
from adaptsize.sizes import size_from_feature
from adaptsize.typing import BoolArray, FloatArray, IntArray

#: The background of a surface is refined until no edge is longer than this many sizes ...
_EDGE_OVER_SIZE = 2.0
#: ... or it would have more nodes than this,
_MAX_NODES = 400_000
#: or more than this share of the elements allowed.  A single layer of tetrahedra has about 4.5
#: per node of such a surface, and a thicker solid has more than 10.  A surface with more nodes
#: consists of slivers much narrower than the size, where no finer background is needed.
_NODES_PER_ELEMENT = 1.0 / 10.0
#: Distance from the surface over its diagonal at which a point is outside or in another body.
_BESIDE = 1e-6
#: Sizes grow from a surface to the middle by at most this power of e.
_MOST_E_FOLDS = 100.0
#: From `SurfaceDomain.of` to the caller of `size_function`.
_STACK_LEVEL = 5


@dataclass
class SurfaceDomain:
    """The solid that a surface in space encloses."""

    mesh: SimplexMesh
    winding: WindingNumber | None = None
    """That of the surface if it has bodies that overlap."""

    @classmethod
    def of(cls, mesh: SimplexMesh) -> SurfaceDomain:
        """Return the solid, and warn if bodies of the surface overlap."""
        overlapping = overlapping_bodies(mesh)
        if overlapping is None:
            return cls(mesh)
        warnings.warn(
            f"{overlapping}; facets inside of bodies do not bound the sizes",
            OpenSurfaceWarning,
            stacklevel=_STACK_LEVEL,
        )
        return cls(mesh, WindingNumber(oriented(mesh)[0]))

    @property
    def dim(self) -> int:
        """Number of coordinates."""
        return self.mesh.dim

    @cached_property
    def _width(self) -> FloatArray:
        """Local feature size at the nodes, for the crease angle of the first request."""
        if self.winding is not None:
            return self._smallest(self._finder.at_nodes())
        return size_from_feature(self.mesh, elements_across=2.0, crease_angle=self._crease_angle)

    @cached_property
    def _finder(self) -> SphereFinder:
        return SphereFinder(self.mesh, crease_angle=self._crease_angle)

    def _smallest(self, spheres: InscribedSpheres) -> FloatArray:
        """Return the smallest radius of each owner, of the spheres between points of the boundary.

        Where bodies overlap, facets of one are inside the other.  They are not the boundary of the
        solid, and the spheres there become arbitrarily small where the bodies meet.
        """
        if self.winding is None:
            return spheres.smallest()
        met = np.flatnonzero(np.isfinite(spheres.radii))
        outward = (spheres.contacts - spheres.centres)[met] / spheres.radii[met, None]
        inner = self._are_inside(spheres.points, -spheres.normals)
        inner[met] |= self._are_inside(spheres.contacts[met], outward)
        return replace(spheres, radii=np.where(inner, np.inf, spheres.radii)).smallest()

    def _are_inside(self, points: FloatArray, outward: FloatArray) -> BoolArray:
        """Return whether points of a body with their normals are inside of another body."""
        assert self.winding is not None
        return self.winding.contains(points + _BESIDE * self.mesh.diagonal * outward)

    def _without_inner(self, bound: FloatArray) -> FloatArray:
        """Return a bound at the nodes, inf at those inside other bodies."""
        if self.winding is None:
            return bound
        spheres = self._finder.at_nodes()
        inner = self._are_inside(spheres.points, -spheres.normals)
        outer = np.bincount(spheres.owners, ~inner, spheres.n_owners)
        count = np.bincount(spheres.owners, minlength=spheres.n_owners)
        return np.where((outer == 0) & (count > 0), np.inf, bound)

    def limited(self, request: Request) -> tuple[SizeFunction, SizeReport]:
        """Return the limited sizes on a refined copy, and which cause controls them where.

        A new node on an edge along which the surface bends gets the mean of the
        curvatures at the ends.  A new node in a flat facet, or on a feature edge, gets no
        curvature.  There the sizes may grow from the nodes of the file, however far apart
        these are.  Edges in flat facets are flipped to avoid slivers, which makes gradient
        limiting faster and more accurate.
        """
        self._crease_angle = request.crease_angle
        mesh, max_nodes = self.mesh, float(_MAX_NODES)
        if not request.is_fixed:
            max_nodes = min(max_nodes, _NODES_PER_ELEMENT * request.max_elements)
        bounds = _bounds_at_nodes(mesh, request)
        if "curvature" in bounds:
            bounds["curvature"] = self._without_inner(bounds["curvature"])
        folds = folds_of(mesh, np.deg2rad(request.crease_angle))
        across = across_surface(self._width, request) if request.across > 0.0 else None
        while True:
            mesh = flip_edges(mesh, np.concatenate([folds.bent, folds.sharp]))
            size, report = _limited(mesh, bounds, across, request)
            ends = size.values[mesh.edges].min(axis=1)
            long = mesh.edge_lengths > _EDGE_OVER_SIZE * ends
            if not long.any() or mesh.n_points + int(long.sum()) > max_nodes:
                return size, report
            split = split_edges(mesh, long)
            parents = mesh.edges[split.split_edges]
            bounds = _at_middles(bounds, parents, folds)
            folds = folds.split(parents, mesh.n_points)
            if across is not None:
                spheres = self._finder.near(split.mesh.points[mesh.n_points :])
                across = np.concatenate([across, across_surface(self._smallest(spheres), request)])
            mesh = split.mesh


def across_surface(lfs: FloatArray, request: Request) -> FloatArray:
    """Return the size on a surface for the requested number of elements across.

    From the surface to the middle, at a distance lfs, sizes grow to h + g lfs.  The integral of
    1 / h along that path is half the number of elements.
    """
    if request.g == 0.0:
        return 2.0 / request.across * lfs
    growth = min(0.5 * request.g * request.across, _MOST_E_FOLDS)
    share: float = request.g / np.expm1(growth)
    return share * lfs


def _bounds_at_nodes(mesh: SimplexMesh, request: Request) -> dict[str, FloatArray]:
    """Return the bounds that new nodes inherit from the nodes of the file."""
    bounds = {}
    if request.bounds_curvature:
        bounds["curvature"] = request.on_curves(mesh)
    if request.h0 is not None:
        bounds["h0"] = bound_at_nodes(request.h0, mesh)
    return bounds


def _at_middles(
    bounds: dict[str, FloatArray], parents: IntArray, folds: Folds
) -> dict[str, FloatArray]:
    """Return bounds extended to new nodes at edge midpoints, inf where the surface is flat."""
    curved = are_among(parents, folds.bent)
    longer = {}
    for name, h0 in bounds.items():
        at_middle = np.full(len(parents), np.inf)
        at_middle[curved] = 2.0 / (1.0 / h0[parents[curved]]).sum(axis=1).clip(1e-300)
        longer[name] = np.concatenate([h0, at_middle])
    return longer


def through_the_inside(size: SizeFunction) -> SizeFunction:
    """Return sizes on the surface lowered to the growth through the solid."""
    background = size.background
    return SizeFunction(background, size(background.points), g=size.g, hmax=size.hmax)


def _limited(
    mesh: SimplexMesh, bounds: dict[str, FloatArray], across: FloatArray | None, request: Request
) -> tuple[SizeFunction, SizeReport]:
    every = bounds if across is None else bounds | {"feature size": across}
    every = every | request.from_sources(mesh)
    limits = request.limits(mesh.diagonal)
    h, report = limit_requested(mesh, every, limits, request, with_tolerance="curvature" in bounds)
    return SizeFunction(mesh, h, g=request.g, hmax=limits[1]), report
