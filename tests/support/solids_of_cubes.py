"""Solids of unit cubes."""

from itertools import permutations

import numpy as np

from adaptsize import SimplexMesh


def solid_of_cubes(keep, shape, seed):
    """Tetrahedra of the unit cubes in a box whose middles are kept, inner nodes moved."""
    corner = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1).reshape(-1, 3)
    corner = corner[keep(corner + 0.5)]
    number = np.arange(np.prod(np.add(shape, 1))).reshape(np.add(shape, 1))
    cells = []
    for way in permutations(range(3)):
        steps = np.concatenate(
            [np.zeros((1, 3), int), np.cumsum(np.eye(3, dtype=int)[list(way)], 0)]
        )
        cells.append(np.column_stack([number[tuple((corner + step).T)] for step in steps]))
    used, cells = np.unique(np.concatenate(cells), return_inverse=True)
    points = np.argwhere(number >= 0)[used].astype(float)
    mesh = SimplexMesh(points, cells.reshape(-1, 4))
    inner = np.setdiff1d(np.arange(mesh.n_points), mesh.boundary().nodes)
    points[inner] += np.random.default_rng(seed).uniform(-0.15, 0.15, (len(inner), 3))
    return SimplexMesh(points, mesh.cells)
