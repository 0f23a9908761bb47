"""Octrees and quadtrees: places along the Z curve, and nodes.

A place in the tree is a *code*: the number of the root cell, row by row, followed by
``dim`` bits per level, axis 0 first.  A node is a *key*: the scalar product of its integer
coordinates on the lattice of the smallest leaves and the strides of that lattice, so that
a step along an axis is one addition.  Nodes are found by key in hash tables (open
addressing, linear probing, -1: free).

Finest leaves have no hanging node, so every centre that is needed lies on that lattice too.
"""

from typing import NamedTuple

import numpy as np

from adaptsize._kernels.compiling import inner, kernel


class Leaves(NamedTuple):
    """Leaves on the lattice of the smallest ones.

    Parameters
    ----------
    indices : int64[n_leaves, dim]
        Lower corners.
    levels : int8[n_leaves]
        Counted from the finest: edges are ``1 << levels`` lattice intervals long.
    strides : int64[dim]
    """

    indices: np.ndarray
    levels: np.ndarray
    strides: np.ndarray


class Table(NamedTuple):
    """A hash table of nodes.

    Parameters
    ----------
    keys : int64[2**k]
        -1 where free.
    numbers : int32[2**k]
    """

    keys: np.ndarray
    numbers: np.ndarray


class Nodes(NamedTuple):
    """The nodes of an octree.

    Parameters
    ----------
    leaves : Leaves
    corners : int32[n_leaves, 2**dim]
        Corner j lies at the upper end of axis d where bit ``dim - 1 - d`` of j is 1.
    hanging : bool[n_leaves]
        Whether a node other than the corners lies on the boundary of the leaf.
    n_corners : int
    table : Table
        Corners.
    centres : Table
        In/Out: centres of squares.
    keys : int64[bound], In/Out
        Keys of the corners, and behind them those of the centres.
    leaf_centres : int32[n_leaves], Out
        Node at the centre of each cube with hanging nodes; others are left.
    first_cells : int64[n_leaves + 1], Out
        First simplex of each leaf, and their number.
    """

    leaves: Leaves
    corners: np.ndarray
    hanging: np.ndarray
    n_corners: int
    table: Table
    centres: Table
    keys: np.ndarray
    leaf_centres: np.ndarray
    first_cells: np.ndarray


@kernel
def encode(indices, level, root_shape, codes):
    """Fill the codes of cells.

    Parameters
    ----------
    indices : int64[n, dim]
        Integer coordinates of the cells among those of their level.
    level : int
    root_shape : int64[dim]
    codes : int64[n]
        Out.
    """
    dim = indices.shape[1]
    for c in range(indices.shape[0]):
        code = 0
        for d in range(dim):
            code = code * root_shape[d] + (indices[c, d] >> level)
        for bit in range(level - 1, -1, -1):
            for d in range(dim):
                code = (code << 1) | ((indices[c, d] >> bit) & 1)
        codes[c] = code


@kernel
def decode(codes, level, root_shape, indices):
    """Fill the integer coordinates of cells among those of their level; inverse of `encode`.

    Parameters
    ----------
    codes : int64[n]
    level : int
    root_shape : int64[dim]
    indices : int64[n, dim]
        Out.
    """
    dim = indices.shape[1]
    for c in range(codes.shape[0]):
        root = codes[c] >> (dim * level)
        for d in range(dim - 1, -1, -1):
            indices[c, d] = root % root_shape[d]
            root //= root_shape[d]
        for bit in range(level - 1, -1, -1):
            digit = codes[c] >> (dim * bit)
            for d in range(dim):
                indices[c, d] = (indices[c, d] << 1) | ((digit >> (dim - 1 - d)) & 1)


@inner
def _slot_of(keys, key):
    """Return the place of a key in a hash table, or the free one where it belongs."""
    mask = keys.shape[0] - 1
    slot = np.int64((np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(32)) & mask
    while keys[slot] != key and keys[slot] >= 0:
        slot = (slot + 1) & mask
    return slot


@kernel
def find_node(table, key):
    """Return the number of a key in a hash table, -1 if it is not there."""
    slot = _slot_of(table.keys, key)
    return table.numbers[slot] if table.keys[slot] == key else -1


@inner
def find_or_add(table, key, number):
    """Return the number of a key in a hash table; a new key gets ``number``."""
    slot = _slot_of(table.keys, key)
    if table.keys[slot] != key:
        table.keys[slot], table.numbers[slot] = key, number
    return table.numbers[slot]


@kernel
def number_corners(leaves, table, corners, node_keys):
    """Give numbers to the different corners of the leaves, in the order in which they are met.

    Parameters
    ----------
    leaves : Leaves
    table : Table
        In/Out: empty.
    corners : int32[n_leaves, 2**dim]
        Out: see `Nodes`.
    node_keys : int64[bound]
        Out: as many as there are corners.

    Returns
    -------
    int
        Number of different corners.
    """
    indices, strides = leaves.indices, leaves.strides
    n_points = np.int64(0)
    dim = indices.shape[1]
    for leaf in range(indices.shape[0]):
        size = 1 << leaves.levels[leaf]
        for j in range(corners.shape[1]):
            key = np.int64(0)
            for d in range(dim):
                key += (indices[leaf, d] + size * ((j >> (dim - 1 - d)) & 1)) * strides[d]
            node = find_or_add(table, key, n_points)
            corners[leaf, j] = node
            if node == n_points:
                node_keys[n_points] = key
                n_points += 1
    return n_points


@kernel
def mark_hanging(leaves, table, hanging):
    """Mark the leaves that have a node other than their corners on their boundary.

    A finer neighbour at a face or an edge has been halved at least once, so the middle of
    an edge of the leaf is a node then.

    Parameters
    ----------
    leaves, table
        As in and from `number_corners`.
    hanging : bool[n_leaves]
        Out.

    Returns
    -------
    int
        Number of leaves marked.
    """
    indices, strides = leaves.indices, leaves.strides
    dim = indices.shape[1]
    count = 0
    for leaf in range(indices.shape[0]):
        hanging[leaf] = False
        size = 1 << leaves.levels[leaf]
        if size == 1:
            continue
        base = 0
        for d in range(dim):
            base += indices[leaf, d] * strides[d]
        for axis in range(dim):
            for j in range(1 << dim):
                key = base + (size >> 1) * strides[axis]
                for d in range(dim):
                    key += size * ((j >> d) & 1) * strides[d]
                # Corners j above the leaf along the axis would repeat edges of others.
                if (j >> axis) & 1 == 0 and find_node(table, key) >= 0:
                    hanging[leaf] = True
        count += hanging[leaf]
    return count
