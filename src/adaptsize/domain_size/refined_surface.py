"""A surface that is refined until its sizes are known, with the bounds at its nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from adaptsize._causes import WIDTH, Cause
from adaptsize._size_function import SizeFunction
from adaptsize.background import SimplexMesh
from adaptsize.background.splitting import SplitMesh, halved_edges, split_edges
from adaptsize.background.topology import marked, rows_among
from adaptsize.domain_size.bounds import Bounds, LimitedBounds
from adaptsize.domain_size.prescribed import BoundsByCause
from adaptsize.domain_size.request import Request
from adaptsize.domain_size.surface_bounds import BOUNDS, BY_CAUSE
from adaptsize.geometry import tuning
from adaptsize.limiting.inside import InnerSizes, InnerSource
from adaptsize.sizes.inside import at_nodes_only, inner_sources
from adaptsize.typing import BoolArray, FloatArray, IndexArray, IntArray

if TYPE_CHECKING:
    from adaptsize.domain_size.on_surface import SurfaceDomain


@dataclass(frozen=True, eq=False)
class _Marked:
    """Edges of the refined surface that lie on certain edges of the given one."""

    edges: IntArray
    """int32[k, 2], rows sorted."""
    row: IndexArray
    """int[k]: what each lies on."""

    def find(self, edges: IntArray) -> IndexArray:
        """Return for each edge, int32[n, 2], what it lies on, else -1."""
        place = rows_among(edges, self.edges)
        return np.append(self.row, -1)[place]

    def split(self, parents: IntArray, n_points: int) -> _Marked:
        """Return the edges after those in ``parents`` were halved; row k has node n_points + k."""
        edges, origin = halved_edges(self.edges, parents, n_points)
        return _Marked(edges, self.row[origin])


@dataclass(frozen=True, eq=False)
class RefinedSurface:
    """A refined copy of a surface, and the bounds at points of it."""

    solid: SurfaceDomain
    mesh: SimplexMesh
    owner: IndexArray
    """The facet of the given surface of which each triangle is a part."""
    nodal: dict[Cause, FloatArray]
    """The measures of `BOUNDS` at the nodes, by their causes."""
    in_facets: BoundsByCause
    """Widths at points in the facets of the given surface."""
    features: _Marked
    bent: _Marked
    sources: Sequence[InnerSource]
    """Those of the request that act inside."""

    @classmethod
    def of(cls, solid: SurfaceDomain, request: Request) -> RefinedSurface:
        """Return the surface as it is given."""
        faces = solid.faces
        first = {bound.cause: bound.first(solid, request) for bound in BOUNDS}
        nodal = {cause: measure for cause, measure in first.items() if measure is not None}
        in_facets: BoundsByCause = []
        if WIDTH in nodal:
            _, places, widths = solid.first_samples
            in_facets = [(WIDTH, places, widths)]
        return cls(
            solid,
            faces.mesh,
            np.arange(faces.mesh.n_cells),
            nodal,
            in_facets,
            _Marked(faces.features, np.arange(len(faces.features))),
            _Marked(solid.bent, np.zeros(len(solid.bent), np.intp)),
            inner_sources(request.sources, solid.mesh, request.limits(solid.mesh.diameter)[1]),
        )

    def limited(self, request: Request) -> LimitedBounds:
        """Return the limited sizes at the nodes."""
        mesh, faces = self.mesh, self.solid.faces
        inside = self.solid.inside
        normals = inside.normals_of_parts(mesh, self.owner)
        at_nodes = request.from_sources(mesh, at_nodes_only(request.sources))
        bounds = {
            cause: BY_CAUSE[cause].sizes(measure, self.solid, request)
            for cause, measure in self.nodal.items()
        }
        points = [
            (cause, at, BY_CAUSE[cause].sizes(width, self.solid, request))
            for cause, at, width in self.in_facets
        ]
        return Bounds(
            mesh,
            bounds | at_nodes,
            request.limits(faces.mesh.diameter, of_chords=True),
            points=points,
            is_rough=faces.is_rough,
            solid=(inside, normals),
            inner=self.sources,
            of_chords=True,
        ).limited(request)

    def size_of(self, limited: LimitedBounds) -> SizeFunction:
        """Return the size function of limited sizes, with a report."""
        report, solid = limited.report, limited.bounds.solid
        assert solid is not None, "those of a surface have one"
        inner = tuple(source.clipped(report.hmin, np.inf) for source in self.sources)
        return SizeFunction(
            self.mesh, limited.h, g=report.g, hmax=report.hmax, report=report,
            inner=InnerSizes(*solid, limited.aims, inner),
        )  # fmt: skip

    def split(self, long: BoolArray, request: Request) -> RefinedSurface:
        """Return the surface with some edges halved, with bounds at the new nodes and facets."""
        split = split_edges(self.mesh, long)
        mesh, owner = split.mesh, self.owner[split.parents]
        parents = self.mesh.edges[split.split_edges]
        nodal = {}
        for cause, measure in self.nodal.items():
            nodal[cause] = np.full(mesh.n_points, np.inf)
            nodal[cause][: len(measure)] = measure
            BY_CAUSE[cause].at_new(self, split, nodal[cause], request)
        in_facets = list(self.in_facets)
        if WIDTH in nodal:
            in_facets.append(self._in_new_facets(split, owner, nodal[WIDTH], request))
        return RefinedSurface(
            self.solid,
            mesh,
            owner,
            nodal,
            in_facets,
            self.features.split(parents, self.mesh.n_points),
            self.bent.split(parents, self.mesh.n_points),
            self.sources,
        )

    def _in_new_facets(
        self, split: SplitMesh, owner: IndexArray, widths: FloatArray, request: Request
    ) -> tuple[Cause, FloatArray, FloatArray]:
        """Return the widths at the centroids of new triangles with a node where none counts.

        At the end of a narrow part, the rays from nodes may leave through the end.
        """
        cells = split.mesh.cells
        is_new = np.bincount(split.parents)[split.parents] > 1
        chosen = np.flatnonzero(is_new & np.isinf(widths[cells]).any(axis=1))
        middles = split.mesh.points[cells[chosen]].mean(axis=1)
        places = self.solid.faces.frame.of(middles)
        found = self.solid.widths(places, owner[chosen], request.progress)
        counts = np.isfinite(found)
        return WIDTH, middles[counts], found[counts]

    def starts(self, split: SplitMesh) -> tuple[IndexArray, FloatArray, IndexArray]:
        """Return new nodes, points in the frame where rays for them start, and their facets.

        On the edge between two facets of the given surface, a ray starts beside it on each.
        """
        mesh, n = self.mesh, self.mesh.n_points
        places = self.solid.faces.frame.of(split.mesh.points)
        number = np.full(len(mesh.edges), -1)
        number[split.split_edges] = np.arange(n, n + len(split.split_edges))
        cell, v = np.nonzero(number[mesh.cell_facets] >= 0)
        node, owner = number[mesh.cell_facets[cell, v]], self.owner[cell]
        first = np.full(split.mesh.n_points, -1)
        first[node] = owner
        is_between = marked(node[owner != first[node]], split.mesh.n_points)
        beside = np.flatnonzero(is_between[node])
        inside = np.unique(node[~is_between[node]])
        starts = places[node[beside]]
        starts += tuning.BESIDE_EDGE * (places[mesh.cells[cell[beside], v[beside]]] - starts)
        centres = np.arange(split.mesh.n_points - len(split.inside), split.mesh.n_points)
        return (
            np.concatenate([node[beside], inside, centres]),
            np.concatenate([starts, places[inside], places[centres]]),
            np.concatenate([owner[beside], first[inside], self.owner[split.inside]]),
        )
