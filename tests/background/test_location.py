"""The locator against a look at every cell."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import jittered_cube, random_sphere, random_square
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import SimplexMesh
from adaptsize._kernels.distance import closest_on_cell


def smallest_distances(mesh, points):
    """Distance of each point to its closest cell, by trying all of them."""
    corners = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.dim)))
    cells = mesh.cells.copy()  # writable, as everywhere else: one compilation less
    result = []
    for x in np.pad(points, ((0, 0), (0, 3 - mesh.dim))):
        place = tuple(float(t) for t in x)
        tried = [closest_on_cell(corners, cells, c, place)[0] for c in range(mesh.n_cells)]
        result.append(np.sqrt(min(tried)))
    return np.array(result)


def closest_points(mesh, cells, weights):
    return (weights[:, :, None] * mesh.points[mesh.cells[cells]]).sum(axis=1)


def check_against_all_cells(mesh, points):
    cells, weights, distances = mesh.locator.nearest(points)
    unit = np.abs(mesh.points).max() + np.abs(points).max()
    assert_allclose(distances, smallest_distances(mesh, points), rtol=0.0, atol=1e-13 * unit)
    # The weights give a point of the cell at that distance.
    assert (weights >= 0.0).all()
    assert_allclose(weights.sum(axis=1), 1.0, rtol=0.0, atol=1e-13)
    moved = np.linalg.norm(closest_points(mesh, cells, weights) - points, axis=1)
    assert_allclose(moved, distances, rtol=0.0, atol=1e-13 * unit)


def polyline():
    angle = np.linspace(0.0, 5.0, 40)
    points = np.column_stack([np.cos(angle), np.sin(angle), 0.1 * angle])
    return SimplexMesh(points, np.column_stack([np.arange(39), np.arange(1, 40)]))


def with_hole():
    mesh = random_square(300, 61007)
    centres = mesh.points[mesh.cells].mean(axis=1)
    return SimplexMesh(mesh.points, mesh.cells[np.linalg.norm(centres, axis=1) > 0.6])


def two_balls():
    first, second = random_sphere(60, 30317), random_sphere(40, 30319, radius=0.2)
    points = np.concatenate([first.points, second.points + np.array([2.0, 0.0, 0.0])])
    return SimplexMesh(points, np.concatenate([first.cells, second.cells + 60]))


MESHES = {
    "triangles": lambda: random_square(200, 8123),
    "with a hole": with_hole,
    "tetrahedra": lambda: jittered_cube(5, 771, half_width=1.0),
    "sphere": lambda: random_sphere(150, 4099),
    "two balls": two_balls,
    "polyline in space": polyline,
    "segments on a line": lambda: SimplexMesh([[0.0], [1.0], [3.0], [4.0]], [[0, 1], [2, 3]]),
    "one triangle": lambda: SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]]),
}


@pytest.mark.parametrize("name", MESHES)
def test_nearest_agrees_with_a_look_at_every_cell(name):
    mesh = MESHES[name]()
    rng = np.random.default_rng(1709)
    around = rng.uniform(-1.6, 1.6, (40, mesh.dim))
    far = rng.uniform(-1e3, 1e3, (5, mesh.dim))
    on_nodes = mesh.points[mesh.cells[:10].ravel()]
    on_edges = mesh.points[mesh.edges[:20]].mean(axis=1)
    check_against_all_cells(mesh, np.concatenate([around, far, on_nodes, on_edges]))


@st.composite
def lattice_meshes(draw):
    """Draw cells between random points of a coarse lattice: overlapping, flat, repeated."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    dim = draw(st.integers(1, 3))
    width = draw(st.integers(2, dim + 1))
    points = rng.integers(0, 4, (int(rng.integers(width, 30)), dim)).astype(float)
    n_cells = int(rng.integers(1, 40))
    cells = np.array([rng.permutation(len(points))[:width] for _ in range(n_cells)])
    queries = rng.integers(-2, 12, (12, dim)) / 2.0
    return SimplexMesh(points, cells), queries


@given(lattice_meshes())
@settings(max_examples=60)
def test_nearest_agrees_with_a_look_at_every_cell_of_nasty_meshes(case):
    check_against_all_cells(*case)


@pytest.mark.parametrize("name", MESHES)
def test_cells_within_a_distance_are_those_of_a_look_at_every_cell(name):
    mesh, rng = MESHES[name](), np.random.default_rng(61013)
    points = rng.uniform(mesh.points.min() - 0.2, mesh.points.max() + 0.2, (20, mesh.dim))
    points[:4] = mesh.points[mesh.cells[rng.integers(0, mesh.n_cells, 4), 0]]
    reach = np.where(np.arange(20) % 2 == 0, 0.0, 0.4)
    which, cells = mesh.locator.within(points, reach)
    corners = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.dim)))
    rows = mesh.cells.copy()
    expected = [
        (q, c)
        for q, x in enumerate(np.pad(points, ((0, 0), (0, 3 - mesh.dim))))
        for c in range(mesh.n_cells)
        if closest_on_cell(corners, rows, c, tuple(map(float, x)))[0] <= reach[q] ** 2
    ]
    assert list(zip(which.tolist(), cells.tolist(), strict=True)) == expected


@pytest.mark.parametrize("scale", [1e-59, 1e59])
def test_any_unit_of_length_works(scale):
    mesh = random_square(50, 1213)
    points = np.random.default_rng(1217).uniform(-2.0, 2.0, (100, 2))
    cells, weights, distances = mesh.locator.nearest(points)
    scaled = SimplexMesh(mesh.points * scale, mesh.cells).locator.nearest(points * scale)
    assert_array_equal(scaled[0], cells)
    # Relative rounding of the scaled coordinates, enlarged by the flattest triangle.
    assert_allclose(scaled[1], weights, rtol=0.0, atol=1e-11)
    assert_allclose(scaled[2] / scale, distances, rtol=1e-12, atol=1e-15)
