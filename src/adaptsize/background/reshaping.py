"""Refinement of an existing octree, and how well it interpolates its nodal values."""

from itertools import product

import numpy as np

from adaptsize.background.octree import Octree
from adaptsize.background.refinement import NeedsRefinement
from adaptsize.typing import BoolArray, FloatArray, LongArray

# Relative tolerance for the comparison of edges of cells, which differ by factors of 2.
_SAME = 1.5


def refined(octree: Octree, times: LongArray, within: NeedsRefinement) -> Octree:
    """Return an octree whose leaves are halved further along each axis.

    Parameters
    ----------
    octree : Octree
    times : int64[n_leaves]
        How often each leaf is halved at most, >= 0.
    within : callable
        As ``needs_refinement`` of `Octree.build`: which parts of leaves are halved further.

    Returns
    -------
    Octree
        Its nodes include the corners of all leaves of ``octree``.

    Raises
    ------
    ValueError
        If the smallest cells would be too small for float64.

    Examples
    --------
    >>> tree = Octree([0, 0], [1, 1], (1, 1), [1, 1, 1, 1])
    >>> refined(tree, np.array([2, 0, 0, 0]), lambda centres, sizes: np.ones(len(sizes), bool))
    Octree(19 leaves of level 1 to 3, 2-D)
    """

    def needs_refinement(centres: FloatArray, sizes: FloatArray) -> BoolArray:
        leaf = octree.find_leaves(centres)
        edges = octree.leaf_sizes[leaf, 0]
        last = edges * 0.5 ** times[leaf].astype(float)
        needed = np.asarray(sizes[:, 0] > _SAME * last)
        parts = np.flatnonzero(needed & (sizes[:, 0] < edges / _SAME))
        if len(parts):
            needed[parts] = within(centres[parts], sizes[parts])
        return needed

    return Octree.build(
        octree.lower,
        octree.upper,
        needs_refinement,
        max_level=int((octree.levels + times).max()),
        root_shape=octree.root_shape,
    )


def parent_errors(
    octree: Octree, values: FloatArray, where: BoolArray, known: BoolArray
) -> FloatArray:
    """Return how well nodal values would be interpolated if a leaf were not halved.

    The cell of which a leaf is a part has nodes at its corners, and at the midpoints of its edges
    and diagonals.  The value at each midpoint is compared with the mean of the values at the two
    ends.  On the leaf itself, the error of interpolation is about half of that at kinks of the
    values, and a quarter where they are smooth.

    Parameters
    ----------
    octree : Octree
    values : float64[n_points]
        Positive.
    where : bool[n_points]
        Nodes at which the error counts.
    known : bool[n_points]
        Nodes whose values are known.

    Returns
    -------
    float64[n_leaves]
        Largest differences relative to the value at the midpoint; 0 for leaves of level 0.
    """
    lattice, dim = octree._lattice, octree.dim
    indices = lattice.indices >> (lattice.depth - octree.levels.astype(np.int64))[:, None]
    parents = np.column_stack([octree.levels.astype(np.int64), indices >> 1])
    unique, number = np.unique(parents, axis=0, return_inverse=True)
    # All these places are corners of the leaves of a parent, and thus nodes.
    edges = np.int64(1) << (lattice.depth - unique[:, :1])
    places = list(product(range(3), repeat=dim))
    keys = octree._nodes.keys[: octree.n_points]
    order = np.argsort(keys)
    at = np.empty((len(places), len(unique)))
    counts, is_known = (np.empty(at.shape, np.bool_) for _ in range(2))
    for k, place in enumerate(places):
        key = ((2 * unique[:, 1:] + np.array(place)) * edges) @ np.array(lattice.strides)
        node = order[np.searchsorted(keys[order], key)]
        at[k], counts[k], is_known[k] = values[node], where[node], known[node]
    error = np.zeros(len(unique))
    for k, place in enumerate(places):
        for one in product(*[(0, 2) if p == 1 else (p,) for p in place]):
            other = tuple(2 * p - q for p, q in zip(place, one, strict=True))
            if 1 in place and one < other and 1 not in one:
                a, b = places.index(one), places.index(other)
                off = np.abs(0.5 * (at[a] + at[b]) - at[k]) / at[k]
                error = np.maximum(error, np.where(is_known[a] & is_known[b] & counts[k], off, 0.0))
    error[unique[:, 0] == 0] = 0.0
    return np.asarray(error[number.reshape(-1)])
