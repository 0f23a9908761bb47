"""``adaptsize limit`` and ``adaptsize remesh`` with a metric."""

import json

import numpy as np
import pytest
from command_line import call

import adaptsize as ads
from adaptsize._defaults import METRIC_GRADIENT_LIMIT
from adaptsize.metrics import Metric, MetricFunction, limit_metric


def slanted(mesh):
    """Return sizes of 0.1 by 0.5 at 30 degrees at the first node, and 1 elsewhere."""
    sizes = np.ones((mesh.n_points, 2))
    sizes[0] = 0.1, 0.5
    c, s = np.sqrt(0.75), 0.5
    return Metric(sizes, np.tile([[c, -s], [s, c]], (mesh.n_points, 1, 1)))


@pytest.fixture
def square(tmp_path):
    mesh = ads.SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    metric = slanted(mesh)
    fields = {"requirement": metric.matrices.reshape(4, 4), "h0": np.ones(4)}
    ads.write(tmp_path / "square.vtu", mesh, fields=fields)
    ads.write(tmp_path / "requirement.sol", MetricFunction(mesh, metric))
    return tmp_path / "square.vtu"


@pytest.mark.parametrize("given", ["requirement", "requirement.sol"])
def test_limit_writes_the_limited_metric(capsys, square, given):
    output = square.with_name("limited.vtu")
    source = square.with_name(given) if given.endswith(".sol") else given
    assert call("limit", square, "--metric", source, "-g", "0.3", "-o", output) == 0
    printed = capsys.readouterr()
    assert "3 of 4 nodes lowered" in printed.out
    assert "Metric(4 nodes in 2-D, sizes 0.1 to 0.924" in printed.out
    assert "fields requirement, h0, metric, metric.lengths" in printed.out
    mesh = ads.read(square)
    expected = limit_metric(mesh, slanted(mesh), 0.3)
    found = ads.read_metric(output)
    np.testing.assert_allclose(found.matrices, expected.matrices, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "given", "g"),
    [("fine.vtu", ["-g", "0.5"], 0.5), ("fine.mesh", [], METRIC_GRADIENT_LIMIT)],
)
def test_remesh_follows_the_metric(capsys, square, name, given, g):
    output = square.with_name(name)
    words = ["--metric", "requirement", *given, "--hmax", "0.4", "-o", output, "--json"]
    assert call("remesh", square, *words) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["g"] == g
    new = ads.read(output)
    assert result["mesh"]["n_cells"] == new.n_cells > 20
    assert result["metric"]["hmax"] <= 0.4 * (1.0 + 1e-9)
    metric = ads.read_metric(output if name == "fine.vtu" else output.with_suffix(".sol"))
    assert metric.sizes.min() == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("command", "words", "message"),
    [
        ("limit", [], "--field or --metric must be given, got neither"),
        ("limit", ["--metric", "requirement", "--field", "h0"], "must be given, got both"),
        (
            "limit",
            ["--metric", "none"],
            "--metric must be a nodal field of the mesh (requirement, h0), got 'none'",
        ),
        ("limit", ["--metric", "missing.sol"], "missing.sol: No such file"),
        (
            "limit",
            ["--metric", "requirement", "--method", "exact"],
            "--metric does not go with --me",
        ),
        (
            "remesh",
            ["--metric", "requirement", "--field", "h0"],
            "--metric does not go with --field",
        ),
        (
            "remesh",
            ["--metric", "requirement", "--nodes", "9"],
            "--metric does not go with --nodes",
        ),
        (
            "limit",
            ["--metric", "requirement", "-o", "a.jig.msh"],
            "cannot hold a metric; write .vtu",
        ),
    ],
)
def test_what_makes_no_sense_is_one_line(refused, square, command, words, message):
    output = square.with_name("out.vtu")
    code = 1 if "No such file" in message else 2
    assert message in refused(command, square, "-o", output, *words, "-g", "0.3", code=code)
    assert not output.exists()
