"""Surfaces that lie in a plane of space."""

import numpy as np

from adaptsize.background import SimplexMesh

#: Distances from a plane, over the diagonal, that are rounding.
_ROUNDING = 1e-8


def is_in_plane(mesh: SimplexMesh) -> bool:
    """Return whether triangles in space lie in one plane, up to 1e-8 of the diagonal.

    Examples
    --------
    >>> points = [[0, 0, 1], [1, 0, 2], [1, 1, 3], [0, 1, 2]]
    >>> is_in_plane(SimplexMesh(points, [[0, 1, 2], [0, 2, 3]]))
    True
    >>> points[3][0] = 0.5
    >>> is_in_plane(SimplexMesh(points, [[0, 1, 2], [0, 2, 3]]))
    False
    """
    if (mesh.cell_dim, mesh.dim) != (2, 3):
        return False
    used = mesh.points[mesh.in_a_cell]
    # A large triangle decides most cases, without all points.
    largest = mesh.points[mesh.cells[mesh.measures.argmax()]]
    for points in (np.concatenate([largest, used[:: 1 + len(used) // 100]]), used):
        about = points - points.mean(axis=0)
        normal = np.linalg.svd(about, full_matrices=False)[2][-1]
        if np.ptp(about @ normal) > _ROUNDING * mesh.diagonal:
            return False
    return True
