"""Places of nodes, and nodal values of a background at any points."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_float_array, as_points, one_of
from adaptsize._kernels.simplex import fill_hat_gradients
from adaptsize.background.grid import CartesianGrid
from adaptsize.background.octree import Octree
from adaptsize.background.partitioned import AnyMesh, PartitionedMesh
from adaptsize.background.requests import ask_nearest, boxes_of
from adaptsize.background.simplex import SimplexMesh, as_mesh
from adaptsize.typing import Background, BoolArray, FloatArray

Outside = Literal["nearest", "nan"]
AnyBackground: TypeAlias = SimplexMesh | CartesianGrid | Octree


def nodes_in_domain(background: Background | PartitionedMesh) -> BoolArray:
    """Return which nodes are in the domain, bool[n_points]: others say nothing about it.

    Those are inactive nodes of a grid, and nodes of a mesh that are in no cell.
    """
    if isinstance(background, SimplexMesh | PartitionedMesh):
        return background.in_a_cell
    if isinstance(background, CartesianGrid) and background.active is not None:
        return background.active.ravel()
    return np.ones(math.prod(background.nodal_shape), np.bool_)


def interpolate(
    background: AnyMesh | CartesianGrid | Octree,
    values: npt.ArrayLike,
    points: npt.ArrayLike,
    *,
    outside: Outside = "nearest",
) -> FloatArray:
    """Return nodal values of a mesh, grid or octree at any points, by linear interpolation.

    Parameters
    ----------
    background : SimplexMesh, PartitionedMesh, CartesianGrid or Octree
    values : array_like of float, of the nodal shape
        Finite or inf, for instance a depth, a velocity or a solution.
    points : array_like of float, shape (n, dim)
        In the mesh of all ranks if it is in parts; each rank may give others.
    outside : {"nearest", "nan"}
        What a point outside the background gets: the value at the closest point of the
        background, or NaN.

    Returns
    -------
    ndarray of float64, shape (n,)
        Between the values of the nodes around the point; inf if one of them with a positive
        weight is inf.

    Raises
    ------
    ValueError
        If an argument is invalid.

    See Also
    --------
    adaptsize.transfer_fields : Conservative transfer of fields between meshes.

    Examples
    --------
    >>> grid = CartesianGrid([0, 0], 1.0, (2, 2))
    >>> interpolate(grid, [[0, 1], [2, 3]], [[0.5, 0.25], [9, 9]], outside="nan").tolist()
    [1.25, nan]
    """
    background = as_mesh("background", background, PartitionedMesh, CartesianGrid, Octree)

    def check() -> tuple[FloatArray, FloatArray]:
        one_of("outside", outside, ("nearest", "nan"))
        nodal = as_float_array("values", values, background.nodal_shape)
        return nodal, as_points("points", points, background.dim)

    if isinstance(background, PartitionedMesh):
        nodal, where = background.ranks.agree(check)
        mesh = background.mesh

        def answer(asked: FloatArray) -> FloatArray:
            if mesh is None:  # nothing is asked of this rank
                return np.empty((0, 2))
            nodes, weights, distance = mesh.locator.weights(asked)
            return np.column_stack([distance, np.einsum("iv,iv->i", weights, nodal[nodes])])

        rows = ask_nearest(background, boxes_of(background), where, answer)
        distances, found = rows[:, 0], np.ascontiguousarray(rows[:, 1])
    else:
        nodal, where = check()
        found, distances = background.locator.interpolate(nodal, where)
    if outside == "nan":
        # The tolerance is that of rounding.
        found = np.where(distances > 1e-12 * background.diagonal, np.nan, found)
    return found


def places_of(
    background: AnyBackground | PartitionedMesh,
) -> Callable[[npt.NDArray[np.integer]], FloatArray]:
    """Return a function that maps node numbers to coordinates, float64[n, dim]."""
    if not isinstance(background, CartesianGrid):
        return lambda nodes: background.points[nodes]
    origin, spacing, shape = background.origin, background.spacing, background.shape
    return lambda nodes: origin + spacing * np.stack(np.unravel_index(nodes, shape), axis=1)


def hat_gradients(mesh: SimplexMesh) -> tuple[FloatArray, FloatArray]:
    """Return the measures of cells and the gradients of their hat functions, 0 in flat cells.

    Returns
    -------
    float64[n_cells], float64[n_cells, cell_dim + 1, dim]
    """
    measures, gradients = np.empty(mesh.n_cells), np.empty((*mesh.cells.shape, mesh.dim))
    fill_hat_gradients(mesh.points, mesh.cells, measures, gradients)
    return measures, gradients


def cell_gradients(mesh: SimplexMesh, nodal: FloatArray) -> FloatArray:
    """Return the gradient in each cell, float64[n_cells, dim]; 0 in flat ones and next to inf."""
    with np.errstate(invalid="ignore"):
        rises = nodal[mesh.cells] - nodal[mesh.cells[:, :1]]
    rises[~np.isfinite(rises).all(axis=1)] = 0.0
    if mesh.cell_dim == mesh.dim == 2:
        return _gradients_in_plane(mesh.points[mesh.cells], rises, mesh.measures > 0.0)
    return np.asarray(np.einsum("cv,cvd->cd", rises, hat_gradients(mesh)[1]))


def _gradients_in_plane(corners: FloatArray, rises: FloatArray, solid: BoolArray) -> FloatArray:
    """Return the gradients in triangles from the rises off their first corners, 0 in flat ones.

    `fill_hat_gradients`, for cells of any dimension, takes six times as long.
    """
    (ax, ay), (bx, by) = ((corners[:, v] - corners[:, 0]).T for v in (1, 2))
    twice, (_, a, b) = ax * by - ay * bx, rises.T
    gradients = np.zeros((len(corners), 2))
    for column, along in ((0, a * by - b * ay), (1, b * ax - a * bx)):
        np.divide(along, twice, out=gradients[:, column], where=solid)
    return gradients
