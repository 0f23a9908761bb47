"""Octrees that the tests share."""

import numpy as np
from hypothesis import strategies as st

from adaptsize import Octree

DEEPEST = {2: 6, 3: 4}


def at_random(seed, share):
    """Refine cells with a probability, at random."""
    rng = np.random.default_rng(seed)
    return lambda centres, sizes: rng.random(len(centres)) < share


def sphere(x):
    return np.linalg.norm(x, axis=1) - 0.7


@st.composite
def octrees(draw, balanced=None):
    """Draw a box, root cells and a random tree in it, most of them far from balanced."""
    dim = draw(st.sampled_from([2, 3]))
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    lower = rng.uniform(-3.0, 1.0, dim)
    return Octree.build(
        lower,
        lower + rng.uniform(0.5, 2.0, dim),
        at_random(seed + 1, rng.uniform(0.3, 0.8)),
        max_level=draw(st.integers(0, DEEPEST[dim])),
        balanced=draw(st.booleans()) if balanced is None else balanced,
        root_shape=rng.integers(1, 4, dim),
    )


def random_points(tree, n, seed):
    """Random points, half of them on planes of the lattice: nodes, edges, faces, diagonals."""
    share = np.random.default_rng(seed).random((n, tree.dim))
    share[::2] = np.rint(share[::2] * 12.0) / 12.0
    return tree.lower * (1.0 - share) + tree.upper * share
