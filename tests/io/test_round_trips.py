"""Meshes and fields come back from files as they were written."""

from dataclasses import replace

import meshio
import numpy as np
import pytest
from mesh_files import SQUARE, tagged_mesh
from meshes import jittered_cube, random_sphere, random_square, slit_square
from numpy.testing import assert_array_equal

from adaptsize import SimplexMesh, SizeFunction, read, read_size, write
from adaptsize.errors import InputWarning

MESH_FORMATS = [".vtu", ".vtk", ".xdmf", ".msh", ".mesh", ".meshb"]
FIELD_FORMATS = [".vtu", ".vtk", ".xdmf", ".msh"]
CELL_FIELD_FORMATS = FIELD_FORMATS[:3]
SURFACE_FORMATS = [".ply", ".obj", ".off"]


def there_and_back(file, mesh, **options):
    write(file, mesh, **options)
    return read(file)


LINE = SimplexMesh(SQUARE, [[0, 1], [1, 2], [2, 3]], cell_tags=[1, 2, 2])


@pytest.mark.parametrize("mesh", [tagged_mesh(2), tagged_mesh(3), LINE])
@pytest.mark.parametrize("suffix", MESH_FORMATS)
def test_points_cells_tags_and_fields_come_back_to_the_last_bit(tmp_path, suffix, mesh):
    back = there_and_back(tmp_path / f"mesh{suffix}", mesh)
    for array in ("points", "cells", "cell_tags", "tagged_facets", "facet_tags"):
        assert_array_equal(getattr(back, array), getattr(mesh, array), err_msg=array)
    if suffix in FIELD_FORMATS:
        assert set(back.point_data) == set(mesh.point_data)
        for name, values in mesh.point_data.items():
            assert_array_equal(back.point_data[name], values)
            assert back.point_data[name].dtype.isnative
    if suffix in CELL_FIELD_FORMATS:
        assert set(back.cell_data) == set(mesh.cell_data)
        for name, values in mesh.cell_data.items():
            assert_array_equal(back.cell_data[name], values)


@pytest.mark.parametrize(
    "suffix", [".vtkhdf", ".vtu", ".vtk", ".msh", ".xdmf", ".mesh", ".su2", ".inp"]
)
@pytest.mark.parametrize("n", [4, 7])
def test_both_sides_of_a_slit_stay_apart_in_all_formats(tmp_path, suffix, n):
    mesh = slit_square(n)
    back = there_and_back(tmp_path / f"a{suffix}", mesh)
    assert back.n_points == mesh.n_points
    assert back.boundary().mesh.n_cells == mesh.boundary().mesh.n_cells


@pytest.mark.parametrize("suffix", [".vtkhdf", *FIELD_FORMATS])
@pytest.mark.parametrize("name", ["v v", "\u00e9 2"])
def test_fields_keep_names_with_spaces_and_accents(tmp_path, suffix, name):
    mesh = random_square(20, 7305)
    back = there_and_back(tmp_path / f"a{suffix}", mesh, fields={name: np.arange(20.0)})
    assert_array_equal(back.point_data[name], np.arange(20.0))


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


@pytest.mark.parametrize("mesh", [tagged_mesh(2), tagged_mesh(3)])
def test_solvers_get_cells_regions_and_boundaries(tmp_path, mesh):
    dim = mesh.dim
    mesh = replace(mesh, tag_names={(dim, 2): "soft part", (dim - 1, 5): "wall"})
    for suffix in (".inp", ".bdf", ".su2"):
        back = there_and_back(tmp_path / f"mesh{suffix}", mesh)
        assert np.abs(back.points - mesh.points).max() < 1e-10 * mesh.diagonal
        assert_array_equal(np.sort(back.cells, axis=1), np.sort(mesh.cells, axis=1))
        assert (back.signed_measures > 0.0).all()
        if suffix == ".inp":  # sets are numbered in their order
            assert_array_equal(
                back.cell_tags, np.unique(mesh.cell_tags, return_inverse=True)[1] + 1
            )
            assert "soft_part" in back.tag_names.values()
        if suffix == ".bdf":  # cells without a tag, 0 here, have a property of their own
            assert_array_equal(back.cell_tags, np.where(mesh.cell_tags, mesh.cell_tags, 4))
    assert (tmp_path / "mesh.su2").read_text().count("MARKER_TAG= wall\n") == 1
    sets = meshio.read(tmp_path / "mesh.inp")
    assert_array_equal(sets.cell_sets["soft_part"][0], np.flatnonzero(mesh.cell_tags == 2))
    assert list(sets.point_sets)[:3] == ["boundary4", "wall", "boundary6"]
    wall = np.unique(mesh.tagged_facets[mesh.facet_tags == 5])
    assert_array_equal(sets.point_sets["wall"], wall)


@pytest.mark.parametrize(
    ("one", "other", "written"),
    [
        ("a b", "a_b", ["a_b", "a_b_2"]),
        ("Wall", "wall", ["Wall", "wall_2"]),  # the same name for Abaqus
        ("\u00e9", "\u00fc", ["_", "__2"]),
        ("wall", "wall", ["wall"]),
    ],
)
def test_sets_of_solvers_have_the_cells_of_one_name(tmp_path, one, other, written):
    cells, facets = [[0, 1, 2], [0, 2, 3]], [[0, 1], [1, 2]]
    names = {(2, 1): one, (2, 2): other, (1, 1): one, (1, 2): other}
    mesh = SimplexMesh(
        SQUARE, cells, cell_tags=[1, 2], tagged_facets=facets, facet_tags=[1, 2], tag_names=names
    )
    back = there_and_back(tmp_path / "mesh.inp", mesh)
    for dim in (1, 2):
        assert [name for key, name in back.tag_names.items() if key[0] == dim] == written
    assert len(np.unique(back.cell_tags)) == len(np.unique(back.facet_tags)) == len(written)
    write(tmp_path / "mesh.su2", mesh)
    text = (tmp_path / "mesh.su2").read_text()
    assert text.count("MARKER_TAG=") == len(written)


@pytest.mark.parametrize("suffix", [".stl", *SURFACE_FORMATS])
def test_surfaces_come_back_to_the_last_bit_that_the_format_holds(tmp_path, suffix):
    mesh = random_sphere(50, 7304)
    fields = {"h": np.random.default_rng(7309).random(50)} if suffix == ".ply" else {}
    back = there_and_back(tmp_path / f"mesh{suffix}", mesh, fields=fields)
    if suffix == ".stl":
        assert (back.n_points, back.is_closed) == (50, True)
        assert_array_equal(back.points[back.cells], mesh.points[mesh.cells].astype(np.float32))
        return
    assert_array_equal(back.points, mesh.points)
    assert_array_equal(back.cells, mesh.cells)
    assert fields.keys() == back.point_data.keys()
    assert all(np.array_equal(back.point_data[name], fields[name]) for name in fields)


def test_normals_in_stl_files_are_unit_and_point_outward(tmp_path):
    mesh = random_sphere(50, 7306)
    write(tmp_path / "mesh.stl", mesh)
    record = [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
    records = np.frombuffer((tmp_path / "mesh.stl").read_bytes(), record, offset=84)
    along = (records["normal"] * records["corners"].mean(axis=1)).sum(axis=1)
    assert (along > 0).all()
    # float32 has 24 bits: the sum of three squares is 1 to a few 6e-8.
    np.testing.assert_allclose((records["normal"] ** 2).sum(axis=1), 1.0, atol=1e-6)


@pytest.mark.parametrize("suffix", [".stl", *SURFACE_FORMATS])
def test_tetrahedra_are_written_to_surface_formats_as_their_boundary(tmp_path, suffix):
    mesh = jittered_cube(4, 7307)
    back = there_and_back(tmp_path / f"mesh{suffix}", mesh)
    assert back.cell_dim == 2
    assert back.is_closed
    assert back.n_cells == mesh.boundary().mesh.n_cells


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
    with pytest.warns(InputWarning, match="none inside"):
        write(tmp_path / "h.pos", size)  # holds sizes only
    assert "h.g" not in (tmp_path / "h.pos").read_text()
