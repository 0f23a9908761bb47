"""SizeFunction: interpolation, points outside, inf, and the errors."""

from functools import partial

import numpy as np
import pytest
from meshes import jittered_cube, random_sphere, random_square, structured_square
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import SimplexMesh, SizeFunction
from adaptsize.errors import OutsideError

SQUARE = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])


def points_of_cells(mesh, n, seed):
    """Random points of the mesh, the same number from each cell on average."""
    rng = np.random.default_rng(seed)
    cells = rng.integers(0, mesh.n_cells, n)
    weights = rng.dirichlet(np.ones(mesh.cells.shape[1]), n)
    return (weights[:, :, None] * mesh.points[mesh.cells[cells]]).sum(axis=1)


@pytest.mark.parametrize(
    "mesh",
    [random_square(500, 3301), jittered_cube(6, 3307, half_width=1.0), random_sphere(300, 3313)],
    ids=["triangles", "tetrahedra", "surface"],
)
def test_linear_sizes_are_reproduced_to_rounding(mesh):
    slope = np.array([0.3, -0.2, 0.1])[: mesh.dim]
    points = points_of_cells(mesh, 2500, 3319)
    size = SizeFunction(mesh, 1.0 + mesh.points @ slope)
    assert_allclose(size(points), 1.0 + points @ slope, rtol=0.0, atol=1e-12)


def test_sizes_stay_between_the_nodal_ones_and_constants_are_exact():
    mesh = random_square(200, 3331)
    points = np.random.default_rng(3343).uniform(-2.0, 2.0, (1000, 2))
    assert_array_equal(SizeFunction(mesh, np.full(200, 0.1))(points), 0.1)
    values = np.random.default_rng(3347).uniform(0.1, 3.0, 200)
    sizes = SizeFunction(mesh, values)(points)
    assert sizes.min() >= values.min()
    assert sizes.max() <= values.max()


def test_outside_takes_the_value_of_the_closest_point():
    size = SizeFunction(SQUARE, 1.0 + SQUARE.points @ [1.0, 2.0])
    points = np.random.default_rng(3359).uniform(-2.0, 3.0, (500, 2))
    inside = np.clip(points, 0.0, 1.0)  # the closest point of a square
    assert_allclose(size(points), 1.0 + inside @ [1.0, 2.0], rtol=1e-14)


def test_outside_error_names_the_first_point_and_its_distance():
    size = SizeFunction(SQUARE, np.ones(4), outside="error")
    with pytest.raises(
        OutsideError,
        match=r"got points\[1\] = \(2, 0\.5\) at a distance of 1 from it \(and 1 more\)",
    ):
        size([[0.5, 0.5], [2.0, 0.5], [0.5, -3.0]])


def test_inf_spreads_over_cells_but_not_to_finite_nodes_and_edges():
    size = SizeFunction(SQUARE, [1.0, np.inf, 2.0, 3.0])
    points = [
        [0.0, 0.0],  # finite node
        [1.0, 0.0],  # node that is inf
        [0.75, 0.25],  # in the cell of that node
        [0.5, 0.5],  # middle of the edge between 1 and 2
        [0.25, 0.75],  # in the cell where all is finite: 1/4, 1/4, 1/2
        [-1.0, -1.0],  # closest to the finite node
        [2.0, -1.0],  # closest to the node that is inf
    ]
    assert_array_equal(size(points), [1.0, np.inf, np.inf, 1.5, 2.25, 1.0, np.inf])


ONES = SizeFunction(SQUARE, np.ones(4))
OF_VALUES = partial(SizeFunction, SQUARE)


@pytest.mark.parametrize(
    ("call", "given", "message"),
    [
        (ONES, [0.5, 0.5], r"shape \(n, 2\), got \(2,\); .* shape \(1, 2\)"),
        (OF_VALUES, [1.0, 0.0, 1.0, -1.0], r"values\[1\] = 0\.0 \(and 1 more\)"),
        (lambda h: ONES.clip(*h), (2.0, 1.0), "hmin must be at most hmax = 1, got 2"),
        (lambda g: SizeFunction(SQUARE, np.ones(4), g=g), 0.3, "g is for sizes on surfaces"),
        (lambda h: SizeFunction(SQUARE, np.ones(4), hmax=h), 0.3, "hmax needs g"),
    ],
)
def test_what_does_not_fit_is_refused(call, given, message):
    with pytest.raises(ValueError, match=message):
        call(given)


def test_values_are_copied_and_read_only():
    given = np.ones(4)
    size = SizeFunction(SQUARE, given)
    given[0] = 7.0
    assert_array_equal(size.values, 1.0)
    with pytest.raises(ValueError, match="read-only"):
        size.values[0] = 2.0


def test_minimum_with_another_background_samples_at_the_own_nodes():
    fine = structured_square(8, half_width=1.0)
    other = SizeFunction(SQUARE, 0.5 + SQUARE.points @ [1.0, 0.0])
    least = SizeFunction(fine, np.ones(fine.n_points)).minimum(other)
    x = np.clip(fine.points[:, 0], 0.0, 1.0)  # outside the unit square: its closest point
    assert least.background is fine
    assert_allclose(least.values, np.minimum(1.0, 0.5 + x), rtol=1e-14)


def test_clip_keeps_values_between_the_bounds():
    size = SizeFunction(SQUARE, [0.1, 1.0, 5.0, np.inf])
    assert_array_equal(size.clip(0.2, 2.0).values, [0.2, 1.0, 2.0, 2.0])
    assert_array_equal(size.clip(hmin=0.2).values, [0.2, 1.0, 5.0, np.inf])
    assert_array_equal(size.clip(hmax=2.0).values, [0.1, 1.0, 2.0, 2.0])
    assert_array_equal(size.clip().values, size.values)


def test_on_another_mesh_samples_at_its_nodes():
    fine = structured_square(4, half_width=0.5)
    fine = SimplexMesh(fine.points + 0.5, fine.cells)
    size = SizeFunction(SQUARE, 1.0 + SQUARE.points @ [2.0, 1.0]).on(fine)
    assert size.background is fine
    assert_allclose(size.values, 1.0 + fine.points @ [2.0, 1.0], rtol=1e-14)


# --- off surfaces and lines ---------------------------------------------------------------


def least_over_a_surface(mesh, values, points, g, n=20):
    """The least of h(y) + g |x - y| over samples of the triangles, from above."""
    at = [(i / n, j / n) for i in range(n + 1) for j in range(n + 1 - i)]
    weights = np.array([(1.0 - s - t, s, t) for s, t in at])
    samples = np.einsum("sv,cvd->csd", weights, mesh.points[mesh.cells]).reshape(-1, 3)
    sizes = np.einsum("sv,cv->cs", weights, values[mesh.cells]).ravel()
    away = np.linalg.norm(points[:, None] - samples, axis=2)
    return (sizes + g * away).min(axis=1)


@pytest.mark.parametrize("g", [0.1, 2.0])
def test_sizes_off_a_surface_are_the_least_that_it_allows(g):
    rng = np.random.default_rng(2301)
    mesh = random_sphere(60, 2302)
    values = rng.uniform(0.2, 1.0, mesh.n_points)
    points = rng.uniform(-0.5, 0.5, (200, 3))
    size = SizeFunction(mesh, values, g=g)
    reference = least_over_a_surface(mesh, values, points, g)
    found = size(points)
    spacing = mesh.edge_lengths.max() / 20
    assert (found <= reference * (1.0 + 1e-12)).all()
    assert (found >= reference - (g + 2.0) * spacing).all()
    capped = SizeFunction(mesh, values, g=g, hmax=0.4)
    assert_array_equal(capped(points), np.minimum(found, 0.4))


def test_sizes_off_a_line_in_the_plane_grow_with_the_distance():
    line = SimplexMesh([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]], [[0, 1], [1, 2]])
    size = SizeFunction(line, [0.5, 0.5, 0.5], g=0.3)
    assert_allclose(size([[0.5, 2.0], [2.0, -1.0], [4.0, 0.0]]), [1.1, 0.8, 0.8], rtol=1e-12)


def test_the_growth_is_kept_by_clip_and_minimum_and_spent_by_on():
    cube = jittered_cube(4, 2305)
    surface = cube.boundary().mesh
    size = SizeFunction(surface, np.full(surface.n_points, 2.0), g=0.1, hmax=4.0)
    middle = [[0.0, 0.0, 0.0]]
    assert size(middle) == 4.0
    assert size.clip(hmax=3.0)(middle) == 3.0
    assert size.minimum(SizeFunction(surface, np.full(surface.n_points, 1.0)))(middle) == 4.0
    nodal = size.on(cube)
    assert nodal.g is None
    assert_array_equal(nodal.values, size(cube.points))
