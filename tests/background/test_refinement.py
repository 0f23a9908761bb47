"""Criteria for the refinement of octrees, refinement, and errors on parents of leaves."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from trees import sphere

from adaptsize import Octree, refine_at_boundary, refine_to_size
from adaptsize.background.reshaping import parent_errors, refined

SQUARE = Octree([0, 0], [1, 1], (1, 1), [2] * 16)


@pytest.mark.parametrize("dim", [2, 3])
def test_no_large_leaf_is_cut_by_the_boundary(dim):
    spacing = 0.1
    tree = Octree.build([-1] * dim, [1] * dim, refine_at_boundary(sphere, spacing), max_level=9)
    phi = sphere(tree.points)[tree.leaf_corners]
    cut = (phi.min(axis=1) < 0.0) & (phi.max(axis=1) > 0.0)
    edges = tree.leaf_sizes.max(axis=1)
    assert cut.any()
    assert edges[cut].max() <= spacing
    assert edges.min() > spacing / 2  # no finer than asked
    assert edges.max() >= 4 * spacing


def spike(x):
    """A size with gradient 1 that is small within 0.02 of a point, which samples miss."""
    return np.minimum(1.0, 0.01 + np.linalg.norm(x - 0.3, axis=1))


@pytest.mark.parametrize("dim", [2, 3])
def test_with_g_no_small_size_is_overlooked(dim):
    def narrow(x):
        return np.minimum(0.3, spike(x))

    tree = Octree.build(
        np.zeros(dim), np.ones(dim), refine_to_size(narrow, factor=0.5, g=1.0), max_level=12
    )
    rng = np.random.default_rng(9091)
    x = np.concatenate([rng.random((20000, dim)), 0.3 + rng.normal(0.0, 0.02, (2000, dim))])
    edges = tree.leaf_sizes.max(axis=1)
    assert (edges[tree.locator.leaf(x)] <= 0.5 * narrow(x)).all()
    # Not finer than the Notes say: the parent's edge was above the bound for its centre.
    bound = 0.5 * 0.3 / (1.0 + 0.5 * 0.5 * np.sqrt(dim))
    assert edges.max() > 0.5 * bound


def test_without_g_sizes_are_looked_at_in_centres_and_corners():
    def size(x):
        return np.where((x == 1.0).all(axis=1), 0.1, 1.0)  # at one corner of the box only

    tree = Octree.build([0, 0], [1, 1], refine_to_size(size), max_level=10)
    assert tree.levels.max() == 4  # 1/16 <= 0.1 < 1/8
    assert tree.n_leaves == 1 + 4 * 3
    blind = Octree.build([0, 0], [1, 1], refine_to_size(size, g=0.0), max_level=10)
    assert blind.n_leaves == 1


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
