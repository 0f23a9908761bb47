"""Meshes, smooth fields and linear elements for the tests of recovered derivatives."""

import numpy as np
from meshes import jittered_cube, jittered_square, structured_square
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

MESHES = {
    "jittered": lambda n: jittered_square(n, 71829, half_width=1.0),
    "regular": lambda n: structured_square(n - 1, half_width=1.0),
    "cube": lambda n: jittered_cube(n, 71829, half_width=1.0),
}


def wave(x):
    """A smooth field, its gradient and its second derivatives."""
    k = np.array([2.0, 1.5, 1.0])[: x.shape[1]]
    phase = x @ k + 0.3
    u = np.sin(phase) + x[:, 0] ** 3
    gradient = np.cos(phase)[:, None] * k
    gradient[:, 0] += 3.0 * x[:, 0] ** 2
    hessian = -np.sin(phase)[:, None, None] * np.outer(k, k)
    hessian[:, 0, 0] += 6.0 * x[:, 0]
    return u, gradient, hessian


def root_mean_square(error):
    return np.sqrt((error.reshape(len(error), -1) ** 2).sum(axis=1).mean())


def hat_gradients(mesh):
    """Gradients of the hat functions, float64[n_cells, dim + 1, dim]."""
    corners = mesh.points[mesh.cells]
    inner = np.linalg.inv(corners[:, 1:] - corners[:, :1]).swapaxes(1, 2)
    return np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)


def solve_poisson(mesh, u, source, coefficient=1.0):
    """Linear elements for -div(coefficient grad u) = source, u given on the boundary.

    The right-hand side is lumped; the coefficient is constant in each cell.
    """
    gradients = hat_gradients(mesh)
    local = np.einsum("mid,mjd,m->mij", gradients, gradients, coefficient * mesh.measures)
    k = mesh.dim + 1
    rows, columns = np.repeat(mesh.cells, k, axis=1), np.tile(mesh.cells, (1, k))
    n = mesh.n_points
    matrix = coo_array((local.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n)).tocsr()
    load = np.bincount(mesh.cells.ravel(), np.repeat(mesh.measures / k, k)) * source
    fixed = mesh.boundary().nodes
    free = np.setdiff1d(np.arange(n), fixed)
    found = u.copy()
    found[free] = spsolve(
        matrix[free][:, free].tocsc(), load[free] - matrix[free][:, fixed] @ u[fixed]
    )
    return found


def gradient_errors(mesh, values, exact_gradient):
    """L2 error of the gradient in each cell, by the rule of the cell's corners moved inwards."""
    slopes = np.einsum("mid,mi->md", hat_gradients(mesh), values[mesh.cells])
    d = mesh.dim
    # Exact for quadratics, with equal weights.
    small = (1.0 - 1.0 / np.sqrt(d + 2.0)) / (d + 1.0)
    rule = np.full((d + 1, d + 1), small) + np.eye(d + 1) * (1.0 - (d + 1) * small)
    at = np.einsum("qi,mid->mqd", rule, mesh.points[mesh.cells])
    exact = exact_gradient(at.reshape(-1, d)).reshape(at.shape)
    square = ((exact - slopes[:, None]) ** 2).sum(axis=2).mean(axis=1)
    return np.sqrt(square * mesh.measures)
