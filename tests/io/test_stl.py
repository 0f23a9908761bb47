"""STL files: both kinds, merging of corners, and what is dropped."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_files import TWO_TRIANGLES
from numpy.testing import assert_array_equal
from stl_files import ASCII_STL, binary_stl

from adaptsize import read
from adaptsize.background.merging import merge_equal_points
from adaptsize.errors import InputWarning


def test_ascii_stl_corners_are_merged_where_equal_and_minus_zero_is_zero(tmp_path):
    file = tmp_path / "two.stl"
    file.write_text(ASCII_STL)
    mesh = read(file)
    assert_array_equal(mesh.points, [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
    assert_array_equal(mesh.cells, TWO_TRIANGLES)


@pytest.mark.parametrize("tail", [b"", b"trailing bytes"])
def test_a_binary_stl_whose_header_says_solid_is_read_as_binary(tmp_path, tail):
    file = tmp_path / "solid.stl"
    corners = np.random.default_rng(7310).random((5, 3, 3)).astype(np.float32)
    file.write_bytes(binary_stl(corners, header=b"solid made by a program", tail=tail))
    mesh = read(file)
    assert_array_equal(mesh.points[mesh.cells], corners)


def test_stl_points_that_are_merely_close_stay_apart(tmp_path):
    file = tmp_path / "close.stl"
    one = np.float32(1)
    file.write_text(ASCII_STL.replace("vertex 1.0e0 1 1", f"vertex {1 + 2e-16!r} 1 1"))
    assert read(file).n_points == 5
    corners = np.zeros((2, 3, 3), np.float32)
    corners[:, 1, 0] = [one, np.nextafter(one, np.float32(2))]
    corners[:, 2, 1] = 1
    file.write_bytes(binary_stl(corners))
    assert read(file, flatten=False).n_points == 4


def test_stl_triangles_with_a_repeated_corner_are_dropped_and_counted(tmp_path):
    file = tmp_path / "degenerate.stl"
    corners = np.random.default_rng(7311).random((6, 3, 3))
    corners[[1, 4], 2] = corners[[1, 4], 0]
    file.write_bytes(binary_stl(corners))
    with pytest.warns(InputWarning, match=r"degenerate\.stl: 2 cells .* dropped"):
        mesh = read(file)
    assert mesh.n_cells == 4
    assert_array_equal(np.unique(mesh.cells), np.arange(mesh.n_points))  # no node left over


def test_flat_stl_triangles_with_three_different_corners_are_kept(tmp_path):
    file = tmp_path / "flat.stl"
    file.write_bytes(
        binary_stl([[[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 0, 0], [1, 0, 0], [0, 1, 1]]])
    )
    assert_array_equal(read(file).measures == 0.0, [True, False])


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.sampled_from([2, 3]))
def test_merging_keeps_every_corner_and_no_two_equal_nodes(seed, n, levels):
    rng = np.random.default_rng(seed)
    corners = rng.integers(-1, levels, (n, 3)) * rng.choice([1.0, 0.1, -0.0])
    points, number = merge_equal_points(corners)
    assert_array_equal(points[number], corners)
    assert len(np.unique(points + 0.0, axis=0)) == len(points)
    first = np.array([np.flatnonzero(number == i)[0] for i in range(len(points))])
    assert (np.diff(first) > 0).all()  # numbered in order of appearance
