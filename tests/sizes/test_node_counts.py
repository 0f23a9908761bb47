"""The predicted number of nodes."""

import numpy as np
import pytest
from meshes import jittered_cube, structured_square

from adaptsize import SimplexMesh, remesh
from adaptsize.sizes import predict
from adaptsize.sizes.budget import elements_with_nodes, nodes_of

TETRAHEDRON = SimplexMesh(np.vstack([np.zeros(3), np.eye(3)]), [[0, 1, 2, 3]])


@pytest.mark.parametrize("n", [3, 40])
def test_triangles_follow_from_euler(n):
    mesh = structured_square(n)
    boundary = mesh.boundary().mesh.n_cells
    assert nodes_of(2, mesh.n_cells, boundary) == mesh.n_points - 1  # characteristic 1
    expected = elements_with_nodes(structured_square(2), mesh.n_points - 1)
    assert expected == pytest.approx(mesh.n_cells)


def test_sizes_are_counted_inside_and_on_the_boundary():
    # Sides of length 1 and the hypotenuse, an area of 1/2.
    mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    triangles = 4.0 / np.sqrt(3.0) * 0.5 / 0.01**2
    segments = (2.0 + np.sqrt(2.0)) / 0.01
    assert predict(mesh, np.full(3, 0.01)).nodes == pytest.approx(0.5 * (triangles + segments))
    line = SimplexMesh([[0.0], [1.0]], [[0, 1]])
    assert predict(line, [0.1, 0.1]).nodes == pytest.approx(11)


def test_tetrahedra_are_those_around_edges():
    # A ball of many regular tetrahedra would have 1 / (6 / q - 1) cells per node: 5.9 for q = 5.13.
    assert 1e6 / nodes_of(3, 1e6, 0.0) == pytest.approx(5.9, abs=0.01)
    expected = elements_with_nodes(TETRAHEDRON, 1e6)
    facets = 4.0 * expected ** (2 / 3)
    assert nodes_of(3, expected, facets) == pytest.approx(1e6)


def test_mmg_makes_the_predicted_number():
    pytest.importorskip("mmgpy")
    cube = jittered_cube(4, 1711, half_width=0.5)
    new = remesh(cube, lambda x: np.full(len(x), 0.1), backend="mmg")
    boundary = new.boundary().mesh.n_cells
    assert nodes_of(3, new.n_cells, boundary) == pytest.approx(new.n_points, rel=0.01)
