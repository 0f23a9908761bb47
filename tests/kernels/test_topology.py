"""Distinct index rows and rings against their definitions."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from adaptsize.background.topology import rings, unique_rows


@st.composite
def index_rows(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n_points = draw(st.integers(1, 9))
    shape = (draw(st.integers(1, 40)), draw(st.integers(1, 4)))
    return rng.integers(0, n_points, shape).astype(np.int32), n_points


@given(index_rows())
def test_unique_rows_give_the_rows_back(problem):
    rows, n_points = problem
    before = rows.copy()
    unique, number = unique_rows(rows, n_points)
    assert (unique[number] == np.sort(rows, axis=1)).all()
    assert unique.tolist() == np.unique(np.sort(rows, axis=1), axis=0).tolist()
    assert (rows == before).all()


@given(index_rows())
def test_rings_hold_every_cell_of_a_node_once_per_mention(problem):
    cells, n_points = problem
    ring_ptr, ring = rings(cells, n_points)
    assert ring_ptr[0] == 0
    assert ring_ptr[-1] == cells.size
    for i in range(n_points):
        assert ring[ring_ptr[i] : ring_ptr[i + 1]].tolist() == np.nonzero(cells == i)[0].tolist()
