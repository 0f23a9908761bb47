"""Small domains for the tests of remeshing."""

import numpy as np
from scipy.spatial import Delaunay

from adaptsize import SimplexMesh

#: The surface of the unit cube: corners and triangles, oriented outwards.
CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
CUBE_CELLS = np.array([
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
    [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
])  # fmt: skip


#: Kuhn's division of a cube into six tetrahedra around the diagonal 0-7.
_KUHN = [(0, 1, 3, 7), (0, 3, 2, 7), (0, 2, 6, 7), (0, 6, 4, 7), (0, 4, 5, 7), (0, 5, 1, 7)]


def block(n, *, length=1):
    """Tetrahedra of a block [0, length] x [0, 1]^2, n to a unit of length."""
    shape = (length * n + 1, n + 1, n + 1)
    index = np.arange(np.prod(shape)).reshape(shape)
    corner = [
        index[i : shape[0] - 1 + i, j : shape[1] - 1 + j, k : shape[2] - 1 + k].ravel()
        for k in (0, 1)
        for j in (0, 1)
        for i in (0, 1)
    ]
    cells = np.concatenate([np.stack([corner[v] for v in tet], axis=1) for tet in _KUHN])
    axes = [np.arange(s) / n for s in shape]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return SimplexMesh(points, cells)


def _two_regions(mesh, tags, planes):
    """Tag cells by the side of x = 1 that they are on, and facets in planes of given x."""
    x = mesh.points[mesh.facets][:, :, 0]
    facets = [mesh.facets[(np.abs(x - at) < 1e-9).all(axis=1)] for at in planes]
    left = mesh.points[mesh.cells].mean(axis=1)[:, 0] < 1.0
    return SimplexMesh(
        mesh.points,
        mesh.cells,
        cell_tags=np.where(left, *tags),
        tagged_facets=np.concatenate(facets),
        facet_tags=np.repeat(list(planes.values()), [len(f) for f in facets]),
    )


def two_region_block(n):
    """Two unit cubes, tags 7 (x < 1) and -3; interface 40, the end x = 0 41, x = 2 42."""
    return _two_regions(block(n, length=2), (7, -3), {1.0: 40, 0.0: 41, 2.0: 42})


def two_region_rectangle(n):
    """Triangles of [0, 2] x [0, 1], tags 5 (x < 1) and 9; interface 30, the end x = 0 31."""
    x, y = np.meshgrid(np.arange(2 * n + 1) / n, np.arange(n + 1) / n, indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])
    mesh = SimplexMesh(points, Delaunay(points).simplices)
    return _two_regions(mesh, (5, 9), {1.0: 30, 0.0: 31})


def facet_areas(mesh, tag):
    """Return the area (or length) of the facets with a tag."""
    facets = mesh.tagged_facets[mesh.facet_tags == tag]
    return SimplexMesh(mesh.points, facets).measures.sum()


def joined(*meshes):
    """Return meshes side by side as one, without merging nodes."""
    starts = np.cumsum([0, *(mesh.n_points for mesh in meshes)])
    cells = [mesh.cells + start for mesh, start in zip(meshes, starts, strict=False)]
    return SimplexMesh(np.concatenate([mesh.points for mesh in meshes]), np.concatenate(cells))


def moved(mesh, offset, scale=1.0):
    """Return a mesh scaled and shifted, without its tags."""
    return SimplexMesh(mesh.points * scale + offset, mesh.cells)
