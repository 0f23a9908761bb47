"""``dataset.adaptsize``: sizes and meshes of PyVista's data sets, which are not changed."""

from pathlib import Path

import numpy as np
import pytest

pyvista = pytest.importorskip("pyvista", reason="the accessor is PyVista's")

from adaptsize import SizeFunction, size_conformity, size_function  # noqa: E402
from adaptsize.bridges.pyvista import AdaptsizeAccessor  # noqa: E402

ROOT = Path(__file__).parents[2]


@pytest.fixture
def plate():
    return pyvista.Plane(i_resolution=12, j_resolution=12).triangulate()


def test_it_is_an_entry_point_of_pyvista():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert '[project.entry-points."pyvista.accessors"]\nadaptsize = "adaptsize.bridges' in text
    assert isinstance(pyvista.Sphere().adaptsize, AdaptsizeAccessor)


def test_size_is_that_of_size_function_and_the_data_set_stays(plate):
    sized = plate.adaptsize.size(hmax=0.1, g=0.2)
    expected = size_function(plate.adaptsize.mesh, hmax=0.1, g=0.2)
    np.testing.assert_array_equal(sized.point_data["h"], expected.values)
    assert "h" not in plate.point_data
    assert type(sized) is type(plate)


def test_remesh_follows_the_sizes_of_the_data_set(plate):
    plate.point_data["h"] = 0.05 + 0.1 * np.abs(plate.points[:, 0])
    plate.point_data["x"] = plate.points[:, 0]
    new = plate.adaptsize.remesh()
    assert isinstance(new, pyvista.UnstructuredGrid)
    np.testing.assert_allclose(new.point_data["x"], new.points[:, 0], atol=1e-6)
    found = new.adaptsize.conformity()
    assert found.share_in_band > 0.85
    mesh = plate.adaptsize.mesh
    size = SizeFunction(mesh, mesh.point_data["h"])
    again = size_conformity(new.adaptsize.mesh, size)
    assert found.share_in_band == pytest.approx(again.share_in_band, abs=0.01)
