"""OpenFOAM's gmshToFoam finds the cells, zones and patches of our `.msh`."""

import os
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

import adaptsize as ads
from conftest import face

CONTROL = """FoamFile { version 2.0; format ascii; class dictionary; object controlDict; }
application none; startFrom startTime; startTime 0; stopAt endTime; endTime 1; deltaT 1;
writeControl timeStep; writeInterval 1; writePrecision 15;
"""


def rows_in(path):
    """The rows of a list in a file of OpenFOAM."""
    text = path.read_text()
    text = text[text.index("}") + 1 :]
    count = int(re.search(r"^(\d+)\s*$", text, re.MULTILINE)[1])
    rows = re.findall(r"^\d*\(([^()\n]+)\)\s*$", text, re.MULTILINE)
    if not rows:
        rows = text[text.index("(") + 1 : text.rindex(")")].split()
    assert len(rows) == count
    return [[float(word) for word in row.split()] for row in rows]


@pytest.mark.skipif(shutil.which("gmshToFoam") is None, reason="needs gmshToFoam (openfoam)")
def test_gmsh_to_foam(tmp_path, solid):
    # gmshToFoam takes names without spaces only.
    names = {key: name.replace(" ", "_") for key, name in solid.tag_names.items()}
    mesh = replace(solid, tag_names=names)
    ads.write(tmp_path / "a.msh", mesh)
    (tmp_path / "system").mkdir()
    (tmp_path / "system" / "controlDict").write_text(CONTROL)
    done = subprocess.run(
        ["gmshToFoam", "a.msh"], cwd=tmp_path, capture_output=True, text=True, check=False,
        timeout=120, env={"WM_PROJECT_DIR": "/usr/share/openfoam"} | dict(os.environ),  # of Debian
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    folder = tmp_path / "constant" / "polyMesh"
    points = np.array(rows_in(folder / "points"))
    faces = np.array(rows_in(folder / "faces"), int)
    owner = np.array(rows_in(folder / "owner"), int).ravel()
    neighbour = np.array(rows_in(folder / "neighbour"), int).ravel()
    n_cells = max(owner.max(), neighbour.max()) + 1
    assert (len(points), n_cells) == (mesh.n_points, mesh.n_cells)
    corners = points[faces]
    normals = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flux = (corners.mean(axis=1) * normals).sum(axis=1) / 3.0
    volumes = np.bincount(owner, flux, n_cells)
    volumes -= np.bincount(neighbour, flux[: len(neighbour)], n_cells)
    np.testing.assert_allclose(np.sort(volumes), np.sort(mesh.measures), rtol=1e-6)
    text = (folder / "boundary").read_text()
    patches = re.findall(r"^ +(\w+)\s*\{[^}]*?nFaces\s+(\d+);\s*startFace\s+(\d+);", text, re.M)
    for name, tagged in (("fixed_end", "fixed end"), ("1st_pressed_face", "1st pressed face")):
        found = [slice(int(first), int(first) + int(n)) for n_, n, first in patches if n_ == name]
        area = np.linalg.norm(normals[found[0]], axis=1).sum()
        assert area == pytest.approx(face(solid, tagged)[1], rel=1e-6)
    zones = (folder / "cellZones").read_text()
    for (dim, _), name in mesh.tag_names.items():
        assert dim == 2 or name in zones
