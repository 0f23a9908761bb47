"""Metrics in files: round trips, the order of entries, and damaged files."""

import numpy as np
import pytest
from shapes import block, two_region_rectangle

import adaptsize as ads
from adaptsize import Metric, MetricFunction
from adaptsize.errors import MeshFileError

MESHES = {"plane": two_region_rectangle(2), "tetrahedra": block(1), "surface": None}
MESHES["surface"] = MESHES["tetrahedra"].boundary().mesh


def random_metric(mesh, seed=1123):
    rng = np.random.default_rng(seed)
    directions = np.linalg.qr(rng.standard_normal((mesh.n_points, mesh.dim, mesh.dim)))[0]
    return Metric(10.0 ** rng.uniform(-3, 0, (mesh.n_points, mesh.dim)), directions)


@pytest.mark.parametrize("suffix", [".sol", ".vtu", ".vtk", ".xdmf", ".msh"])
@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_a_metric_comes_back_as_it_was_written(tmp_path, mesh, suffix):
    metric = random_metric(mesh)
    file = tmp_path / f"part{suffix}"
    ads.write(file, MetricFunction(mesh, metric))
    back = ads.read_metric(file)
    # Condition numbers up to 1e6: sizes are recovered to 1e-16 times that.
    assert back.sizes == pytest.approx(metric.sizes, rel=1e-9)
    assert back.matrices == pytest.approx(metric.matrices, rel=1e-12, abs=1e-6)


def test_paraview_finds_nine_components_and_the_lengths(tmp_path):
    mesh = MESHES["plane"]
    metric = random_metric(mesh)
    ads.write(tmp_path / "part.vtu", MetricFunction(mesh, metric))
    fields = ads.read(tmp_path / "part.vtu").point_data
    assert fields["metric"].shape == fields["metric.lengths"].shape == (mesh.n_points, 9)
    lengths = fields["metric.lengths"].reshape(-1, 3, 3)
    assert lengths[:, :2, :2] == pytest.approx(metric.lengths)
    assert (lengths[:, 2] == 0.0).all()
    assert (lengths[:, :, 2] == 0.0).all()


def test_vtk_reads_the_field_as_tensors(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    mesh = MESHES["tetrahedra"]
    metric = random_metric(mesh)
    ads.write(tmp_path / "part.vtu", MetricFunction(mesh, metric))
    array = pyvista.read(tmp_path / "part.vtu").point_data["metric"]
    assert array.reshape(-1, 3, 3) == pytest.approx(metric.matrices)


SOL = "MeshVersionFormatted 2\n\nDimension 2\n\nSolAtVertices\n2\n1 3\n4 0 9\n4 1 9\n\nEnd\n"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("part.sol", SOL.replace("Dimension 2", ""), "lacks Dimension"),
        ("part.sol", SOL.replace("1 3", "1 2"), "must hold one size"),
        ("part.sol", SOL.replace("\n2\n", "\n3\n"), "ends after 6 of 9 numbers"),
        ("part.sol", SOL.replace("4 1 9\n\nEnd\n", "4 1"), "ends after 5 of 6 numbers"),
        ("part.sol", SOL.replace("4 1 9", "4 7 9"), "must be positive definite"),
        ("part.sol", SOL.replace("4 1 9", "4 nan 9"), "must be finite"),
        ("part.sol", SOL.replace("Dimension 2", "Dimension 4"), "must hold one size"),
        ("part.sol", "\xff", "not a text file"),
    ],
)
def test_damaged_files_are_refused_in_one_line(tmp_path, name, content, message):
    file = tmp_path / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode("latin1"))
    with pytest.raises(MeshFileError, match=message) as caught:
        ads.read_metric(file)
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)
