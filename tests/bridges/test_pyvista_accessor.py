"""``dataset.adaptsize``: sizes and meshes of PyVista's data sets, which are not changed."""

import inspect
from pathlib import Path

import numpy as np
import pytest

pyvista = pytest.importorskip("pyvista", reason="the accessor is PyVista's")

from adaptsize import (  # noqa: E402
    PointSource,
    SizeFunction,
    check_mesh,
    limit_gradient,
    remesh,
    size_conformity,
    size_function,
)
from adaptsize.bridges.pyvista import AdaptsizeAccessor  # noqa: E402
from adaptsize.errors import InputWarning  # noqa: E402
from adaptsize.options import options_of  # noqa: E402
from adaptsize.options.sizes import ImageOptions  # noqa: E402

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


def test_a_chain_of_methods_makes_the_mesh_of_the_functions(tmp_path):
    """With sizes that the points of the data set cannot hold, also copied, and from a file."""
    plate = pyvista.Plane(i_resolution=4, j_resolution=4).triangulate()
    plate.clear_data()
    source = PointSource([0.13, 0.21], 0.004)
    mesh = plate.adaptsize.mesh
    size = size_function(mesh, sources=source, hmax=0.2)
    expected = remesh(mesh, size)
    sized = plate.adaptsize.size(sources=source, hmax=0.2)
    made = sized.adaptsize.remesh()
    np.testing.assert_array_equal(made.points[:, :2], expected.points)
    np.testing.assert_array_equal(made.cells_dict[5], expected.cells)
    assert made.adaptsize.conformity().served == size_conformity(expected, size).served > 0.9
    # What is stored is linear between the nodes of the refined background.
    sized.save(tmp_path / "sized.vtp")
    linear = remesh(mesh, SizeFunction(size.background, size.values))
    for data in (sized.copy(), pyvista.read(tmp_path / "sized.vtp")):
        np.testing.assert_array_equal(data.adaptsize.remesh().points[:, :2], linear.points)
    assert linear.n_cells == pytest.approx(expected.n_cells, rel=0.02)
    assert expected.n_cells > 1.5 * plate.adaptsize.remesh(0.2).n_cells


def test_sizes_that_were_changed_count_instead_of_the_size_function():
    plate = pyvista.Plane(i_resolution=6, j_resolution=6).triangulate()
    sized = plate.adaptsize.size(hmax=0.1)
    sized.point_data["h"] *= 2.0
    assert sized.adaptsize.size_function.values.min() == pytest.approx(
        2.0 * plate.adaptsize.size(hmax=0.1).adaptsize.size_function.values.min()
    )
    del sized.point_data["h"]
    assert sized.adaptsize.size_function is None
    assert repr(sized.adaptsize).endswith("triangles), no sizes)")


def test_sizes_of_a_solid_keep_their_growth_and_name_what_a_file_does_not_hold():
    ball = pyvista.Sphere(theta_resolution=12, phi_resolution=12)
    sized = ball.adaptsize.size(hmax=0.2, g=0.1)
    again = sized.copy().adaptsize.size_function
    inside = np.zeros((1, 3))
    np.testing.assert_array_equal(again(inside), sized.adaptsize.size_function(inside))
    sized = ball.adaptsize.size(hmax=0.2, sources=PointSource([0.1, 0.0, 0.0], 0.05))
    with pytest.warns(InputWarning, match="sources inside the part act as they do on its surface"):
        assert sized.copy().adaptsize.size_function is not None


def test_methods_show_and_take_the_options_of_the_functions(plate):
    def options(function):
        parameters = inspect.signature(function).parameters.values()
        return {p.name for p in parameters if p.kind is p.KEYWORD_ONLY}

    accessor = plate.adaptsize
    others = {"box", *options_of(ImageOptions)}  # of domains that are no meshes
    assert options(accessor.size) == options(size_function) - others
    assert options(accessor.limit) == options(limit_gradient)
    assert options(accessor.remesh) == options(size_function) - others | options(remesh)
    assert options(accessor.check) == options(check_mesh)
    with pytest.raises(TypeError, match="hmim"):
        accessor.remesh(hmim=1.0)
    made = accessor.remesh(elements_per_radian=0.0, hmax=0.2, timeout=60.0, tolerance=1e-2)
    assert made.adaptsize.check(original=plate).is_met
