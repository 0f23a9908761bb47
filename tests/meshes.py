"""Meshes that the tests share, made from a seed that each test writes out."""

import numpy as np
from scipy.spatial import ConvexHull, Delaunay

from adaptsize import SimplexMesh


def random_square(n, seed, *, half_width=1.0):
    """Delaunay triangles of n uniformly random points: obtuse ones and slivers included."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-half_width, half_width, (n, 2))
    return SimplexMesh(points, Delaunay(points).simplices)


def jittered_square(n_side, seed, *, half_width=50.0):
    """Delaunay triangles of an n_side x n_side grid, inner points moved by up to 0.3 cells."""
    return _jittered(n_side, 2, seed, half_width)


def jittered_cube(n_side, seed, *, half_width=50.0):
    """Delaunay tetrahedra of a jittered grid; flat slivers on the boundary are dropped."""
    mesh = _jittered(n_side, 3, seed, half_width)
    spacing = 2.0 * half_width / (n_side - 1)
    return SimplexMesh(mesh.points, mesh.cells[mesh.measures > 1e-9 * spacing**3])


def _jittered(n_side, dim, seed, half_width):
    rng = np.random.default_rng(seed)
    axis = np.linspace(-half_width, half_width, n_side)
    points = np.stack(np.meshgrid(*[axis] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    spacing = axis[1] - axis[0]
    inner = (np.abs(points) < half_width - 0.5 * spacing).all(axis=1)
    points[inner] += rng.uniform(-0.3, 0.3, (inner.sum(), dim)) * spacing
    return SimplexMesh(points, Delaunay(points).simplices)


def structured_square(n, *, half_width=50.0):
    """n x n squares, each cut into two right triangles along the same diagonal."""
    axis = np.linspace(-half_width, half_width, n + 1)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])
    corner = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    lower = np.stack([a, b, c], axis=-1).reshape(-1, 3)
    upper = np.stack([a, c, d], axis=-1).reshape(-1, 3)
    return SimplexMesh(points, np.concatenate([lower, upper]))


def random_sphere(n, seed, *, radius=1.0):
    """Convex hull of n random points on a sphere: an irregular closed surface."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, 3))
    points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
    cells = ConvexHull(points).simplices.astype(np.int32)
    corners = points[cells]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normal, corners[:, 0]) < 0.0
    cells[inward] = cells[inward][:, [0, 2, 1]]
    return SimplexMesh(points, cells)
