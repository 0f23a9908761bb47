"""Three ways from the data of one program to another, each in at most 20 lines."""

import inspect
import json

import meshio
import numpy as np
import pytest
import trimesh

import adaptsize as ads


def coast_to_fort14(folder):
    """From the lines of a coast in GeoJSON to a mesh for ADCIRC, with open and land boundaries."""
    sea = ads.polygons(folder / "coast.geojson", tolerance=4e-3)
    size = ads.size_function(sea, hmin=500.0, hmax=4000.0, g=0.2)
    mesh = ads.remesh(sea, size)
    away = ads.SignedDistance(sea.boundary().mesh)(mesh.points)
    ads.write(folder / "fort.14", mesh.with_data(point_data={"depth": 5.0 - 0.01 * away}))


def part_to_dolfinx(folder):
    """From a surface of trimesh to tetrahedra with named boundaries, for dolfinx.io.gmsh."""
    part = trimesh.creation.cylinder(radius=1.0, height=4.0, sections=32)
    ends = np.round(part.face_normals[:, 2]).astype(int)  # 1 at the top, -1 at the bottom
    surface = ads.SimplexMesh(
        part.vertices,
        part.faces,
        cell_tags=ends + 2,
        tag_names={(2, 1): "inlet", (2, 2): "wall", (2, 3): "outlet"},
    )
    mesh = ads.remesh(surface, ads.size_function(surface, hmin=0.5))
    ads.write(folder / "part.msh", mesh)


def labels_to_abaqus(folder):
    """From an image of labels to a file for Abaqus with element and node sets."""
    image = np.load(folder / "labels.npy")
    mesh = ads.mesh_image(image, spacing=0.1, hmin=0.3)
    names = {1: "matrix", 2: "fibre"}
    regions = {name: [np.flatnonzero(mesh.cell_tags == tag)] for tag, name in names.items()}
    edge = {"edge": np.unique(mesh.boundary().nodes)}
    file = meshio.Mesh(
        np.pad(mesh.points, ((0, 0), (0, 1))),
        [("triangle", mesh.cells)],
        cell_sets=regions,
        point_sets=edge,
    )
    file.write(folder / "part.inp")


@pytest.mark.parametrize("story", [coast_to_fort14, part_to_dolfinx, labels_to_abaqus])
def test_a_story_has_at_most_20_lines(story):
    assert len(inspect.getsource(story).splitlines()) <= 20


def test_a_coast_gets_open_and_land_boundaries_in_fort_14(tmp_path):
    pytest.importorskip("mmgpy")
    x = np.linspace(0.0, 40e3, 400)
    shore = np.column_stack([x, 2e3 * np.sin(x / 2e3) + 500.0 * np.sin(x / 300.0)])
    angle = np.linspace(0.0, 2.0 * np.pi, 100)
    island = (20e3, -10e3) + 2e3 * np.column_stack([np.cos(angle), np.sin(angle)])
    island[-1] = island[0]
    sea = [shore[-1], (40e3, -20e3), (0.0, -20e3), shore[0]]
    lines = {"land": shore, "open sea": sea, "island": island}
    features = [
        {
            "type": "Feature",
            "properties": {"name": name},
            "geometry": {"type": "LineString", "coordinates": np.array(line).tolist()},
        }
        for name, line in lines.items()
    ]
    collection = {"type": "FeatureCollection", "features": features}
    (tmp_path / "coast.geojson").write_text(json.dumps(collection))
    coast_to_fort14(tmp_path)
    mesh = ads.read(tmp_path / "fort.14")
    assert sorted(mesh.tag_names.values()) == ["island", "land", "open sea"]
    assert mesh.minimum_angles().min() > 10.0
    length = {}
    for (_, tag), name in mesh.tag_names.items():
        ends = mesh.points[mesh.tagged_facets[mesh.facet_tags == tag]]
        length[name] = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum()
    assert length["open sea"] == pytest.approx(80e3 + shore[-1, 1], rel=1e-9)
    # Chords that are at most d = 190 m from a circle of radius R are shorter by d / 3 R.
    assert length["island"] == pytest.approx(2.0 * np.pi * 2e3, rel=0.033)
    assert len(mesh.tagged_facets) == len(mesh.boundary().mesh.cells)


def test_a_part_keeps_the_names_of_its_ends(tmp_path):
    pytest.importorskip("mmgpy")
    part_to_dolfinx(tmp_path)
    found = meshio.read(tmp_path / "part.msh")
    numbers = {name: number for name, (number, dim) in found.field_data.items() if dim == 2}
    assert sorted(numbers) == ["inlet", "outlet", "wall"]
    mesh = ads.read(tmp_path / "part.msh")
    assert mesh.cell_dim == 3
    for name, height in (("inlet", -2.0), ("outlet", 2.0)):
        nodes = mesh.tagged_facets[mesh.facet_tags == numbers[name]]
        np.testing.assert_allclose(mesh.points[nodes][:, :, 2], height, atol=1e-9)
        u, v = (mesh.points[nodes[:, k]] - mesh.points[nodes[:, 0]] for k in (1, 2))
        area = 0.5 * np.linalg.norm(np.cross(u, v), axis=1).sum()
        assert area == pytest.approx(16.0 * np.sin(np.pi / 16.0), rel=0.01)


def test_regions_of_an_image_become_sets_of_abaqus(tmp_path):
    pytest.importorskip("mmgpy")
    x, y = np.meshgrid(*[np.arange(60)] * 2, indexing="ij")
    labels = np.where(np.hypot(x - 29.5, y - 29.5) < 15, 2, 1)
    np.save(tmp_path / "labels.npy", np.pad(labels, 5))
    labels_to_abaqus(tmp_path)
    found = meshio.read(tmp_path / "part.inp")
    mesh = ads.SimplexMesh(found.points[:, :2], found.cells_dict["triangle"])
    areas = {name: mesh.measures[rows[0]].sum() for name, rows in found.cell_sets.items()}
    assert areas["fibre"] == pytest.approx(np.pi * 1.5**2, rel=0.03)
    assert areas["fibre"] + areas["matrix"] == pytest.approx(mesh.measures.sum())
    np.testing.assert_array_equal(np.sort(found.point_sets["edge"]), mesh.boundary().nodes)
