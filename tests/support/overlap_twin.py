"""The common part of two simplices, by Qhull."""

import math

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, Delaunay, HalfspaceIntersection


def common_part(a, b):
    """Return the common part cut into simplices, float64[n, dim + 1, dim]; [] if there is none."""
    dim = a.shape[1]
    rows = np.concatenate([ConvexHull(corners).equations for corners in (a, b)])
    # The centre of the largest ball inside, if there is one.
    found = linprog(
        [0] * dim + [-1],
        A_ub=np.column_stack([rows[:, :-1], np.ones(len(rows))]),
        b_ub=-rows[:, -1],
        bounds=[(None, None)] * dim + [(0, None)],
    )
    if not found.success or found.x[-1] < 1e-9:
        return []
    corners = HalfspaceIntersection(rows, found.x[:-1]).intersections
    return corners[Delaunay(corners).simplices]


def measure(simplex):
    return abs(np.linalg.det(simplex[1:] - simplex[0])) / math.factorial(simplex.shape[1])
