"""Octrees around shapes, and checks of points on them."""

import numpy as np
import solid_shapes as solid
from scipy.spatial import cKDTree

from adaptsize import (
    Octree,
    SimplexMesh,
    refine_at_boundary,
)

TURN = solid.turn_about((1.0, 2.0, 3.0), 40.0)


def moved(mesh, turn=TURN, shift=0.0):
    """The mesh, turned about the origin after a shift."""
    return SimplexMesh((mesh.points + np.asarray(shift)) @ turn.T, mesh.cells)


def around(distance, step, dim=2, half=1.3):
    """An octree that is as fine as that at the boundary, placed without symmetry."""
    lower = -half - 0.1 * np.array([0.13, 0.29, 0.41])[:dim]
    near = refine_at_boundary(distance, step)
    return Octree.build(lower, lower + 2.1 * half, near, max_level=12)


def to(boundary):
    """The distance from a boundary, without sign, as a function."""
    return lambda x: boundary.locator.nearest(x)[2]


def covered(axis, points, within):
    """Whether every point of an axis has a found one that near."""
    return bool((cKDTree(points).query(axis)[0] <= within).all())
