"""Measures, gradients and mass matrices of linear elements."""

import math

import numpy as np

from adaptsize._kernels.compiling import kernel, lean_kernel


@kernel
def dual_edges(points, cell, edges, dual):
    """Fill the edge vectors from vertex 0 and their dual basis; return the measure.

    Modified Gram-Schmidt on the edges, each projected out twice, keeps slivers
    accurate where the determinant of the Gram matrix would lose half the digits.

    Parameters
    ----------
    points : float64[n, dim]
    cell : int32[k + 1]
    edges : float64[k, dim]
        Out: x_i - x_0.
    dual : float64[k, dim]
        Out: gradients of the barycentric coordinates 1..k, in the cell's plane;
        zero if the cell is degenerate.

    Returns
    -------
    float64
        Length, area or volume, >= 0; 0 if an edge adds less than 1e-14 of its
        length to the span of the others.
    """
    k = edges.shape[0]
    dim = points.shape[1]
    for i in range(k):
        for d in range(dim):
            edges[i, d] = points[cell[i + 1], d] - points[cell[0], d]
    measure = 1.0
    for last in range(k):
        # The part of edge `last` across all other edges; its length is a height.
        basis = np.empty((k, dim))
        for count in range(k):
            i = (last + 1 + count) % k  # `last` itself comes at the end
            for d in range(dim):
                basis[count, d] = edges[i, d]
            full = 0.0
            for d in range(dim):
                full += edges[i, d] ** 2
            for _ in range(2):
                for b in range(count):
                    along = 0.0
                    for d in range(dim):
                        along += basis[count, d] * basis[b, d]
                    for d in range(dim):
                        basis[count, d] -= along * basis[b, d]
            rest = 0.0
            for d in range(dim):
                rest += basis[count, d] ** 2
            if rest <= 1e-28 * full or full == 0.0:
                dual[:, :] = 0.0
                return 0.0
            height = math.sqrt(rest)
            if last == 0:
                measure *= height / (count + 1)
            if i == last:
                for d in range(dim):
                    dual[last, d] = basis[count, d] / rest
            for d in range(dim):
                basis[count, d] /= height
    return measure


@kernel
def fill_measures(points, cells, measures):
    """Fill the length, area or volume of each cell.

    Parameters
    ----------
    points : float64[n, dim]
    cells : int32[m, k + 1]
    measures : float64[m]
        Out: >= 0; 0 for degenerate cells.
    """
    k = cells.shape[1] - 1
    edges = np.empty((k, points.shape[1]))
    dual = np.empty((k, points.shape[1]))
    for c in range(cells.shape[0]):
        measures[c] = dual_edges(points, cells[c], edges, dual)


@kernel
def fill_hat_gradients(points, cells, measures, gradients):
    """Fill measure and gradients of the hat functions of each cell.

    Parameters
    ----------
    points : float64[n, dim]
    cells : int32[m, k + 1]
    measures : float64[m]
        Out: 0 in degenerate cells.
    gradients : float64[m, k + 1, dim]
        Out: 0 in degenerate cells.
    """
    k = cells.shape[1] - 1
    dim = points.shape[1]
    edges = np.empty((k, dim))
    dual = np.empty((k, dim))
    for c in range(cells.shape[0]):
        measures[c] = dual_edges(points, cells[c], edges, dual)
        for d in range(dim):
            total = 0.0
            for i in range(k):
                gradients[c, i + 1, d] = dual[i, d]
                total += dual[i, d]
            gradients[c, 0, d] = -total


@lean_kernel
def add_mass(cells, share, x, y):
    """Add the product of the mass matrix of linear elements with columns.

    Parameters
    ----------
    cells : int32[m, k]
    share : float64[m]
        The measures of the cells over k (k + 1).
    x, y : float64[n, columns]
        ``y``: In/Out.
    """
    for c in range(cells.shape[0]):
        for j in range(x.shape[1]):
            total = 0.0
            for v in range(cells.shape[1]):
                total += x[cells[c, v], j]
            for v in range(cells.shape[1]):
                y[cells[c, v], j] += share[c] * (x[cells[c, v], j] + total)
