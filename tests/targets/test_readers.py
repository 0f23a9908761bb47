"""Readers of other programs find the counts, names, areas and volumes that we wrote."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import adaptsize as ads
from conftest import face

#: A Python with pyNastran, which needs other versions of packages than we do.
NASTRAN = os.environ.get("NASTRAN_PYTHON", "")


@pytest.mark.parametrize("order", [1, 2])
def test_gmsh(tmp_path, solid, order):
    gmsh = pytest.importorskip("gmsh")
    ads.write(tmp_path / "a.msh", solid, order=order)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "a.msh"))
        names = {gmsh.model.getPhysicalName(*pair) for pair in gmsh.model.getPhysicalGroups()}
        assert {"fixed end", "1st pressed face"} <= names
        kind = {1: 4, 2: 11}[order]
        tags, _ = gmsh.model.mesh.getElementsByType(kind)
        assert len(tags) == solid.n_cells
        volumes = gmsh.model.mesh.getElementQualities(tags, "volume")
        assert np.sum(volumes) == pytest.approx(solid.measures.sum(), rel=1e-9)
        if order == 2:  # all nodes are where the order of Gmsh wants them
            worst = gmsh.model.mesh.getElementQualities(tags, "minSJ").min()
            gmsh.model.mesh.setOrder(1)
            tags, _ = gmsh.model.mesh.getElementsByType(4)
            straight = gmsh.model.mesh.getElementQualities(tags, "minSJ").min()
            assert worst == pytest.approx(straight, rel=1e-6)
    finally:
        gmsh.finalize()


READ_NASTRAN = """
import json, sys
from pyNastran.bdf.bdf import read_bdf
model = read_bdf(sys.argv[1], xref=False, punch=True, validate=False, debug=None)
model.cross_reference(xref_elements=False, xref_nodes=True)
elements = {}
for element in model.elements.values():
    elements.setdefault(element.type, []).append([element.pid, *element.node_ids])
points = {n: list(node.get_position()) for n, node in model.nodes.items()}
print(json.dumps({"elements": elements, "points": points}))
"""


@pytest.mark.skipif(not NASTRAN, reason="needs NASTRAN_PYTHON, a Python with pyNastran")
@pytest.mark.parametrize("order", [1, 2])
def test_pynastran(tmp_path, solid, order):
    ads.write(tmp_path / "a.bdf", solid, order=order)
    text = (tmp_path / "a.bdf").read_text().replace("BEGIN BULK\n", "")
    (tmp_path / "a.bdf").write_text(text)
    code = [NASTRAN, "-c", READ_NASTRAN, str(tmp_path / "a.bdf")]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(code, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout.splitlines()[-1])
    cells = np.array(found["elements"]["CTETRA"])
    assert cells.shape == (solid.n_cells, 5 if order == 1 else 11)
    points = {int(n): place for n, place in found["points"].items()}
    corners = np.array([[points[n] for n in cell[1:5]] for cell in cells.tolist()])
    made = ads.SimplexMesh(corners.reshape(-1, 3), np.arange(4 * len(cells)).reshape(-1, 4))
    assert made.signed_measures.min() > 0.0
    assert made.measures.sum() == pytest.approx(solid.measures.sum(), rel=1e-7)
    facets = found["elements"]["CTRIA3" if order == 1 else "CTRIA6"]
    for tag in np.unique(solid.facet_tags).tolist():
        assert sum(row[0] == tag for row in facets) == (solid.facet_tags == tag).sum()


def test_scikit_fem(tmp_path, solid):
    skfem = pytest.importorskip("skfem")
    ads.write(tmp_path / "a.msh", solid)
    mesh = skfem.Mesh.load(str(tmp_path / "a.msh"))
    assert mesh.t.shape[1] == solid.n_cells
    basis = skfem.FacetBasis(mesh, skfem.ElementTetP1(), facets=mesh.boundaries["1st pressed face"])
    area = skfem.Functional(lambda w: 1.0 + 0.0 * w.x[0]).assemble(basis)
    assert area == pytest.approx(face(solid, "1st pressed face")[1], rel=1e-9)
    whole = skfem.Basis(mesh, skfem.ElementTetP1())
    volume = skfem.Functional(lambda w: 1.0 + 0.0 * w.x[0]).assemble(whole)
    assert volume == pytest.approx(solid.measures.sum(), rel=1e-9)


@pytest.mark.skipif(
    shutil.which("FreeFem++") is None, reason="needs FreeFem++ (freefem++, libfreefem++)"
)
@pytest.mark.parametrize("suffix", ["msh", "mesh"])
def test_freefem(tmp_path, solid, suffix):
    ads.write(tmp_path / f"a.{suffix}", solid)
    load = {"msh": 'load "gmsh"\nmesh3 Th = gmshload3("a.msh");',
            "mesh": 'mesh3 Th = readmesh3("a.mesh");'}[suffix]  # fmt: skip
    tag = next(t for (_, t), name in solid.tag_names.items() if name == "1st pressed face")
    script = (
        f'load "msh3"\n{load}\ncout.precision(15);\n'
        'cout << "RESULT " << Th.nv << " " << Th.nt << " " << Th.measure << " " '
        f"<< int2d(Th, {tag})(1.0) << endl;\n"
    )
    (tmp_path / "a.edp").write_text(script)
    plugins = {"FF_LOADPATH": "/usr/lib/freefem++"} | dict(os.environ)  # of Debian
    done = subprocess.run(
        ["FreeFem++", "-nw", "-v", "0", "a.edp"], cwd=tmp_path, capture_output=True, text=True,
        check=False, timeout=120, env=plugins,
    )  # fmt: skip
    line = next((row for row in done.stdout.splitlines() if row.startswith("RESULT")), done.stdout)
    n_points, n_cells, volume, area = map(float, line.split()[1:])
    assert (n_points, n_cells) == (solid.n_points, solid.n_cells)
    assert volume == pytest.approx(solid.measures.sum(), rel=1e-9)
    assert area == pytest.approx(face(solid, "1st pressed face")[1], rel=1e-9)


@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
@pytest.mark.parametrize("order", [1, 2])
def test_pyvista(tmp_path, solid, suffix, order):
    pyvista = pytest.importorskip("pyvista")
    file = Path(tmp_path, f"a{suffix}")
    ads.write(file, solid, order=order)
    grid = pyvista.read(file)
    cells = grid.extract_cells(grid.celltypes == {1: 10, 2: 24}[order])
    assert cells.n_cells == solid.n_cells
    assert cells.compute_cell_sizes()["Volume"].sum() == pytest.approx(
        solid.measures.sum(), rel=1e-6
    )
