"""The surface that is meshed, and on which sizes are found: without defects, around its solid."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from adaptsize._pickling import once
from adaptsize.background import SimplexMesh
from adaptsize.background.topology import compacted, places_among
from adaptsize.geometry.solid import Solid
from adaptsize.remeshing import tuning
from adaptsize.remeshing.crossings import crossing_facets
from adaptsize.remeshing.hole_filling import bodies_of, close_holes
from adaptsize.remeshing.preparation import RepairedMesh, repair_mesh
from adaptsize.remeshing.roughness import is_rough_within, smoothed


class SurfaceToFill(NamedTuple):
    """The facets that are sized and meshed, and the solid that they bound."""

    sound: RepairedMesh
    solid: Solid
    n_caps: int
    """Number of triangles by which holes were closed."""
    left: float = 1.0
    """Share of the tolerance that is left for a mesh; the rest has made the surface smooth."""

    @property
    def is_crossed(self) -> bool:
        """Whether facets cross others: of bodies that overlap, whose union could not be made."""
        return self.left == 1.0 and self.solid.is_divided and self.sound.mesh is not self.solid.skin


def surface_to_fill(surface: SimplexMesh, tolerance: float = np.inf) -> SurfaceToFill:
    """Return a surface without its defects and the facets inside of its solid, normals outward.

    Holes are closed by flat caps, if these are small compared with the surface, do not cross their
    own body, and its winding number leaves them free (`Solid.is_opening`).  If bodies overlap, the
    result is the boundary of their union.  All facets stay if that could not be made, or if edges
    of the surface have tags.  A surface that is rough by less than the tolerance is made smooth
    within a share of that.  The result is kept with the given surface.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space.
    tolerance : float
        Allowed distance of the mesh, over the diagonal.
    """
    found = once(surface, "_to_fill", lambda: _to_fill(surface))
    if not np.isfinite(tolerance) or found.is_crossed:
        return found
    return once(surface, f"_to_fill_{tolerance!r}", lambda: _smooth(found, tolerance))


def _smooth(found: SurfaceToFill, tolerance: float) -> SurfaceToFill:
    """Return a surface that is smooth where it was rough by less than the tolerance."""
    from scipy.spatial import cKDTree

    sound, mesh = found.sound, found.sound.mesh
    allowed = tolerance * mesh.diagonal
    if not is_rough_within(mesh, allowed):
        return found
    smooth = smoothed(mesh, allowed)
    if smooth is None or smooth.mesh is mesh:
        return found
    place = places_among(smooth.nodes, mesh.n_points)
    gone = np.flatnonzero(place < 0)
    place[gone] = cKDTree(smooth.mesh.points).query(mesh.points[gone])[1]
    node_map = np.append(place, np.int32(-1))[sound.node_map]
    nodes = sound.nodes[smooth.nodes]
    new = RepairedMesh(smooth.mesh, nodes, node_map, sound.repairs)
    return found._replace(sound=new, left=1.0 - smooth.share)


def _to_fill(surface: SimplexMesh) -> SurfaceToFill:
    repaired = repair_mesh(surface)
    closed = _without_holes(repaired.mesh)
    sound, solid = repaired._replace(mesh=closed), Solid.of(closed)
    return SurfaceToFill(_around(sound, solid), solid, closed.n_cells - repaired.mesh.n_cells)


def _without_holes(mesh: SimplexMesh) -> SimplexMesh:
    """Return a surface whose holes are closed, itself if they cannot be, or are no holes.

    The cap of a plane hole is where the winding number of its body is one half.
    """
    if mesh.is_closed or Solid.of(mesh).is_closed:
        return mesh
    try:
        closed = close_holes(mesh)
    except ValueError:
        return mesh
    if not np.array_equal(closed.cells[: mesh.n_cells], mesh.cells):
        return mesh  # it was repaired once more, so that nodes have other numbers
    area = float(closed.measures[mesh.n_cells :].sum())
    if area > tuning.MOST_OF_CAPS * float(mesh.measures.sum()):
        return mesh
    if not _close_their_bodies(closed, mesh.n_cells):
        return mesh
    return replace(closed, tagged_facets=mesh.tagged_facets, facet_tags=mesh.facet_tags)


def _close_their_bodies(closed: SimplexMesh, first: int) -> bool:
    """Return whether caps, the cells from ``first`` on, lie in openings and cross no own facets.

    Bodies that cross each other become their union, also at a cap.
    """
    points, body = closed.points, bodies_of(closed)
    for one in np.unique(body[first:]):
        rows = np.flatnonzero(body == one)
        own, caps = (closed.cells[rows[(rows >= first) == is_cap]] for is_cap in (False, True))
        if not Solid(SimplexMesh(points, own)).is_opening(points[caps].mean(axis=1)).all():
            return False
        crossing = crossing_facets(SimplexMesh(points, closed.cells[rows])).cells
        if (rows[crossing] >= first).any():
            return False
    return True


def _around(repaired: RepairedMesh, solid: Solid) -> RepairedMesh:
    """Return the facets of a surface that bound its solid."""
    mesh = repaired.mesh
    kept = ~solid.hidden
    is_whole = solid.is_divided or not solid.is_closed or not kept.any()
    if solid.is_divided and solid.skin.is_closed and mesh.tagged_facets is None:
        known = solid.nodes_of_skin
        nodes = np.where(known >= 0, repaired.nodes[known], -1)
        place = np.full(mesh.n_points + 1, -1, np.int32)
        place[known] = np.arange(len(known))
        place[-1] = -1
        node_map = place[repaired.node_map]
        return RepairedMesh(solid.skin, nodes.astype(np.int32), node_map, repaired.repairs)
    if is_whole or kept.all():
        if np.array_equal(solid.cells, mesh.cells):
            return repaired
        return repaired._replace(mesh=replace(mesh, cells=solid.cells))
    nodes, cells = compacted(solid.cells[kept])
    place = np.append(places_among(nodes, mesh.n_points), np.int32(-1))
    edges = tags = None
    if mesh.tagged_facets is not None and mesh.facet_tags is not None:
        edges = place[mesh.tagged_facets]
        good = (edges >= 0).all(axis=1)
        edges, tags = edges[good], mesh.facet_tags[good]
    outer = SimplexMesh(
        mesh.points[nodes],
        cells,
        cell_tags=None if mesh.cell_tags is None else mesh.cell_tags[kept],
        tagged_facets=edges,
        facet_tags=tags,
        tag_names=mesh.tag_names,
    )
    return RepairedMesh(outer, repaired.nodes[nodes], place[repaired.node_map], repaired.repairs)
