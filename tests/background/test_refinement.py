"""Criteria for the refinement of octrees, refinement, and errors on parents of leaves."""

import numpy as np
import pytest
from trees import sphere

from adaptsize import Octree, refine_at_boundary, refine_to_size
from adaptsize.background.reshaping import refined

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
    assert (edges[tree.find_leaves(x)] <= 0.5 * narrow(x)).all()
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


@pytest.mark.parametrize("g", [None, 0.0])
def test_leaves_of_just_the_size_are_not_divided(g):
    def size(x):
        return np.full(len(x), 0.125)

    tree = Octree.build([0, 0], [1, 1], refine_to_size(size, factor=2.0, g=g), max_level=10)
    assert tree.n_leaves == 16


def test_parts_of_leaves_are_halved_where_needed():
    def left(centres, sizes):
        return centres[:, 0] < 0.1

    times = np.zeros(16, int)
    times[0] = 2
    tree = refined(SQUARE, times, left)
    assert np.bincount(tree.levels).tolist() == [0, 0, 15, 2, 8]
