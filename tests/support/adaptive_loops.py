"""An indicator and a disc for the tests of adaptation."""

import numpy as np

from adaptsize import SimplexMesh

SEED = 93187


def indicator(mesh, place=0.0):
    """An error that is large around a place."""
    middle = mesh.points[mesh.cells].mean(axis=1)
    power = 1.0 / mesh.dim + 0.5
    return mesh.measures**power * np.exp(-4.0 * np.linalg.norm(middle - place, axis=1))


def disc(n, radius=1.0):
    """Triangles of a disc of n rings, all boundary nodes on the circle."""
    from scipy.spatial import Delaunay

    rings = [np.zeros((1, 2))]
    for k in range(1, n + 1):
        angle = 2.0 * np.pi * np.arange(6 * k) / (6 * k)
        rings.append(radius * k / n * np.column_stack([np.cos(angle), np.sin(angle)]))
    points = np.concatenate(rings)
    return SimplexMesh(points, Delaunay(points).simplices)


def to_circle(x):
    return x / np.linalg.norm(x, axis=1, keepdims=True)
