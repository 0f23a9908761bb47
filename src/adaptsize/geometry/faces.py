"""Faces of a surface, as a tag of each triangle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adaptsize._checks import as_angle, check_type
from adaptsize.background import SimplexMesh
from adaptsize.background.topology import are_among, components_of, pairs_of_cells
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
    check_type("surface", surface, SimplexMesh)
    limit = as_angle("angle", angle)
    # Edges of three or more triangles are feature edges, too: all others have two.
    is_free = ~are_among(surface.facets, crease_edges(surface, crease_angle=limit))
    face = components_of(pairs_of_cells(surface, is_free) // 3, surface.n_cells)
    names = {key: name for key, name in surface.tag_names.items() if key[0] != 2}
    return replace(surface, cell_tags=face.astype(np.int32) + 1, tag_names=names)
