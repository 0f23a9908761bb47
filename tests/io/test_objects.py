"""Meshes of other programs are taken as they are, and made from ours with their names."""

import numpy as np
import pytest
from mesh_files import SQUARE, TWO_TRIANGLES, tagged_mesh
from numpy.testing import assert_array_equal

import adaptsize as ads
from adaptsize import SimplexMesh
from adaptsize.quality import summarize


def box_of_trimesh():
    import trimesh

    return trimesh.creation.box((2.0, 1.0, 1.0))


def square_of_meshio():
    import meshio

    return meshio.Mesh(np.array(SQUARE, float), [("triangle", np.array(TWO_TRIANGLES))])


def sphere_of_pyvista():
    return pytest.importorskip("pyvista").Sphere()


def square_of_skfem():
    skfem = pytest.importorskip("skfem")
    square = skfem.MeshTri().refined(2).with_boundaries({"left": lambda x: x[0] == 0.0})
    return square.with_subdomains({"core": lambda x: x[0] < 0.5})


def cube_of_netgen():
    return pytest.importorskip("netgen.csg").unit_cube.GenerateMesh(maxh=0.5)


OBJECTS = {
    box_of_trimesh: 10.0, square_of_meshio: 1.0, square_of_skfem: 1.0, cube_of_netgen: 1.0,
    sphere_of_pyvista: 3.1255,
}  # fmt: skip


@pytest.mark.parametrize("make", OBJECTS)
def test_functions_take_objects_of_other_programs(tmp_path, make):
    made = make()
    assert summarize(made).measure == pytest.approx(OBJECTS[make], rel=1e-3)
    mesh = SimplexMesh.from_object(made)
    assert mesh.measures.sum() == pytest.approx(OBJECTS[make], rel=1e-3)
    h0 = np.where(np.arange(mesh.n_points) == 0, 0.1, 1.0)
    assert_array_equal(ads.limit_gradient(made, h0, 0.3), ads.limit_gradient(mesh, h0, 0.3))
    ads.write(tmp_path / "a.vtu", made, fields={"h": h0})
    back = ads.read(tmp_path / "a.vtu")
    assert_array_equal(back.cells, mesh.cells)
    assert_array_equal(back.point_data["h"], h0)
    assert back.tag_names == mesh.tag_names


def test_tags_of_scikit_fem_and_netgen_have_their_names():
    mesh = SimplexMesh.from_object(square_of_skfem())
    assert mesh.tag_names == {(2, 1): "core", (1, 1): "left"}
    centres = mesh.points[mesh.cells].mean(axis=1)
    assert_array_equal(mesh.cell_tags == 1, centres[:, 0] < 0.5)
    assert (mesh.points[mesh.tagged_facets][..., 0] == 0.0).all()
    assert len(mesh.tagged_facets) == 4
    cube = SimplexMesh.from_object(cube_of_netgen())
    assert len(cube.tagged_facets) == len(cube.boundary().mesh.cells)
    names = {name for (dim, _), name in cube.tag_names.items() if dim == 2}
    assert {"back", "front", "left", "right", "top", "bottom"} == names


@pytest.mark.parametrize("dim", [2, 3])
def test_a_mesh_of_scikit_fem_comes_back_whole(dim):
    pytest.importorskip("skfem")
    mesh = tagged_mesh(dim)
    made = mesh.to_skfem()
    back = SimplexMesh.from_object(made)
    assert_array_equal(back.points, mesh.points)
    assert_array_equal(np.sort(back.cells), np.sort(mesh.cells))
    named = np.array([back.tag_names.get((dim, tag), "0") for tag in back.cell_tags])
    assert_array_equal(named.astype(int), mesh.cell_tags)
    assert set(made.boundaries) == {str(tag) for tag in np.unique(mesh.facet_tags)}
    assert len(back.tagged_facets) == len(mesh.tagged_facets)


def test_a_surface_of_trimesh_comes_back_in_the_same_order():
    mesh = SimplexMesh(np.eye(4, 3), [[0, 1, 2], [0, 1, 3]])
    back = SimplexMesh.from_object(mesh.to_trimesh())
    assert_array_equal(back.points, mesh.points)
    assert_array_equal(back.cells, mesh.cells)


def test_other_objects_are_refused():
    with pytest.raises(ValueError, match=r"mesh must be of meshio, PyVista, .*got 3"):
        SimplexMesh.from_object(3)
    skfem = pytest.importorskip("skfem")
    with pytest.raises(ValueError, match="to_meshtri"):
        SimplexMesh.from_object(skfem.MeshQuad())
    with pytest.raises(ValueError, match="must fill its space"):
        SimplexMesh(np.eye(3), [[0, 1, 2]]).to_skfem()


def test_arrays_of_the_wrong_shape_are_explained():
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES)
    with pytest.raises(ValueError, match=r"h0 must have shape \(4,\), got \(2,\); one per node"):
        ads.limit_gradient(mesh, [0.1, 0.2], 0.3)
    with pytest.raises(ValueError, match="points is transposed"):
        ads.SizeFunction(mesh, np.ones(4))(np.ones((2, 5)))
