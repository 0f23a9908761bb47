"""Cells that are no simplices, which cells of a file are read, and which tags."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_files import SQUARE, TWO_TRIANGLES, write_raw
from numpy.testing import assert_array_equal

from adaptsize import SimplexMesh, read
from adaptsize._formats import blocks
from adaptsize.errors import InputWarning

CUBE = np.array([[x, y, z] for z in (0, 1) for x, y in SQUARE], dtype=float)  # as VTK numbers it


def test_quadrilaterals_are_cut_along_the_shorter_diagonal(tmp_path):
    points = [[0, 0, 0], [3, 0, 0], [4, 1, 0], [1, 1, 0]]  # 0-2 is longer than 1-3
    file = write_raw(tmp_path / "quad.vtu", points, [("quad", [[0, 1, 2, 3]])])
    with pytest.warns(InputWarning, match="1 quadrilaterals split into 2 triangles"):
        mesh = read(file)
    assert {frozenset(cell) for cell in mesh.cells.tolist()} == {
        frozenset({1, 2, 3}),
        frozenset({0, 1, 3}),
    }


@pytest.mark.parametrize("turn", range(4))
def test_a_dented_quadrilateral_is_cut_inside(tmp_path, turn):
    # Corner (0.2, 0.2) is reflex: only the diagonal from it lies inside.  Area 0.2 by hand:
    # two triangles of base sqrt(0.08) along the diagonal, each 0.5 * 0.2 * 1.
    ring = np.roll([[0, 0, 0], [1, 0, 0], [0.2, 0.2, 0], [0, 1, 0]], turn, axis=0)
    file = write_raw(tmp_path / "dart.vtu", ring, [("quad", [[0, 1, 2, 3]])])
    with pytest.warns(InputWarning):
        mesh = read(file)
    assert (mesh.signed_measures > 0).all()
    assert mesh.measures.sum() == pytest.approx(0.2, rel=1e-14)


def hexahedra(n):
    """n x n x n cubes of side 1, in VTK's numbering."""
    points = np.indices((n + 1,) * 3).reshape(3, -1).T.astype(float)
    first = np.flatnonzero((points < n).all(axis=1))
    return points, first[:, None] + CUBE.astype(int) @ [(n + 1) ** 2, n + 1, 1]


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_hexahedra_become_matching_tetrahedra_however_they_are_numbered(seed):
    rng = np.random.default_rng(seed)
    points, cells = hexahedra(3)
    number = rng.permutation(len(points))
    shuffled = np.empty_like(points)
    shuffled[number] = points
    raw = blocks.RawMesh(shuffled, [("hexahedron", number[cells])])
    mesh = SimplexMesh(shuffled, blocks.simplices_of(raw, 3).cells)
    assert mesh.n_cells == 6 * 27
    assert (mesh.signed_measures > 0).all()
    assert mesh.measures.sum() == pytest.approx(27.0, rel=1e-13)
    # Matching: facets inside have two cells, and those with one are the 2 * 9 * 6 of the cube.
    assert np.bincount(mesh.facet_cell_counts).tolist()[1:] == [108, (4 * 162 - 108) // 2]


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_wedges_and_pyramids_match_the_hexahedron_between_them(seed):
    # A cube, a wedge of volume 1/2 on its side x = 1 and a pyramid of volume 1/3 on top.
    points = np.vstack([CUBE, [[2, 0, 0], [2, 0, 1], [0.5, 0.5, 2]]])
    number = np.random.default_rng(seed).permutation(len(points))
    shuffled = np.empty_like(points)
    shuffled[number] = points
    raw = blocks.RawMesh(
        shuffled,
        [
            ("hexahedron", number[[[0, 1, 2, 3, 4, 5, 6, 7]]]),
            ("wedge", number[[[1, 8, 2, 5, 9, 6]]]),
            ("pyramid", number[[[4, 5, 6, 7, 10]]]),
        ],
    )
    simplices = blocks.simplices_of(raw, 3)
    mesh = SimplexMesh(shuffled, simplices.cells)
    assert np.bincount(simplices.block).tolist() == [6, 3, 2]
    assert (mesh.signed_measures > 0).all()
    volumes = np.bincount(simplices.block, weights=mesh.measures)
    np.testing.assert_allclose(volumes, [1, 1 / 2, 1 / 3], rtol=1e-14)
    # Common faces: 2 quadrilaterals.  Outside: 4 + 2 quadrilaterals, 2 + 4 triangles.
    assert np.count_nonzero(mesh.facet_cell_counts == 1) == 18
    assert mesh.facet_cell_counts.max() == 2


def test_split_hexahedra_carry_their_tags_fields_and_boundary_quads(tmp_path):
    points, cells = hexahedra(2)
    bottom = cells[points[cells[:, 0], 2] == 0][:, [0, 1, 2, 3]]
    tags = np.arange(1, 9)
    file = write_raw(
        tmp_path / "hex.vtu",
        points,
        [("hexahedron", cells), ("quad", bottom)],
        cell_data={"region": [tags, np.full(4, 5)], "rho": [tags / 2, np.zeros(4)]},
    )
    with pytest.warns(InputWarning, match="8 hexahedra split into 48 tetrahedra"):
        mesh = read(file)
    assert_array_equal(mesh.cell_tags, np.repeat(tags, 6))
    assert_array_equal(mesh.cell_data["rho"], np.repeat(tags / 2, 6))
    assert_array_equal(mesh.facet_tags, np.full(8, 5))
    assert mesh.measures.sum() == pytest.approx(8.0, rel=1e-14)


@pytest.mark.parametrize(
    ("cell_type", "n_nodes", "n_corners"),
    [("line3", 3, 2), ("triangle6", 6, 3), ("tetra10", 10, 4)],
)
def test_cells_of_higher_order_are_reduced_to_their_corners(
    tmp_path, cell_type, n_nodes, n_corners
):
    points = np.random.default_rng(7312).random((n_nodes + 1, 3))
    file = write_raw(
        tmp_path / "curved.vtu",
        points,
        [(cell_type, [range(n_nodes)])],
        point_data={"x": points[:, 0]},
    )
    with pytest.warns(InputWarning, match="reduced to their corners"):
        mesh = read(file)
    # The node of no cell at all stays, the mid-side nodes go.
    kept = points[[*range(n_corners), n_nodes]]
    assert_array_equal(mesh.points, kept)
    assert_array_equal(mesh.point_data["x"], kept[:, 0])
    assert_array_equal(mesh.cells, [range(n_corners)])


@pytest.mark.parametrize("turn", range(9))
def test_polygons_are_split_inside_however_they_begin(turn):
    # An L of three unit squares with corners on its edges: fans from most corners overlap.
    ring = [[0, 0], [1, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2], [0, 1.5], [0, 1]]
    points = np.roll(np.array(ring, float), turn, axis=0)
    raw = blocks.RawMesh(points, [("polygon", np.arange(9)[None])])
    mesh = SimplexMesh(points, blocks.simplices_of(raw, 2).cells)
    assert mesh.n_cells == 7
    assert (mesh.signed_measures > 0.0).all()
    assert mesh.measures.sum() == pytest.approx(3.0, rel=1e-14)


def test_polygons_on_a_line_are_split_too():
    points = np.array([[0, 0], [1, 0], [2, 0], [3, 0], [4, 0], [0, 1]], float)
    raw = blocks.RawMesh(points, [("polygon", np.array([[0, 1, 2, 3, 4], [0, 1, 2, 3, 5]]))])
    simplices = blocks.simplices_of(raw, 2)
    assert sorted(simplices.row) == [0, 0, 0, 1, 1, 1]
    assert {*simplices.cells[simplices.row == 0].ravel()} == {0, 1, 2, 3, 4}


def mixed_file(tmp_path):
    """A tetrahedron, two of its faces, one edge, and a node of its own."""
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [5, 5, 5]]
    cells = [("line", [[2, 3]]), ("triangle", [[1, 2, 3], [0, 1, 3]]), ("tetra", [[0, 1, 2, 3]])]
    tags = [np.array([7]), np.array([8, 9]), np.array([3])]
    return write_raw(tmp_path / "mixed.vtu", points, cells, cell_data={"region": tags})


def test_cells_of_the_highest_dimension_are_taken_and_nodes_in_no_cell_kept(tmp_path):
    with pytest.warns(InputWarning, match=r"mixed.vtu: 1 tagged segments dropped \(7\)$"):
        mesh = read(mixed_file(tmp_path))
    assert repr(mesh) == "SimplexMesh(5 points in 3-D, 1 tetrahedra)"
    assert_array_equal(mesh.cell_tags, [3])
    assert_array_equal(mesh.tagged_facets, [[1, 2, 3], [0, 1, 3]])
    assert_array_equal(mesh.facet_tags, [8, 9])


def test_kind_takes_other_cells_and_leaves_nodes_of_the_rest_out(tmp_path):
    file = mixed_file(tmp_path)
    triangles = read(file, kind="triangles")
    assert_array_equal(triangles.cell_tags, [8, 9])
    assert_array_equal(triangles.facet_tags, [7])
    segments = read(file, kind="segments")
    assert_array_equal(segments.points, [[0, 1, 0], [0, 0, 1], [5, 5, 5]])
    assert_array_equal(segments.cells, [[0, 1]])
    assert_array_equal(segments.cell_tags, [7])


def with_cell_data(tmp_path, data):
    points, cells = np.pad(SQUARE, ((0, 0), (0, 1))), [("triangle", TWO_TRIANGLES)]
    return read(write_raw(tmp_path / "m.vtu", points, cells, cell_data=data))


@pytest.mark.parametrize(
    "name", ["gmsh:physical", "medit:ref", "region", "Material", "MaterialIDs", "tag", "cell_tags"]
)
def test_regions_are_found_under_the_names_that_programs_use(tmp_path, name):
    data = {"rank": [np.array([5, 6])], name: [np.array([2.0, 4.0])]}
    mesh = with_cell_data(tmp_path, data)
    assert_array_equal(mesh.cell_tags, [2, 4])
    assert set(mesh.cell_data) == {"rank"}


@pytest.mark.parametrize("values", [[1.5, 2.0], [np.nan, 1.0]])
def test_fields_that_are_not_integers_are_no_tags(tmp_path, values):
    mesh = with_cell_data(tmp_path, {"region": [np.array(values)]})
    assert mesh.cell_tags is None
    assert_array_equal(mesh.cell_data["region"], values)


def test_tagged_facets_that_bound_no_cell_are_dropped_and_counted(tmp_path):
    points = np.pad([*SQUARE, [2, 2]], ((0, 0), (0, 1)))
    file = write_raw(
        tmp_path / "m.vtu",
        points,
        [("triangle", TWO_TRIANGLES), ("line", [[1, 0], [1, 3], [2, 4]])],
        cell_data={"tag": [np.array([0, 0]), np.array([5, 6, 7])]},
    )
    with pytest.warns(InputWarning, match="2 tagged facets that bound no cell dropped"):
        mesh = read(file)
    assert_array_equal(mesh.tagged_facets, [[1, 0]])
    assert_array_equal(mesh.facet_tags, [5])
    assert mesh.cell_tags is None
