"""Nodes of an octree and the splitting of its leaves into simplices: arrays for the kernels."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from adaptsize._kernels.octree import cut_leaves, mark_hanging, number_corners
from adaptsize.background._octree_growth import CodeArray, indices_of
from adaptsize.typing import IntArray


class Lattice(NamedTuple):
    """The lattice of the smallest leaves."""

    depth: int
    counts: npt.NDArray[np.int64]
    """Number of intervals along each axis, int64[dim]."""
    strides: npt.NDArray[np.int64]
    """Step of the key along each axis, int64[dim]."""
    starts: CodeArray
    """Code of the first smallest cell in each leaf, int64[n_leaves], ascending."""
    indices: npt.NDArray[np.int64]
    """Lower corner of each leaf, int64[n_leaves, dim]."""


class Parts(NamedTuple):
    """Arrays that define nodes and simplices; fields as in `adaptsize._kernels.octree`."""

    indices: npt.NDArray[np.int64]
    levels: npt.NDArray[np.int8]
    """Counted from the finest."""
    strides: npt.NDArray[np.int64]
    corners: IntArray
    hanging: npt.NDArray[np.bool_]
    n_corners: int
    tables: tuple[npt.NDArray[Any], ...]
    node_keys: npt.NDArray[np.int64]
    leaf_centres: IntArray
    n_points: int
    n_cells: int


def lattice_of(levels: npt.NDArray[np.int8], root_shape: tuple[int, ...]) -> Lattice:
    """Return the lattice of leaves with the given levels along the Z curve."""
    depth = int(levels.max())
    counts = np.array(root_shape, np.int64) << depth
    strides = np.append(np.cumprod(counts[:0:-1] + 1)[::-1], 1)
    sizes = np.int64(1) << (len(root_shape) * (depth - levels.astype(np.int64)))
    starts = np.cumsum(sizes) - sizes
    return Lattice(depth, counts, strides, starts, indices_of(starts, depth, root_shape))


def number_nodes(levels: npt.NDArray[np.int8], lattice: Lattice) -> Parts:
    """Assign numbers to corners and centres, and count the simplices."""
    n_leaves, dim = lattice.indices.shape
    from_finest = (lattice.depth - levels).astype(np.int8)
    leaves = (lattice.indices, from_finest, lattice.strides)
    # A cell that is refined has 3^dim corners instead of 2^dim, and 2^dim leaves instead of 1.
    n_roots = int(np.prod(lattice.counts >> lattice.depth))
    n_refined = (n_leaves - n_roots) // (2**dim - 1)
    bound = 2**dim * n_roots + (3**dim - 2**dim) * n_refined
    corner_table = _hash_table(bound)
    corners = np.empty((n_leaves, 2**dim), np.int32)
    corner_keys = np.empty(bound, np.int64)
    n_corners = number_corners(*leaves, *corner_table, corners, corner_keys)
    hanging = np.empty(n_leaves, np.bool_)
    n_hanging = mark_hanging(*leaves, *corner_table, hanging)
    # A centre for each square with a hanging node on an edge: 6 faces, or the leaf itself.
    n_squares = (6 if dim == 3 else 1) * n_hanging
    tables = (*corner_table, *_hash_table(n_squares))
    node_keys = np.empty(n_corners + n_squares + n_hanging, np.int64)
    node_keys[:n_corners] = corner_keys[:n_corners]
    leaf_centres = np.full(n_leaves, -1, np.int32)
    parts = (*leaves, corners, hanging, n_corners, tables, node_keys, leaf_centres)
    n_points, n_cells = cut_leaves(*parts, np.empty((0, dim + 1), np.int32))
    return Parts(*parts, n_points, n_cells)


def cut(parts: Parts) -> IntArray:
    """Return the simplices, int32[n_cells, dim + 1], positively oriented, in order of leaves."""
    cells = np.empty((parts.n_cells, parts.indices.shape[1] + 1), np.int32)
    cut_leaves(*parts[:-2], cells)
    return cells


def _hash_table(n_entries: int) -> tuple[npt.NDArray[np.int64], IntArray]:
    """Return an empty hash table that n entries fill by at most two thirds."""
    size = 1 << int(max(3 * n_entries // 2, 1)).bit_length()
    return np.full(size, -1, np.int64), np.empty(size, np.int32)
