"""Codes along the Z curve, and the hash tables of nodes."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from adaptsize._kernels.octree import Leaves, Table, decode, encode, find_node, number_corners


def codes_by_hand(indices, level, root_shape):
    """Write the code of each cell digit by digit, with Python's own integers."""
    codes = []
    for cell in indices.tolist():
        code = int(np.ravel_multi_index([i >> level for i in cell], root_shape))
        for bit in reversed(range(level)):
            for i in cell:
                code = 2 * code + (i >> bit) % 2
        codes.append(code)
    return codes


@pytest.mark.parametrize(
    ("root_shape", "level"),
    [((1, 1), 0), ((3, 2), 5), ((1, 1), 31), ((2, 1, 3), 0), ((1, 3, 2), 4), ((7, 1, 1), 20)],
)
def test_codes_are_those_of_the_z_curve_and_decode_inverts_them(root_shape, level):
    rng = np.random.default_rng(80231)
    counts = np.array(root_shape, np.int64) << level
    indices = rng.integers(0, counts, (50, len(root_shape)))
    indices[0], indices[1] = 0, counts - 1
    codes = np.empty(50, np.int64)
    encode(indices, level, np.array(root_shape), codes)
    assert_array_equal(codes, codes_by_hand(indices, level, root_shape))
    assert codes[0] == 0
    assert codes[1] == np.prod(counts) - 1  # the codes of a level have no gaps
    back = np.zeros_like(indices)
    decode(codes, level, np.array(root_shape), back)
    assert_array_equal(back, indices)


def test_nodes_are_found_in_a_full_table_and_others_are_not():
    # A row of 300 leaves of a quadtree has 602 corners; the table is filled to 602 / 1024,
    # so that many keys are not in their first slot.
    n = 300
    indices = np.stack([np.arange(n), np.zeros(n, np.int64)], axis=1)
    strides = np.array([7919, 1])
    table = Table(np.full(1024, -1, np.int64), np.empty(1024, np.int32))
    corners, node_keys = np.empty((n, 4), np.int32), np.empty(4 * n, np.int64)
    leaves = Leaves(indices, np.zeros(n, np.int8), strides)
    count = number_corners(leaves, table, corners, node_keys)
    assert count == 2 * (n + 1)
    wanted = np.add.outer(7919 * np.arange(n + 1), [0, 1]).ravel()
    assert_array_equal(np.sort(node_keys[:count]), wanted)
    found = [find_node(table, key) for key in node_keys[:count]]
    assert_array_equal(found, np.arange(count))
    assert_array_equal(node_keys[corners[:, 2]], 7919 * np.arange(1, n + 1))  # upper, lower
    missing = np.setdiff1d(np.arange(0, 40000, 7), wanted)
    assert {find_node(table, key) for key in missing} == {-1}
