"""The files in data/ are what data/README.md says."""

import importlib.util
import runpy
from pathlib import Path

import meshio
import numpy as np
import pytest
import trimesh

DATA = Path(__file__).parents[2] / "data"
NAMES = [
    "bracket.stl",
    "slit.vtu",
    "curved.vtu",
    "lshape.vtu",
    "shell.vtu",
    "block.vtu",
    "plate.vtk",
    "deer.ply",
    "coast.geojson",
]


@pytest.mark.parametrize("name", NAMES)
def test_under_a_megabyte(name):
    assert 0 < (DATA / name).stat().st_size < 1_000_000


def test_bracket_is_a_closed_solid_of_the_drawn_volume():
    bracket = trimesh.load(DATA / "bracket.stl")
    assert bracket.is_watertight
    assert bracket.is_winding_consistent
    assert bracket.euler_number == 2 - 2 * 6  # six through holes
    np.testing.assert_allclose(bracket.extents, [100.0, 60.0, 40.0])
    # Volume of the drawing, with true circles; polygons of 40 to 64 sides stay within 0.1 %.
    pi = np.pi
    profile = 100 * 8 + 8 * 32 + 100 * (1 - pi / 4)
    plate = 60 * profile - 2 * 8 * 64 * (1 - pi / 4)
    bosses = pi * (12**2 * 12 + 9**2 * 6)
    bores = pi * (7**2 * 20 + 5**2 * 14 + 4 * 4.5**2 * 8)
    rib = 1.8 * (46 * (3 + 28) / 2 - 100 * (1 - pi / 4))
    assert bracket.volume == pytest.approx(plate + bosses - bores + rib, rel=1e-3)


def test_bracket_has_slivers_and_no_bend_that_may_pass_for_curvature():
    bracket = trimesh.load(DATA / "bracket.stl")
    assert (np.rad2deg(bracket.face_angles).min(axis=1) < 5.0).mean() > 0.4
    bend = np.rad2deg(bracket.face_adjacency_angles)
    assert not ((bend > 15.0) & (bend < 60.0)).any()


def test_deer_is_a_closed_scan_with_antlers():
    deer = trimesh.load(DATA / "deer.ply")
    assert deer.is_watertight
    assert deer.is_winding_consistent
    assert deer.euler_number == 2
    # Up to the tips of the antlers, which end in balls of radius 0.6 at a height of 117.
    assert deer.extents[2] == pytest.approx(117.5, abs=0.3)
    tip = deer.vertices[(deer.vertices[:, 2] > 112.0) & (deer.vertices[:, 1] > 14.0)]
    across = tip - tip.mean(axis=0)
    thickness = 2.0 * np.linalg.svd(across, compute_uv=False)[1:] * np.sqrt(2.0 / len(tip))
    assert (thickness > 1.0).all()
    assert (thickness < 2.0).all()


def test_shell_is_rolled_without_stretching():
    mesh = meshio.read(DATA / "shell.vtu")
    cells, flat = mesh.cells_dict["triangle"], mesh.point_data["rolled_out"]
    pairs = np.concatenate([cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [2, 0]]])
    length = np.linalg.norm(np.diff(mesh.points[pairs], axis=1)[:, 0], axis=1)
    rolled_out = np.linalg.norm(np.diff(flat[pairs], axis=1)[:, 0], axis=1)
    # A chord of an arc of angle a = 0.2 / radius is shorter than the arc by a^2 / 24.
    assert (length <= rolled_out * (1 + 1e-9)).all()
    assert (length >= rolled_out * (1 - (0.3 / 0.5) ** 2 / 24)).all()


def test_block_has_two_regions_and_closed_tagged_faces():
    mesh = meshio.read(DATA / "block.vtu")
    corners = mesh.points[mesh.cells_dict["tetra"]]
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6
    region, tag = mesh.cell_data_dict["region"]["tetra"], mesh.cell_data_dict["tag"]["triangle"]
    assert volume.sum() == pytest.approx(40 * 20 * 20, rel=1e-9)
    ball = 4 / 3 * np.pi * 6**3
    assert 0.93 * ball < volume[region == 2].sum() < ball  # a polyhedron inscribed in the ball
    assert sorted(set(tag)) == [1, 2, 3, 10]


@pytest.mark.skipif(importlib.util.find_spec("manifold3d") is None, reason="needs manifold3d")
def test_the_script_makes_the_bracket(tmp_path):
    script = runpy.run_path(str(DATA / "make_samples.py"))
    script["make_bracket"](tmp_path / "bracket.stl")
    made, kept = trimesh.load(tmp_path / "bracket.stl"), trimesh.load(DATA / "bracket.stl")
    assert made.is_watertight
    assert made.volume == pytest.approx(kept.volume, rel=1e-6)
