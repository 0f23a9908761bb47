"""Octrees: leaves, and the simplices that they are cut into."""

import numpy as np
import pytest
from hypothesis import given, settings
from numpy.testing import assert_allclose, assert_array_equal
from trees import DEEPEST, at_random, octrees, sphere

from adaptsize import Octree


def lies_on_box(tree, facets):
    """Return which facets lie in a side of the box."""
    x = tree.points[facets]
    on_side = [(x[:, :, d] == end[d]).all(axis=1) for d in range(tree.dim)
               for end in (tree.lower, tree.upper)]  # fmt: skip
    return np.any(on_side, axis=0)


# Cutting into simplices


def check_conforming(tree):
    mesh = tree.mesh
    assert np.may_share_memory(mesh.points, tree.points)
    assert (mesh.signed_measures > 0.0).all()
    volume = np.prod(tree.upper - tree.lower)
    assert_allclose(mesh.measures.sum(), volume, rtol=1e-12)
    # Cells of positive volume fill the box; if each facet inside belongs to two of them, no
    # node hangs.
    assert mesh.facet_cell_counts.max() <= 2
    assert lies_on_box(tree, mesh.facets[mesh.facet_cell_counts == 1]).all()
    assert_array_equal(np.unique(mesh.cells), np.arange(tree.n_points))
    assert len(np.unique(tree.points, axis=0)) == tree.n_points


@given(octrees())
@settings(max_examples=30)
def test_any_tree_is_cut_into_simplices_that_fit_together(tree):
    check_conforming(tree)


def test_a_quadtree_by_hand():
    # One quarter of the square halved: two of the others have a hanging node.
    tree = Octree([0, 0], [4, 4], (1, 1), [2, 2, 2, 2, 1, 1, 1])
    assert_array_equal(tree.leaf_lower, [[0, 0], [0, 1], [1, 0], [1, 1], [0, 2], [2, 0], [2, 2]])
    assert_array_equal(tree.leaf_sizes, [[1, 1]] * 4 + [[2, 2]] * 3)
    assert_array_equal(tree.leaf_centres, tree.leaf_lower + 0.5 * tree.leaf_sizes)
    assert_array_equal(tree.points[tree.leaf_corners[5]], [[2, 0], [2, 2], [4, 0], [4, 2]])
    assert_array_equal(tree.points[-2:], [[1, 3], [3, 1]])  # centres, behind 14 corners
    assert (tree.n_points, tree.mesh.n_cells) == (16, 4 * 2 + 2 * 5 + 2)
    # Diagonals go from corners of even indices on their level to odd ones.
    edges = {frozenset(map(tuple, edge)) for edge in tree.points[tree.mesh.edges].tolist()}
    diagonals = [((0, 0), (1, 1)), ((0, 2), (1, 1)), ((2, 0), (1, 1)), ((2, 2), (1, 1))]
    assert edges.issuperset(map(frozenset, [*diagonals, ((4, 4), (2, 2))]))


def dihedral_angles(mesh):
    """Angles of triangles, or between faces of tetrahedra, in degrees."""
    corners = mesh.points[mesh.cells]
    matrix = np.linalg.inv(corners[:, 1:] - corners[:, :1])
    normals = np.concatenate([-matrix.sum(axis=2, keepdims=True), matrix], axis=2)
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    cosines = -np.einsum("cdi,cdj->cij", normals, normals)
    i, j = np.triu_indices(mesh.dim + 1, 1)
    return np.degrees(np.arccos(np.clip(cosines[:, i, j], -1.0, 1.0)))


@pytest.mark.parametrize(("dim", "least", "most"), [(2, 45.0, 90.0), (3, 45.0, 120.0)])
def test_balanced_cubes_have_the_promised_angles(dim, least, most):
    tree = Octree.build(
        np.zeros(dim), np.ones(dim), at_random(7349, 0.45), max_level=DEEPEST[dim],
        balanced=True, root_shape=[2] * dim,
    )  # fmt: skip
    angles = dihedral_angles(tree.mesh)
    # acos near 0 degrees would lose digits; near these angles it does not.
    assert_allclose([angles.min(), angles.max()], [least, most], atol=1e-9)


# Leaves


@pytest.mark.parametrize("dim", [2, 3])
def test_leaves_are_refined_exactly_where_the_criterion_asks(dim):
    asked = []

    def needs_refinement(centres, sizes):
        asked.append(len(centres))
        return (np.abs(sphere(centres)) < 0.4 * sizes[:, 0]) & (sizes[:, 0] > 0.1)

    tree = Octree.build(-np.ones(dim), np.ones(dim), needs_refinement, max_level=DEEPEST[dim])
    assert len(asked) == DEEPEST[dim]
    n_refined = (tree.n_leaves - 1) // (2**dim - 1)
    assert sum(asked) - n_refined == np.count_nonzero(tree.levels < DEEPEST[dim])
    below = tree.levels < DEEPEST[dim]
    assert not needs_refinement(tree.leaf_centres[below], tree.leaf_sizes[below]).any()
    # The parent of a leaf: the cell of twice the size on the lattice of its level.
    edges = tree.leaf_sizes
    parents = np.floor((tree.leaf_centres + 1.0) / (2.0 * edges)) * 2.0 * edges - 1.0 + edges
    inner = tree.levels > 0
    assert needs_refinement(parents[inner], 2.0 * edges[inner]).all()


@given(octrees(balanced=True))
@settings(max_examples=20)
def test_balanced_leaves_that_touch_differ_by_one_level_at_most(tree):
    # A coarser leaf that touches a leaf covers the whole side, edge or corner of it.
    for direction in np.ndindex(*[3] * tree.dim):
        beside = tree.leaf_centres + 0.50001 * (np.array(direction) - 1) * tree.leaf_sizes
        neighbour = tree.find_leaves(beside)
        assert (tree.levels - tree.levels[neighbour] <= 1).all()


@pytest.mark.parametrize("dim", [2, 3])
def test_balance_refines_only_and_adds_nothing_to_a_balanced_tree(dim):
    def build(balanced):
        criterion = at_random(5711, 0.4)
        box = (np.zeros(dim), np.ones(dim))
        return Octree.build(*box, criterion, max_level=5, balanced=balanced, root_shape=[3] * dim)

    plain, balanced = build(False), build(True)
    assert balanced.n_leaves > plain.n_leaves
    holder = plain.find_leaves(balanced.leaf_centres)
    assert (balanced.levels >= plain.levels[holder]).all()

    def like_balanced(centres, sizes):
        level = np.rint(np.log2(1.0 / (3.0 * sizes[:, 0])))
        return balanced.levels[balanced.find_leaves(centres)] > level

    again = Octree.build(
        np.zeros(dim), np.ones(dim), like_balanced, max_level=5, balanced=True, root_shape=[3] * dim
    )
    assert again.n_leaves <= balanced.n_leaves


# Arguments


def never(centres, sizes):
    return np.zeros(len(centres), bool)


@pytest.mark.parametrize(
    ("lower", "upper", "keywords", "message"),
    [
        ([0, 0], [1, 0], {}, r"upper must be greater than lower = \[0.0, 0.0\], got upper\[1\]"),
        ([0, 0], [1, 1e-61], {}, r"upper - lower must be at least 1e-60, got .*\[1\] = 1e-61"),
        ([0] * 3, [1] * 3, {"max_level": 21}, r"max_level must be at most 20 for \(1, 1, 1\)"),
        ([1e9] * 2, [1e9 + 1] * 2, {"max_level": 20}, r"max_level = 20 makes cells with edges"),
        ([0, 0], [1, 1], {"root_shape": [1, 0]}, r"root_shape must be integers >= 1, got"),
        ([0, 0], [1e7, 1], {"max_leaves": 10**6}, r"has 10000000 leaves when .* level 0"),
    ],
)
def test_bad_boxes_and_numbers_are_named(lower, upper, keywords, message):
    with pytest.raises(ValueError, match=message):
        Octree.build(lower, upper, never, **{"max_level": 1, **keywords})


@pytest.mark.parametrize(
    ("levels", "message"),
    [
        ([1, 1, 1], r"levels must be those of leaves that fill the box, got .* 0.75 of it"),
        ([2, 1, 2, 2, 2, 1, 1], r"along the Z curve, got levels\[1\] = 1"),
    ],
)
def test_levels_that_do_not_fill_the_box_are_refused(levels, message):
    with pytest.raises(ValueError, match=message):
        Octree([0, 0], [1, 1], (1, 1), levels)
