"""Grouping of index rows and rings against sets and dictionaries."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adaptsize._kernels.topology import fill_rings, group_rows
from adaptsize.background.topology import edges_of, facets_of, rings, unique_rows


@st.composite
def index_rows(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n_points = draw(st.integers(1, 9))
    shape = (draw(st.integers(1, 40)), draw(st.integers(1, 4)))
    return rng.integers(0, n_points, shape).astype(np.int32), n_points


@given(index_rows())
def test_groups_are_the_sorted_distinct_rows_and_first_is_met_first(problem):
    rows, n_points = problem
    rows = np.sort(rows, axis=1)
    first, group = np.full((2, len(rows)), -7, np.int32)
    start, free = np.zeros((2, n_points + 1), np.int64)
    count = group_rows(rows, (start, free, np.empty(len(rows), np.int32)), first, group)
    distinct = sorted(set(map(tuple, rows.tolist())))
    assert count == len(distinct)
    for number, row in enumerate(distinct):
        met = [r for r, other in enumerate(rows.tolist()) if tuple(other) == row]
        assert first[number] == met[0]
        assert (group[met] == number).all()


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


def test_rings_overwrite_what_the_arrays_held():
    ring_ptr, ring = np.full(5, 99, np.int32), np.full(3, 99, np.int32)
    fill_rings(np.array([[2, 0, 3]], np.int32), 4, ring_ptr, ring)
    assert ring_ptr.tolist() == [0, 1, 1, 2, 3]
    assert ring.tolist() == [0, 0, 0]


@pytest.mark.parametrize(("width", "n_edges", "n_facets"), [(2, 1, 2), (3, 3, 3), (4, 6, 4)])
def test_a_single_simplex_has_its_edges_and_facets(width, n_edges, n_facets):
    cells = np.arange(width, dtype=np.int32)[None, ::-1]
    assert len(edges_of(cells, width)) == n_edges
    facets, cell_facets = facets_of(cells, width)
    assert len(facets) == n_facets
    assert sorted(cell_facets[0].tolist()) == list(range(n_facets))
