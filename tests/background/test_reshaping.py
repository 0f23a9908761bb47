"""Refinement of octrees, and the error of interpolation on parents of leaves."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from adaptsize import Octree
from adaptsize.background.reshaping import parent_errors, refined

SQUARE = Octree([0, 0], [1, 1], (1, 1), [2] * 16)


def test_leaves_are_halved_as_often_as_requested():
    times = np.zeros(16, int)
    times[[0, 5]] = 1, 3
    tree = refined(SQUARE, times)
    assert np.bincount(tree.levels).tolist() == [0, 0, 14, 4, 0, 64]
    assert (tree.locator.leaf(SQUARE.points) >= 0).all()
    inside = tree.leaf_centres[tree.levels == 5]
    assert (np.abs(inside - SQUARE.leaf_centres[5]) < 0.125).all()


def test_parts_of_leaves_are_halved_where_needed():
    def left(centres, sizes):
        return centres[:, 0] < 0.1

    times = np.zeros(16, int)
    times[0] = 2
    tree = refined(SQUARE, times, left)
    assert np.bincount(tree.levels).tolist() == [0, 0, 15, 2, 8]


@pytest.mark.parametrize("dim", [2, 3])
def test_errors_on_parents_are_those_of_midpoints(dim):
    tree = Octree([0] * dim, [1] * dim, (1,) * dim, [2] * 4**dim)
    everywhere = np.ones(tree.n_points, bool)
    linear = 1.0 + tree.points.sum(axis=1)
    assert_allclose(parent_errors(tree, linear, everywhere, everywhere), 0.0, atol=1e-14)
    # A kink at x = 0.25, in the middle of the parents on the left.
    kinked = 1.0 + np.abs(tree.points[:, 0] - 0.25)
    error = parent_errors(tree, kinked, everywhere, everywhere)
    assert_allclose(error, np.where(tree.leaf_centres[:, 0] < 0.5, 0.25, 0.0), atol=1e-14)


def test_nodes_that_do_not_count_have_no_error():
    kinked = 1.0 + np.abs(SQUARE.points[:, 0] - 0.25)
    low, everywhere = SQUARE.points[:, 1] < 0.4, np.ones(SQUARE.n_points, bool)
    upper = SQUARE.leaf_centres[:, 1] > 0.5
    assert (parent_errors(SQUARE, kinked, low, everywhere)[upper] == 0.0).all()
    assert parent_errors(SQUARE, kinked, low, everywhere).max() > 0.2
    assert (parent_errors(SQUARE, kinked, everywhere, low)[upper] == 0.0).all()
