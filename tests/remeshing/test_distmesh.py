"""Meshes from distance and size functions: what they keep, how good they are, what is refused."""

import itertools

import numpy as np
import pytest
from distance_shapes import ball, box

import adaptsize as ads
from adaptsize.errors import ConvergenceWarning, ResolutionWarning
from adaptsize.remeshing.distmesh.nodes import _short_and_long

SEEDS = (20040601, 771)
disc, square = ball(1.0), box(2.0, 2.0)


def ring(x):
    """A disc of radius 1 less one of radius 0.3, not concentric."""
    return np.maximum(disc(x), 0.3 - np.linalg.norm(x - [0.2, 0.2], axis=1))


def ring_size(x):
    return 0.03 + 0.25 * np.abs(np.linalg.norm(x - [0.2, 0.2], axis=1) - 0.3)


def corner(x):
    """An L: the square of edge 2 less its upper right quarter."""
    return np.maximum(square(x), -square(x - 1.0))


def ellipse(x):
    """No distance: its slope at the boundary is 1 to 2."""
    return (x[:, 0] / 2.0) ** 2 + x[:, 1] ** 2 - 1.0


def dumbbell(x):
    """Two discs of radius 0.6 and a neck of width 0.04."""
    discs = [np.linalg.norm(x - [c, 0.0], axis=1) - 0.6 for c in (-1.0, 1.0)]
    return np.min([*discs, box(2.0, 0.04)(x)], axis=0)


def neck_size(x):
    away = np.maximum(np.abs(x) - [0.4, 0.02], 0.0)
    return 0.02 + 0.2 * np.linalg.norm(away, axis=1)


# Domain, size, half the box, exact area.
PLANE = {
    "disc": (disc, 0.15, 1.2, np.pi),
    "ring": (ring, ring_size, 1.2, np.pi * 0.91),
    "corner": (corner, 0.12, 1.2, 3.0),
    "ellipse": (ellipse, 0.12, 2.2, 2.0 * np.pi),
    "dumbbell": (dumbbell, neck_size, 2.0, None),
}


def mesh_of(distance, size, half, dim=2, **options):
    return ads.mesh_from_distance(distance, size, [-half] * dim, [half] * dim, **options)


def with_report(distance, size, half, dim=2, **options):
    low, high = [-half] * dim, [half] * dim
    return ads.mesh_from_distance.with_info(distance, size, low, high, **options)


def assert_is_sound(mesh, distance, tolerance):
    """No cell inverted or given twice, no node unused, all facets of one or two cells."""
    assert (mesh.signed_measures > 0.0).all()
    assert len(np.unique(np.sort(mesh.cells, axis=1), axis=0)) == mesh.n_cells
    assert len(np.unique(mesh.cells)) == mesh.n_points
    assert mesh.facet_cell_counts.max() <= 2
    assert np.abs(distance(mesh.boundary().mesh.points)).max() < tolerance


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", PLANE)
def test_plane_meshes_are_sound_good_and_of_the_wanted_sizes(name, seed):
    distance, size, half, area = PLANE[name]
    mesh, report = with_report(distance, size, half, seed=seed)
    # The tolerance of the projection is 1e-6 sizes; the slope of the ellipse is up to 2.
    assert_is_sound(mesh, distance, 1e-6)
    assert report.conformity.share_in_band > 0.97
    assert report.conformity.angle_min > 22.0
    assert report.conformity.angle_p01 > 30.0
    assert report.conformity.edges.q50 == pytest.approx(1.0, abs=0.05)
    assert report.converged
    assert report.n_components == 1
    if area is not None:  # chords of length h cut h^2 / (12 r^2) from a circle of radius r
        assert report.measure == pytest.approx(area, rel=0.02)


def test_the_seed_decides_and_nothing_else():
    state = np.random.get_state()[1].copy()  # noqa: NPY002 - it must not change
    first, again = (mesh_of(ring, ring_size, 1.2, seed=9) for _ in range(2))
    other = mesh_of(ring, ring_size, 1.2, seed=np.random.default_rng(10))
    np.testing.assert_array_equal(first.points, again.points)
    np.testing.assert_array_equal(first.cells, again.cells)
    assert other.points.shape != first.points.shape or (other.points != first.points).any()
    np.testing.assert_array_equal(state, np.random.get_state()[1])  # noqa: NPY002


def test_fixed_points_are_the_first_nodes():
    fixed = np.array([[0.0, 0.0], [1.0, 0.0], [0.31, -0.4]])
    given = fixed.copy()
    mesh, report = with_report(disc, 0.2, 1.2, fixed_points=fixed)
    np.testing.assert_array_equal(mesh.points[:3], given)
    np.testing.assert_array_equal(fixed, given)
    assert report.fixed_nodes.tolist() == [0, 1, 2]


def largest(x):
    """The largest norm: near its corners it is no distance, and its zero has an angle there."""
    return np.abs(x).max(axis=1) - 1.0


@pytest.mark.parametrize(
    ("distance", "corners", "area"),
    [(largest, list(itertools.product((-1.0, 1.0), repeat=2)), 4.0), (corner, [(0.0, 0.0)], 3.0)],
)
def test_corners_are_found_in_the_plane(distance, corners, area):
    mesh = mesh_of(distance, 0.15, 1.2)
    for place in corners:
        assert np.linalg.norm(mesh.points - place, axis=1).min() < 1e-6
    assert mesh.measures.sum() == pytest.approx(area, rel=1e-6)


def test_a_domain_that_goes_on_is_cut_off_only_if_asked():
    def half_plane(x):
        return x[:, 0] - 0.1

    with pytest.raises(ValueError, match="clip=True"):
        mesh_of(half_plane, 0.2, 1.0)
    mesh = mesh_of(half_plane, 0.2, 1.0, clip=True)
    assert mesh.measures.sum() == pytest.approx(2.2, rel=1e-6)


def graded(x):
    return 0.09 + 0.25 * np.linalg.norm(x - [0.9, 0.0, 0.0], axis=1)


def test_a_graded_ball_has_no_slivers():
    mesh, report = with_report(disc, graded, 1.2, 3)
    assert_is_sound(mesh, disc, 1e-5)
    assert mesh.boundary().mesh.is_closed
    assert report.n_slivers == 0
    assert report.conformity.angle_min > 15.0
    assert report.conformity.share_in_band > 0.93


def test_edges_of_a_box_in_space_are_found():
    mesh, report = with_report(box(1.6, 1.0, 1.0), 0.25, 1.0, 3)
    # Chamfers of a size at all edges would take 14.4 * 0.25^2 / 2 of 1.6.
    assert mesh.measures.sum() == pytest.approx(1.6, rel=0.01)
    assert report.conformity.angle_min > 15.0
    assert report.n_slivers == 0


def test_parts_that_do_not_touch_are_all_meshed():
    def two(x):
        return np.minimum(*(np.linalg.norm(x - [c, 0.0], axis=1) - 0.4 for c in (-0.6, 0.6)))

    report = with_report(two, 0.12, 1.2)[1]
    assert report.n_components == 2
    assert report.n_broken == 0


def test_a_neck_narrower_than_the_size_is_reported():
    with pytest.warns(ResolutionWarning, match=r"components are connected|no node nearby|measure"):
        report = with_report(dumbbell, 0.3, 2.0)[1]
    assert report.n_broken + report.n_uncovered > 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"distance": lambda x: np.nan * disc(x)}, r"distance\(points\) must be finite"),
        ({"distance": lambda x: disc(x) + 5.0}, "is it negative inside"),
        ({"size": lambda x: np.full(len(x), np.inf)}, "finite and positive in the domain"),
        ({"size": 5.0}, "size must be small enough"),
        ({"fixed_points": [[0.0, 0.0], [1.1, 0.0]]}, r"fixed_points\[1\]"),
        ({"fixed_points": [[0.0, 0.0], [0.0, 0.0]]}, "distinct"),
    ],
)
def test_wrong_arguments_are_refused_by_name(change, message):
    arguments = {"distance": disc, "size": 0.3, "lower": [-1.2, -1.2], "upper": [1.2, 1.2]}
    with pytest.raises(ValueError, match=message):
        ads.mesh_from_distance(**{**arguments, **change})


def test_the_mesh_does_not_depend_on_the_unit_of_length():
    def scaled(x):
        return 4.0 * disc(x / 4.0)

    small = mesh_of(disc, 0.35, 1.25, 2, seed=5)
    large = mesh_of(scaled, 1.4, 5.0, 2, seed=5)
    # Powers of two are exact, so that every decision falls the same way.
    np.testing.assert_array_equal(4.0 * small.points, large.points)
    np.testing.assert_array_equal(small.cells, large.cells)


def test_a_function_without_slope_is_reported():
    with pytest.warns(ResolutionWarning, match="no slope"):
        report = with_report(lambda x: np.sign(disc(x)), 0.3, 1.2)[1]
    assert report.boundary_residual == np.inf


def test_too_few_steps_are_reported():
    with pytest.warns(ConvergenceWarning, match="max_iter"):
        mesh_of(ring, ring_size, 1.2, max_iter=1)


def test_edges_lose_or_get_nodes_as_many_as_the_median_edge_says():
    """Where the median edge is right, only edges that are far too short or too long do."""
    ratio = np.array([0.5, 0.7, 0.8, *[1.0] * 20, 1.2, 1.3, 1.6])
    short, long = _short_and_long(ratio, 12, 2)
    assert (short.tolist(), long.tolist()) == ([0], [25])
    # Edges of .9: of 12 nodes, 12 (1 - .9^2) = 2.28 are too many; of 1.2: 5.28 are missing, but
    # only two edges besides the worst are longer than 1.15.
    short, long = _short_and_long(np.array([0.5, 0.7, 0.8, *[0.9] * 20]), 12, 2)
    assert (short.tolist(), long.tolist()) == ([0, 1], [])
    short, long = _short_and_long(np.array([*[1.1] * 20, 1.2, 1.3, 1.6]), 12, 2)
    assert (short.tolist(), long.tolist()) == ([], [22, 21])
