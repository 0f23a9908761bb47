"""`read_cad`: CAD models as surfaces whose regions are the faces, and tagged segments the edges."""

import math
import subprocess
import sys

import numpy as np
import pytest

from adaptsize import read, read_cad
from adaptsize.errors import BackendError, MeshFileError

# In a process of its own: gmsh changes the interpreter that it runs in.
PLATE = """
import gmsh, sys
gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Verbosity", 1)
box = gmsh.model.occ.addBox(0, 0, 0, 40, 30, 10)
bore = gmsh.model.occ.addCylinder(12, 15, -1, 0, 0, 12, 5)
gmsh.model.occ.cut([(3, box)], [(3, bore)])
gmsh.model.occ.synchronize()
for name in sys.argv[1:]:
    gmsh.write(name)
"""


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    pytest.importorskip("gmsh", reason="Gmsh reads CAD models")
    folder = tmp_path_factory.mktemp("cad")
    names = [str(folder / f"plate.{suffix}") for suffix in ("step", "brep")]
    subprocess.run([sys.executable, "-c", PLATE, *names], check=True, capture_output=True)
    return folder


def test_a_cone_ends_at_its_tip(models):
    script = PLATE.partition("box =")[0] + "gmsh.model.occ.addCone(0, 0, 0, 0, 0, 20, 10, 0)\n"
    script += "gmsh.model.occ.synchronize()\ngmsh.write(sys.argv[1])\n"
    path = models / "cone.step"
    subprocess.run([sys.executable, "-c", script, path], check=True, capture_output=True)
    part = read_cad(path, timeout=60.0)
    assert (part.facet_cell_counts == 2).all()
    assert np.linalg.norm(part.points - [0, 0, 20], axis=1).min() < 1e-6
    assert part.n_cells < 60_000


@pytest.mark.parametrize("suffix", ["step", "brep"])
def test_the_surface_is_closed_and_has_a_region_per_face(models, suffix):
    part = read_cad(models / f"plate.{suffix}", elements_per_circle=60)
    assert (part.facet_cell_counts == 2).all()
    area = {tag: part.measures[part.cell_tags == tag].sum() for tag in np.unique(part.cell_tags)}
    disc = 25.0 * math.pi
    exact = sorted([300.0, 300.0, 400.0, 400.0, 1200.0 - disc, 1200.0 - disc, 100.0 * math.pi])
    np.testing.assert_allclose(sorted(area.values()), exact, rtol=2e-3)


def test_edges_of_the_model_are_tagged_segments(models):
    part = read_cad(models / "plate.step")
    ends = part.points[part.tagged_facets]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    # Four edges along each axis, two circles, and the seam of the bore.
    expected = 4 * (40 + 30 + 10) + 2 * 10.0 * math.pi + 10
    assert lengths.sum() == pytest.approx(expected, rel=2e-3)
    assert len(np.unique(part.facet_tags)) == 15


def test_options_set_the_lengths_of_edges(models):
    coarse = read_cad(models / "plate.step", elements_per_circle=12)
    fine = read_cad(models / "plate.step", elements_per_circle=12, largest=2.0)
    assert coarse.n_cells < read_cad(models / "plate.step").n_cells
    assert np.quantile(fine.edge_lengths, 0.95) < 2.5 < np.quantile(coarse.edge_lengths, 0.95)


def test_damaged_and_missing_files_are_refused(models, tmp_path):
    (tmp_path / "bad.step").write_bytes((models / "plate.step").read_bytes()[:3000])
    with pytest.raises((BackendError, MeshFileError)) as caught:
        read_cad(tmp_path / "bad.step")
    assert "\x1b" not in str(caught.value)  # Gmsh prints in colours
    with pytest.raises(MeshFileError, match=r"none\.step does not exist"):
        read_cad(tmp_path / "none.step")


def test_read_says_what_reads_cad_models(tmp_path):
    (tmp_path / "part.step").write_text("ISO-10303-21;")
    with pytest.raises(MeshFileError, match="holds a CAD model, not a mesh; use read_cad"):
        read(tmp_path / "part.step")
