"""STL files: both kinds, merging of corners, and what is dropped."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_files import TWO_TRIANGLES
from numpy.testing import assert_array_equal
from stl_files import ASCII_STL, binary_stl

from adaptsize import CartesianGrid, SimplexMesh, read
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


def box(n, rng):
    """The surface of a block, turned, scaled and shifted."""
    mesh = CartesianGrid([0.0] * 3, 1.0 / n, (n + 1, n + 1, n + 2)).mesh.boundary().mesh
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    points = 10.0 ** rng.uniform(-2, 3) * (mesh.points @ turn + rng.standard_normal(3))
    return SimplexMesh(points, mesh.cells)


def write_text(path, corners):
    """Text has all digits."""
    facet = "facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n"
    rows = ["".join("vertex {!r} {!r} {!r}\n".format(*row) for row in c) for c in corners.tolist()]
    path.write_text("solid a\n" + "".join(map(facet.format, rows)) + "endsolid a\n")


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([1e-12, 1e-9, 1e-6, 1e-4, 1e-3]),
    st.sampled_from(["closed", "open"]),
)
def test_corners_with_noise_are_joined_at_their_mean(tmp_path_factory, seed, noise, kind):
    rng, file = np.random.default_rng(seed), tmp_path_factory.mktemp("noise") / "a.stl"
    mesh = box(3, rng)
    cells = mesh.cells if kind == "closed" else mesh.cells[5:]
    corners = mesh.points[cells]
    corners += noise * mesh.diagonal * rng.uniform(-1.0, 1.0, corners.shape)
    write_text(file, corners)
    with pytest.warns(InputWarning, match=r"corners up to .* apart joined") as caught:
        found = read(file)
    within = float(str(caught[0].message).split("up to ")[1].split()[0])
    assert within < 0.101 * mesh.edge_lengths.min()
    if noise > 1e-10:  # of the distance between two corners of the same node
        assert within < 8.0 * noise * mesh.diagonal
    assert found.n_points == len(np.unique(cells))
    assert found.is_closed == (kind == "closed")
    away = np.linalg.norm(found.points[found.cells] - mesh.points[cells], axis=-1)
    assert away.max() <= 2.0 * noise * mesh.diagonal


def test_seams_that_differ_by_rounding_are_joined_and_gaps_are_kept(tmp_path):
    rng, file = np.random.default_rng(7312), tmp_path / "a.stl"
    mesh = box(4, rng)
    flat = mesh.points[mesh.cells].mean(axis=1)
    apart = flat[:, 0] > flat[:, 0].mean()
    for gap, is_closed in ((1e-8, True), (1e-7, True), (1e-4, False)):
        corners = mesh.points[mesh.cells]
        corners[apart] += gap * mesh.diagonal
        write_text(file, corners)
        if is_closed:
            with pytest.warns(InputWarning, match="corners up to .* apart joined"):
                assert read(file).is_closed
        else:
            assert not read(file).is_closed


def test_sheets_side_by_side_and_triangles_on_their_own_stay(tmp_path):
    square = CartesianGrid([0.0, 0.0], 0.25, (5, 5)).mesh
    sheet = np.pad(square.points, ((0, 0), (0, 1)))[square.cells]
    write_text(tmp_path / "a.stl", np.concatenate([sheet, sheet + np.array([0, 0, 0.01])]))
    assert read(tmp_path / "a.stl").n_points == 2 * square.n_points
    apart = sheet + 0.02 * np.arange(len(sheet))[:, None, None]
    write_text(tmp_path / "a.stl", apart)
    assert read(tmp_path / "a.stl").n_points == 3 * len(sheet)
