"""Edges across walls: their lengths follow from the domain, whatever the sizes."""

import numpy as np

from adaptsize.background import SimplexMesh
from adaptsize.background.simplex import facets_with_normals
from adaptsize.background.topology import are_among, edges_of, marked
from adaptsize.geometry.boundary import facet_normals
from adaptsize.quality import tuning
from adaptsize.typing import BoolArray


def across_walls(mesh: SimplexMesh) -> BoolArray:
    """Return whether each edge leads from one side of the boundary to the opposite one, inside.

    At the nodes of opposite sides, the outward normals point away from each other.  Surfaces have
    no inside.

    Examples
    --------
    Of a row of squares, the edges through the inside, but not those at both ends:

    >>> points = [[x, y] for x in range(4) for y in (0, 1)]
    >>> cells = [[2 * k + i for i in three] for k in range(3) for three in ((0, 2, 3), (0, 3, 1))]
    >>> mesh = SimplexMesh(points, cells)
    >>> mesh.edges[across_walls(mesh)].tolist()
    [[0, 3], [2, 3], [2, 5], [4, 5], [4, 7]]
    """
    found = np.zeros(len(mesh.edges), np.bool_)
    if mesh.cell_dim < mesh.dim:
        return found
    facets = facets_with_normals(mesh, mesh.facet_cell_counts == 1)[2]
    normals = np.zeros_like(mesh.points)
    np.add.at(normals, facets, facet_normals(mesh.points[facets])[:, None])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.maximum(lengths, np.finfo(float).tiny)
    on_boundary = marked(facets, mesh.n_points)[mesh.edges].all(axis=1)
    inner = on_boundary & ~are_among(mesh.edges, edges_of(facets, mesh.n_points))
    one, other = normals[mesh.edges[inner]].swapaxes(0, 1)
    found[inner] = np.einsum("ij,ij->i", one, other) < tuning.OPPOSITE_SIDES
    return found
