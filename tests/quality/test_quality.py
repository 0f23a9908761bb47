"""Element quality and conformity against values derived by hand."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import jittered_cube, random_sphere, structured_square
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import SimplexMesh, size_conformity
from adaptsize.quality.elements import minimum_angles, radius_ratios

# Corners, radius ratio, smallest (dihedral) angle in degrees.
EXACT = {
    "equilateral triangle": ([[0, 0], [1, 0], [0.5, np.sqrt(0.75)]], 1.0, 60.0),
    # r = 1 - sqrt(2)/2, R = sqrt(2)/2
    "half a square": ([[0, 0], [1, 0], [0, 1]], 2.0 * (np.sqrt(2.0) - 1.0), 45.0),
    # sides 3, 4, 5: r = 1, R = 2.5
    "3-4-5 in space": ([[1, 0, 0], [1, 4, 0], [1, 0, 3]], 0.8, np.degrees(np.arctan2(3, 4))),
    # height e over a base of 2: A = e, sides 2, s, s with s^2 = 1 + e^2
    "flat triangle": (
        [[-1, 0], [1, 0], [0, 1e-6]],
        16e-12 / (2.0 * (1.0 + 1e-12) * (2.0 + 2.0 * np.sqrt(1.0 + 1e-12))),
        np.degrees(np.arctan(1e-6)),
    ),
    "regular tetrahedron": (
        [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]],
        1.0,
        np.degrees(np.arccos(1.0 / 3.0)),
    ),
    # V = 1/6, area (3 + sqrt 3)/2, so r = 1/(3 + sqrt 3); R = sqrt(3)/2
    "corner of a cube": (
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
        np.sqrt(3.0) - 1.0,
        np.degrees(np.arccos(1.0 / np.sqrt(3.0))),
    ),
    # Two crossed segments a height 2 e apart, e = 1e-6: V = 4 e/3, the four faces have
    # area sqrt(1 + 4 e^2), the normals of two faces at a side have cosine 1/(1 + 4 e^2),
    # and the centre of all is at the distance R = sqrt(1 + e^2).
    "sliver": (
        [[1, 0, 1e-6], [-1, 0, 1e-6], [0, 1, -1e-6], [0, -1, -1e-6]],
        3e-6 / np.sqrt(1.0 + 4e-12) / np.sqrt(1.0 + 1e-12),
        np.degrees(np.arctan(np.sqrt(8e-12 + 16e-24))),
    ),
}


def one_cell(corners):
    return SimplexMesh(corners, [np.arange(len(corners))])


@pytest.mark.parametrize("name", EXACT)
def test_radius_ratio_and_smallest_angle_of_known_cells(name):
    corners, ratio, angle = EXACT[name]
    assert_allclose(radius_ratios(one_cell(corners)), [ratio], rtol=1e-9)
    assert_allclose(minimum_angles(one_cell(corners)), [angle], rtol=1e-9)


DEGENERATE = {
    "three on a line": [[0, 0], [1, 1], [2, 2]],
    "two in one point": [[0, 0], [0, 0], [1, 0]],
    "four in a plane": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, 0]],
    "four on a circle": [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]],
    "four on a line": [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]],
    "all in one point": [[1, 1, 1], [1, 1, 1], [1, 1, 1], [1, 1, 1]],
}


@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_cells_have_quality_zero(name):
    mesh = one_cell(DEGENERATE[name])
    assert_array_equal(radius_ratios(mesh), 0.0)
    assert_array_equal(minimum_angles(mesh), 0.0)


@given(st.integers(0, 2**32 - 1), st.integers(3, 4), st.sampled_from([1e-50, 1e-3, 1e50]))
def test_quality_does_not_depend_on_unit_order_of_corners_or_place(seed, width, unit):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(width, 3))
    mesh = one_cell(corners)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    other = one_cell((corners[rng.permutation(width)] @ turn + rng.normal(size=3)) * unit)
    # Bounded by the rounding of the coordinates over the height of the flattest cell drawn.
    assert_allclose(radius_ratios(other), radius_ratios(mesh), rtol=1e-8, atol=1e-9)
    assert_allclose(minimum_angles(other), minimum_angles(mesh), rtol=1e-8, atol=1e-7)
    assert 0.0 < radius_ratios(mesh)[0] <= 1.0


# Four by four squares of side 1, each cut in two: 20 + 20 edges of length 1 and 16
# diagonals of length sqrt 2; 16 edges of length 1 on the boundary.
GRID = structured_square(4, half_width=2.0)


@pytest.mark.parametrize("size", [0.8, np.full(25, 0.8), lambda x: np.full(len(x), 0.8)])
def test_ratios_on_a_grid_by_hand(size):
    conformity = size_conformity(GRID, size)
    edges = conformity.edges
    long = np.sqrt(2.0) / 0.8  # 1.77: out of the band; 1/0.8 = 1.25 is in it
    assert edges.n_edges == 56
    quantiles = [edges.q05, edges.q25, edges.q50, edges.q75, edges.q95]
    assert_allclose(quantiles, [1.25, 1.25, 1.25, long, long])  # 40/56 = 0.714 < 0.75
    assert_allclose(edges.mean, (40 * 1.25 + 16 * long) / 56)
    assert_allclose(conformity.share_in_band, 40 / 56)
    assert conformity.boundary_edges.n_edges == 16
    assert_allclose(conformity.boundary_edges.mean, 1.25)
    assert conformity.boundary_edges.share_in_band == 1.0
    assert_allclose(conformity.radius_ratio_min, 2.0 * (np.sqrt(2.0) - 1.0))
    assert_allclose(conformity.radius_ratio_mean, conformity.radius_ratio_min)
    assert_allclose([conformity.angle_min, conformity.angle_p01], 45.0)
    assert conformity.n_inverted == 0


def test_hausdorff_distance_of_a_shifted_cube():
    # Moved by 0.1 along x, the face x = 0.5 is 0.1 away from the cube and so is x = -0.5
    # from the moved one; no point is farther.
    cube = jittered_cube(5, 7019, half_width=0.5)
    skin = cube.boundary().mesh
    moved = SimplexMesh(skin.points + np.array([0.1, 0.0, 0.0]), skin.cells)
    conformity = size_conformity(cube, 1.0, surface=moved)
    assert_allclose(conformity.hausdorff, 0.1)
    assert_allclose(conformity.hausdorff_relative, 0.1 / np.sqrt(3.0))
    assert_allclose(size_conformity(cube, 1.0, surface=skin).hausdorff, 0.0, atol=1e-15)


def test_hausdorff_distance_sees_more_than_the_nodes():
    # A bent square cut along either diagonal: the same nodes.
    bent = SimplexMesh([[0, 0, 0], [1, 0, 0], [1, 1, 0.4], [0, 1, 0]], [[0, 1, 3], [1, 2, 3]])
    other = SimplexMesh(bent.points, [[0, 1, 2], [0, 2, 3]])
    # The middles of the two diagonals are (.5, .5, 0) and (.5, .5, .2).
    distance = size_conformity(bent, 1.0, surface=other).hausdorff
    assert 0.1 < distance <= 0.2


@pytest.mark.parametrize(
    ("size", "message"),
    [
        (5e-324, r"edges / size must be at most 1e\+60, got edges / size\[0\] = inf"),
        (np.inf, "size must be finite on one edge at least"),
        (np.where(np.arange(25) == 7, np.nan, 1.0), r"size\[7\] = nan"),
        (lambda x: x, r"size\(midpoints\) must have shape \(56,\), got \(56, 2\)"),
    ],
)
def test_bad_sizes_are_refused(size, message):
    with pytest.raises(ValueError, match=message):
        size_conformity(GRID, size)


def test_hausdorff_distance_is_measured_both_ways():
    one = random_sphere(80, 7027)
    far = one.points + np.array([5.0, 0.0, 0.0])
    two = SimplexMesh(
        np.concatenate([one.points, far]), np.concatenate([one.cells, one.cells + 80])
    )
    there = size_conformity(one, 1.0, surface=two).hausdorff
    back = size_conformity(two, 1.0, surface=one).hausdorff
    assert there == back
    assert 4.9 < there <= 5.0  # the farthest of the sampled points is near the far pole


def test_a_conformity_shows_itself_in_one_line():
    text = repr(size_conformity(GRID, 0.1))
    assert re.fullmatch(
        r"Conformity\(\d+ triangles, [\d.]+% of edges in band, [\d.]+% served, "
        r"smallest angle [\d.]+ degrees\)",
        text,
    )
