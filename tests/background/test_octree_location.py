"""Location in octrees, sizes on them, and the order of limited sizes."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from trees import octrees, random_points

from adaptsize import Octree


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
