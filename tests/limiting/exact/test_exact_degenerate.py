"""Exact limiting on meshes that are no proper triangulation, with answers worked out by hand.

A source of size 1 is at one node; ``lengths`` are those of the shortest paths from there.
"""

import numpy as np
import pytest
from exact_oracle import plane_domain, plane_sizes
from meshes import slit_square, structured_square
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import Delaunay
from shapes import joined, moved
from test_exact_any_mesh import assert_between_bounds

from adaptsize import SimplexMesh, limit_gradient
from adaptsize.limiting import Exact

G = 0.3
INF = np.inf
SQRT2, SQRT5 = np.sqrt(2.0), np.sqrt(5.0)


def limit(mesh, h0, face_sources=True):
    return limit_gradient(mesh, h0, G, method=Exact(face_sources))


def assert_lengths(mesh, source, lengths):
    """Compare sizes, and in the plane those of the reference, with 1 + g * lengths."""
    h0 = np.full(mesh.n_points, INF)
    h0[source] = 1.0
    expected = 1.0 + G * np.asarray(lengths)
    if mesh.cell_dim == 2:
        assert_allclose(plane_sizes(plane_domain(mesh), h0, G), expected, rtol=1e-13)
    for face_sources in (False, True):
        assert_allclose(limit(mesh, h0, face_sources=face_sources), expected, rtol=1e-13)


# Three unit squares, an L, its reflex corner at node 4.  From node 5 = (2, 1): node 7 = (1, 2) by
# the corner 1 + 1, node 6 = (0, 2) by the corner 1 + sqrt 2.
L_POINTS = [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1], [0, 2], [1, 2]]
L_CELLS = [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [3, 4, 7], [3, 7, 6]]
L_LENGTHS = [SQRT5, SQRT2, 1.0, 2.0, 1.0, 0.0, 1.0 + SQRT2, 2.0]


@pytest.mark.parametrize("again", [[0], [3], [4], [2, 3, 4], [0, 1, 2, 3, 4, 5]])
@pytest.mark.parametrize("order", [[0, 1, 2], [1, 0, 2]], ids=["alike", "turned over"])
def test_cells_given_twice_have_no_effect(again, order):
    twice = np.array(L_CELLS)[again][:, order]
    assert_lengths(SimplexMesh(L_POINTS, np.concatenate([L_CELLS, twice])), 5, L_LENGTHS)


def test_a_node_at_the_place_of_another_does_not_see_through_the_wall_there():
    mesh = slit_square(10)
    distance = np.linalg.norm(mesh.points - [0.6, 0.0], axis=1)
    faces = np.flatnonzero(distance < 1e-12)  # a node on each face of the slit, which ends at 0
    for node, source in (faces, faces[::-1]):
        cell = mesh.cells[(mesh.cells == node).any(axis=1)][0]
        flat = [node, mesh.n_points, cell[cell != node][0]]
        points = np.concatenate([mesh.points, mesh.points[[node]]])
        h0 = np.full(len(points), INF)
        h0[source] = 1.0
        h = limit(SimplexMesh(points, np.concatenate([mesh.cells, [flat]])), h0)
        assert_allclose(h[[node, -1]], 1.0 + G * 1.2, rtol=1e-13)


def test_flat_cells_on_the_hull_have_no_effect():
    # The L, node 8 in the middle of its lower side 0-2 and node 9 in the middle of 4-5.
    points = [*L_POINTS, [1.5, 0.0], [1.5, 1.0]]
    lengths = [*L_LENGTHS, np.hypot(0.5, 1.0), 0.5]
    cut = [[0, 1, 4], [0, 4, 3], [1, 8, 9], [1, 9, 4], [8, 2, 5], [8, 5, 9], *L_CELLS[4:]]
    for flat in ([[1, 8, 2]], [[4, 9, 5]], [[1, 8, 2], [9, 5, 4]]):
        for cells in (flat, [cell[::-1] for cell in flat]):
            assert_lengths(SimplexMesh(points, cut + cells), 5, lengths)


def test_a_node_that_only_a_flat_cell_on_the_hull_has_is_reached_through_it():
    # Nodes 8 and 9 as above, but on sides of cells that do not have them.
    points = [*L_POINTS, [1.5, 0.0], [1.5, 1.0]]
    mesh = SimplexMesh(points, [*L_CELLS, [1, 8, 2], [4, 9, 5]])
    assert_lengths(mesh, 5, [*L_LENGTHS, np.hypot(0.5, 1.0), 0.5])
    # From node 8 all is seen but node 7: the line to node 6 is left of the corner at y = 1.
    near = np.hypot(0.5, 1.0)
    assert_lengths(mesh, 8, [1.5, 0.5, 0.5, np.hypot(1.5, 1), near, near, 2.5, near + 1, 0, 1])


# Below y = 0 one cell on the side from node 0 to node 1, above it two, which meet in node 2.
ROWS = [[0, 0], [2, 0], [1, 0], [1, -1], [0, 1], [2, 1]]
ROW_CELLS = [[0, 1, 3], [0, 2, 4], [2, 5, 4], [2, 1, 5]]


def test_a_flat_cell_between_two_rows_lets_everything_through():
    # The hull of the six nodes, which is convex.
    mesh = SimplexMesh(ROWS, [*ROW_CELLS, [0, 2, 1]])
    assert_lengths(mesh, 3, [SQRT2, SQRT2, 1.0, 0.0, SQRT5, SQRT5])
    assert_lengths(mesh, 4, [1.0, SQRT5, SQRT2, SQRT5, 0.0, 2.0])


@pytest.mark.parametrize("gap", [0.0, 0.1])
def test_nothing_crosses_between_components(gap):
    one = structured_square(5, half_width=1.0)
    mesh = joined(one, moved(one, [2.0 + gap, 0.0]))
    away = np.linalg.norm(one.points - one.points[0], axis=1)
    assert_lengths(mesh, 0, np.concatenate([away, np.full(one.n_points, INF)]))
    h0 = np.full(mesh.n_points, INF)
    h0[[0, one.n_points]] = 1.0, 0.1
    expected = np.concatenate([1.0 + G * away, 0.1 + G * away])
    assert_allclose(limit(mesh, h0), expected, rtol=1e-13)


def boxes(*corners):
    """Unit cubes of 6 tetrahedra each, which share the nodes that they have in common."""
    ways = [[0, 1, 3, 7], [0, 1, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 4, 6, 7]]
    unit = np.array([[k & 1, k >> 1 & 1, k >> 2] for k in range(8)], float)
    all_points = (np.array(corners, float)[:, None] + unit).reshape(-1, 3)
    points, number = np.unique(all_points, axis=0, return_inverse=True)
    cells = number.reshape(-1, 1, 8)[:, 0][:, ways]
    return SimplexMesh(points, cells.reshape(-1, 4))


def node_at(mesh, place):
    return int(np.flatnonzero((mesh.points == place).all(axis=1))[0])


def test_tetrahedra_given_twice_or_flat_have_no_effect():
    mesh = boxes((0, 0, 0), (1, 0, 0), (0, 1, 0))
    source = node_at(mesh, (2, 1, 0))
    h0 = np.full(mesh.n_points, INF)
    h0[source] = 1.0
    h = limit(mesh, h0)
    # Over the edge x = y = 1 to (1, 2, z): turned into one plane, hypot(1 + 1, z).
    for z, length in ((0, 2.0), (1, SQRT5)):
        assert_allclose(h[node_at(mesh, (1, 2, z))], 1.0 + G * length, rtol=1e-9)
    corners = [node_at(mesh, place) for place in ((0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1))]
    for more in (mesh.cells[:3], mesh.cells[5:, [1, 0, 2, 3]], mesh.cells, [corners]):
        changed = SimplexMesh(mesh.points, np.concatenate([mesh.cells, more]))
        assert_allclose(limit(changed, h0), h, rtol=1e-12)


def test_cubes_that_share_an_edge_a_node_or_nothing():
    # Over the common edge x = y = 1 from (0, 1, 0) to (1, 2, 1): hypot(1 + 1, 1) at the least.
    mesh = boxes((0, 0, 0), (1, 1, 0))
    h0 = np.full(mesh.n_points, INF)
    h0[node_at(mesh, (0, 1, 0))] = 1.0
    h = limit(mesh, h0)
    assert h[node_at(mesh, (1, 2, 1))] > (1.0 + G * SQRT5) * (1.0 - 1e-12)
    assert_allclose(h[node_at(mesh, (1, 2, 0))], 1.0 + G * 2.0, rtol=1e-12)
    assert_between_bounds(mesh, h0, G, face_sources=False)
    # By the common node (1, 1, 1): sqrt 2 + sqrt 2 from (0, 1, 0) to (2, 1, 2).
    mesh = boxes((0, 0, 0), (1, 1, 1))
    h0 = np.full(mesh.n_points, INF)
    h0[node_at(mesh, (0, 1, 0))] = 1.0
    h = limit(mesh, h0)
    assert_allclose(h[node_at(mesh, (2, 1, 2))], 1.0 + G * 2.0 * SQRT2, rtol=1e-12)
    assert_between_bounds(mesh, h0, G, face_sources=False)
    mesh = boxes((0, 0, 0), (1.5, 0, 0))
    h0 = np.full(mesh.n_points, INF)
    h0[node_at(mesh, (1, 0, 0))] = 1.0
    assert_array_equal(np.isinf(limit(mesh, h0)), mesh.points[:, 0] > 1.2)


def test_bounds_that_satisfy_the_limit_need_no_paths():
    # Regression: the set of paths was empty, and was indexed.
    points = np.random.default_rng(2).random((20, 3))
    cells = Delaunay(points).simplices
    doubled = SimplexMesh(points, np.concatenate([cells, cells]))
    h, info = limit_gradient.with_info(doubled, np.full(20, 0.5), 0.3, method="exact")
    assert (h == 0.5).all()
    assert info.n_proved == 20


def test_information_passes_through_a_pinched_node():
    # Unit squares that share node 3 = (1, 1).  From node 1 = (1, 0): to (2, 1) by the node 1 + 1,
    # straight 1.4; to (1, 2) straight through the node.
    points = [[0, 0], [1, 0], [0, 1], [1, 1], [2, 1], [1, 2], [2, 2]]
    cells = [[0, 1, 3], [0, 3, 2], [3, 4, 6], [3, 6, 5]]
    assert_lengths(SimplexMesh(points, cells), 1, [1.0, 0, SQRT2, 1, 2, 2, 1 + SQRT2])
    lengths = [0, 1, 1, SQRT2, 1 + SQRT2, 1 + SQRT2, 2 * SQRT2]
    assert_lengths(SimplexMesh(points, cells), 0, lengths)
