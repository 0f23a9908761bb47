"""CalculiX runs a static analysis from our files (Debian: calculix-ccx)."""

import re
import shutil
import subprocess

import numpy as np
import pytest
from numpy.testing import assert_allclose

import adaptsize as ads
from conftest import face

pytestmark = pytest.mark.skipif(shutil.which("ccx") is None, reason="needs ccx (calculix-ccx)")

STEP = """*MATERIAL, NAME=steel
*ELASTIC
210000, 0.3
*SOLID SECTION, ELSET=Eall, MATERIAL=steel
*BOUNDARY
fixed_end, 1, 3
*STEP
*STATIC
*DSLOAD
boundary_1st_pressed_face, P, {pressure}
*NODE PRINT, NSET=fixed_end, TOTALS=ONLY
RF
*EL PRINT, ELSET=Eall, TOTALS=ONLY
EVOL
*END STEP
"""


def totals(text, what):
    return np.array(re.search(rf"{what}.*\n\n(.*)\n", text)[1].split(), float)


def finished(folder, step):
    """Run a job and return what it prints."""
    (folder / "job.inp").write_text("*INCLUDE, INPUT=mesh.inp\n" + step)
    done = subprocess.run(
        ["ccx", "-i", "job"], cwd=folder, capture_output=True, text=True, timeout=300, check=False
    )
    assert "Job finished" in done.stdout, done.stdout[-2000:]
    assert "*ERROR" not in done.stdout
    return (folder / "job.dat").read_text()


@pytest.mark.parametrize("order", [1, 2])
def test_a_pressure_on_a_side_of_a_plane_mesh_with_two_materials(tmp_path, plane, order):
    ads.write(tmp_path / "mesh.inp", plane, order=order)
    materials = "".join(
        f"*MATERIAL, NAME={name}\n*ELASTIC\n{modulus}, 0.3\n"
        f"*SOLID SECTION, ELSET={name}, MATERIAL={name}\n1.\n"
        for name, modulus in (("left", 1000.0), ("right", 2000.0))
    )
    step = (
        "*BOUNDARY\noutlet, 1, 2\nNall, 3, 3\n*STEP\n*STATIC\n*DSLOAD\ninlet, P, 2.\n"
        "*NODE PRINT, NSET=outlet, TOTALS=ONLY\nRF\n*END STEP\n"
    )
    printed = finished(tmp_path, materials + step)
    inlet = plane.tagged_facets[plane.facet_tags == 1]
    length = np.linalg.norm(np.diff(plane.points[inlet], axis=1), axis=2).sum()
    # The inlet is at the left, and the pressure pushes to the right.
    assert_allclose(totals(printed, "total force")[:2], [-2.0 * length, 0.0], atol=2e-5 * length)


@pytest.mark.parametrize("order", [1, 2])
def test_a_pressure_on_a_named_face_is_balanced_by_the_fixed_one(tmp_path, solid, order):
    ads.write(tmp_path / "mesh.inp", solid, order=order)
    pressure = 2.5
    printed = finished(tmp_path, STEP.format(pressure=pressure))
    vector, area = face(solid, "1st pressed face")
    # A pressure acts against the normals; the support answers with the opposite force.
    scale = pressure * area
    assert_allclose(totals(printed, "total force"), pressure * vector, atol=2e-6 * scale)
    assert_allclose(totals(printed, "total volume"), solid.measures.sum(), rtol=1e-6)
