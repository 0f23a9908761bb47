"""Tags under the names that programs use, by a name that is given, and fields that may be tags."""

import meshio
import numpy as np
import pytest
from command_line import call
from meshes import jittered_cube, random_square
from numpy.testing import assert_array_equal

from adaptsize import SimplexMesh, read
from adaptsize.errors import InputWarning, OptionError

NAMES = {
    "VMTK, Gmsh": "CellEntityIds",
    "SimVascular": "ModelRegionID",
    "Elmer": "GeometryIds",
    "MOOSE": "ObjectId",
    "Exodus": "ElementBlockIds",
    "VTK": "RegionId",
    "ITK-SNAP": "Label",
    "ParaView": "Material IDs",
    "others": "material_id",
    "own": "cell_tags",
}


def with_field(path, name, seed=5221, dtype=np.int32, of_facets=None):
    """A file of tetrahedra and their boundary with a cell field, and the mesh and its tags."""
    mesh, rng = jittered_cube(3, seed), np.random.default_rng(seed)
    boundary = mesh.boundary()
    facets = boundary.nodes[boundary.mesh.cells]
    x = mesh.points[mesh.cells].mean(axis=1)[:, 0]
    tags, facet_tags = np.where(x < 0.0, 3, 7), rng.integers(1, 4, len(facets))
    fields = {name: [tags.astype(dtype), facet_tags.astype(dtype)]}
    if of_facets:
        zeros = [np.zeros(len(part), dtype) for part in (tags, facet_tags)]
        fields = {name: [fields[name][0], zeros[1]], of_facets: [zeros[0], fields[name][1]]}
    cells = [("tetra", mesh.cells), ("triangle", facets)]
    meshio.write(path, meshio.Mesh(mesh.points, cells, cell_data=fields))
    return mesh, tags, facets, facet_tags


@pytest.mark.parametrize("program", NAMES)
@pytest.mark.parametrize(("suffix", "dtype"), [(".vtu", np.int32), (".vtk", np.int64)])
def test_names_of_other_programs_are_known(tmp_path, program, suffix, dtype):
    name = NAMES[program] if suffix == ".vtu" else NAMES[program].replace(" ", "_")
    _, tags, facets, facet_tags = with_field(tmp_path / f"a{suffix}", name, dtype=dtype)
    found = read(tmp_path / f"a{suffix}")
    assert_array_equal(found.cell_tags, tags)
    assert_array_equal(found.tagged_facets, facets)
    assert_array_equal(found.facet_tags, facet_tags)
    assert not found.cell_data


def test_cells_and_facets_may_have_fields_of_their_own(tmp_path):
    mesh, tags, _, facet_tags = with_field(
        tmp_path / "a.vtu", "ModelRegionID", of_facets="ModelFaceID"
    )
    found = read(tmp_path / "a.vtu")
    assert_array_equal(found.cell_tags, tags)
    assert_array_equal(found.facet_tags, facet_tags)
    assert found.n_cells == mesh.n_cells


@pytest.mark.parametrize("name", ["organ", "my.zone"])
def test_other_fields_are_named_in_a_warning_and_can_be_chosen(tmp_path, name):
    _, tags, _, facet_tags = with_field(tmp_path / "a.vtu", name)
    with pytest.warns(InputWarning, match=f"the integer fields '{name}' may be some"):
        found = read(tmp_path / "a.vtu")
    assert found.cell_tags is None
    assert_array_equal(found.cell_data[name], tags)
    chosen = read(tmp_path / "a.vtu", tags=name)
    assert_array_equal(chosen.cell_tags, tags)
    assert_array_equal(chosen.facet_tags, facet_tags)
    with pytest.raises(OptionError, match=rf"no cell field 'none' .*integer cell fields: {name}"):
        read(tmp_path / "a.vtu", tags="none")


@pytest.mark.parametrize("kind", ["numbers", "cycle", "constant", "rank", "floats"])
def test_fields_that_are_no_tags_draw_no_warning(tmp_path, kind):
    mesh = random_square(40, 5222)
    values = {
        "numbers": np.arange(mesh.n_cells),
        "cycle": np.arange(mesh.n_cells) % 3,
        "constant": np.full(mesh.n_cells, 3),
        "rank": np.where(mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.0, 1, 0),
        "floats": np.arange(mesh.n_cells) % 3 + 0.5,
    }[kind]
    points = np.pad(mesh.points, ((0, 0), (0, 1)))
    fields = {kind: [values]}
    meshio.write(
        tmp_path / "a.vtu", meshio.Mesh(points, [("triangle", mesh.cells)], cell_data=fields)
    )
    assert read(tmp_path / "a.vtu").cell_tags is None  # warnings are errors


@pytest.mark.parametrize("command", ["info", "remesh"])
def test_the_command_takes_the_name_of_tags(tmp_path, capsys, command):
    if command == "remesh":
        pytest.importorskip("mmgpy")
    mesh = random_square(40, 5223)
    right = (mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.0).astype(int)
    points = np.pad(mesh.points, ((0, 0), (0, 1)))
    fields = {"soil": [1 + right]}
    meshio.write(
        tmp_path / "a.vtu", meshio.Mesh(points, [("triangle", mesh.cells)], cell_data=fields)
    )
    words = {"info": [], "remesh": ["--hmax", "0.5", "-o", tmp_path / "b.vtu"]}[command]
    assert call(command, tmp_path / "a.vtu", "--tags", "soil", *words) == 0
    printed = capsys.readouterr()
    assert "may be some" not in printed.err
    if command == "remesh":
        assert set(read(tmp_path / "b.vtu").cell_tags) == {1, 2}
    assert call(command, tmp_path / "a.vtu", "--tags", "sand", *words) == 2
    assert "has no cell field 'sand' for tags" in capsys.readouterr().err


def test_a_mesh_keeps_the_fields_that_are_not_chosen(tmp_path):
    mesh = random_square(40, 5224)
    points = np.pad(mesh.points, ((0, 0), (0, 1)))
    one, other = (np.random.default_rng(k).integers(1, 3, mesh.n_cells) for k in (5225, 5226))
    fields = {"region": [one], "organ": [other]}
    meshio.write(
        tmp_path / "a.vtu", meshio.Mesh(points, [("triangle", mesh.cells)], cell_data=fields)
    )
    found = read(tmp_path / "a.vtu", tags="organ")
    assert_array_equal(found.cell_tags, other)
    assert_array_equal(found.cell_data["region"], one)
    assert isinstance(found, SimplexMesh)
