"""The exact method keeps no second copy of its large arrays."""

import tracemalloc

import numpy as np

from adaptsize import SimplexMesh
from adaptsize.limiting.exact.field import entries_at, node_entries

M = 1 << 15
TABLE = 12 * 8  # bytes of an entry in space


def _peak(make):
    """Return the peak of the traced memory during a call, per entry."""
    make()  # compiles
    tracemalloc.start()
    try:
        make()
        return tracemalloc.get_traced_memory()[1] / M
    finally:
        tracemalloc.stop()


def test_entries_are_made_once():
    rng = np.random.default_rng(60521)
    points, sizes = rng.random((M, 3)), rng.random(M)
    named = rng.integers(0, M, (M, 3)).astype(np.int32)
    # Beside the table there are the tree over the entries, and nodes.  A second table makes 3.4.
    assert _peak(lambda: entries_at(points, sizes, named)) < 2.5 * TABLE
    assert _peak(lambda: node_entries(points, sizes, named[:, 0])) < 2.5 * TABLE


def test_mesh_shares_mapped_cells(tmp_path):
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    np.save(tmp_path / "cells.npy", np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    cells = np.load(tmp_path / "cells.npy", mmap_mode="r")
    assert np.shares_memory(SimplexMesh(points, cells).cells, cells)
