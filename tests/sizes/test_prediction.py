"""The predicted number of elements: integrals over cells, and over what a surface encloses."""

import math

import numpy as np
import pytest
from meshes import random_sphere, structured_square
from scipy.integrate import quad
from shapes import block, joined, moved
from solids import inside_out

from adaptsize import SimplexMesh
from adaptsize.geometry.distance.winding import WindingNumber
from adaptsize.sizes import Enclosed, predict

PER_VOLUME = 6.0 * math.sqrt(2.0)
SQUARE = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
CUBE = block(2)


def test_linear_sizes_on_a_simplex_are_integrated_exactly():
    # Integral of 1/h^3 over the unit cube with h = .1 + .1 x: (1/.01 - 1/.04) / .2 = 375.
    expected = PER_VOLUME * 375.0
    assert predict(CUBE, 0.1 + 0.1 * CUBE.points[:, 0]).cells == pytest.approx(expected, rel=1e-12)
    assert predict(CUBE, lambda x: 0.1 + 0.1 * x[:, 0]).cells == pytest.approx(expected, rel=1e-12)
    # Over the triangle x + y < 1 with h = a + b x: the integral of (1 - x) / (a + b x)^2.
    triangle = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    expected = quad(lambda x: 4.0 / math.sqrt(3.0) * (1.0 - x) / (0.01 + x) ** 2, 0.0, 1.0)[0]
    predicted = predict(triangle, lambda x: 0.01 + x[:, 0])
    assert predicted.cells == pytest.approx(expected, rel=1e-10)
    # Two sides with those sizes, the integral of 1 / h along each, and one with h = .01.
    along = math.log(1.01 / 0.01)
    assert predicted.facets == pytest.approx((1.0 + math.sqrt(2.0)) * along + 100.0, rel=1e-10)


@pytest.mark.parametrize("least", [0.01, 0.001])
@pytest.mark.parametrize("mesh", [SQUARE, structured_square(9, half_width=0.5)])
def test_sizes_that_are_small_between_the_nodes_are_found(mesh, least):
    # In a square of side 1, h = least + r / 5 around a point: polar coordinates.
    middle = np.add(mesh.points.mean(axis=0), [0.013, -0.07])

    def size(x):
        return least + 0.2 * np.linalg.norm(x - middle, axis=1)

    def rest(angle):  # to the side of the square in that direction
        to = [(s * 0.5 - c) / d if d != 0.0 else np.inf
              for c, d in ((0.013, math.cos(angle)), (-0.07, math.sin(angle)))
              for s in (-1.0, 1.0)]  # fmt: skip
        b = min(t for t in to if t > 0.0)
        return (math.log1p(0.2 * b / least) + least / (least + 0.2 * b) - 1.0) / 0.04

    expected = 4.0 / math.sqrt(3.0) * quad(rest, 0.0, 2.0 * math.pi, limit=400)[0]
    assert predict(mesh, size).cells == pytest.approx(expected, rel=0.02)


def rotation(seed):
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]


def errors_in_a_plate(n_points, sizes):
    """Return the relative errors in turned plates a x 1 x 1/10 with h = c + |z| / 4."""
    errors = []
    for k in range(8):
        turn, long, c = rotation(700 + k), 1.2 + 0.2 * k, sizes
        surface = CUBE.boundary().mesh
        plate = SimplexMesh(
            ((surface.points - 0.5) * [long, 1.0, 0.1]) @ turn.T + 3.0, surface.cells
        )

        def size(x, turn=turn, c=c):
            return c + 0.25 * np.abs(((x - 3.0) @ turn)[:, 2])

        half = (c**-2 - (c + 0.0125) ** -2) / 0.5  # integral over 0 < z < 1/20
        expected = PER_VOLUME * long * 2.0 * half
        errors.append(predict(Enclosed(plate, n_points), size).cells / expected - 1.0)
    return np.array(errors)


@pytest.mark.parametrize("c", [0.1, 0.03, 0.01])
def test_the_integral_in_a_surface_is_right_within_two_per_cent(c):
    errors = errors_in_a_plate(4000, c)
    assert np.abs(errors).max() < 0.03
    assert abs(errors.mean()) < 0.01


def test_graded_sizes_in_a_ball_follow_the_closed_form():
    # The integral of 4 pi r^2 / (a + r / 4)^3.  What the facets cut off is coarse.
    ball = random_sphere(3000, 8071)
    expected = quad(lambda r: 4.0 * math.pi * r**2 / (0.02 + 0.25 * r) ** 3, 0.0, 1.0)[0]
    found = predict(Enclosed(ball), lambda x: 0.02 + 0.25 * np.linalg.norm(x, axis=1))
    assert found.cells == pytest.approx(PER_VOLUME * expected, rel=0.02)
    assert found.facets == pytest.approx(4 / 3**0.5 * 4.0 * math.pi / 0.27**2, rel=0.02)


def test_cavities_are_left_out_and_overlaps_count_once():
    cube = CUBE.boundary().mesh
    hollow = joined(cube, inside_out(moved(cube, 0.25, 0.5)))
    shifted = joined(cube, moved(cube, [0.5, 0.0, 0.0]))
    for surface, volume in ((hollow, 0.875), (shifted, 1.5)):
        found = predict(Enclosed(surface), lambda x: np.full(len(x), 0.05)).cells
        assert found == pytest.approx(PER_VOLUME * volume / 0.05**3, rel=0.02)


def test_the_integral_in_a_surface_converges():
    # Stratified samples with boxes at the boundary: better than the order 1/2 of plain ones.
    coarse, fine = (np.sqrt(np.mean(errors_in_a_plate(n, 0.02) ** 2)) for n in (300, 300 * 4**2))
    assert coarse < 0.06
    assert fine < coarse / 4.0


def test_the_prediction_turns_moves_and_scales_with_the_surface():
    ball = random_sphere(500, 77)
    points = ball.points * [1.0, 0.6, 0.3] + 0.1 * ball.points[:, [1, 0, 2]] ** 2
    here = SimplexMesh(points, ball.cells)

    def size(x):
        return 0.05 + 0.2 * np.linalg.norm(x - [0.5, 0.1, 0.0], axis=1)

    plain = predict(Enclosed(here), size).cells
    for seed in (1, 4):  # one of them mirrors
        turn = rotation(seed)
        there = SimplexMesh(7.0 * points @ turn.T + 5.0, ball.cells)
        found = predict(Enclosed(there), lambda x, t=turn: 7.0 * size(((x - 5.0) / 7.0) @ t)).cells
        assert found == pytest.approx(plain, rel=1e-6)


def test_in_an_open_box_no_cube_takes_the_side_of_a_larger_one():
    # Between the rims of a hole, the winding number changes where there is no surface.
    skin = CUBE.boundary().mesh
    lid = (skin.points[skin.cells][:, :, 2] == 1.0).all(axis=1)
    box = SimplexMesh(skin.points, skin.cells[~lid])

    def size(x):
        return 0.03 + 0.25 * np.abs(x[:, 2] - 1.0)

    n = 60
    grid = (np.indices((n, n, n)).reshape(3, -1).T + 0.5) / n
    grid = grid[WindingNumber(box).contains(grid)]
    expected = PER_VOLUME * np.sum(size(grid) ** -3.0) / n**3
    assert predict(Enclosed(box), size).cells == pytest.approx(expected, rel=0.02)
