"""Meshes that the tests share, made from a seed that each test writes out."""

import numpy as np
from scipy.spatial import Delaunay
from solids import hull

from adaptsize import SimplexMesh


def random_square(n, seed, *, half_width=1.0):
    """Delaunay triangles of n uniformly random points: obtuse ones and slivers included."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-half_width, half_width, (n, 2))
    return SimplexMesh(points, Delaunay(points).simplices)


def random_cube(n, seed):
    """Delaunay tetrahedra of n uniformly random points in the unit cube."""
    points = np.random.default_rng(seed).random((n, 3))
    return SimplexMesh(points, Delaunay(points).simplices)


def jittered_square(n_side, seed, *, half_width=50.0):
    """Delaunay triangles of an n_side x n_side grid, inner points moved by up to 0.3 cells."""
    points, spacing = _grid(n_side, 2, half_width)
    inner = (np.abs(points) < half_width - 0.5 * spacing).all(axis=1)
    move = np.random.default_rng(seed).uniform(-0.3, 0.3, (inner.sum(), 2))
    points[inner] += move * spacing
    return SimplexMesh(points, Delaunay(points).simplices)


def jittered_cube(n_side, seed, *, half_width=50.0):
    """Delaunay tetrahedra of a grid, its nodes moved by up to 0.3 cells, on the hull within it.

    Rectangles of nodes on the hull would hold flat cells: left in, or left out as cracks
    under other cells, they are walls to what travels inside the domain.
    """
    points, spacing = _grid(n_side, 3, half_width)
    move = np.random.default_rng(seed).uniform(-0.3, 0.3, points.shape) * spacing
    points += np.where(np.abs(points) < half_width - 0.5 * spacing, move, 0.0)
    return SimplexMesh(points, Delaunay(points).simplices)


def _grid(n_side, dim, half_width):
    """Return the nodes of a grid, float64[n_side^dim, dim], and their spacing."""
    axis = np.linspace(-half_width, half_width, n_side)
    points = np.stack(np.meshgrid(*[axis] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    return points, axis[1] - axis[0]


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


def slit_square(n):
    """The square (-1, 1)^2 with a slit of no width: y = 0, x > 0; n is even."""
    mesh = structured_square(n, half_width=1.0)
    on_slit = np.flatnonzero((np.abs(mesh.points[:, 1]) < 1e-12) & (mesh.points[:, 0] > 1e-12))
    twin = np.arange(mesh.n_points)
    twin[on_slit] = mesh.n_points + np.arange(len(on_slit))
    above = mesh.points[mesh.cells].mean(axis=1)[:, 1] > 0.0
    points = np.concatenate([mesh.points, mesh.points[on_slit]])
    return SimplexMesh(points, np.where(above[:, None], twin[mesh.cells], mesh.cells))


def random_sphere(n, seed, *, radius=1.0):
    """Convex hull of n random points on a sphere: an irregular closed surface."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, 3))
    return hull(points * (radius / np.linalg.norm(points, axis=1, keepdims=True)))


def with_cracks(surface, seed, *, apart=1e-8):
    """Return a surface of which some nodes are there twice, a little apart, so that edges are open.

    ``apart`` is over the diagonal.
    """
    rng = np.random.default_rng(seed)
    n, cells = surface.n_points, surface.cells.copy()
    chosen = rng.choice(n, n // 10, replace=False)
    corner = np.isin(cells, chosen) & (rng.random(cells.shape) < 0.5)
    cells[corner] += n
    offsets = apart * surface.diagonal * rng.normal(size=(n, 3))
    points = np.concatenate([surface.points, surface.points + offsets])
    used, cells = np.unique(cells, return_inverse=True)
    return SimplexMesh(points[used], cells.reshape(-1, 3))
