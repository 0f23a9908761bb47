"""From the file of one program to that of another, in a few lines each."""

import json
from dataclasses import replace

import numpy as np
import pytest

import adaptsize as ads


def test_a_coast_of_geojson_gets_the_mesh_of_a_tidal_model(tmp_path):
    pytest.importorskip("mmgpy")
    shore, sea = [[0, 0], [20, 4], [40, 0]], [[40, 0], [40, 30], [0, 30], [0, 0]]
    island = [[15, 15], [20, 15], [20, 20], [15, 15]]
    kinds = {"land": ("LineString", shore), "open sea": ("LineString", sea)}
    kinds["island"] = ("Polygon", [island])
    features = [
        {"type": "Feature", "properties": {"name": name},
         "geometry": {"type": kind, "coordinates": points}}
        for name, (kind, points) in kinds.items()
    ]  # fmt: skip
    coast = {"type": "FeatureCollection", "crs": "EPSG:32632", "features": features}
    (tmp_path / "coast.geojson").write_text(json.dumps(coast))

    domain = ads.read(tmp_path / "coast.geojson")
    made = ads.remesh(domain, ads.size_function(domain, hmin=2, hmax=6))
    depth = np.full(made.n_points, 5.0)
    ads.write(tmp_path / "fort.14", made.with_data(point_data={"depth": depth}))

    back = ads.read(tmp_path / "fort.14")
    assert set(back.tag_names.values()) == {"land", "open sea", "island"}
    assert back.measures.sum() == pytest.approx(40 * 30 - 80 - 12.5, rel=1e-6)


def test_a_part_of_trimesh_gets_a_named_mesh_of_a_solver():
    trimesh, skfem = pytest.importorskip("trimesh"), pytest.importorskip("skfem")
    surface = ads.SimplexMesh.from_object(trimesh.creation.box((2, 1, 1)))
    left = np.isclose(surface.points[surface.cells, 0], -1.0).all(axis=1)
    tags = {(2, 1): "clamped", (2, 2): "free"}
    surface = replace(surface, cell_tags=np.where(left, 1, 2), tag_names=tags)

    solid = ads.remesh(surface, 0.5).to_skfem()  # to_dolfinx: tests/with_dolfinx

    area = skfem.FacetBasis(solid, skfem.ElementTetP1(), facets="clamped").dx.sum()
    assert area == pytest.approx(1.0)
    assert set(solid.boundaries) == {"clamped", "free"}


def test_a_label_image_gets_a_file_of_abaqus(tmp_path):
    pytest.importorskip("mmgpy")
    labels = np.zeros((24, 24, 24), np.uint8)
    labels[4:20, 4:20, 4:20] = 1
    labels[12:20, 4:20, 4:20] = 2
    np.save(tmp_path / "labels.npy", labels)

    mesh = ads.mesh_image(ads.read_image(tmp_path / "labels.npy"), hmin=3, hmax=5)
    ads.write(tmp_path / "labels.inp", mesh)

    back = ads.read(tmp_path / "labels.inp")
    regions, faces = ({name for (d, _), name in back.tag_names.items() if d == k} for k in (3, 2))
    assert regions == {"region1", "region2"}
    assert faces == {"boundary_of_1", "boundary_of_2", "interface_of_1_and_2"}
    assert np.bincount(back.cell_tags, back.measures)[1:] == pytest.approx([2048, 2048], rel=0.1)
