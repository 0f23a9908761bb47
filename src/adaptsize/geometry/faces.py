"""Faces of a surface, as a tag of each triangle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_angle, check_type
from adaptsize.background import SimplexMesh
from adaptsize.geometry.curvature import crease_edges


def tag_faces(surface: SimplexMesh, angle: float = 40.0) -> SimplexMesh:
    """Return a surface with a tag for each face; faces are separated by feature edges.

    A file such as STL contains triangles but no faces.  The tags are kept by `remesh`.  They can
    be used to prescribe sizes with `RegionSource`, and boundary conditions in a solver.

    Parameters
    ----------
    surface : SimplexMesh
        Triangles in space, in any orientation.
    angle : float, default 40
        Edges with a larger angle between the normals of their two triangles are feature edges;
        so are edges of one, three or more triangles, and tagged edges.  In degrees, from 0 to
        180.

    Returns
    -------
    SimplexMesh
        The same mesh with ``cell_tags`` 1 to n instead of the given ones.  Triangles have the
        same tag if they are connected by a path that crosses no feature edge.  Faces are numbered
        in the order of their first triangles.

    Raises
    ------
    ValueError
        If the cells are not triangles in space, or the angle is out of range.

    Notes
    -----
    Time and memory are O(n).  A feature edge that ends inside a face does not divide it.

    Examples
    --------
    The six triangles at a corner of a cube, two on each of its sides:

    >>> points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]]
    >>> cells = [[0, 1, 2], [0, 2, 3], [0, 1, 5], [0, 5, 4], [0, 3, 6], [0, 6, 4]]
    >>> tag_faces(SimplexMesh(points, cells)).cell_tags
    array([1, 1, 2, 2, 3, 3], dtype=int32)
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    check_type("surface", surface, SimplexMesh)
    limit = as_angle("angle", angle)
    feature = _keys(crease_edges(surface, crease_angle=limit), surface.n_points)
    # Edges of three or more triangles are feature edges, too: all others have two.
    is_free = ~np.isin(_keys(surface.facets, surface.n_points), feature)
    at_edge = np.argsort(surface.cell_facets, axis=None, kind="stable")
    at_edge = at_edge[is_free[surface.cell_facets.ravel()[at_edge]]]
    one, two = (at_edge // 3).reshape(-1, 2).T
    n = surface.n_cells
    links = coo_array((np.ones(len(one), np.int8), (one, two)), shape=(n, n))
    face = connected_components(links, directed=False)[1]
    first, number = np.unique(face, return_index=True, return_inverse=True)[1:]
    rank = np.argsort(np.argsort(first)).astype(np.int32)
    names = {key: name for key, name in surface.tag_names.items() if key[0] != 2}
    return replace(surface, cell_tags=rank[number.reshape(-1)] + 1, tag_names=names)


def _keys(edges: npt.NDArray[np.int32], n_points: int) -> npt.NDArray[np.int64]:
    """Return one number for each edge, int64[n]."""
    return edges[:, 0].astype(np.int64) * n_points + edges[:, 1]
