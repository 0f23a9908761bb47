"""The snippets of docs/solvers.md run as they stand, where the solver is installed."""

import re
from pathlib import Path

import numpy as np
import pytest
from page_code import blocks_of

import adaptsize as ads
from adaptsize.remeshing import available_backends

PAGE = Path(__file__).parents[1] / "docs" / "solvers.md"

pytestmark = pytest.mark.skipif(
    not available_backends()["mmg"].installed, reason="the page remeshes by Mmg"
)


def names_after(section):
    """Run the blocks of a section of the page one after the other; return what they leave."""
    text = PAGE.read_text(encoding="utf-8")
    start = text.index(f"\n## {section}\n") + 1
    end = text.find("\n## ", start)
    blocks = blocks_of(text, start, end if end > 0 else None)
    assert blocks, f"no snippets under {section}"
    names = {"__name__": "page"}
    for block in blocks:
        if not block.can_run():
            pytest.skip(f"needs {block.needs}")
        assert block.difference(block.run(PAGE, names)) is None
    return names


def measure(points, cells):
    corners = points[cells]
    return np.linalg.det(corners[:, 1:] - corners[:, :1]) / 2.0


def test_every_block_of_the_page_stands_in_a_section_that_is_run():
    sections = re.split(r"^## ", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    with_blocks = [s.split("\n", 1)[0] for s in sections if blocks_of(s)]
    assert with_blocks == [
        "Plain arrays",
        "meshio and PyVista",
        "scikit-fem",
        "DOLFINx",
        "MFEM",
        "NGSolve",
    ]
    assert PAGE.read_text(encoding="utf-8").count("```python") == 8


def test_objects_of_meshio_and_pyvista(monkeypatch):
    monkeypatch.chdir(PAGE.parents[1])
    names = names_after("meshio and PyVista")
    mesh, given = names["mesh"], ads.read("data/block.vtu")
    assert mesh.n_cells == given.n_cells
    assert (mesh.cell_tags == given.cell_tags).all()
    assert (mesh.facet_tags == given.facet_tags).all()
    assert set(mesh.point_data) == set(given.point_data)


def test_plain_arrays():
    names = names_after("Plain arrays")
    points, cells = names["points"], names["cells"]
    assert len(cells) == pytest.approx(500, rel=0.15)
    areas = measure(points, cells)
    assert (areas > 0.0).all()
    assert areas.sum() == pytest.approx(1.0, rel=1e-12)
    # Fine where the indicator is large.
    away = np.linalg.norm(points[cells].mean(axis=1) - 0.5, axis=1)
    assert areas[away < 0.2].mean() < 0.5 * areas[away > 0.5].mean()


def test_scikit_fem():
    names = names_after("scikit-fem")
    m = names["m"]
    areas = measure(m.p.T, m.t.T)
    assert np.abs(areas).sum() == pytest.approx(1.0, rel=1e-12)
    right = m.subdomains["right"]
    assert np.abs(areas[right]).sum() == pytest.approx(0.5, rel=1e-12)
    assert (m.p[0, m.t[:, right]].mean(axis=0) > 0.5).all()
    bottom = m.facets[:, m.boundaries["bottom"]]
    assert (m.p[1, bottom] == 0.0).all()
    lengths = np.abs(m.p[0, bottom[1]] - m.p[0, bottom[0]])
    assert lengths.sum() == pytest.approx(1.0, rel=1e-12)
    assert np.median(lengths) == pytest.approx(0.05, rel=0.3)


def test_dolfinx():
    names = names_after("DOLFINx")
    domain, mesh = names["domain"], names["mesh"]
    assert mesh.n_cells == pytest.approx(500, rel=0.15)
    geometry = domain.geometry
    assert geometry.dofmaps[0].shape == mesh.cells.shape
    np.testing.assert_array_equal(
        geometry.x[:, :2], mesh.points[geometry.input_global_indices]
    )  # the same bits, in another order
    again = measure(geometry.x[:, :2], geometry.dofmaps[0])
    tags = names["tags"]
    assert len(tags.indices) == len(mesh.tagged_facets) > 8
    middles = names["dmesh"].compute_midpoints(domain, 1, tags.indices)
    assert set(tags.values) == {7}
    assert not middles[:, 1].any()
    cells = domain.topology.original_cell_index
    np.testing.assert_allclose(np.abs(again), mesh.measures[cells], rtol=1e-9)


def test_mfem(tmp_path):
    names = names_after("MFEM")
    mfem, m, mesh = names["mfem"], names["m"], names["mesh"]
    assert m.GetNE() == mesh.n_cells == pytest.approx(1000, rel=0.15)
    # The maximum of -div grad u = 1 on the unit square is 0.07367 (Fourier series).
    assert names["poisson"](m).max() == pytest.approx(0.07367, rel=0.01)
    np.testing.assert_array_equal(m.GetBdrAttributeArray(), mesh.facet_tags)
    for name in ("data/block.vtu", "data/slit.vtu"):
        part = ads.read(PAGE.parents[1] / name)
        ads.write(tmp_path / "part.msh", part)
        again = mfem.Mesh(str(tmp_path / "part.msh"), 1, 1)
        assert (again.GetNV(), again.GetNE()) == (part.n_points, part.n_cells)
        assert set(part.facet_tags) <= set(again.GetBdrAttributeArray())
    again.PrintVTK(str(tmp_path / "part.vtk"))
    assert ads.read(tmp_path / "part.vtk").n_cells == part.n_cells


def test_ngsolve():
    names = names_after("NGSolve")
    m, mesh = names["m"], names["mesh"]
    assert m.ne == mesh.n_cells == pytest.approx(1000, rel=0.15)
    assert names["values"].max() == pytest.approx(0.07367, rel=0.01)
    tags = [e.index + 1 for e in m.Elements(names["ng"].BND)]
    np.testing.assert_array_equal(tags, mesh.facet_tags)
