"""The surface that is meshed, and on which sizes are found: without defects, around its solid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adaptsize._pickling import once
from adaptsize.background import SimplexMesh
from adaptsize.background.topology import compacted, places_among
from adaptsize.geometry.solid import Solid
from adaptsize.remeshing.preparation import RepairedMesh, repair_mesh


def surface_to_fill(surface: SimplexMesh) -> RepairedMesh:
    """Return a surface without its defects and the facets inside of its solid, normals outward.

    If bodies overlap it is the boundary of their union.  All facets stay if that could not be made,
    or if edges of the surface have tags.  The result is kept with the given surface.
    """
    return once(surface, "_to_fill", lambda: _around_solid(repair_mesh(surface)))


def _around_solid(repaired: RepairedMesh) -> RepairedMesh:
    mesh, solid = repaired.mesh, Solid.of(repaired.mesh)
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
