"""The files in data/ are what data/README.md says."""

import importlib.util
import runpy
from pathlib import Path

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


@pytest.mark.skipif(importlib.util.find_spec("manifold3d") is None, reason="needs manifold3d")
def test_the_script_makes_the_bracket(tmp_path):
    script = runpy.run_path(str(DATA / "make_samples.py"))
    script["make_bracket"](tmp_path / "bracket.stl")
    made, kept = trimesh.load(tmp_path / "bracket.stl"), trimesh.load(DATA / "bracket.stl")
    assert made.is_watertight
    assert made.volume == pytest.approx(kept.volume, rel=1e-6)
