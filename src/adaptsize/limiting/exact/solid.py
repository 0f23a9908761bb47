"""A solid that is not convex, as lines of sight and reflex edges need it."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.space_sight import Sight
from adaptsize.background import SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.geometry.boundary import FlatBoundary
from adaptsize.geometry.convexity import Ridges, ridges_of
from adaptsize.geometry.flat_faces import with_flat_faces
from adaptsize.limiting.edge_based import limit_along_edges
from adaptsize.limiting.exact.candidates import (
    Component,
    Extra,
    candidates_of,
)
from adaptsize.limiting.exact.field import (
    Entries,
)
from adaptsize.limiting.exact.obstacles_in_space import (
    ReflexEdges,
    build_sight,
    find_reflex_edges,
    measure_facets,
)
from adaptsize.typing import BoolArray, FloatArray, IntArray


class Solid(NamedTuple):
    """A solid, its reflex edges, and the nodes at which sizes are computed."""

    points: FloatArray
    """float64[n, 3]: the nodes; on one of many processes, its own and those at the boundary.

    Those on faces that are plane but for noise are in common planes."""
    surface: SimplexMesh | None
    """The boundary before nodes were moved for that; None if none was."""
    moved: float
    """How far a coordinate has been moved, at most."""
    nodes: IntArray
    """int32[k]: the nodes to solve along a Morton curve; nodes of reflex edges are among them."""
    sight: Sight
    reflex_edges: ReflexEdges


def solid_of(
    mesh: SimplexMesh,
    boundary: FlatBoundary,
    nodes: IntArray | None = None,
    around: IntArray | None = None,
    ridges: Ridges | None = None,
) -> Solid:
    """Return a solid with all nodes of a mesh, or some of them, to solve.

    Parameters
    ----------
    mesh : SimplexMesh
        Has all cells with a node on the boundary, others do not matter.
    boundary : FlatBoundary
    nodes : int32[k], optional
        Nodes to solve besides those of reflex edges; by default all.
    around : int32[m, 4], optional
        Tetrahedra that fill the solid, more than once perhaps, with all edges and faces that may be
        sources; by default the cells.
    ridges : Ridges, optional
        Those of the boundary, if they are known.
    """
    facets = boundary.facets
    ridges = ridges_of(facets, mesh.n_points) if ridges is None else ridges
    points = with_flat_faces(mesh.points, facets, ridges)
    shapes = measure_facets(points, facets)
    sight = build_sight(points, mesh.cells if around is None else around, facets, shapes)
    reflex_edges = find_reflex_edges(ridges, points, shapes, sight.walls.slack)
    surface = None if points is mesh.points else SimplexMesh(mesh.points, facets)
    moved = float(np.abs(points - mesh.points).max())
    if nodes is None:
        return Solid(points, surface, moved, along_curve(points), sight, reflex_edges)
    nodes = np.union1d(nodes, reflex_edges.nodes).astype(np.int32)
    order = along_curve(np.ascontiguousarray(points[nodes]))
    return Solid(points, surface, moved, nodes[order], sight, reflex_edges)


class WholeSolid:
    """A solid that is not convex, of which all is known; a rank may know a part only."""

    def __init__(
        self, component: Component, solid: Solid, points: FloatArray | None = None
    ) -> None:
        """``points``: the nodes of the component as in the solid, by default all of these."""
        self.mesh = component.mesh if component.links is None else component.links
        self.h0, self.solid = component.h0, solid
        if solid.surface is not None:
            points = solid.points if points is None else points
            component = component._replace(
                mesh=SimplexMesh(points, component.mesh.cells), extra=self._moved(component.extra)
            )
        self.component = component

    def _moved(self, extra: Extra | None) -> Extra | None:
        """Return the sources between the nodes, those on the boundary moved with it."""
        solid = self.solid
        if extra is None or solid.surface is None:
            return extra
        facets, weights, away = solid.surface.locator.nearest(extra.points)
        corners = solid.points[solid.surface.cells[facets]]
        on = (away <= 10.0 * solid.moved)[:, None]
        places = np.where(on, np.einsum("iv,ivd->id", weights, corners), extra.points)
        return extra._replace(points=places)

    def candidates(self) -> tuple[IntArray, BoolArray | None]:
        """Return the result of `candidates_of`."""
        return candidates_of(self.component)

    def with_others(self, entries: Entries) -> tuple[Entries, npt.NDArray[Any]]:
        """Return sources with those that others know, and the numbers of their nodes."""
        return entries, entries.nodes

    def known(self, numbers: npt.NDArray[Any]) -> IntArray:
        """Return the nodes of sources, given their numbers; -1 for points between the nodes."""
        return np.where(numbers < len(self.h0), numbers, -1).astype(np.int32)

    def own(self, sizes: FloatArray) -> FloatArray:
        """Return the sizes at the nodes of the component."""
        return sizes

    def total(self, nodes: IntArray) -> int:
        """Return the number of nodes on all ranks."""
        return len(nodes)

    def any(self, flag: bool) -> bool:
        """Return whether a flag is set on any rank."""
        return flag

    def need_all_cells(self) -> None:
        """Raise `NeedsWholeMesh` if cells inside the solid are not known."""

    def spread(self, h: FloatArray) -> FloatArray:
        """Return sizes, lowered along edges."""
        component = self.component
        return limit_along_edges(self.mesh, h, component.g, component.workers.report)
