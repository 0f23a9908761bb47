"""Sizes of the solid that a surface encloses, on a refined copy of the surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_sizes, place_text, warn_caller
from adaptsize._defaults import CORNER_ANGLE
from adaptsize._progress import silent
from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.background.merging import ordered_by_place, reordered
from adaptsize.domain_size import tuning
from adaptsize.domain_size.prescribed import bound_at_nodes
from adaptsize.domain_size.refined_surface import RefinedSurface
from adaptsize.domain_size.reports import report_of
from adaptsize.domain_size.request import Request
from adaptsize.domain_size.thin_parts import ThinParts
from adaptsize.errors import InputWarning, OpenSurfaceWarning
from adaptsize.geometry.creases import folds_of, tips_of_cones
from adaptsize.geometry.faces import Faces
from adaptsize.geometry.inside import Inside
from adaptsize.geometry.separation import FeaturePoints, Separation
from adaptsize.geometry.solid import Solid
from adaptsize.geometry.width import Width
from adaptsize.remeshing.meshed_surface import surface_to_fill
from adaptsize.remeshing.preparation import repair_mesh
from adaptsize.remeshing.surface_checks import inner_facets, open_boundary, overlapping_bodies
from adaptsize.sizes import Enclosed
from adaptsize.sizes.curvature import radius_at_curves
from adaptsize.sizes.sources import BallSource, BoxSource, CurveSource, PointSource
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray, ProgressCallback


@dataclass(eq=False)
class SurfaceDomain:
    """The solid that a surface in space encloses, and what its bounds are found with."""

    mesh: SimplexMesh
    """Its nodes and cells ordered by their places."""
    nodes: IndexArray
    """The node of the surface without defects at each node."""
    overlaps: bool
    """Whether bodies of the surface overlap, or intersect themselves."""
    crease_angle: float
    """Degrees."""
    node_map: IntArray | None = None
    """The node of the surface without defects for each given one, -1 for those left out; None: the
    surface had none."""

    @classmethod
    def of(
        cls, mesh: SimplexMesh, crease_angle: float, node_map: IntArray | None = None
    ) -> SurfaceDomain:
        """Return the solid of a surface without defects."""
        ordered, nodes = ordered_by_place(mesh)
        return cls(ordered, nodes, overlapping_bodies(mesh) is not None, crease_angle, node_map)

    @cached_property
    def enclosed(self) -> Enclosed:
        """The solid, to predict the number of elements in it."""
        return Enclosed(self.mesh)

    @cached_property
    def thin_parts(self) -> ThinParts:
        """Its thin walls and narrow faces."""
        return ThinParts(self.faces, self.width)

    @cached_property
    def inside(self) -> Inside:
        """The solid, in which sizes grow."""
        return Inside(self.faces, self.overlaps)

    def size_for(self, request: Request) -> SizeFunction:
        """Return the limited sizes on a refined copy, with a report.

        The bounds are known at points: the width where rays start, in the facets; the separation
        and the curvature of curves on feature edges; the curvature of the surface at its nodes.
        From these points, sizes grow inside the solid.  Edges longer than two sizes are halved, and
        the bounds are found at points between.  A new node on an edge along which the surface bends
        gets the mean of the curvatures at the ends; on the way to the tip of a cone, where there is
        none, it gets half of the radius at the other end.

        The surface gets at most 400 000 nodes, and not more than a tenth of the elements allowed
        where these are above 20 000: a single layer of tetrahedra has about 4.5 per node of it,
        and a thicker solid more than 10.
        A surface with more nodes consists of slivers much narrower than the size, where no finer
        background is needed.  Between two long edges of slivers, halving one makes
        the other the longer one for ever: this ends once a few edges are no shorter.
        """
        if request.h0 is not None and not callable(request.h0):
            request = replace(request, h0=self._at_nodes(request.h0))
        surface = RefinedSurface.of(self, request)
        allowed = tuning.SHARE_ON_SURFACE * request.max_elements
        max_nodes = float(tuning.MOST_NODES_OF_SOURCES)
        if not request.is_fixed:
            max_nodes = min(max_nodes, max(allowed, tuning.FEW_NODES))
        shortest, in_vain = np.inf, 0
        while True:
            limited, mesh = surface.limited(request), surface.mesh
            ratio = mesh.edge_lengths / limited.h[mesh.edges].min(axis=1)
            long, room = ratio > 2.0, max_nodes - mesh.n_points
            for power in range(2, 64):
                if np.count_nonzero(long) <= room:
                    break
                long = ratio > 2.0**power  # the longest ones if not all
            in_vain = 0 if ratio.max() < (1.0 - tuning.LESS) * shortest else in_vain + 1
            shortest = min(shortest, float(ratio.max()))
            is_vain = in_vain > tuning.PASSES_IN_VAIN and long.mean() < tuning.FEW_LONG
            if is_vain or not long.any():
                return surface.size_of(limited)
            surface = surface.split(long, request)

    def _at_nodes(self, h0: npt.ArrayLike) -> FloatArray:
        """Return bounds at given nodes as those at the nodes, the least one of joined nodes."""
        if self.node_map is None:
            return bound_at_nodes(h0, self.mesh)[self.nodes]
        given = as_sizes("h0", h0, self.node_map.shape)
        bounds = np.full(len(self.nodes) + 1, np.inf)  # the last one is that of nodes left out
        np.minimum.at(bounds, self.node_map, given)
        return bounds[self.nodes]

    def in_given_order(self, size: SizeFunction) -> SizeFunction:
        """Return the sizes with the nodes of the surface without defects first, in their order.

        Sizes at the nodes are lowered to those that cells around them allow through the solid.
        """
        mesh, report = size.background, report_of(size)
        assert isinstance(mesh, SimplexMesh), "sizes of a surface are on a copy of it"
        number = np.arange(mesh.n_points, dtype=np.int32)
        number[: len(self.nodes)] = self.nodes
        place = np.argsort(number)
        given = reordered(mesh, place)
        values, cause = size(mesh.points)[place], report.cause[place]
        cause.flags.writeable = False
        bounds = {name: bound[place] for name, bound in report.bounds.items()}
        origin = None if report.origin is None else np.append(number, -1)[report.origin[place]]
        report = replace(report, background=given, cause=cause, bounds=bounds, origin=origin)
        inner = None if size.inner is None else size.inner.reordered(place)
        return SizeFunction(given, values, g=size.g, hmax=size.hmax, report=report, inner=inner)

    @cached_property
    def faces(self) -> Faces:
        """Its faces and feature edges."""
        return Faces.of(self.mesh, self.crease_angle)

    @cached_property
    def radius(self) -> FloatArray:
        """Radius of the surface and its feature edges at the nodes; inf inside of other bodies."""
        radius = radius_at_curves(self.faces.mesh, self.crease_angle)
        radius[self.inner_nodes] = np.inf
        return radius

    @cached_property
    def bent(self) -> IntArray:
        """Edges along which the surface is curved."""
        return folds_of(self.faces.mesh, np.deg2rad(self.crease_angle)).bent

    @cached_property
    def tips(self) -> IndexArray:
        """Nodes where a cone ends, off the feature edges, and where no curvature is known."""
        mesh, angle = self.faces.mesh, np.deg2rad(self.crease_angle)
        found = np.setdiff1d(tips_of_cones(mesh.points, mesh.cells, angle), self.faces.features)
        return found[np.isinf(self.radius[found])]

    @cached_property
    def inner_nodes(self) -> BoolArray:
        """Which nodes are inside of other bodies, with all facets around them."""
        mesh = self.faces.mesh
        inner = np.zeros(mesh.n_points, np.bool_)
        if not self.overlaps:
            return inner
        owners = np.repeat(np.arange(mesh.n_cells), 3)
        own = self.width.are_inner(self.faces.frame.of(mesh.points)[mesh.cells.ravel()], owners)
        inner[mesh.cells] = True
        inner[mesh.cells.ravel()[~own]] = False
        return inner

    @cached_property
    def width(self) -> Width:
        """What shoots rays through the solid."""
        return Width(self.faces, CORNER_ANGLE, self.overlaps)

    @cached_property
    def separation(self) -> Separation:
        """What finds distances between features."""
        return Separation(self.faces, CORNER_ANGLE, self.width.walls)

    @cached_property
    def first_samples(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The width at the nodes of the given surface, and points in its facets with theirs."""
        faces = self.faces
        found = self.width.samples(silent)
        kept = (found.corner < 0) & np.isfinite(found.widths)
        frame = faces.frame
        places = found.points[kept] / frame.scale + frame.origin
        return self.width.nodal(found), places, found.widths[kept] / frame.scale

    def widths(
        self, places: FloatArray, owners: IndexArray, report: ProgressCallback
    ) -> FloatArray:
        """Return the width at points in given facets, places in the frame."""
        return self.width.shoot(places, owners, report) / self.faces.frame.scale

    @cached_property
    def first_separations(self) -> FloatArray:
        """Separations at the nodes of the surface, inf off its feature edges."""
        nodes = self.separation.nodes
        return self.separations(nodes.node, nodes, silent, self.faces.mesh.n_points)

    def separations(
        self, at: IndexArray, which: FeaturePoints, report: ProgressCallback, n: int
    ) -> FloatArray:
        """Return n separations, those at given places in the list and inf elsewhere."""
        nodal = np.full(n, np.inf)
        nodal[at] = self.separation.at(which, report) / self.faces.frame.scale
        return nodal


def warn_of_left_out(surface: SimplexMesh) -> None:
    """Warn of repaired defects of a surface, of closed holes, and of facets that bound no sizes.

    Warns
    -----
    InputWarning, OpenSurfaceWarning
    """
    repaired = repair_mesh(surface)
    if repaired.repairs:
        warn_caller(repaired.repairs, InputWarning)
    if surface_to_fill(surface).n_caps:
        holes = open_boundary(repaired.mesh)
        warn_caller(f"the surface is open: {holes}; flat caps close it", OpenSurfaceWarning)
    found = overlapping_bodies(repaired.mesh) or inner_facets(Solid.of(repaired.mesh))
    if found is not None:
        text = f"{found}; facets inside of bodies do not bound the sizes"
        warn_caller(text, OpenSurfaceWarning)


def warn_of_outside(domain: SurfaceDomain, sources: Sequence[Any], g: float) -> None:
    """Warn of sources outside a part, if that increases their sizes by more than a fifth.

    They act on the closest point of the surface, with their distance from it.
    """
    for source in sources:
        places, sizes, reach = _extent(source)
        away = domain.inside.moved_inside(places)[1] - reach
        excess = g * away / sizes
        if len(excess) == 0 or excess.max() <= 0.2:
            continue
        worst = int(np.argmax(excess))
        warn_caller(
            f"{type(source).__name__} requests the size {sizes[worst]:.4g} at "
            f"{place_text(places[worst])}, which is {away[worst]:.4g} outside of the part: it acts "
            "on the closest point of the surface, with its distance from it",
            InputWarning,
        )


def _extent(source: Any) -> tuple[FloatArray, FloatArray, float]:
    """Return points of a source, the sizes there, and how far it extends from them."""
    if isinstance(source, PointSource | CurveSource):
        return *source.rows(3), 0.0
    if isinstance(source, BallSource):
        return source.middle(3)[None, :], np.array([float(source.size)]), float(source.radius)
    if isinstance(source, BoxSource):
        lower, upper = source.corners(3)
        radius = 0.5 * float(np.linalg.norm(upper - lower))
        return 0.5 * (lower + upper)[None, :], np.array([float(source.size)]), radius
    return np.empty((0, 3)), np.empty(0), 0.0
