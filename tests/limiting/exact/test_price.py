"""`method="auto"` leaves domains with very many corners to fast marching."""

import domains
import numpy as np
import pytest
from meshes import jittered_square
from numpy.testing import assert_array_equal
from partitions import SIZE, on_ranks, partition

import adaptsize as ads
from adaptsize import limit_gradient
from adaptsize.geometry.boundary import flat_boundary
from adaptsize.geometry.convexity import count_corners
from adaptsize.limiting.exact.plane import check_price
from adaptsize.limiting.problem import TooManyCorners

G = 0.3


def porous(n_side, n_holes):
    """Return a square without some of its triangles, with a bound at one node."""
    mesh, _ = domains.with_removed_cells(jittered_square(n_side, 2301), 2302, n_holes)
    h0 = np.full(mesh.n_points, np.inf)
    h0[mesh.cells[0, 0]] = 1.0
    return mesh, h0


MANY = porous(30, 150)
FEW = porous(30, 60)


def corners_of(mesh):
    return count_corners(mesh.points, flat_boundary(mesh))


def test_fast_marching_is_taken_where_corners_are_too_many():
    mesh, h0 = MANY
    n = corners_of(mesh)
    assert n > 256
    assert n * n > 40 * mesh.n_points
    h, info = limit_gradient.with_info(mesh, h0, G)
    assert info.method == "fast-marching"
    assert info.n_proved is None
    assert_array_equal(h, limit_gradient(mesh, h0, G, method="fast-marching"))
    assert limit_gradient.with_info(mesh, h0, G, method="exact")[1].method == "exact"


def test_the_exact_method_is_taken_where_they_are_few():
    mesh, h0 = FEW
    assert 0 < corners_of(mesh) <= 256
    assert limit_gradient.with_info(mesh, h0, G)[1].method == "exact"


@pytest.mark.parametrize(
    ("n_corners", "n_nodes", "too_many"),
    [(256, 1, False), (257, 1651, True), (257, 1652, False), (2000, 100_000, False)],
)
def test_the_limit_is_the_documented_one(n_corners, n_nodes, too_many):
    if too_many:
        with pytest.raises(TooManyCorners):
            check_price(n_corners, n_nodes)
    else:
        check_price(n_corners, n_nodes)


def test_nodes_of_walls_that_are_straight_to_noise_do_not_count():
    mesh, _ = domains.maze(6000, seed=2305)
    assert corners_of(mesh) == 23
    rng = np.random.default_rng(2306)
    noisy = ads.SimplexMesh(mesh.points + rng.uniform(-1e-6, 1e-6, mesh.points.shape), mesh.cells)
    assert corners_of(noisy) == 23


def test_bounds_at_points_are_solved_exactly_at_any_price():
    mesh, h0 = MANY
    place = mesh.points[mesh.cells[7]].mean(axis=0, keepdims=True)
    _, info = limit_gradient.with_info(mesh, h0, G, point_sources=(place, [0.5]))
    assert info.method == "exact"


@pytest.mark.parametrize("domain", [MANY, FEW])
def test_a_warm_start_takes_the_same_method(domain):
    mesh, h0 = domain
    _, info = limit_gradient.with_info(mesh, h0, G)
    changed = h0.copy()
    changed[mesh.cells[-1, 0]] = 2.0
    h, again = limit_gradient.with_info(mesh, changed, G, initial=info)
    assert again.method == info.method
    assert_array_equal(h, limit_gradient(mesh, changed, G))


def test_grids_with_many_inactive_nodes_are_left_to_fast_marching():
    active = np.random.default_rng(2303).random((60, 60)) > 0.1
    active[0, 0] = True
    grid = ads.CartesianGrid([0.0, 0.0], spacing=1.0, shape=(60, 60), active=active)
    h0 = np.full(grid.shape, np.inf)
    h0[0, 0] = 1.0
    h, info = limit_gradient.with_info(grid, h0, G)
    assert info.method == "fast-marching"
    assert_array_equal(h, limit_gradient(grid, h0, G, method="fast-marching"))


@pytest.mark.parametrize("domain", [MANY, FEW])
def test_all_ranks_take_the_method_of_the_whole(domain):
    mesh, h0 = domain
    expected, info = limit_gradient.with_info(mesh, h0, G)

    def limit(part):
        found, own = limit_gradient.with_info(part, h0[part.global_ids], G)
        return found, own.method

    ranks = partition(mesh, "strips", SIZE, np.random.default_rng(2304))
    results, parts = on_ranks(mesh, ranks, SIZE, limit)
    for (h, method), part in zip(results, parts, strict=True):
        assert method == info.method
        np.testing.assert_allclose(h, expected[part.global_ids], rtol=1e-12)
