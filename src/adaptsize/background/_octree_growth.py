"""Construction of an octree: refinement level by level, 2:1 balance, and its nodes.

Cells are represented by sorted codes (see `adaptsize._kernels.octree`), one array per level.
A tree is defined by the refined cells of each level.
"""

from itertools import product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._checks import as_plain_array
from adaptsize._kernels.octree import (
    Leaves,
    Nodes,
    Table,
    decode,
    encode,
    mark_hanging,
    number_corners,
)
from adaptsize._kernels.octree_cells import cut_leaves
from adaptsize.background.refinement import NeedsRefinement
from adaptsize.typing import BoolArray, FloatArray, LongArray


def indices_of(codes: LongArray, level: int, root_shape: tuple[int, ...]) -> LongArray:
    """Return the integer coordinates of cells among those of their level, int64[n, dim]."""
    indices = np.zeros((len(codes), len(root_shape)), np.int64)
    decode(codes, level, np.array(root_shape, np.int64), indices)
    return indices


def codes_of(indices: LongArray, level: int, root_shape: tuple[int, ...]) -> LongArray:
    """Return the codes of cells; inverse of `indices_of`."""
    codes = np.empty(len(indices), np.int64)
    encode(indices, level, np.array(root_shape, np.int64), codes)
    return codes


def refine(
    lower: FloatArray,
    upper: FloatArray,
    root_shape: tuple[int, ...],
    needs_refinement: NeedsRefinement,
    max_level: int,
    max_leaves: int,
) -> list[LongArray]:
    """Return the cells of each level that the criterion refines."""
    dim = len(root_shape)
    cells = np.arange(np.prod(root_shape), dtype=np.int64)
    n_leaves = len(cells)
    refined: list[LongArray] = []
    for level in range(max_level):
        counts = np.array(root_shape) << level
        share = (indices_of(cells, level, root_shape) + 0.5) / counts
        centres = lower * (1.0 - share) + upper * share
        sizes = np.broadcast_to((upper - lower) / counts, centres.shape)
        parents = cells[_answer(needs_refinement, centres, sizes)]
        if len(parents) == 0:
            break
        n_leaves += (2**dim - 1) * len(parents)
        refuse_too_many(n_leaves, level + 1, max_leaves)
        refined.append(parents)
        cells = _children(parents, dim)
    return refined


def refuse_too_many(n_leaves: int, level: int, max_leaves: int) -> None:
    """Raise a ValueError if there are more leaves than allowed."""
    if n_leaves > max_leaves:
        raise ValueError(
            f"max_leaves = {max_leaves} is not enough: the octree has {n_leaves} leaves "
            f"when it is refined to level {level}"
        )


def balance(refined: list[LongArray], root_shape: tuple[int, ...]) -> list[LongArray]:
    """Return the refined cells such that the levels of touching leaves differ by at most one.

    Proceeds from the finest level to coarser ones.  Every neighbour of a refined cell, at
    faces, edges and corners, must exist; the parents of its neighbours must be refined.
    """
    balanced = list(refined)
    for level in range(len(refined) - 1, 0, -1):
        indices = indices_of(balanced[level], level, root_shape)
        # Only the neighbour on the cell's own side of its parent may have another parent.
        toward = np.where(indices % 2 == 0, -1, 1)
        counts = np.array(root_shape) << (level - 1)
        wanted = [balanced[level - 1]]
        for step in product((0, 1), repeat=len(root_shape)):
            parents = indices // 2 + np.array(step) * toward
            inside = ((parents >= 0) & (parents < counts)).all(axis=1)
            wanted.append(np.unique(codes_of(parents[inside], level - 1, root_shape)))
        balanced[level - 1] = np.unique(np.concatenate(wanted))
    return balanced


def leaf_levels(refined: list[LongArray], root_shape: tuple[int, ...]) -> npt.NDArray[np.int8]:
    """Return the levels of the leaves along the Z curve, given the refined cells."""
    dim, depth = len(root_shape), len(refined)
    cells = np.arange(np.prod(root_shape), dtype=np.int64)
    starts, levels = [], []
    for level in range(depth + 1):
        is_leaf = np.ones(len(cells), bool)
        if level < depth:
            is_leaf[np.searchsorted(cells, refined[level])] = False
        leaves = cells[is_leaf]
        starts.append(leaves << (dim * (depth - level)))
        levels.append(np.full(len(leaves), level, np.int8))
        if level < depth:
            cells = _children(refined[level], dim)
    # Sorted runs, one per level: a stable sort merges them.
    order = np.argsort(np.concatenate(starts), kind="stable")
    return np.concatenate(levels)[order]


def _children(parents: LongArray, dim: int) -> LongArray:
    """Return the codes of all children, sorted if the parents are."""
    children: LongArray = (parents[:, None] << dim) | np.arange(2**dim)
    return children.ravel()


def _answer(needs_refinement: NeedsRefinement, centres: FloatArray, sizes: FloatArray) -> BoolArray:
    answer = as_plain_array("needs_refinement(centres, sizes)", needs_refinement(centres, sizes))
    if answer.dtype != np.bool_ or answer.shape != (len(centres),):
        raise ValueError(
            f"needs_refinement must return bool of shape {(len(centres),)}, one per cell, "
            f"got {answer.dtype} of shape {answer.shape}"
        )
    return answer


class Lattice(NamedTuple):
    """The lattice of the smallest leaves.

    Parameters
    ----------
    depth : int
    counts : LongArray
        Number of intervals along each axis, int64[dim].
    strides : LongArray
        Step of the key along each axis, int64[dim].
    starts : LongArray
        Code of the first smallest cell in each leaf, int64[n_leaves], ascending.
    indices : LongArray
        Lower corner of each leaf, int64[n_leaves, dim].
    """

    depth: int
    counts: LongArray
    strides: LongArray
    starts: LongArray
    indices: LongArray


def lattice_of(levels: npt.NDArray[np.int8], root_shape: tuple[int, ...]) -> Lattice:
    """Return the lattice of leaves with the given levels along the Z curve."""
    depth = int(levels.max())
    counts = np.array(root_shape, np.int64) << depth
    strides = np.append(np.cumprod(counts[:0:-1] + 1)[::-1], 1)
    sizes = np.int64(1) << (len(root_shape) * (depth - levels.astype(np.int64)))
    starts = np.cumsum(sizes) - sizes
    return Lattice(depth, counts, strides, starts, indices_of(starts, depth, root_shape))


def number_nodes(levels: npt.NDArray[np.int8], lattice: Lattice) -> tuple[Nodes, int, int]:
    """Assign numbers to corners and centres; return how many there are, and how many simplices."""
    n_leaves, dim = lattice.indices.shape
    leaves = Leaves(lattice.indices, (lattice.depth - levels).astype(np.int8), lattice.strides)
    # A cell that is refined has 3^dim corners instead of 2^dim, and 2^dim leaves instead of 1.
    n_roots = int(np.prod(lattice.counts >> lattice.depth))
    n_refined = (n_leaves - n_roots) // (2**dim - 1)
    bound = 2**dim * n_roots + (3**dim - 2**dim) * n_refined
    table = _hash_table(bound)
    corners = np.empty((n_leaves, 2**dim), np.int32)
    corner_keys = np.empty(bound, np.int64)
    n_corners = number_corners(leaves, table, corners, corner_keys)
    hanging = np.empty(n_leaves, np.bool_)
    n_hanging = mark_hanging(leaves, table, hanging)
    # A centre for each square with a hanging node on an edge: 6 faces, or the leaf itself.
    n_squares = (6 if dim == 3 else 1) * n_hanging
    keys = np.empty(n_corners + n_squares + n_hanging, np.int64)
    keys[:n_corners] = corner_keys[:n_corners]
    centres, leaf_centres = _hash_table(n_squares), np.full(n_leaves, -1, np.int32)
    first = np.empty(n_leaves + 1, np.int64)
    nodes = Nodes(leaves, corners, hanging, n_corners, table, centres, keys, leaf_centres, first)
    return nodes, *cut_leaves(nodes, np.empty((0, dim + 1), np.int32))


def _hash_table(n_entries: int) -> Table:
    """Return an empty hash table that n entries fill by at most two thirds."""
    size = 1 << int(max(3 * n_entries // 2, 1)).bit_length()
    return Table(np.full(size, -1, np.int64), np.empty(size, np.int32))
