"""Entries of the exact method: nodes, edges and faces with their bounds, sorted, with a tree."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptsize.background._curve import along_curve
from adaptsize.limiting.exact.work import boxes_over
from adaptsize.typing import BoolArray, FloatArray, IntArray


class Wave(NamedTuple):
    """Entries that are processed together, along a Morton curve."""

    table: FloatArray
    """float64[m, dim * (dim + 1)], or more columns in the plane (see exact.py, exact_plane.py)."""
    boxes: FloatArray
    """The tree over them (see trees.py)."""
    nodes: IntArray
    """int32[m, dim]: nodes of each entry, padded with -1."""

    @property
    def places(self) -> FloatArray:
        """float64[m, dim, dim]: vertices, the first one repeated where there are fewer."""
        dim = self.nodes.shape[1]
        return self.table[:, : dim * dim].reshape(-1, dim, dim)

    @property
    def sizes(self) -> FloatArray:
        """float64[m, dim]: bounds at the vertices, padded with inf."""
        dim = self.nodes.shape[1]
        return self.table[:, dim * dim : dim * (dim + 1)]

    def only(self, which: BoolArray) -> Wave:
        """Return a wave of some of the entries."""
        return _with_tree(self.table[which], self.nodes[which])


def _with_tree(table: FloatArray, nodes: IntArray) -> Wave:
    wave = Wave(table, np.empty(0), nodes)
    lower, upper, value = wave.places[:, 0], wave.places[:, 0], wave.sizes[:, 0]
    for v in range(1, nodes.shape[1]):
        lower, upper = np.minimum(lower, wave.places[:, v]), np.maximum(upper, wave.places[:, v])
        value = np.minimum(value, wave.sizes[:, v])
    return wave._replace(boxes=boxes_over(lower, upper, value))


def sorted_wave(table: FloatArray, nodes: IntArray) -> Wave:
    """Return entries in any order as a wave."""
    order = along_curve(table[:, : nodes.shape[1]])
    return _with_tree(table[order], nodes[order])


def node_table(places: FloatArray, sizes: FloatArray) -> FloatArray:
    """Return the table of nodes."""
    m, dim = places.shape
    table = np.full((m, dim * (dim + 1)), np.inf)
    for v in range(dim):
        table[:, v * dim : (v + 1) * dim] = places
    table[:, dim * dim] = sizes
    return table


# The tables are the largest arrays of the exact method.  They are made in their final order: there
# is never a second one.


def node_wave(places: FloatArray, sizes: FloatArray, names: IntArray) -> Wave:
    """Return nodes as a wave."""
    order = along_curve(places)
    nodes = np.full(places.shape, -1, np.int32)
    nodes[:, 0] = names[order]
    return _with_tree(node_table(places[order], sizes[order]), nodes)


def wave_at(points: FloatArray, sizes: FloatArray, named: IntArray) -> Wave:
    """Return nodes, edges or triangles, given by their nodes padded with -1, as a wave.

    Edges and triangles represent their interior only.  Their nodes, and the edges of triangles,
    are separate entries.
    """
    m, dim = named.shape
    named = named[along_curve(points[named[:, 0]])]
    table = np.empty((m, dim * (dim + 1)))
    for v in range(dim):
        used = np.where(named[:, v] >= 0, named[:, v], named[:, 0])
        table[:, v * dim : (v + 1) * dim] = points[used]
        table[:, dim * dim + v] = np.where(named[:, v] >= 0, sizes[used], np.inf)
    return _with_tree(table, named)
