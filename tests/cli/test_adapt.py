"""``adaptsize adapt``: the next mesh from an indicator or a solution in a file."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import call
from meshes import jittered_square

from adaptsize import adapt, read, write
from adaptsize.sizes import zz_indicator

DATA = Path(__file__).parents[2] / "data"


@pytest.fixture
def solved(tmp_path):
    """A file with a solution u, an indicator eta and a cell field k."""
    mesh = jittered_square(10, 2711, half_width=1.0)
    u = np.exp(-20.0 * (mesh.points**2).sum(axis=1))
    data = {"eta": zz_indicator(mesh, u), "k": np.arange(mesh.n_cells) % 3}
    write(tmp_path / "solved.vtu", mesh.with_data(point_data={"u": u}, cell_data=data))
    return tmp_path / "solved.vtu"


@pytest.mark.parametrize(
    ("words", "options"),
    [
        (["--elements", "900"], {"elements": 900.0}),
        (["--nodes", "500", "--hmin", "0.02"], {"nodes": 500.0, "hmin": 0.02}),
        (["--tolerance", "0.3", "-g", "0.2", "--order", "2"], {"tolerance": 0.3, "order": 2.0}),
    ],
)
def test_adapt_is_read_and_adapt(capsys, solved, words, options):
    pytest.importorskip("mmgpy")
    output = solved.with_name("next.vtu")
    assert call("adapt", solved, "-o", output, "--field", "eta", *words, "--json") == 0
    result = json.loads(capsys.readouterr().out)
    mesh = read(solved)
    options = {"g": 0.2 if "-g" in words else 0.25, **options}
    expected = adapt(mesh, mesh.cell_data["eta"], fields=mesh.point_data, **options)
    written = read(output)
    np.testing.assert_array_equal(written.points, expected.mesh.points)
    np.testing.assert_array_equal(written.point_data["u"], expected.fields["u"])
    np.testing.assert_allclose(written.point_data["h"], expected.size(written.points))
    assert set(written.cell_data) == {"k"}
    assert result["remeshed"] is True
    assert result["mesh"]["n_cells"] == written.n_cells
    assert result["error"] == pytest.approx(np.linalg.norm(mesh.cell_data["eta"]))


def test_a_solution_is_estimated_and_a_mesh_with_the_sizes_is_kept(capsys, solved):
    pytest.importorskip("mmgpy")
    first, output = solved.with_name("first.vtu"), solved.with_name("next.vtu")
    for name, field in ((first, "eta"), (output, "u")):
        assert call("adapt", solved, "-o", name, "--field", field, "--elements", 900) == 0
    np.testing.assert_array_equal(read(first).points, read(output).points)
    capsys.readouterr()
    # The error is within this tolerance already.
    words = ["--field", "u", "--tolerance", "100", "--json"]
    assert call("adapt", solved, "-o", output, *words) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["remeshed"], result["converged"]) == (False, True)
    np.testing.assert_array_equal(read(output).points, read(solved).points)


@pytest.mark.parametrize("suffix", [".vtu", ".msh"])
def test_cell_fields_are_listed_or_named_where_the_format_has_none(capsys, solved, suffix):
    output = solved.with_name("next" + suffix)
    words = ["--field", "u", "--tolerance", "100"]  # the mesh stays, without a generator's run
    assert call("adapt", solved, "-o", output, *words) == 0
    found = capsys.readouterr()
    holds = suffix == ".vtu"
    assert (", fields u, h, cell fields eta, k" in found.out) == holds
    message = "next.msh holds no cell fields: k is not written"
    assert (message in found.err, "k" in read(output).cell_data) == (not holds, holds)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--field", "u"], "--elements, --nodes or --tolerance must be given"),
        (
            ["--field", "v", "--nodes", 9],
            "--field must be a field of the mesh (eta, k, u), got 'v'",
        ),
        (
            ["--field", "u", "--nodes", 9, "--elements", 9],
            "--elements and --nodes exclude each other",
        ),
        (["--field", "u", "--nodes", 0], "--nodes must be finite and >= 1, got 0"),
        (["--field", "eta", "--nodes", 9, "--order", 0], "order must be finite and > 0"),
    ],
)
def test_what_does_not_fit_is_refused(refused, solved, words, message):
    assert message in refused("adapt", solved, "-o", solved.with_name("next.vtu"), *words)
    assert not solved.with_name("next.vtu").exists()


def test_fields_that_are_not_finite_are_named(solved, capsys, refused):
    mesh, output = read(solved), solved.with_name("next.vtu")
    u, eta = mesh.point_data["u"].copy(), mesh.cell_data["eta"].copy()
    u[5] = eta[[7, 9]] = np.nan
    write(solved, mesh.with_data(point_data={"u": u}, cell_data={"eta": eta}))
    arguments = ("adapt", solved, "-o", output, "--elements", "300", "--backend", "bisection")
    for name, place in (("u", 5), ("eta", 7)):
        text = f"field '{name}' must be finite, got field '{name}'[{place}] = nan"
        assert text in refused(*arguments, "--field", name, code=1)
    write(solved, mesh.with_data(point_data={"u": u}, cell_data={"eta": mesh.cell_data["eta"]}))
    assert call(*arguments, "--field", "eta") == 0
    assert "field 'u' is left out: 1 of its values are not finite" in capsys.readouterr().err
    assert "u" not in read(output).point_data
