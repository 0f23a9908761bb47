"""Cells on the same side of a facet as a neighbour, against the definition."""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from adaptsize import SimplexMesh
from adaptsize.quality.connections import repeated_cells
from adaptsize.quality.elements import flat_cells, folded_cells


def folded_slowly(mesh):
    """For each inner facet of two cells, compare the sides of the opposite corners."""
    flat, found = flat_cells(mesh), np.zeros(mesh.n_cells, bool)
    for k, facet in enumerate(mesh.facets):
        cells, corners = np.nonzero(mesh.cell_facets == k)
        if len(cells) != 2 or flat[cells].any():
            continue
        base = mesh.points[facet]
        sides = []
        for c, v in zip(cells, corners, strict=True):
            edges = np.vstack([base[1:] - base[0], mesh.points[mesh.cells[c, v]] - base[0]])
            sides.append(np.sign(np.linalg.det(edges)))
        found[cells] |= sides[0] == sides[1] != 0.0
    return found


def repeated_slowly(mesh):
    rows = [tuple(sorted(cell)) for cell in mesh.cells.tolist()]
    return [[k, rows.index(row)] for k, row in enumerate(rows) if rows.index(row) < k]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("moved", [0.0, 0.1, 0.4])
@pytest.mark.parametrize("kind", ["positive", "any orientation", "repeated", "flat"])
def test_folded_and_repeated_cells_are_those_of_the_definition(kind, moved, dim):
    rng = np.random.default_rng(int(10 * moved) + dim)
    for _ in range(12):
        points = rng.random((int(rng.integers(dim + 2, 25)), dim))
        cells = Delaunay(points).simplices.astype(np.int32)
        points = points + moved * rng.normal(size=points.shape)
        if kind != "positive":
            cells = np.array([rng.permutation(cell) for cell in cells])
        if kind == "repeated":
            again = cells[rng.integers(0, len(cells), 2)]
            cells = np.concatenate([cells, [rng.permutation(cell) for cell in again]])
        if kind == "flat":
            points[cells[0, -1]] = points[cells[0, :-1]].mean(axis=0)
        mesh = SimplexMesh(points, cells)
        assert np.array_equal(folded_cells(mesh), folded_slowly(mesh))
        assert repeated_cells(mesh).tolist() == repeated_slowly(mesh)


def test_a_cell_twice_beside_nothing_else_is_found():
    points = [[0, 0], [1, 0], [0, 1], [5, 5], [6, 5], [5, 6]]
    mesh = SimplexMesh(points, [[0, 1, 2], [3, 4, 5], [5, 3, 4]])
    assert repeated_cells(mesh).tolist() == [[2, 1]]
