"""What the commands print, as text, as JSON, quietly and step by step, and what they write."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import call
from shapes import block

from adaptsize import SimplexMesh, read, size_function, write
from adaptsize._size_report import CODES
from adaptsize.cli import console as console_module
from adaptsize.cli.console import Console, Steps

DATA = Path(__file__).parents[2] / "data"
CUBE = block(2)


def command_line(command, square):
    output = square.with_name("out.vtu")
    return {
        "info": ["info", square],
        "check": ["check", square],
        "limit": ["limit", square, "-o", output, "--field", "h0", "-g", "0.3"],
        "size": ["size", square, "-o", output, "--hmax", "0.5"],
    }[command]


@pytest.mark.parametrize("command", ["info", "check", "limit", "size"])
def test_quiet_prints_nothing(capsys, square, command):
    assert call(*command_line(command, square), "--quiet") == 0
    assert capsys.readouterr() == ("", "")


def test_verbose_prints_the_time_of_each_step(capsys, square):
    assert call(*command_line("limit", square), "-v") == 0
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(":")[1].strip() for line in lines] == ["reading", "limiting", "writing"]
    assert all(line.endswith(" s") for line in lines)


def test_quiet_and_verbose_exclude_each_other(refused, square):
    assert "--quiet and --verbose exclude each other" in refused("info", square, "-q", "-v")


@pytest.fixture
def clock(monkeypatch):
    """A clock that the test sets, and no timer."""

    class Clock:
        now = 100.0

        def monotonic(self):
            return self.now

    clock = Clock()
    monkeypatch.setattr(console_module, "time", clock)
    return clock


def test_each_step_is_a_line_once_a_command_takes_long(clock):
    lines = []
    console = Console()
    console.say = lines.append
    steps = Steps(console, 3)
    steps.begin("reading")
    clock.now += 1.0
    steps.begin("sizes")
    assert lines == []
    clock.now += 9.0
    steps.talk()  # as the timer does
    clock.now += 10.0
    steps.report("limiting", 0.1)
    assert lines == ["step 2 of 3: sizes (after 10 s)"]
    clock.now += 21.0
    steps.report("limiting", 0.5)
    steps.begin("writing")
    steps.end()
    assert lines[1:] == [
        "step 2 of 3: sizes, 40 s so far, about 40 s left",
        "step 3 of 3: writing (after 41 s)",
    ]
    assert console.times == [("reading", 1.0), ("sizes", 40.0), ("writing", 0.0)]


def test_limit_writes_the_nodes_that_sizes_come_from(square):
    # Opposite corners: the size of 0.4 reaches nothing but its own node.
    write(square, read(square), fields={"h0": [0.1, np.inf, 0.4, np.inf]})
    output = square.with_name("limited.vtu")
    assert call("limit", square, "--field", "h0", "-g", "0.3", "-o", output) == 0
    fields = read(output).point_data
    np.testing.assert_array_equal(fields["source"], [0, 0, 2, 0])
    np.testing.assert_allclose(fields["h"], [0.1, 0.4, 0.4, 0.4], rtol=1e-12)


@pytest.mark.parametrize("name", ["cube.vtu", "cube.stl"])
def test_size_is_read_and_size_function(cubes, name):
    output = cubes / "h.vtu"
    assert call("size", cubes / name, "-o", output, "--elements-across", 5) == 0
    size = size_function(read(cubes / name), elements_across=5.0)
    # Iterations on surfaces amplify rounding, which may differ between two calls.
    np.testing.assert_allclose(read(output).point_data["h"], size.values, rtol=1e-6)


@pytest.fixture
def cubes(tmp_path):
    """A cube, its surface, and a cube that is a little larger."""
    write(tmp_path / "cube.vtu", CUBE)
    write(tmp_path / "cube.stl", CUBE)
    write(tmp_path / "large.vtu", SimplexMesh(CUBE.points * 1.01, CUBE.cells))
    return tmp_path


def test_a_mesh_of_another_domain_exits_1_and_lists_the_worst_places(capsys, cubes):
    words = ["check", str(cubes / "large.vtu"), "--original", str(cubes / "cube.stl")]
    assert call(*words) == 1
    lines = capsys.readouterr().out.splitlines()
    # The corner moves by 0.01 of the diagonal, measured between the two.
    (failed,) = (i for i, line in enumerate(lines) if line.startswith("boundary  MISSED"))
    assert "within 0.0173 (0.01 of the diagonal), 0.00173 (0.001) allowed" in lines[failed]
    assert lines[failed + 1].strip() == "0.01732 at (1.01, 1.01, 1.01)"
    assert call(*words, "--tolerance", "0.02") == 0


def test_sizes_of_the_mesh_are_checked_if_there_are_any(capsys, cubes):
    write(cubes / "sized.vtu", CUBE, fields={"h": np.full(CUBE.n_points, 5.0)})
    assert call("check", str(cubes / "sized.vtu"), "--json") == 1
    result = json.loads(capsys.readouterr().out)
    assert [d["name"] for d in result["requirements"] if not d["is_met"]] == ["edges", "served"]
    assert result["is_met"] is False
    assert result["n_inverted"] == 0
    assert "error" not in result
    assert call("check", str(cubes / "cube.vtu"), "--field", "h") == 2
    assert "--field must be a nodal field of the mesh (none), got 'h'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("move", "code", "status"), [(1.0, 0, "met"), (1.05, 0, "near"), (1.2, 1, "missed")]
)
def test_check_exits_with_1_only_where_a_requirement_is_missed(capsys, cubes, move, code, status):
    away = 0.01 * move * CUBE.diagonal
    write(cubes / "moved.vtu", CUBE.moved(CUBE.points + np.array([away, 0.0, 0.0])))
    words = ["check", cubes / "moved.vtu", "--original", cubes / "cube.stl", "--tolerance", "0.01"]
    assert call(*words, "--json") == code
    result = json.loads(capsys.readouterr().out)
    assert (result["status"], result["is_met"]) == (status, status == "met")
    (boundary,) = (one for one in result["requirements"] if one["name"] == "boundary")
    assert boundary["status"] == status
    assert boundary["value"] == pytest.approx(0.01 * move, rel=1e-5)
    assert boundary["limit"] == pytest.approx(0.01)
    assert call(*words) == code
    word = "MISSED" if status == "missed" else status
    assert f"boundary  {word}" in capsys.readouterr().out


def test_the_distance_to_an_open_surface_is_that_which_is_compared(capsys, cubes):
    skin = CUBE.boundary().mesh
    write(cubes / "open.stl", SimplexMesh(skin.points, skin.cells[:-2]))
    words = ["check", cubes / "cube.vtu", "--original", cubes / "open.stl", "--json"]
    write(cubes / "cube.vtu", CUBE, fields={"h": np.full(CUBE.n_points, 0.65)})
    assert call(*words) == 0
    result = json.loads(capsys.readouterr().out)
    (boundary,) = (d["value"] for d in result["requirements"] if d["name"] == "boundary")
    assert result["hausdorff_relative"] == boundary < 1e-6


def test_meshes_of_a_family_have_the_sizes_of_sources(tmp_path):
    pytest.importorskip("mmgpy")
    words = ["--levels", 2, "--hmax", 0.5, "--source", "point:0,0=0.1"]
    assert call("family", DATA / "lshape.vtu", "-o", tmp_path / "m.vtu", *words) == 0
    h = [read(tmp_path / f"m-{level}.vtu").point_data["h"].min() for level in (1, 2)]
    np.testing.assert_allclose(h, [0.1, 0.1 / np.sqrt(2.0)], rtol=0.05)


def test_limit_has_a_default_of_the_gradient(square):
    """That of the library: the size of 0.1 has grown by a quarter of the distance."""
    output = square.with_name("limited.vtu")
    assert call("limit", square, "--field", "h0", "-o", output, "-q") == 0
    assert read(output).point_data["h"][1] == pytest.approx(0.1 + 0.25)


def test_the_codes_of_causes_do_not_depend_on_the_causes_in_the_file(square, capsys):
    output = square.with_name("sizes.vtu")
    for words in (["--source", "point:0,0=0.01"], ["-K", "0", "--source", "point:0,0=0.01"]):
        assert call("size", square, "-o", output, "--hmax", "0.05", *words) == 0
        assert " 3 sources, 6 hmin, 7 hmax" in capsys.readouterr().out
        assert set(np.unique(read(output).point_data["cause"])) == {3, 7}


def test_every_cause_has_a_code():
    size = size_function(read(DATA / "bracket.stl"), max_elements=3000, tolerance=0.01)
    assert set(size.report.causes) <= CODES.keys()
    assert list(CODES.values()) == list(range(8))  # codes of files are not changed
