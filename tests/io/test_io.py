"""Reading and writing files: what comes back, what is mended, what is refused."""

import os
import re
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import jittered_cube, random_sphere, random_square
from numpy.testing import assert_array_equal
from stl_files import ASCII_STL, binary_stl

from adaptsize import SimplexMesh, SizeFunction, read, read_size, write
from adaptsize._formats import blocks, stl
from adaptsize.errors import MeshFileError, MeshRepairWarning

posix_only = pytest.mark.skipif(sys.platform == "win32", reason="pipes with a path")

MESH_FORMATS = [".vtu", ".vtk", ".xdmf", ".msh", ".mesh", ".meshb"]
FIELD_FORMATS = [".vtu", ".vtk", ".xdmf", ".msh"]
SURFACE_FORMATS = [".ply", ".obj", ".off"]

SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]
TWO_TRIANGLES = [[0, 1, 2], [0, 2, 3]]
CUBE = np.array([[x, y, z] for z in (0, 1) for x, y in SQUARE], dtype=float)  # as VTK numbers it


def tagged_mesh(dim):
    """A mesh with regions, a tagged boundary, and fields of several shapes and types."""
    mesh = random_square(40, 7301) if dim == 2 else jittered_cube(4, 7302)
    rng = np.random.default_rng(7303)
    boundary = mesh.boundary()
    return SimplexMesh(
        mesh.points,
        mesh.cells,
        cell_tags=rng.integers(0, 4, mesh.n_cells),
        tagged_facets=boundary.nodes[boundary.mesh.cells],
        facet_tags=rng.integers(4, 9, boundary.mesh.n_cells),
        point_data={
            "h": rng.random(mesh.n_points),
            "velocity": rng.random((mesh.n_points, 3)),
            "number": np.arange(mesh.n_points),
        },
        cell_data={"quality": rng.random(mesh.n_cells), "rank": np.arange(mesh.n_cells)},
    )


# ---------------------------------------------------------------- there and back


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("suffix", MESH_FORMATS)
def test_points_cells_and_tags_come_back_to_the_last_bit(tmp_path, suffix, dim):
    mesh = tagged_mesh(dim)
    write(tmp_path / f"mesh{suffix}", mesh)
    back = read(tmp_path / f"mesh{suffix}")
    assert_array_equal(back.points, mesh.points)
    assert_array_equal(back.cells, mesh.cells)
    assert_array_equal(back.cell_tags, mesh.cell_tags)
    assert_array_equal(back.tagged_facets, mesh.tagged_facets)
    assert_array_equal(back.facet_tags, mesh.facet_tags)


@pytest.mark.parametrize("dim", [2, 3])
def test_names_of_physical_groups_come_back_from_gmsh_files(tmp_path, dim):
    names = {(dim, 1): "fluid", (dim, 3): "same", (dim - 1, 4): "same", (dim - 1, 5): "ä 'b'"}
    mesh = replace(tagged_mesh(dim), tag_names=names)
    write(tmp_path / "mesh.msh", mesh)
    assert read(tmp_path / "mesh.msh").tag_names == names
    held = meshio.read(tmp_path / "mesh.msh").field_data
    assert held["fluid"].tolist() == [1, dim]


@pytest.mark.parametrize("some", [False, True])
def test_cells_without_a_tag_are_a_group_of_their_own_for_gmsh(tmp_path, some):
    # Gmsh keeps the cells of groups only, and group 0 is none.
    mesh = tagged_mesh(3)
    tags = np.where(np.arange(mesh.n_cells) < 5, 2, 0) if some else None
    mesh = replace(mesh, cell_tags=tags, tag_names={(3, 1): "named, but not used"})
    write(tmp_path / "mesh.msh", mesh)
    written = meshio.read(tmp_path / "mesh.msh")
    groups = written.cell_data_dict["gmsh:physical"]["tetra"].tolist()
    assert set(groups) == ({2, 3} if some else {2})
    assert written.field_data["adaptsize untagged"].tolist() == [3 if some else 2, 3]
    back = read(tmp_path / "mesh.msh")
    assert_array_equal(back.facet_tags, mesh.facet_tags)
    assert back.tag_names == {(3, 1): "named, but not used"}
    if some:
        assert_array_equal(back.cell_tags, tags)
    else:
        assert back.cell_tags is None


def test_a_mesh_without_tags_has_no_groups_in_gmsh_files(tmp_path):
    write(tmp_path / "mesh.msh", SimplexMesh(SQUARE, TWO_TRIANGLES))
    assert b"PhysicalNames" not in (tmp_path / "mesh.msh").read_bytes()
    assert read(tmp_path / "mesh.msh").cell_tags is None


def test_gmsh_keeps_all_cells_and_names_of_a_written_file(tmp_path):
    gmsh = pytest.importorskip("gmsh")
    mesh = replace(tagged_mesh(3), cell_tags=None, tag_names={(2, 4): "wall"})
    write(tmp_path / "mesh.msh", mesh)
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "mesh.msh"))
        gmsh.write(str(tmp_path / "again.msh"))
    finally:
        gmsh.finalize()
    again = read(tmp_path / "again.msh")
    assert again.n_cells == mesh.n_cells
    assert again.cell_tags is None
    assert again.tag_names == {(2, 4): "wall"}


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("suffix", FIELD_FORMATS)
def test_nodal_fields_come_back_in_the_byte_order_of_the_machine(tmp_path, suffix, dim):
    mesh = tagged_mesh(dim)
    write(tmp_path / f"mesh{suffix}", mesh)
    back = read(tmp_path / f"mesh{suffix}")
    assert set(back.point_data) == set(mesh.point_data)
    for name, values in mesh.point_data.items():
        assert_array_equal(back.point_data[name], values)
        assert back.point_data[name].dtype.isnative


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".xdmf"])
def test_cell_fields_come_back_from_files_with_tagged_facets(tmp_path, suffix):
    mesh = tagged_mesh(3)
    write(tmp_path / f"mesh{suffix}", mesh)
    back = read(tmp_path / f"mesh{suffix}")
    assert set(back.cell_data) == {"quality", "rank"}
    assert_array_equal(back.cell_data["quality"], mesh.cell_data["quality"])
    assert_array_equal(back.cell_data["rank"], mesh.cell_data["rank"])


@pytest.mark.parametrize("suffix", SURFACE_FORMATS)
def test_surfaces_come_back_to_the_last_bit(tmp_path, suffix):
    mesh = random_sphere(50, 7304)
    write(tmp_path / f"mesh{suffix}", mesh)
    back = read(tmp_path / f"mesh{suffix}")
    assert_array_equal(back.points, mesh.points)
    assert_array_equal(back.cells, mesh.cells)


def test_a_surface_comes_back_from_stl_rounded_to_float32(tmp_path):
    mesh = random_sphere(50, 7305)
    write(tmp_path / "mesh.stl", mesh)
    back = read(tmp_path / "mesh.stl")
    assert back.n_points == mesh.n_points
    assert back.is_closed
    assert_array_equal(back.points[back.cells], mesh.points[mesh.cells].astype(np.float32))


def test_normals_in_stl_files_are_unit_and_point_outward(tmp_path):
    mesh = random_sphere(50, 7306)
    write(tmp_path / "mesh.stl", mesh)
    records = np.frombuffer((tmp_path / "mesh.stl").read_bytes(), stl._RECORD, offset=84)
    along = (records["normal"] * records["corners"].mean(axis=1)).sum(axis=1)
    assert (along > 0).all()
    # float32 has 24 bits: the sum of three squares is 1 to a few 6e-8.
    np.testing.assert_allclose((records["normal"] ** 2).sum(axis=1), 1.0, atol=1e-6)


@pytest.mark.parametrize("suffix", [".stl", *SURFACE_FORMATS])
def test_tetrahedra_are_written_to_surface_formats_as_their_boundary(tmp_path, suffix):
    mesh = jittered_cube(4, 7307)
    write(tmp_path / f"mesh{suffix}", mesh)
    back = read(tmp_path / f"mesh{suffix}")
    assert back.cell_dim == 2
    assert back.is_closed
    assert back.n_cells == mesh.boundary().mesh.n_cells


@pytest.mark.parametrize("suffix", MESH_FORMATS)
def test_polylines_in_the_plane_come_back(tmp_path, suffix):
    line = SimplexMesh(SQUARE, [[0, 1], [1, 2], [2, 3]], cell_tags=[1, 2, 2])
    write(tmp_path / f"line{suffix}", line)
    back = read(tmp_path / f"line{suffix}")
    assert_array_equal(back.points, line.points)
    assert_array_equal(back.cells, line.cells)
    assert_array_equal(back.cell_tags, line.cell_tags)


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".xdmf"])
def test_a_size_function_is_written_as_the_field_h_with_inf(tmp_path, suffix):
    size = SizeFunction(SimplexMesh(SQUARE, TWO_TRIANGLES), [0.1, 0.2, np.inf, 0.2])
    write(tmp_path / f"size{suffix}", size)
    assert_array_equal(read(tmp_path / f"size{suffix}").point_data["h"], size.values)


def test_fields_are_added_to_and_replace_those_of_the_mesh(tmp_path):
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES, point_data={"a": [1.0] * 4, "b": [2.0] * 4})
    write(tmp_path / "mesh.vtu", mesh, fields={"b": [3.0] * 4, "c": [4.0] * 4})
    back = read(tmp_path / "mesh.vtu")
    assert {name: values[0] for name, values in back.point_data.items()} == {"a": 1, "b": 3, "c": 4}
    assert_array_equal(mesh.point_data["b"], 2.0)


def test_ply_holds_scalar_nodal_fields(tmp_path):
    mesh = random_sphere(20, 7308)
    h = np.random.default_rng(7309).random(20)
    write(tmp_path / "mesh.ply", mesh, fields={"h": h})
    assert_array_equal(read(tmp_path / "mesh.ply").point_data["h"], h)


def test_tags_that_are_all_zero_are_read_as_none(tmp_path):
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES, cell_tags=[0, 0])
    write(tmp_path / "mesh.mesh", mesh)
    back = read(tmp_path / "mesh.mesh")
    assert back.cell_tags is None
    assert not back.cell_data


# ---------------------------------------------------------------- STL


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
    corners[:, 1, 0] = [one, np.nextafter(one, 2 * one)]
    corners[:, 2, 1] = 1
    file.write_bytes(binary_stl(corners))
    assert read(file, flatten=False).n_points == 4


def test_stl_triangles_with_a_repeated_corner_are_dropped_and_counted(tmp_path):
    file = tmp_path / "degenerate.stl"
    corners = np.random.default_rng(7311).random((6, 3, 3))
    corners[[1, 4], 2] = corners[[1, 4], 0]
    file.write_bytes(binary_stl(corners))
    with pytest.warns(MeshRepairWarning, match=r"degenerate\.stl: 2 cells .* dropped"):
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
    points, number = stl.merge_equal_points(corners)
    assert_array_equal(points[number], corners)
    assert len(np.unique(points + 0.0, axis=0)) == len(points)
    first = np.array([np.flatnonzero(number == i)[0] for i in range(len(points))])
    assert (np.diff(first) > 0).all()  # numbered in order of appearance


# ---------------------------------------------------------------- cells that are no simplices


def write_raw(file, points, cells, **options):
    meshio.write(file, meshio.Mesh(np.asarray(points, float), cells, **options))
    return file


def test_quadrilaterals_are_cut_along_the_shorter_diagonal(tmp_path):
    points = [[0, 0, 0], [3, 0, 0], [4, 1, 0], [1, 1, 0]]  # 0-2 is longer than 1-3
    file = write_raw(tmp_path / "quad.vtu", points, [("quad", [[0, 1, 2, 3]])])
    with pytest.warns(MeshRepairWarning, match="1 quadrilaterals split into 2 triangles"):
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
    with pytest.warns(MeshRepairWarning):
        mesh = read(file)
    assert (mesh.signed_measures > 0).all()
    assert mesh.measures.sum() == pytest.approx(0.2, rel=1e-14)


def hexahedra(n):
    """n x n x n cubes of side 1, in VTK's numbering."""
    i = np.arange((n + 1) ** 3).reshape(n + 1, n + 1, n + 1)
    x, y, z = np.meshgrid(*[np.arange(n + 1.0)] * 3, indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    a, b = slice(None, -1), slice(1, None)
    corners = [
        (a, a, a),
        (b, a, a),
        (b, b, a),
        (a, b, a),
        (a, a, b),
        (b, a, b),
        (b, b, b),
        (a, b, b),
    ]
    return points, np.stack([i[c].ravel() for c in corners], axis=1)


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
    with pytest.warns(MeshRepairWarning, match="8 hexahedra split into 48 tetrahedra"):
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
    with pytest.warns(MeshRepairWarning, match="reduced to their corners"):
        mesh = read(file)
    # The node of no cell at all stays, the mid-side nodes go.
    kept = points[[*range(n_corners), n_nodes]]
    assert_array_equal(mesh.points, kept)
    assert_array_equal(mesh.point_data["x"], kept[:, 0])
    assert_array_equal(mesh.cells, [range(n_corners)])


def test_cells_that_cannot_be_split_are_refused(tmp_path):
    raw = [("polygon", [[0, 1, 2, 3, 4]])]
    file = write_raw(tmp_path / "pentagon.vtu", np.random.default_rng(7313).random((5, 3)), raw)
    with pytest.raises(MeshFileError, match=r"pentagon\.vtu: .*polygon"):
        read(file)


# ---------------------------------------------------------------- which cells, which tags


def mixed_file(tmp_path):
    """A tetrahedron, two of its faces, one edge, and a node of its own."""
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [5, 5, 5]]
    cells = [("line", [[2, 3]]), ("triangle", [[1, 2, 3], [0, 1, 3]]), ("tetra", [[0, 1, 2, 3]])]
    tags = [np.array([7]), np.array([8, 9]), np.array([3])]
    return write_raw(tmp_path / "mixed.vtu", points, cells, cell_data={"region": tags})


def test_cells_of_the_highest_dimension_are_taken_and_nodes_in_no_cell_kept(tmp_path):
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


def test_a_kind_that_is_absent_or_unknown_is_refused(tmp_path):
    file = tmp_path / "square.vtu"
    write(file, SimplexMesh(SQUARE, TWO_TRIANGLES))
    with pytest.raises(MeshFileError, match=r"holds no tetrahedra \(found 2 triangles"):
        read(file, kind="tetrahedra")
    with pytest.raises(ValueError, match="kind must be one of"):
        read(file, kind="tets")


@pytest.mark.parametrize(
    "name", ["gmsh:physical", "medit:ref", "region", "Material", "MaterialIDs", "tag", "cell_tags"]
)
def test_regions_are_found_under_the_names_that_programs_use(tmp_path, name):
    data = {"rank": [np.array([5, 6])], name: [np.array([2.0, 4.0])]}
    file = write_raw(
        tmp_path / "m.vtu",
        np.pad(SQUARE, ((0, 0), (0, 1))),
        [("triangle", TWO_TRIANGLES)],
        cell_data=data,
    )
    mesh = read(file)
    assert_array_equal(mesh.cell_tags, [2, 4])
    assert set(mesh.cell_data) == {"rank"}


@pytest.mark.parametrize("values", [[1.5, 2.0], [np.nan, 1.0]])
def test_fields_that_are_not_integers_are_no_tags(tmp_path, values):
    file = write_raw(
        tmp_path / "m.vtu",
        np.pad(SQUARE, ((0, 0), (0, 1))),
        [("triangle", TWO_TRIANGLES)],
        cell_data={"region": [np.array(values)]},
    )
    mesh = read(file)
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
    with pytest.warns(MeshRepairWarning, match="2 tagged facets that bound no cell dropped"):
        mesh = read(file)
    assert_array_equal(mesh.tagged_facets, [[1, 0]])
    assert_array_equal(mesh.facet_tags, [5])
    assert mesh.cell_tags is None


def test_meshes_with_z_zero_are_flattened_unless_told_not_to(tmp_path):
    file = tmp_path / "flat.vtu"
    write(file, SimplexMesh(SQUARE, TWO_TRIANGLES))
    assert read(file).dim == 2
    assert read(file, flatten=False).dim == 3
    write(file, SimplexMesh(np.pad(SQUARE, ((0, 0), (0, 1)), constant_values=2), TWO_TRIANGLES))
    assert read(file).dim == 3


# ---------------------------------------------------------------- files of other programs


VTU_PIECE = """<Piece NumberOfPoints="3" NumberOfCells="1"><Points>
<DataArray type="Float64" NumberOfComponents="3" format="ascii">{}</DataArray></Points><Cells>
<DataArray type="Int64" Name="connectivity" format="ascii">0 1 2</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">3</DataArray>
<DataArray type="UInt8" Name="types" format="ascii">{}</DataArray></Cells>
<PointData><DataArray type="Float64" Name="h" format="ascii">1 2 3</DataArray></PointData>
</Piece>"""


def write_vtu_pieces(file, *pieces):
    file.write_text(
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian">'
        f"<UnstructuredGrid>{''.join(pieces)}</UnstructuredGrid></VTKFile>"
    )
    return file


def test_multi_piece_vtu_files_are_joined(tmp_path):
    one, two = VTU_PIECE.format("0 0 0 1 0 0 0 1 0", 5), VTU_PIECE.format("2 0 0 3 0 0 2 1 0", 5)
    mesh = read(write_vtu_pieces(tmp_path / "pieces.vtu", one, two))
    assert_array_equal(mesh.cells, [[0, 1, 2], [3, 4, 5]])
    assert mesh.points[3].tolist() == [2, 0]
    assert_array_equal(mesh.point_data["h"], [1, 2, 3, 1, 2, 3])


def test_vtk_cells_of_unknown_types_are_refused_not_left_out(tmp_path):
    piece = VTU_PIECE.format("0 0 0 1 0 0 0 1 0", 99)
    with pytest.raises(MeshFileError, match="VTK type 99"):
        read(write_vtu_pieces(tmp_path / "odd.vtu", piece))


def test_legacy_vtk_with_the_type_names_of_vtk_9_is_read(tmp_path):
    file = tmp_path / "new.vtk"
    file.write_text(
        "# vtk DataFile Version 4.1\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 3 double\n"
        "0 0 0 1 0 0 0 1 0\nCELLS 1 4\n3 0 1 2\nCELL_TYPES 1\n5\nPOINT_DATA 3\n"
        "FIELD FieldData 1\nid 1 3 vtktypeint64\n4 5 6\n"
    )
    assert_array_equal(read(file).point_data["id"], [4, 5, 6])


def test_gmsh_2_files_with_element_fields_are_read_without_them(tmp_path):
    file = tmp_path / "fields.msh"
    file.write_text(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n3\n1 0 0 0\n2 1 0 0\n3 0 1 0\n$EndNodes\n"
        "$Elements\n2\n1 1 2 4 1 1 2\n2 2 2 6 1 1 2 3\n$EndElements\n"
        '$ElementData\n1\n"q"\n1\n0\n3\n0\n1\n2\n1 0.5\n2 0.25\n$EndElementData\n'
    )
    with pytest.warns(MeshRepairWarning, match="ElementData"):
        mesh = read(file)
    assert_array_equal(mesh.cell_tags, [6])
    assert_array_equal(mesh.facet_tags, [4])


def test_gmsh_4_files_give_physical_groups(tmp_path):
    file = tmp_path / "groups.msh"
    file.write_text(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"
        "$Entities\n0 1 1 0\n1 0 0 0 1 0 0 1 11 0\n1 0 0 0 1 1 0 1 22 0\n$EndEntities\n"
        "$Nodes\n1 3 1 3\n2 1 0 3\n1\n2\n3\n0 0 0\n1 0 0\n0 1 0\n$EndNodes\n"
        "$Elements\n2 2 1 2\n1 1 1 1\n1 1 2\n2 1 2 1\n2 1 2 3\n$EndElements\n"
    )
    mesh = read(file)
    assert_array_equal(mesh.cell_tags, [22])
    assert_array_equal(mesh.tagged_facets, [[0, 1]])
    assert_array_equal(mesh.facet_tags, [11])


@pytest.mark.parametrize(
    "faces",
    [
        "f 1 2 3 4",
        "f 1//1 2//1 3//1\nf 1//1 3//1 4//1",
        "f -4 -3 -2\nf -4 -2 -1",
        "f 1/1 2/2 3/3\nf 1/2 3/1 4/1",  # texture seam: still one node per corner
    ],
)
@pytest.mark.filterwarnings("ignore::adaptsize.errors.MeshRepairWarning")
def test_obj_faces_in_all_spellings_give_the_same_surface(tmp_path, faces):
    corners = "v 0 0 0\nv 1 0 0\nv 1 1 1\nv 0 1 1\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\n"
    file = tmp_path / "square.obj"
    file.write_text(f"# comment\no square\n{corners}{faces}\n")
    mesh = read(file)
    assert mesh.n_points == 4
    assert mesh.n_cells == 2
    assert mesh.measures.sum() == pytest.approx(np.sqrt(2), rel=1e-14)


def test_off_with_comments_colours_and_polygons_is_read(tmp_path):
    file = tmp_path / "square.off"
    file.write_text(
        "COFF # by hand\n5 1 0\n0 0 1 9 9 9\n1 0 1 9 9 9 # corner\n2 0.5 1 9 9 9\n"
        "1 1 1 9 9 9\n0 1 1 9 9 9\n5 0 1 2 3 4 0.5 0.5 0.5\n"
    )
    mesh = read(file)
    assert_array_equal(mesh.cells, [[0, 1, 2], [0, 2, 3], [0, 3, 4]])
    assert mesh.measures.sum() == 1.5


# ---------------------------------------------------------------- written whole or not at all


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    file = tmp_path / "mesh.vtu"
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES)
    write(file, mesh)
    before = file.read_bytes()

    def fill_the_disk(path, *args, **kwargs):
        Path(path).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(meshio, "write", fill_the_disk)
    with pytest.raises(MeshFileError, match=r"mesh\.vtu: .*No space left"):
        write(file, mesh)
    assert file.read_bytes() == before
    assert os.listdir(tmp_path) == ["mesh.vtu"]


def test_a_file_is_replaced_in_one_step_not_overwritten(tmp_path):
    file, second_name = tmp_path / "mesh.stl", tmp_path / "second"
    write(file, SimplexMesh(SQUARE, TWO_TRIANGLES))
    before = file.read_bytes()
    os.link(file, second_name)  # shows the old content only if that is never written into
    write(file, SimplexMesh(SQUARE, TWO_TRIANGLES[:1]))
    assert read(file).n_cells == 1
    assert second_name.read_bytes() == before


def test_an_interrupted_write_leaves_nothing(tmp_path, monkeypatch):
    def interrupt(path, corners):
        path.write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(stl, "write_binary", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write(tmp_path / "mesh.stl", SimplexMesh(SQUARE, TWO_TRIANGLES))
    assert os.listdir(tmp_path) == []


def test_links_and_permissions_outlive_a_rewrite(tmp_path):
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES)
    file, link = tmp_path / "mesh.vtu", tmp_path / "link.vtu"
    write(file, mesh)
    plain = tmp_path / "plain"
    plain.touch()
    assert file.stat().st_mode == plain.stat().st_mode  # as any new file
    file.chmod(0o640)
    link.symlink_to(file)
    write(link, mesh, fields={"h": np.ones(4)})
    assert link.is_symlink()
    assert file.stat().st_mode & 0o777 == 0o640
    assert "h" in read(file).point_data


def test_a_path_that_cannot_be_written_is_refused(tmp_path):
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES)
    with pytest.raises(MeshFileError, match="there is no directory"):
        write(tmp_path / "absent" / "mesh.vtu", mesh)
    (tmp_path / "folder.vtu").mkdir()
    with pytest.raises(MeshFileError, match="is a directory"):
        write(tmp_path / "folder.vtu", mesh)


@posix_only
@pytest.mark.parametrize("name", ["pipe.stl", "link.stl"])
def test_a_special_file_is_written_to_and_stays_what_it_is(tmp_path, name):
    # A pipe stands for devices such as /dev/null, which a test should not put at risk.
    pipe, link, mesh = tmp_path / "pipe.stl", tmp_path / "link.stl", random_sphere(8, 7314)
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    write(tmp_path / "mesh.stl", mesh)
    with ThreadPoolExecutor(1) as pool:
        keeper = os.open(pipe, os.O_RDWR)  # a pipe replaced by a file would block the reader
        content = pool.submit(lambda: os.read(keeper, 1_000_000))
        write(tmp_path / name, mesh)
        os.write(keeper, b"end")
    written = content.result()
    os.close(keeper)
    assert written.removesuffix(b"end") == (tmp_path / "mesh.stl").read_bytes()
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert sorted(os.listdir(tmp_path)) == ["link.stl", "mesh.stl", "pipe.stl"]


@posix_only
def test_a_mesh_goes_to_standard_output(tmp_path):
    code = (
        "import adaptsize as ads\n"
        "mesh = ads.SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])\n"
        "ads.write('/dev/stdout', mesh, file_format='off')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert done.stdout.startswith(b"OFF")


def test_unknown_suffixes_and_formats_are_answered_with_the_list(tmp_path):
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES)
    with pytest.raises(ValueError, match=r"suffix .*vtu \.vtu.*got .*mesh\.xyz"):
        write(tmp_path / "mesh.xyz", mesh)
    with pytest.raises(ValueError, match=r"file_format must be one of .*jigsaw.*got 'vtp'"):
        write(tmp_path / "mesh.vtu", mesh, file_format="vtp")


@pytest.mark.parametrize("suffix", [".mesh", ".stl", ".obj", ".off"])
def test_fields_asked_for_are_not_lost_without_a_word(tmp_path, suffix):
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES)
    with pytest.raises(ValueError, match="cannot hold nodal fields, got h"):
        write(tmp_path / f"mesh{suffix}", SizeFunction(mesh, np.ones(4)))
    with pytest.raises(ValueError, match="cannot hold nodal fields, got a, b"):
        write(tmp_path / f"mesh{suffix}", mesh, fields={"a": np.ones(4), "b": np.ones(4)})


def test_wrong_fields_and_objects_are_refused(tmp_path):
    file = tmp_path / "mesh.vtu"
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES)
    with pytest.raises(ValueError, match="4 rows"):
        write(file, mesh, fields={"h": np.ones(3)})
    with pytest.raises(ValueError, match="'h' must hold numbers"):
        write(file, mesh, fields={"h": ["a", "b", "c", "d"]})
    with pytest.raises(ValueError, match="obj must be a SimplexMesh"):
        write(file, np.ones(4))
    with pytest.raises(ValueError, match="must hold triangles or tetrahedra"):
        write(tmp_path / "line.stl", SimplexMesh(SQUARE, [[0, 1]]))
    assert os.listdir(tmp_path) == []


# ---------------------------------------------------------------- sizes for mesh generators


def numbers(text):
    return [float(word) for word in re.findall(r"[-+.\deE]+", text)]


@pytest.mark.parametrize("make", [lambda: random_square(12, 7315), lambda: jittered_cube(2, 7316)])
def test_a_gmsh_view_has_coordinates_and_sizes_of_every_cell(tmp_path, make):
    mesh = make()
    h = np.random.default_rng(7317).uniform(0.1, 1, mesh.n_points)
    write(tmp_path / "size.pos", SizeFunction(mesh, h))
    head, *rows, tail = (tmp_path / "size.pos").read_text().splitlines()
    assert (head, tail) == ('View "h" {', "};")
    assert len(rows) == mesh.n_cells
    n_nodes = mesh.dim + 1
    for row, cell in zip(rows, mesh.cells, strict=True):
        name, coordinates, values = re.fullmatch(r"(S[ST])\((.*)\)\{(.*)\};", row).groups()
        assert name == {2: "ST", 3: "SS"}[mesh.dim]
        given = np.reshape(numbers(coordinates), (n_nodes, 3))
        assert_array_equal(given[:, : mesh.dim], mesh.points[cell])
        assert_array_equal(given[:, mesh.dim :], 0)
        assert_array_equal(numbers(values), h[cell])


@pytest.mark.parametrize("dim", [2, 3])
def test_a_medit_solution_has_one_scalar_per_node(tmp_path, dim):
    mesh = tagged_mesh(dim)
    write(tmp_path / "size.sol", mesh)
    words = (tmp_path / "size.sol").read_text().split()
    head = ["MeshVersionFormatted", "2", "Dimension", str(dim), "SolAtVertices"]
    assert words[:8] == [*head, str(mesh.n_points), "1", "1"]
    assert words[-1] == "End"
    assert_array_equal(np.array(words[8:-1], float), mesh.point_data["h"])


@pytest.mark.parametrize("dim", [2, 3])
def test_a_jigsaw_file_has_points_cells_and_values(tmp_path, dim):
    mesh = tagged_mesh(dim)
    write(tmp_path / "size.jig.msh", mesh)
    lines = (tmp_path / "size.jig.msh").read_text().splitlines()
    n, m = mesh.n_points, mesh.n_cells
    assert lines[:3] == ["MSHID=3;euclidean-mesh", f"NDIMS={dim}", f"POINT={n}"]
    points = np.array([line.split(";") for line in lines[3 : 3 + n]], float)
    assert_array_equal(points, np.pad(mesh.points, ((0, 0), (0, 1))))
    assert lines[3 + n] == f"TRIA{dim + 1}={m}"
    cells = np.array([line.split(";") for line in lines[4 + n : 4 + n + m]], int)
    assert_array_equal(cells, np.column_stack([mesh.cells, mesh.cell_tags]))
    assert lines[4 + n + m] == f"VALUE={n};1"
    assert_array_equal(np.array(lines[5 + n + m :], float), mesh.point_data["h"])
    write(tmp_path / "size.msh", mesh, file_format="jigsaw")
    assert (tmp_path / "size.msh").read_text().splitlines() == lines


@pytest.mark.parametrize("name", ["size.pos", "size.sol", "size.jig.msh"])
def test_sizes_that_generators_do_not_know_are_refused(tmp_path, name):
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES)
    with pytest.raises(ValueError, match=r"h must be finite .*clip.*h\[2\] = inf"):
        write(tmp_path / name, SizeFunction(mesh, [1, 1, np.inf, 1]))
    with pytest.raises(ValueError, match=r"must be positive .*h\[1\] = 0"):
        write(tmp_path / name, mesh, fields={"h": [1, 0, 1, 1]})
    with pytest.raises(ValueError, match="nodal sizes as the field 'h'"):
        write(tmp_path / name, mesh)
    with pytest.raises(ValueError, match="sizes only, as the field 'h', got size"):
        write(tmp_path / name, mesh, fields={"h": [1, 1, 1, 1], "size": [1, 1, 1, 1]})
    assert os.listdir(tmp_path) == []


def test_jigsaw_does_not_take_surfaces_in_space(tmp_path):
    mesh = random_sphere(10, 7318)
    with pytest.raises(ValueError, match="triangles in the plane or tetrahedra for JIGSAW"):
        write(tmp_path / "size.jig.msh", SizeFunction(mesh, np.ones(10)))


def test_gmsh_meshes_with_the_view_as_asked(tmp_path):
    gmsh = pytest.importorskip("gmsh")
    corners = SimplexMesh([[-1, -1], [1, -1], [1, 1], [-1, 1]], TWO_TRIANGLES)
    h = 0.2 + 0.1 * corners.points[:, 0]
    write(tmp_path / "size.pos", SizeFunction(corners, h))
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.addRectangle(-1, -1, 0, 2, 2)
        gmsh.model.occ.synchronize()
        gmsh.merge(str(tmp_path / "size.pos"))
        field = gmsh.model.mesh.field.add("PostView")
        gmsh.model.mesh.field.setNumber(field, "ViewTag", gmsh.view.getTags()[0])
        gmsh.model.mesh.field.setAsBackgroundMesh(field)
        for source in ("FromPoints", "FromCurvature", "ExtendFromBoundary"):
            gmsh.option.setNumber(f"Mesh.MeshSize{source}", 0)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(tmp_path / "square.msh"))
    finally:
        gmsh.finalize()
    mesh = read(tmp_path / "square.msh")
    middle = mesh.points[mesh.edges].mean(axis=1)
    ratio = mesh.edge_lengths / (0.2 + 0.1 * middle[:, 0])
    # Gmsh's own slack: edges of about 0.95 of what is asked, hardly any off by sqrt 2.
    assert 0.8 < np.median(ratio) < 1.2
    assert np.mean((ratio > 1 / np.sqrt(2)) & (ratio < np.sqrt(2))) > 0.9


@pytest.mark.parametrize("name", ["h.vtu", "h.vtk", "h.xdmf"])
@pytest.mark.parametrize("hmax", [0.7, np.inf])
def test_the_growth_off_a_surface_is_kept_in_files(tmp_path, name, hmax):
    surface = random_sphere(60, 4111)
    size = SizeFunction(surface, 0.1 + 0.01 * surface.points[:, 0], g=0.4, hmax=hmax)
    write(tmp_path / name, size)
    again = read_size(tmp_path / name)
    assert (again.g, again.hmax) == (0.4, hmax)
    points = np.random.default_rng(4112).uniform(-1.0, 1.0, (30, 3))
    np.testing.assert_allclose(again(points), size(points), rtol=1e-12)
    write(tmp_path / "h.pos", size)  # holds sizes only
    assert "h.g" not in (tmp_path / "h.pos").read_text()
