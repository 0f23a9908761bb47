"""Interfaces: facets inside a mesh that remeshing keeps."""

import numpy as np

from adaptsize.background import topology
from adaptsize.background.simplex import SimplexMesh, cut_out
from adaptsize.typing import IntArray


def skin_of(mesh: SimplexMesh) -> tuple[SimplexMesh, IntArray]:
    """Return the boundary of cells of full dimension, or a surface or curve itself, and its nodes.

    The nodes are those of the given mesh.
    """
    if mesh.cell_dim == mesh.dim:
        return mesh.boundary()[:2]
    return mesh, np.arange(mesh.n_points, dtype=np.int32)


def interfaces(mesh: SimplexMesh) -> tuple[SimplexMesh, IntArray] | None:
    """Return the facets between cells of different regions, and tagged ones inside of a region.

    Returns
    -------
    SimplexMesh, int32[n]
        The facets, and the node of ``mesh`` at each of their nodes.
    None
        If there are no such facets.
    """
    if mesh.cell_tags is None and mesh.tagged_facets is None:
        return None
    inside = mesh.facet_cell_counts > 1
    kept = np.zeros(len(mesh.facets), np.bool_)
    if mesh.cell_tags is not None:
        lowest, highest = topology.regions_beside(mesh.cell_facets, mesh.cell_tags, len(kept))
        kept |= lowest != highest
    if mesh.tagged_facets is not None:
        rows = np.concatenate([mesh.facets, mesh.tagged_facets])
        number = topology.unique_rows(rows, mesh.n_points)[1]
        kept |= np.isin(number[: len(kept)], number[len(kept) :])
    facets = mesh.facets[inside & kept]
    if len(facets) == 0:
        return None
    return cut_out(mesh.points, facets)


def divided_by_region(mesh: SimplexMesh) -> tuple[SimplexMesh, IntArray] | None:
    """Return a mesh whose regions share no nodes, for functions that jump between them.

    Returns
    -------
    SimplexMesh, int32[n]
        The same cells in the same order, without tags and fields, and the node of ``mesh`` at each
        node.  Nodes in several regions are there once for each.  Nodes in no cell are left out.
    None
        If there is one region only, or no two regions touch.
    """
    if mesh.cell_tags is None:
        return None
    regions, region = np.unique(mesh.cell_tags, return_inverse=True)
    keys = mesh.cells.astype(np.int64) * len(regions) + region.reshape(-1, 1)
    unique, cells = np.unique(keys, return_inverse=True)
    nodes = (unique // len(regions)).astype(np.int32)
    if not (nodes[1:] == nodes[:-1]).any():
        return None
    return SimplexMesh(mesh.points[nodes], cells.reshape(mesh.cells.shape)), nodes
