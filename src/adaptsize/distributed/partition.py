"""Partitions of the cells of a mesh."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background._curve import along_curve
from adaptsize.typing import IntArray


def partition_cells(mesh: SimplexMesh, n_parts: int) -> IntArray:
    """Return the part of each cell, 0 to n_parts - 1: connected parts of nearly equal size.

    METIS is used if ``pymetis`` 2025.2 or later is installed.  Otherwise the cells along a Morton
    curve are cut into pieces of equal length.
    """
    if n_parts < 2 or mesh.n_cells <= n_parts:
        return np.arange(mesh.n_cells, dtype=np.int32) % n_parts
    if find_spec("pymetis") is not None:
        import pymetis

        if hasattr(pymetis, "CSRAdjacency"):
            return _by_metis(mesh, n_parts)
    order = along_curve(np.ascontiguousarray(mesh.points[mesh.cells].mean(axis=1)))
    part = np.empty(mesh.n_cells, np.int32)
    part[order] = np.arange(mesh.n_cells) * n_parts // mesh.n_cells
    return part


def _by_metis(mesh: SimplexMesh, n_parts: int) -> IntArray:
    """Return the parts that METIS finds in the graph of cells with a common facet."""
    import pymetis
    from scipy.sparse import csr_array

    n_facets = len(mesh.facets)
    rows = np.repeat(np.arange(mesh.n_cells), mesh.cells.shape[1])
    incidence = csr_array(
        (np.ones(len(rows), np.int8), (rows, mesh.cell_facets.ravel())),
        shape=(mesh.n_cells, n_facets),
    )
    graph = (incidence @ incidence.T).tocsr()
    graph.setdiag(0)
    graph.eliminate_zeros()
    adjacency = pymetis.CSRAdjacency(graph.indptr, graph.indices)
    found = pymetis.part_graph(n_parts, adjacency)
    return np.asarray(found[1], np.int32)
