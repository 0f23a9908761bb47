"""Location in octrees, sizes on them, and the order of limited sizes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from trees import at_point, at_random, octrees, random_points

from adaptsize import Octree, SizeFunction, limit_gradient
from adaptsize.errors import OutsideError


def check_interpolation(tree, seed):
    x = random_points(tree, 120, seed)
    nodes, weights, distances = tree.locator.weights(x)
    assert_array_equal(distances, 0.0)
    assert (weights >= 0.0).all()
    assert_allclose(weights.sum(axis=1), 1.0, rtol=0.0, atol=1e-14)
    # Weights of a cell of the mesh that give the point itself are its only ones.
    assert_allclose((weights[:, :, None] * tree.points[nodes]).sum(axis=1), x, rtol=0, atol=1e-13)
    cells = [frozenset(cell) for cell in tree.mesh.cells.tolist()]
    ring_ptr, ring = tree.mesh.rings
    for own, weight in zip(nodes.tolist(), weights.tolist(), strict=True):
        used = {i for i, w in zip(own, weight, strict=True) if w > 0.0}
        first = min(used)
        assert any(used <= cells[c] for c in ring[ring_ptr[first] : ring_ptr[first + 1]])


@given(octrees(), st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_interpolation_is_that_of_the_mesh(tree, seed):
    check_interpolation(tree, seed)


@given(octrees())
@settings(max_examples=20)
def test_at_the_nodes_values_are_met_exactly_next_to_inf_too(tree):
    rng = np.random.default_rng(tree.n_points)
    values = np.where(rng.random(tree.n_points) < 0.5, np.inf, rng.random(tree.n_points))
    result, distances = tree.locator.interpolate(values, tree.points)
    assert_array_equal(result, values)
    assert_array_equal(distances, 0.0)


def test_between_inf_and_finite_nodes_is_inf():
    tree = Octree([0, 0], [1, 1], (1, 1), [0])
    at_origin = np.where((tree.points == 0.0).all(axis=1), 2.0, np.inf)
    values, _ = tree.locator.interpolate(at_origin, [[0, 0], [1e-12, 0], [0.5, 0.5], [-1, -1]])
    assert_array_equal(values, [2.0, np.inf, np.inf, 2.0])
    on_axis = np.where(tree.points[:, 1] == 0.0, 2.0, np.inf)
    values, _ = tree.locator.interpolate(on_axis, [[0.3, 0.0], [0.3, 1e-12]])
    assert_array_equal(values, [2.0, np.inf])


@pytest.mark.parametrize("dim", [2, 3])
def test_points_outside_take_the_value_of_the_closest_point_of_the_box(dim):
    tree = Octree.build([-1] * dim, [2] * dim, at_random(6151, 0.6), max_level=3)
    x = np.random.default_rng(6173).uniform(-9.0, 9.0, (200, dim))
    closest = np.clip(x, -1.0, 2.0)
    values = np.random.default_rng(6197).random(tree.n_points)
    outside, distances = tree.locator.interpolate(values, x)
    assert_array_equal(outside, tree.locator.interpolate(values, closest)[0])
    assert_allclose(distances, np.linalg.norm(x - closest, axis=1), rtol=1e-14)


def test_any_unit_of_length_works():
    def build(unit):
        box = (np.array([-1.0, -0.5]) * unit, np.array([1.0, 1.5]) * unit)
        return Octree.build(*box, lambda x, s: at_point(0.1)(x / unit, s / unit), max_level=9)

    tree = build(1.0)
    x = random_points(tree, 100, 3313)
    for unit in (2.0**-190, 2.0**190):
        other = build(unit)
        assert_array_equal(other.points, tree.points * unit)
        ours, theirs = tree.locator.weights(x), other.locator.weights(x * unit)
        assert_array_equal(theirs[1], ours[1])


# Sizes on octrees


def test_size_functions_work_on_octrees():
    tree = Octree.build([0, 0, 0], [1, 1, 1], at_point(0.2), max_level=3)
    size = SizeFunction(tree, 1.0 + tree.points @ [1.0, 2.0, 3.0])
    x = np.random.default_rng(1567).random((50, 3))
    assert_allclose(size(x), 1.0 + x @ [1.0, 2.0, 3.0], rtol=1e-14)  # linear: exact
    assert size.clip(hmax=2.0)(x).max() <= 2.0
    with pytest.raises(OutsideError, match=r"points\[0\] = \(2, 0, 0\) at a distance of 1"):
        SizeFunction(tree, size.values, outside="error")([[2.0, 0.0, 0.0]])
    assert size([[9.0, 9.0, 9.0]]) == pytest.approx(7.0)


def test_limited_sizes_converge_at_first_order():
    # Two sources (Persson 2006, section 6.2) on quadtrees graded around them, and eight times
    # finer on one side of the axis, so that leaves that touch differ by three levels.  Exact
    # values within 10 of the sources take out the logarithm of the cone tips.
    sources, sizes, g = np.array([[-10.0, 0.0], [10.0, 0.0]]), np.array([1.0, 5.0]), 0.3

    def distances(x):
        return np.linalg.norm(x[:, None] - sources, axis=2)

    def error(spacing):
        def needs_refinement(centres, edges):
            near = np.maximum(distances(centres).min(axis=1) / 10.0, 1.0)
            above_axis = np.abs(centres[:, 1] - 0.001) <= 0.5 * edges[:, 1]
            return edges[:, 0] > np.where(above_axis, spacing / 8.0, spacing * near)

        tree = Octree.build([-50, -50], [50, 50], needs_refinement, max_level=12)
        exact = (sizes + g * distances(tree.points)).min(axis=1)
        known = (distances(tree.points) <= 10.0).any(axis=1)
        h0 = np.where(known, exact, np.inf)
        h = limit_gradient(tree.mesh, h0, g, method="fast-marching")
        return np.abs(h - exact).max()

    errors = np.array([error(100.0 / n) for n in (64, 128, 256)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert (orders > 0.85).all(), f"errors {errors}, orders {orders}"
