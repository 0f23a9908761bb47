"""The largest distance of facets from others, against a slow twin with many points."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import adaptsize as ads
from adaptsize.quality.boundary import distances_from, farthest_places
from adaptsize.remeshing.acceptance import Judge


def ball(n, seed):
    points = np.random.default_rng(seed).normal(size=(n, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    return ads.SimplexMesh(points, ConvexHull(points).simplices)


def rough(n, seed):
    """A bumpy open surface over the unit square."""
    rng = np.random.default_rng(seed)
    grid = ads.CartesianGrid([0.0, 0.0], 1.0 / n, (n + 1, n + 1)).mesh
    heights = 0.1 * rng.random(grid.n_points)
    return ads.SimplexMesh(np.column_stack([grid.points, heights]), grid.cells)


def curve(n, seed):
    rng = np.random.default_rng(seed)
    angles = 2.0 * np.pi * np.arange(n) / n
    radius = 1.0 + 0.1 * rng.random(n)
    points = radius[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return ads.SimplexMesh(points, np.stack([np.arange(n), np.roll(np.arange(n), -1)], axis=1))


def soup(n, seed):
    """Triangles of all directions that meet nothing, some of them needles."""
    rng = np.random.default_rng(seed)
    corners = rng.random((n, 1, 3)) + rng.random((n, 1, 1)) ** 3 * rng.normal(size=(n, 3, 3))
    return ads.SimplexMesh(corners.reshape(-1, 3), np.arange(3 * n).reshape(n, 3))


def fan(n, height):
    """Narrow triangles around a tip above the middle of the unit square, and beyond that."""
    angles = 2.0 * np.pi * np.arange(n) / n
    rim = np.stack([0.5 + np.cos(angles), 0.5 + np.sin(angles), 0.0 * angles], axis=1)
    points = np.vstack([[[0.5, 0.5, height]], rim])
    turn = np.arange(n)
    return ads.SimplexMesh(points, np.column_stack([0 * turn, 1 + turn, 1 + (turn + 1) % n]))


PAIRS = {
    "balls": (ball(60, 1), ball(50, 2)),
    "coarse and fine": (ball(20, 3), ball(300, 4)),
    "fine and coarse": (ball(300, 4), ball(20, 3)),
    "rough": (rough(4, 5), rough(7, 6)),
    "large and rough": (rough(1, 5), rough(12, 6)),
    "large and a part of it": (fan(5, 0.05), rough(9, 6)),
    "fans": (rough(1, 2), fan(60, 0.1)),
    "soups": (soup(30, 7), soup(40, 8)),
    "large and soup": (rough(1, 2), soup(60, 9)),
    "curves": (curve(30, 7), curve(41, 8)),
}


def slow(skin, other, pieces=24):
    """The largest distance of points of a grid in each facet, and the spacing of that grid."""
    k, n = skin.cell_dim, pieces
    rows = np.array([(i, j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
    if k == 1:
        rows = np.linspace(0.0, 1.0, 40 * n + 1)[:, None]
    weights = np.column_stack([1.0 - rows.sum(axis=1), rows])
    corners = skin.points[skin.cells]
    at = np.einsum("sj,njk->nsk", weights, corners)
    distance = other.locator.nearest(at.reshape(-1, skin.dim))[2].reshape(len(corners), -1)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    return distance.max(axis=1), longest / (n if k == 2 else 40 * n)


@pytest.mark.parametrize("pair", PAIRS)
def test_no_point_is_farther_than_the_bound_and_the_place_is_as_far_as_that(pair):
    skin, other = PAIRS[pair]
    found = farthest_places(skin, other, 0.0)
    sampled, spacing = slow(skin, other)
    assert (found.bound >= sampled - 1e-12).all()
    assert (found.distance <= sampled + spacing).all()
    assert (found.bound <= 1.01 * np.maximum(found.distance, 1e-6 * skin.diagonal)).all()
    np.testing.assert_allclose(other.locator.nearest(found.points)[2], found.distance, atol=1e-12)


@pytest.mark.parametrize("pair", PAIRS)
def test_facets_nearer_than_enough_are_only_bounded(pair):
    skin, other = PAIRS[pair]
    all_of_it = farthest_places(skin, other, 0.0)
    enough = float(np.median(all_of_it.distance))
    found = farthest_places(skin, other, enough)
    far = all_of_it.distance > 1.02 * enough
    np.testing.assert_allclose(found.distance[far], all_of_it.distance[far], rtol=0.011)
    assert (found.bound[~far] <= 1.01 * 1.02 * enough).all()


def test_the_largest_distance_is_not_at_a_node_or_in_the_middle_of_an_edge_or_facet():
    """A roof whose ridge is above the segment from (.2, 0) to (.2, 1) of a flat square."""
    flat = ads.SimplexMesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    points = [[0, 0, 0], [0.2, 0, -0.2], [1, 0, 0], [1, 1, 0], [0.2, 1, -0.2], [0, 1, 0]]
    roof = ads.SimplexMesh(points, [[0, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4]])
    # Points above the ridge are nearest to the steep side or to the other.
    x = np.linspace(0.0, 1.0, 100_001)
    at = np.column_stack([x, np.full_like(x, 0.5), np.zeros_like(x)])
    exact = roof.locator.nearest(at)[2].max()
    found = distances_from(flat, roof)
    assert found.largest == pytest.approx(exact, rel=0.011)
    n_samples = flat.n_points + len(flat.edges) + flat.n_cells
    assert found.distance[:n_samples].max() < 0.95 * exact


@pytest.mark.parametrize("pair", ["balls", "curves"])
def test_distances_do_not_depend_on_place_scale_and_numbers(pair):
    skin, other = PAIRS[pair]
    largest = distances_from(skin, other).largest
    rng = np.random.default_rng(9)
    turn = np.linalg.qr(rng.normal(size=(skin.dim, skin.dim)))[0]
    move = lambda mesh: mesh.moved(1e6 * (mesh.points @ turn) + 3e6)  # noqa: E731
    assert distances_from(move(skin), move(other)).largest == pytest.approx(1e6 * largest, rel=0.01)
    order = rng.permutation(skin.n_cells)
    mixed = ads.SimplexMesh(skin.points, np.roll(skin.cells[order], 1, axis=1))
    assert distances_from(mixed, other).largest == pytest.approx(largest, rel=0.01)


def test_flat_surfaces_divided_otherwise_are_at_distance_zero():
    rng = np.random.default_rng(3)
    fine, coarse = (ads.CartesianGrid([0.0] * 3, 1.0 / n, (n + 1,) * 3).mesh for n in (7, 2))
    fine = fine.moved(fine.points + 1e-9 * rng.uniform(-1.0, 1.0, fine.points.shape))
    skins = fine.boundary().mesh, coarse.boundary().mesh
    for one, other in (skins, skins[::-1]):
        assert distances_from(one, other).largest <= 2e-9  # at once: all that is rounding


def test_facets_without_an_area_count():
    flat = ads.SimplexMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    needle = ads.SimplexMesh([[0, 0, 0.1], [1, 0, 0.5], [0.5, 0, 0.3]], [[0, 1, 2]])
    assert farthest_places(needle, flat, 0.0).distance == pytest.approx([0.5])
    assert distances_from(flat, needle).largest == pytest.approx(np.hypot(1.0, 0.1), rel=0.01)


@pytest.mark.parametrize(
    ("factor", "status"), [(0.98, "met"), (1.02, "near"), (1.08, "near"), (1.12, "missed")]
)
def test_the_tolerance_is_the_limit_of_the_check_and_of_the_acceptance(factor, status):
    """A limit that is 5 % larger would accept the second, and call the last one near."""
    box = ads.CartesianGrid([0.0] * 3, 0.25, (5, 5, 5)).mesh
    tolerance = 0.01
    moved = box.moved(box.points + factor * tolerance * box.diagonal * np.eye(3)[0])
    found = ads.check_mesh(moved, original=box, tolerance=tolerance).requirements
    accepted = Judge(box, None, None, tolerance)(moved).check.requirements
    for requirements in (found, accepted):
        assert {one.name: one.status for one in requirements}["boundary"] == status
