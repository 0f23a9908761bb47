"""Unknowns and matrices of finite elements on a mesh, also on one that is not made yet."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import comb

import numpy as np

from adaptsize._checks import describe, refusal
from adaptsize._size_report import SizeReport
from adaptsize.background import SimplexMesh
from adaptsize.sizes.budget import nodes_of
from adaptsize.sizes.prediction import Prediction

_MEMORY = re.compile(r"\s*(\d+\.?\d*|\.\d+)\s*([KMGT]?)B?\s*", re.IGNORECASE)


def simplices_of(dim: int, predicted: Prediction) -> tuple[float, ...]:
    """Return the numbers of nodes, edges ... cells, by Euler's formula without its constant.

    Where the facets of the boundary are not known, they are not counted.
    """
    cells, facets, nodes = predicted
    if np.isnan(nodes):
        facets, nodes = 0.0, nodes_of(dim, cells, 0.0)
    if dim == 1:
        return nodes, cells
    if dim == 2:
        return nodes, 1.5 * cells + 0.5 * facets, cells
    triangles = 2.0 * cells + 0.5 * facets
    return nodes, nodes + triangles - cells, triangles, cells


def unknowns_of(simplices: Sequence[float], degree: int) -> float:
    """Return the number of nodes of Lagrange elements, from the numbers of nodes, edges ..."""
    return sum(n * comb(degree - 1, k) for k, n in enumerate(simplices))


def nonzeros_of(simplices: Sequence[float], degree: int) -> float:
    r"""Return the number of ordered pairs of nodes of Lagrange elements with a cell in common.

    Each pair is counted at the smallest simplex that holds both.  A simplex of dimension k holds
    :math:`m_k = \binom{p + k}{k}` nodes, so by inclusion and exclusion
    :math:`\sum_j (-1)^{k - j} \binom{k + 1}{j + 1} m_j^2` pairs that none of its facets holds.
    """
    total = 0.0
    for k, n in enumerate(simplices):
        pairs = [
            (-1) ** (k - j) * comb(k + 1, j + 1) * comb(degree + j, j) ** 2 for j in range(k + 1)
        ]
        total += n * sum(pairs)
    return total


def matrix_of(dim: int, predicted: Prediction, degree: int, components: int) -> tuple[float, float]:
    """Return the number of unknowns, and the bytes of the assembled matrix.

    The matrix is stored by rows, with the integers that SciPy takes for indices.  All components
    at the nodes of a cell are coupled.
    """
    return _matrix(simplices_of(dim, predicted), degree, components)


def _matrix(simplices: Sequence[float], degree: int, components: int) -> tuple[float, float]:
    unknowns = components * unknowns_of(simplices, degree)
    nonzeros = components**2 * nonzeros_of(simplices, degree)
    index = 4.0 if nonzeros < 2.0**31 else 8.0
    return unknowns, (8.0 + index) * nonzeros + index * (unknowns + 1.0)


def system_of(report: SizeReport, degree: int, components: int) -> tuple[float, float]:
    """Return the same for the mesh that a report predicts."""
    predicted = Prediction(report.n_elements, report.n_facets, report.n_nodes)
    return matrix_of(report.element_dim, predicted, degree, components)


def unknowns_on(mesh: SimplexMesh, degree: int, components: int) -> float:
    """Return the number of unknowns on a mesh."""
    return _matrix(simplices_on(mesh), degree, components)[0]


def memory_on(mesh: SimplexMesh, degree: int, components: int) -> float:
    """Return the bytes of the assembled matrix on a mesh."""
    return _matrix(simplices_on(mesh), degree, components)[1]


def simplices_on(mesh: SimplexMesh) -> tuple[float, ...]:
    """Return the numbers of nodes, edges ... cells of a mesh."""
    inner = {1: [], 2: [len(mesh.edges)], 3: [len(mesh.edges), len(mesh.facets)]}[mesh.cell_dim]
    return mesh.n_points, *inner, mesh.n_cells


def as_bytes(memory: str) -> float:
    """Return the number of bytes that a text such as "8GB" stands for."""
    found = _MEMORY.fullmatch(memory) if isinstance(memory, str) else None
    number = float(found[1]) if found else 0.0
    if found is None or number == 0.0:
        wanted = 'must be a text such as "8GB" or "500MB"'
        raise refusal("max_memory", f"{wanted}, got {describe(memory)}")
    return number * 1000.0 ** " KMGT".index(found[2].upper() or " ")
