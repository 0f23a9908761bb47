"""The bounds of the sizes on a surface: a table, one class per cause.

A bound is measured at the nodes of the given surface, then at the new nodes of each refinement, and
turned into sizes by the request.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from adaptsize._causes import CURVATURE, H0, SEPARATION, WIDTH, Cause
from adaptsize.domain_size.prescribed import bound_at_nodes
from adaptsize.domain_size.request import Request
from adaptsize.geometry.separation import FeaturePoints
from adaptsize.typing import FloatArray, IndexArray, IntArray

if TYPE_CHECKING:
    from adaptsize.background.splitting import SplitMesh
    from adaptsize.domain_size.on_surface import SurfaceDomain
    from adaptsize.domain_size.refined_surface import RefinedSurface


class SurfaceBound(ABC):
    """One cause of small sizes on a surface."""

    cause: ClassVar[Cause]

    @abstractmethod
    def first(self, solid: SurfaceDomain, request: Request) -> FloatArray | None:
        """Return the measure at the nodes of the given surface, inf where there is none.

        None if the request does not have this bound.
        """

    @abstractmethod
    def at_new(
        self, surface: RefinedSurface, split: SplitMesh, longer: FloatArray, request: Request
    ) -> None:
        """Fill the measure at new nodes; ``longer`` (In/Out) is known at the old ones, else inf."""

    @abstractmethod
    def sizes(self, measure: FloatArray, solid: SurfaceDomain, request: Request) -> FloatArray:
        """Return the sizes that the request needs for a measure."""


def _means_along_bends(
    surface: RefinedSurface, split: SplitMesh, longer: FloatArray
) -> tuple[IndexArray, IntArray, FloatArray]:
    """Fill the harmonic means of the ends of edges along which the surface is curved.

    Returned are the new nodes on them, the ends, and the measures there.
    """
    n, parents = surface.mesh.n_points, surface.mesh.edges[split.split_edges]
    curved = np.flatnonzero(surface.bent.find(parents) >= 0)
    ends = longer[parents[curved]]
    longer[n + curved] = 2.0 / (1.0 / ends).sum(axis=1).clip(1e-300)
    return n + curved, parents[curved], ends


class Curvature(SurfaceBound):
    """Radii of the surface and of its feature edges."""

    cause = CURVATURE

    def first(self, solid: SurfaceDomain, request: Request) -> FloatArray | None:
        """Return the radii, if curved boundaries are resolved."""
        return solid.radius if request.bounds_curvature else None

    def at_new(
        self, surface: RefinedSurface, split: SplitMesh, longer: FloatArray, request: Request
    ) -> None:
        """Fill means of the curvatures at the ends; new nodes on flat parts have none."""
        nodes, parents, ends = _means_along_bends(surface, split, longer)
        # Along a cone, the radius is proportional to the distance from its tip.
        to_tip = np.isin(parents, surface.solid.tips).any(axis=1)
        longer[nodes[to_tip]] = 0.5 * ends[to_tip].min(axis=1)

    def sizes(self, measure: FloatArray, solid: SurfaceDomain, request: Request) -> FloatArray:
        """Return sizes that resolve the radii."""
        return request.on_curves(measure, solid.faces.mesh.diameter)


class FeatureSeparation(SurfaceBound):
    """Distances between features.

    Where bodies overlap, their features cross each other, and are no features of the union.
    """

    cause = SEPARATION

    def first(self, solid: SurfaceDomain, request: Request) -> FloatArray | None:
        """Return the distances, if close features are resolved."""
        if request.between(solid.faces.is_rough) > 0.0 and not solid.overlaps:
            return solid.first_separations
        return None

    def at_new(
        self, surface: RefinedSurface, split: SplitMesh, longer: FloatArray, request: Request
    ) -> None:
        """Fill the distances of new nodes on feature edges."""
        n, parents = surface.mesh.n_points, surface.mesh.edges[split.split_edges]
        row = surface.features.find(parents)
        at = np.flatnonzero(row >= 0)
        places = surface.solid.faces.frame.of(split.mesh.points[n + at])
        which = FeaturePoints(places, np.full(len(at), -1), row[at])
        longer[n:] = surface.solid.separations(at, which, request.progress, len(longer) - n)

    def sizes(self, measure: FloatArray, solid: SurfaceDomain, request: Request) -> FloatArray:
        """Return sizes between the features."""
        faces = solid.faces
        return request.on_features(measure, faces.mesh.diameter, faces.is_rough)


class LocalWidth(SurfaceBound):
    """Widths of the solid, also at points in the facets (`RefinedSurface.in_facets`)."""

    cause = WIDTH

    def first(self, solid: SurfaceDomain, request: Request) -> FloatArray | None:
        """Return the widths, if narrow parts are resolved."""
        return solid.first_samples[0] if request.across > 0.0 else None

    def at_new(
        self, surface: RefinedSurface, split: SplitMesh, longer: FloatArray, request: Request
    ) -> None:
        """Fill the widths at new nodes, where rays start from."""
        node, places, owners = surface.starts(split)
        np.minimum.at(longer, node, surface.solid.widths(places, owners, request.progress))

    def sizes(self, measure: FloatArray, solid: SurfaceDomain, request: Request) -> FloatArray:
        """Return the size for the requested number of elements across.

        From the surface to the middle, at a distance W / 2, sizes grow to h + g W / 2.  The
        integral of 1 / h along that path is half the number of elements.
        """
        walls = request.across_walls(measure, solid.faces.mesh.diameter)
        if request.g == 0.0:
            return walls / request.across
        growth = min(0.5 * request.g * request.across, 100.0)
        share: float = 0.5 * request.g / np.expm1(growth)
        return share * walls


class GivenSizes(SurfaceBound):
    """The sizes h0 of the request."""

    cause = H0

    def first(self, solid: SurfaceDomain, request: Request) -> FloatArray | None:
        """Return them, if there are any."""
        return None if request.h0 is None else bound_at_nodes(request.h0, solid.mesh)

    def at_new(
        self, surface: RefinedSurface, split: SplitMesh, longer: FloatArray, request: Request
    ) -> None:
        """Fill means along curved edges: elsewhere, sizes that grow from the old nodes suffice."""
        _means_along_bends(surface, split, longer)

    def sizes(self, measure: FloatArray, solid: SurfaceDomain, request: Request) -> FloatArray:
        """Return them."""
        return measure


#: In the order of the report: where two bounds are equal, the first one is the cause.
BOUNDS: Sequence[SurfaceBound] = (Curvature(), FeatureSeparation(), LocalWidth(), GivenSizes())
BY_CAUSE = {bound.cause: bound for bound in BOUNDS}
