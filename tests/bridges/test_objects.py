"""Meshes of other programs are taken as they are, and made from ours with their names."""

from dataclasses import replace

import numpy as np
import pytest
from mesh_files import SQUARE, TWO_TRIANGLES, tagged_mesh
from numpy.testing import assert_array_equal

import adaptsize as ads
from adaptsize import SimplexMesh
from adaptsize.errors import InputWarning
from adaptsize.quality.summary import summarize


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


def test_every_function_for_meshes_takes_them(tmp_path):
    square, h = square_of_skfem(), np.full(25, 0.3)
    size = ads.SizeFunction(square, h)
    calls = [
        lambda: ads.check_mesh(square, size=size),
        lambda: ads.size_conformity(square, size),
        lambda: ads.size_from_hessian(square, square.p[0] ** 2, tolerance=0.1),
        lambda: ads.size_from_error(square, np.ones(32), order=1, tolerance=1.0),
        lambda: ads.zz_indicator(square, h),
        lambda: ads.size_from_sources(square, [ads.PointSource([0, 0], 0.1)]),
        lambda: ads.metric_from_hessian(square, square.p[0] ** 2, tolerance=0.1),
        lambda: ads.MetricFunction(square, ads.Metric.isotropic(h, 2)),
        lambda: ads.transfer_fields(square, square, fields={"u": h}),
        lambda: ads.signed_distance(square, lambda x: x[:, 0] - 0.5),
        lambda: ads.SizeFunction(square, h).on(square),
        lambda: ads.plot.plot_size(square, h, width=100),
    ]
    for call in calls:
        assert call() is not None


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


def named(mesh, cells, tags):
    """The corners of cells with the names of their tags, in an order that is that of places."""
    names = [mesh.tag_names.get((cells.shape[1] - 1, tag), str(tag)) for tag in tags.tolist()]
    corners = [tuple(sorted(map(tuple, mesh.points[cell].tolist()))) for cell in cells]
    return sorted(zip(corners, names, strict=True))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("program", ["skfem", "mfem", "netgen", "gmsh"])
def test_a_mesh_comes_back_from_a_program_with_all_names(program, dim):
    pytest.importorskip(program)
    names = {(dim, 1): "core & shell", (dim, 2): "same", (dim - 1, 4): "same"}
    mesh = replace(tagged_mesh(dim), tag_names=names)
    back = SimplexMesh.from_object(getattr(mesh, f"to_{program}")())
    assert_array_equal(back.points, mesh.points)
    assert_array_equal(np.sort(back.cells), np.sort(mesh.cells))
    untagged = back.cell_tags == 0
    assert_array_equal(untagged, mesh.cell_tags == 0)
    assert named(back, back.cells, back.cell_tags) == named(mesh, mesh.cells, mesh.cell_tags)
    given = named(mesh, mesh.tagged_facets, mesh.facet_tags)
    assert named(back, back.tagged_facets, back.facet_tags) == given


def test_tags_of_one_name_are_one_subdomain():
    pytest.importorskip("skfem")
    mesh = replace(tagged_mesh(2), tag_names={(2, 1): "core", (2, 2): "core", (1, 4): "5"})
    made = mesh.to_skfem()
    assert_array_equal(made.subdomains["core"], np.flatnonzero(np.isin(mesh.cell_tags, [1, 2])))
    assert len(made.boundaries["5"]) == np.count_nonzero(mesh.facet_tags == 4)
    assert len(made.boundaries["5_5"]) == np.count_nonzero(mesh.facet_tags == 5)


def test_parts_of_a_scene_are_tags_with_their_names(tmp_path):
    import trimesh

    scene = trimesh.Scene(
        {"box": trimesh.creation.box(), "line": trimesh.load_path([[0, 0], [1, 0]])}
    )
    move = trimesh.transformations.translation_matrix([3, 0, 0])
    scene.add_geometry(trimesh.creation.icosphere(1), transform=move, node_name="the ball")
    (tmp_path / "a.glb").write_bytes(scene.export(file_type="glb"))
    for mesh in (SimplexMesh.from_object(scene), ads.read(tmp_path / "a.glb")):
        numbers = {name: tag for (_, tag), name in mesh.tag_names.items()}
        assert set(numbers) == {"box", "the ball"}
        ball = mesh.points[mesh.cells[mesh.cell_tags == numbers["the ball"]]]
        assert (ball.reshape(-1, 3).mean(axis=0)[0], len(ball)) == (pytest.approx(3.0), 80)


def test_quadrilaterals_of_netgen_are_split():
    square = pytest.importorskip("netgen.geom2d").unit_square
    made = square.GenerateMesh(maxh=0.3, quad_dominated=True)
    with pytest.warns(InputWarning, match="quadrilaterals split"):
        mesh = SimplexMesh.from_object(made)
    assert mesh.measures.sum() == pytest.approx(1.0)
    assert set(mesh.tag_names.values()) == {"bottom", "right", "top", "left"}


def test_hanging_nodes_of_mfem_are_reported():
    mfem = pytest.importorskip("mfem.ser")
    made = mfem.Mesh.MakeCartesian2D(3, 2, mfem.Element.QUADRILATERAL, True, 2.0, 1.0)
    made.EnsureNCMesh()
    made.GeneralRefinement(mfem.intArray([0]))
    with pytest.warns(InputWarning, match="hanging nodes"):
        assert SimplexMesh.from_object(made).measures.sum() == pytest.approx(2.0)


def test_ngsolve_integrates_over_a_named_boundary():
    ngsolve = pytest.importorskip("ngsolve")
    square = SimplexMesh(SQUARE, TWO_TRIANGLES, tagged_facets=[[0, 1]], facet_tags=[3])
    made = ngsolve.Mesh(replace(square, tag_names={(1, 3): "bottom"}).to_netgen())
    assert made.GetBoundaries() == ("bottom",)
    bottom = made.Boundaries("bottom")
    assert ngsolve.Integrate(1 + ngsolve.y, bottom) == pytest.approx(1.0)
    whole = ngsolve.Mesh(SimplexMesh(SQUARE, TWO_TRIANGLES).to_netgen())
    assert ngsolve.Integrate(1, whole, ngsolve.BND) == pytest.approx(4.0)


def test_the_current_model_of_gmsh_is_a_mesh():
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("box")
        gmsh.model.occ.addBox(0, 0, 0, 1, 0.5, 0.25)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [1], 7, "body")
        gmsh.model.addPhysicalGroup(2, [1, 2], 9, "ends")
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        with pytest.warns(InputWarning, match="reduced to their corners"):
            mesh = SimplexMesh.from_object(gmsh.model)
        gmsh.model.mesh.setOrder(1)
        assert summarize(gmsh.model).measure == pytest.approx(0.125)
    finally:
        gmsh.finalize()
    assert mesh.tag_names == {(3, 7): "body", (2, 9): "ends"}
    assert set(mesh.points[mesh.tagged_facets][..., 0].ravel()) == {0.0, 1.0}
    assert len(np.unique(mesh.cells)) == mesh.n_points


def test_further_groups_of_cells_and_what_has_no_place_are_reported():
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("box")
        gmsh.model.occ.addBox(0, 0, 0, 1, 0.5, 0.25)
        gmsh.model.occ.synchronize()
        for dim, tag, name in ((3, 7, "body"), (3, 8, "steel"), (1, 4, "edge"), (0, 5, "corner")):
            gmsh.model.addPhysicalGroup(dim, [1], tag, name)
        gmsh.model.mesh.generate(3)
        with pytest.warns(InputWarning) as warned:
            mesh = SimplexMesh.from_object(gmsh.model)
    finally:
        gmsh.finalize()
    text = str(warned[0].message)
    assert f"several physical groups keep the first; left out are steel ({mesh.n_cells})" in text
    assert "tagged nodes dropped (corner)" in text
    assert "tagged segments dropped (edge)" in text
    assert set(mesh.cell_tags) == {7}


def test_cells_in_several_subdomains_keep_the_first():
    square = square_of_skfem().with_subdomains({"low": lambda x: x[1] < 0.5})
    with pytest.warns(InputWarning, match=r"keep the first; left out are low \(8\)"):
        mesh = SimplexMesh.from_object(square)
    names = [mesh.tag_names.get((2, tag)) for tag in mesh.cell_tags.tolist()]
    x = mesh.points[mesh.cells].mean(axis=1)
    expected = np.where(x[:, 0] < 0.5, "core", np.where(x[:, 1] < 0.5, "low", None))
    assert names == expected.tolist()


def test_programs_with_positive_tags_refuse_others():
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES, cell_tags=[1, -2])
    for program in ("mfem", "netgen", "gmsh"):
        pytest.importorskip(program)
        with pytest.raises(ValueError, match="cell_tags and facet_tags must be positive"):
            getattr(mesh, f"to_{program}")()


def test_other_objects_are_refused():
    with pytest.raises(ValueError, match=r"mesh must be of meshio, PyVista, .*got 3"):
        SimplexMesh.from_object(3)
    skfem = pytest.importorskip("skfem")
    with pytest.raises(ValueError, match="to_meshtri"):
        SimplexMesh.from_object(skfem.MeshQuad())
    with pytest.raises(ValueError, match="must fill its space"):
        SimplexMesh(np.eye(3), [[0, 1, 2]]).to_skfem()


@pytest.mark.parametrize("make", OBJECTS)
def test_a_new_mesh_is_returned_in_the_kind_of_the_given_one(make):
    given = make()
    mesh = SimplexMesh.from_object(given)
    back = mesh.like(given)
    assert type(back).__module__ == type(given).__module__ or make is sphere_of_pyvista
    again = SimplexMesh.from_object(back)
    assert again.measures.sum() == pytest.approx(OBJECTS[make], rel=1e-3)
    assert mesh.tag_names.items() <= again.tag_names.items()
    assert mesh.like(again) is mesh
    with pytest.raises(ValueError, match=r"other must be of meshio, .*got 3"):
        mesh.like(3)


def test_one_body_of_trimesh_has_no_tags():
    import trimesh

    box = trimesh.creation.box()
    for held in (box, trimesh.Scene({"box": box})):
        mesh = SimplexMesh.from_object(held)
        assert mesh.cell_tags is None
        assert not mesh.tag_names
