"""An order of nodes and cells that depends on their places only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from adaptsize.background.simplex import SimplexMesh


def ordered_by_place(mesh: SimplexMesh) -> tuple[SimplexMesh, npt.NDArray[np.intp]]:
    """Return a mesh with its nodes sorted by their coordinates, and its cells by their nodes.

    What is computed from it is the same for any order of nodes and cells, bit by bit, unless nodes
    coincide.  Data are dropped.

    Returns
    -------
    SimplexMesh
    intp[n_points]
        The node of the given mesh at each node.

    Examples
    --------
    >>> mesh = SimplexMesh([[1, 0], [0, 0], [0, 1]], [[0, 2, 1]])
    >>> ordered, nodes = ordered_by_place(mesh)
    >>> ordered.cells.tolist(), nodes.tolist()
    ([[0, 2, 1]], [1, 2, 0])
    """
    nodes = np.lexsort(mesh.points.T[::-1])
    number = np.empty(mesh.n_points, np.int32)
    number[nodes] = np.arange(mesh.n_points, dtype=np.int32)
    cells = number[mesh.cells]
    if mesh.cell_dim == 2:  # begin with the first node and keep the orientation
        start = cells.argmin(axis=1)[:, None]
        cells = np.take_along_axis(cells, (start + np.arange(3)) % 3, axis=1)
    order = np.lexsort(cells.T[::-1])
    facets = mesh.tagged_facets
    ordered = replace(
        mesh,
        points=mesh.points[nodes],
        cells=cells[order],
        cell_tags=None if mesh.cell_tags is None else mesh.cell_tags[order],
        tagged_facets=None if facets is None else number[facets],
        point_data={},
        cell_data={},
    )
    return ordered, nodes
