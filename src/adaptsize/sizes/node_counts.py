"""Prediction of the number of nodes of a mesh from its numbers of cells and boundary facets."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_number, as_sizes, check_type
from adaptsize.background import SimplexMesh
from adaptsize.sizes.budget import CellSums, calibration, count_elements

#: Tetrahedra around an edge: 5.104 if they were regular, 5.127 to 5.132 in meshes by Mmg.
_CELLS_AROUND_EDGE = 5.13

#: Nodes per cell and per boundary facet, by dimension of the cells.
_PER_CELL = {1: 1.0, 2: 0.5, 3: 6.0 / _CELLS_AROUND_EDGE - 1.0}
_PER_FACET = {1: 0.5, 2: 0.5, 3: 0.25}


def predicted_nodes(mesh: SimplexMesh, size: npt.ArrayLike, *, backend: str | None = None) -> float:
    r"""Return the predicted number of nodes of the given sizes in the domain of a mesh.

    With T cells and B boundary facets of these sizes, it is

    .. math:: T + B / 2, \qquad T / 2 + B / 2, \qquad (6 / q - 1) \, T + B / 4

    for segments, triangles and tetrahedra.  These are Euler's formulas without the Euler
    characteristic, which is a few nodes.  In space, q = 5.13 tetrahedra are around an inner edge
    and half as many around a boundary edge.

    Parameters
    ----------
    mesh : SimplexMesh
    size : array_like of float, shape (n_points,)
        As in `predicted_elements`.
    backend : str, optional
        As in `predicted_elements`.

    Returns
    -------
    float

    Raises
    ------
    ValueError
        If the sizes have another shape or are not positive.

    Examples
    --------
    >>> mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    >>> round(predicted_nodes(mesh, [0.1, 0.1, 0.1]))
    75
    """
    check_type("mesh", mesh, SimplexMesh)
    h = as_sizes("size", size, (mesh.n_points,))
    sums, d = CellSums(), mesh.cell_dim
    cells = calibration(backend, d) * count_elements(mesh, h, sums)
    if d == 1 or _n_boundary_facets(mesh) == 0:
        return nodes_of(d, cells, 2.0 if d == 1 else 0.0)
    boundary = mesh.boundary()
    facets = count_elements(boundary.mesh, h[boundary.nodes], sums)
    return nodes_of(d, cells, calibration(backend, d - 1) * facets)


def nodes_of(cell_dim: int, cells: float, facets: float) -> float:
    """Return the number of nodes of a mesh with so many cells and boundary facets."""
    return _PER_CELL[cell_dim] * cells + _PER_FACET[cell_dim] * facets


def elements_with_nodes(mesh: SimplexMesh, nodes: float, name: str = "nodes") -> float:
    """Return the number of cells of a mesh of the same domain with so many nodes.

    The number of boundary facets is taken to grow as that of a uniformly refined mesh: as the
    cells to the power of (d - 1) / d.

    Examples
    --------
    >>> square = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    >>> round(elements_with_nodes(square, 101**2))  # 2 * 100^2 and 4 * 100
    20002
    """
    wanted = as_number(name, nodes, lower=1.0)
    return cells_for_nodes(wanted, mesh.cell_dim, mesh.n_cells, _n_boundary_facets(mesh))


def cells_for_nodes(wanted: float, d: int, n_cells: int, n_facets: int) -> float:
    """Return the number of cells with so many nodes, given the numbers of the present mesh."""
    facets = n_facets / n_cells ** ((d - 1) / d)
    # With x = cells^(1/d), wanted = a x^d + b x^(d - 1), increasing: Newton's method from above.
    a, b = _PER_CELL[d], _PER_FACET[d] * facets
    x = math.pow(wanted / a, 1.0 / d)
    for _ in range(50):
        excess = a * x**d + b * x ** (d - 1) - wanted
        step = excess / (a * d * x ** (d - 1) + b * (d - 1) * x ** max(d - 2, 0))
        x -= step
        if abs(step) <= 1e-12 * x:
            break
    return max(math.pow(x, d), 1.0)


def _n_boundary_facets(mesh: SimplexMesh) -> int:
    return int(np.count_nonzero(mesh.facet_cell_counts == 1))
