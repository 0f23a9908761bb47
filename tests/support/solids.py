"""Boundaries of known width, as CAD programs export them: no node where none is needed."""

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from adaptsize import SimplexMesh


def hull(points):
    """The boundary of the convex hull of points in 3-D, normals outward."""
    points = np.asarray(points, dtype=float)
    found = ConvexHull(points)
    cells = found.simplices.copy()
    corners = points[cells]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normal, found.equations[:, :3]) < 0.0
    cells[inward] = cells[inward][:, [1, 0, 2]]
    return SimplexMesh(points, cells)


def box(a, b, c):
    """Twelve triangles."""
    corners = np.stack(np.meshgrid([0, a], [0, b], [0, c], indexing="ij"), axis=-1)
    return hull(corners.reshape(-1, 3))


def outline(points, *more):
    """Closed polygons: each runs from node to node and back to its first."""
    loops = [np.asarray(loop, dtype=float) for loop in (points, *more)]
    cells, first = [], 0
    for loop in loops:
        i = first + np.arange(len(loop))
        cells.append(np.column_stack([i, np.roll(i, -1)]))
        first += len(loop)
    return SimplexMesh(np.concatenate(loops), np.concatenate(cells))


def circle(n, radius=1.0):
    """Points of a circle, counter-clockwise."""
    angle = 2.0 * np.pi * np.arange(n) / n
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def cylinder(n, radius=1.0, height=1.0):
    """A closed cylinder along z: n long strips, which meet at 360 / n degrees."""
    ends = [np.column_stack([circle(n, radius), np.full(n, z)]) for z in (0.0, height)]
    return hull(np.concatenate(ends))


def turned(mesh, seed=60311):
    """Turn a body at random."""
    turn = Rotation.random(random_state=seed).as_matrix()
    return SimplexMesh(mesh.points @ turn.T, mesh.cells)


def inside_out(mesh):
    return SimplexMesh(mesh.points, mesh.cells[:, ::-1])
