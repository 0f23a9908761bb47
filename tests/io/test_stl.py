"""STL files: both kinds, merging of corners, and what is dropped."""

import numpy as np
import pytest
from mesh_files import TWO_TRIANGLES
from numpy.testing import assert_array_equal
from stl_files import ASCII_STL, binary_stl

from adaptsize import read
from adaptsize.errors import InputWarning


def test_ascii_stl_corners_are_merged_where_equal_and_minus_zero_is_zero(tmp_path):
    file = tmp_path / "two.stl"
    file.write_text(ASCII_STL)
    mesh = read(file)
    assert_array_equal(mesh.points, [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
    assert_array_equal(mesh.cells, TWO_TRIANGLES)
    file.write_text(ASCII_STL.replace("two triangles", "endfacet of a solid vertex").upper())
    assert_array_equal(read(file).points[read(file).cells], mesh.points[mesh.cells])


def test_a_binary_stl_whose_header_says_solid_is_read_as_binary(tmp_path):
    file = tmp_path / "solid.stl"
    corners = np.random.default_rng(7310).random((5, 3, 3)).astype(np.float32)
    content = binary_stl(corners, header=b"solid made by a program")
    for more in (b"", b"bytes after the triangles"):
        file.write_bytes(content + more)
        mesh = read(file)
        assert_array_equal(mesh.points[mesh.cells], corners)


def test_stl_triangles_with_a_repeated_corner_are_dropped_and_counted(tmp_path):
    file = tmp_path / "degenerate.stl"
    corners = np.random.default_rng(7311).random((6, 3, 3))
    corners[[1, 4], 2] = corners[[1, 4], 0]
    file.write_bytes(binary_stl(corners))
    with pytest.warns(InputWarning, match=r"degenerate\.stl: 2 cells .* dropped"):
        mesh = read(file)
    assert mesh.n_cells == 4
    assert_array_equal(np.unique(mesh.cells), np.arange(mesh.n_points))  # no node left over
