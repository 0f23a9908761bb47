"""Codes along the Z curve, and the hash tables of nodes."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from adaptsize._kernels.octree import decode, encode


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
