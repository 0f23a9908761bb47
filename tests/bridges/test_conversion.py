"""Meshes to and from the objects of meshio and PyVista."""

import re
from dataclasses import replace

import meshio
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from shapes import block, two_region_block, two_region_rectangle

from adaptsize import SimplexMesh
from adaptsize.errors import InputWarning


def with_everything(mesh):
    rng = np.random.default_rng(57120)
    dim = mesh.cell_dim
    return replace(
        mesh,
        cell_tags=np.where(mesh.cell_tags < 6, 0, mesh.cell_tags),
        tag_names={(dim, 9): "right part", (dim, 7): "left", (dim - 1, 30): "between"},
        point_data={"u": rng.random(mesh.n_points), "v": rng.random((mesh.n_points, 3))},
        cell_data={"rho": rng.random(mesh.n_cells), "rank": np.arange(mesh.n_cells)},
    )


def outline():
    return SimplexMesh([[0.0, 0.5], [1, 0], [1, 1]], [[0, 1], [1, 2], [2, 0]], cell_tags=[4, 5, 6])


MESHES = {
    "tetrahedra": lambda: with_everything(two_region_block(2)),
    "plane triangles": lambda: with_everything(two_region_rectangle(2)),
    "surface": lambda: replace(block(2).boundary().mesh, cell_tags=np.arange(1, 49)),
    "polyline": outline,
    "no tags": lambda: block(1),
    "facets only": lambda: replace(two_region_block(1), cell_tags=None),
}


def through_meshio(mesh):
    return SimplexMesh.from_object(mesh.to_meshio())


def through_gmsh_names(mesh):
    return SimplexMesh.from_object(mesh.to_meshio(tag_name="gmsh:physical"))


def through_pyvista(mesh):
    pytest.importorskip("pyvista")
    return SimplexMesh.from_object(mesh.to_pyvista())


@pytest.mark.parametrize("way", [through_meshio, through_gmsh_names, through_pyvista])
@pytest.mark.parametrize("name", MESHES)
def test_a_mesh_comes_back_whole(name, way):
    mesh = MESHES[name]()
    back = way(mesh)
    for array in ("points", "cells", "cell_tags", "tagged_facets", "facet_tags"):
        assert_array_equal(getattr(back, array), getattr(mesh, array), err_msg=array)
    assert back.tag_names == {k: v for k, v in mesh.tag_names.items() if k[0] < 3 or mesh.dim == 3}
    for given, came in ((mesh.point_data, back.point_data), (mesh.cell_data, back.cell_data)):
        assert set(given) <= set(came)
        for field in given:
            assert_array_equal(came[field], given[field])


def test_two_tags_of_one_name_are_refused_for_meshio():
    mesh = replace(block(1), tag_names={(3, 1): "air", (2, 1): "air"})
    with pytest.raises(
        ValueError, match=r"tag_names must be distinct for meshio.* got 'air' twice"
    ):
        mesh.to_meshio()


def test_a_mesh_without_cells_or_of_another_kind_is_refused():
    points = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
    with pytest.raises(ValueError, match=r"^mesh holds points but no cells$"):
        SimplexMesh.from_object(meshio.Mesh(points, []))
    with pytest.raises(ValueError, match=re.escape("mesh holds no tetrahedra (found 1 triangles)")):
        SimplexMesh.from_object(meshio.Mesh(points, [("triangle", [[0, 1, 2]])]), kind="tetrahedra")


def test_data_sets_of_pyvista_of_all_kinds():
    pyvista = pytest.importorskip("pyvista")
    sphere = SimplexMesh.from_object(pyvista.Sphere())
    assert (sphere.dim, sphere.cell_dim, sphere.is_closed) == (3, 2, True)
    with pytest.warns(InputWarning, match="8 hexahedra split into 48 tetrahedra"):
        box = SimplexMesh.from_object(pyvista.ImageData(dimensions=(3, 3, 3)))
    assert (box.signed_measures > 0.0).all()
    assert box.measures.sum() == pytest.approx(8.0)
    line = SimplexMesh.from_object(pyvista.MultipleLines([[0, 0, 1], [1, 0, 1], [1, 1, 1]]))
    assert line.cells.tolist() == [[0, 1], [1, 2]]
    with pytest.warns(InputWarning, match="1 polygons split into 4 triangles"):
        hexagon = SimplexMesh.from_object(pyvista.Polygon(n_sides=6))
    # A regular hexagon of radius 1.
    assert hexagon.measures.sum() == pytest.approx(3.0**1.5 / 2.0, rel=1e-6)
    strip = SimplexMesh.from_object(pyvista.Sphere().strip())
    assert (strip.n_cells, strip.is_closed) == (sphere.n_cells, True)
    assert strip.measures.sum() == pytest.approx(sphere.measures.sum())
    blocks = pyvista.MultiBlock({"left": pyvista.Cube(), "right": pyvista.Sphere(center=(3, 0, 0))})
    with pytest.warns(InputWarning, match="quadrilaterals"):
        both = SimplexMesh.from_object(blocks)
    assert both.tag_names == {(2, 1): "left", (2, 2): "right"}
    assert np.bincount(both.cell_tags).tolist() == [0, 12, sphere.n_cells]
