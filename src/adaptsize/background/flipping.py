"""Edge flips of a triangle mesh towards a constrained Delaunay triangulation."""

from dataclasses import replace

import numpy as np

from adaptsize._kernels.flipping import flip
from adaptsize.background.location import in_space
from adaptsize.background.simplex import SimplexMesh
from adaptsize.background.topology import are_among
from adaptsize.typing import IntArray


def flip_edges(mesh: SimplexMesh, kept: IntArray) -> SimplexMesh:
    """Return triangles on the same nodes with better angles: Delaunay, except for kept edges.

    An edge pq between the triangles cpq and dqp is replaced by cd if the sum of the angles at
    c and d exceeds 180 degrees, until there is no such edge [1]_.  This removes long slivers in
    flat facets.

    Parameters
    ----------
    mesh : SimplexMesh
        Triangles.  Data are dropped; tags of cells and edges are kept, and so are tagged edges.
    kept : int32[n, 2], rows sorted
        Edges that must not be flipped, such as those along which a surface bends.  Edges
        of one cell, of three or more cells, or between cells of different tags or
        orientations are not flipped either, and nor are those whose flip would repeat an edge.

    Returns
    -------
    SimplexMesh
        The smallest angle does not decrease: on bent surfaces, edges that would decrease it stay.
        ``mesh`` itself if no edge is to be flipped.

    References
    ----------
    .. [1] C. L. Lawson, "Software for C1 surface interpolation", in: Mathematical Software III
       (1977) 161-194.

    Examples
    --------
    >>> kite = SimplexMesh([[0, 0], [4, 0], [2, 1], [2, -1]], [[0, 1, 2], [1, 0, 3]])
    >>> flip_edges(kite, np.empty((0, 2), np.int32)).cells.tolist()
    [[2, 0, 3], [2, 3, 1]]
    """
    if mesh.tagged_facets is not None:
        kept = np.concatenate([kept, np.sort(mesh.tagged_facets, axis=1)])
    edges, cells = np.array(mesh.facets), np.array(mesh.cells)
    n_edges = len(edges)
    is_free = (mesh.facet_cell_counts == 2) & ~are_among(edges, kept)
    tags = np.zeros(mesh.n_cells, np.int32) if mesh.cell_tags is None else mesh.cell_tags.copy()
    corners = np.empty((n_edges, 2), np.int64)
    head, link = np.empty(1 << n_edges.bit_length(), np.int32), np.empty(n_edges, np.int32)
    parts = (cells, edges, np.array(mesh.cell_facets), corners, head, link)
    queue, is_queued = np.empty(n_edges, np.int32), np.empty(n_edges, np.bool_)
    if flip(in_space(mesh.points), parts, tags, is_free, (queue, is_queued)) == 0:
        return mesh
    return replace(mesh, cells=cells, point_data={}, cell_data={})
