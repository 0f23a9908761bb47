"""What the commands print, as text, as JSON, quietly and step by step, and what they write."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from command_line import call
from shapes import block

from adaptsize import SimplexMesh, read, size_function, write
from adaptsize.cli import files
from adaptsize.cli import steps as steps_module
from adaptsize.cli.steps import NORMAL, Steps

DATA = Path(__file__).parents[2] / "data"
CUBE = block(2)


def as_parsed(text):
    """Parse strict JSON: no NaN and no Infinity."""

    def refuse(name):
        raise AssertionError(f"{name} in JSON")

    return json.loads(text, parse_constant=refuse)


def command_line(command, square):
    output = square.with_name("out.vtu")
    return {
        "info": ["info", square],
        "check": ["check", square],
        "limit": ["limit", square, "-o", output, "--field", "h0", "-g", "0.3"],
        "size": ["size", square, "-o", output, "--hmax", "0.5"],
    }[command]


def test_json_of_an_error_has_the_error(capsys, tmp_path):
    assert call("info", tmp_path / "none.stl", "--json") == 1
    out, err = capsys.readouterr()
    result = as_parsed(out)
    assert result["error"] == f"{tmp_path / 'none.stl'}: No such file or directory"
    assert err == f"adaptsize: error: {result['error']}\n"
    assert result["command"] == "info"


def test_json_lists_the_warnings(capsys, tmp_path):
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0]]
    with (tmp_path / "dirty.stl").open("w") as file:
        file.write("solid s\n")
        for three in (points[:3], points[3:]):
            corners = "\n".join("vertex {} {} {}".format(*p) for p in three)
            file.write(f"facet normal 0 0 1\nouter loop\n{corners}\nendloop\nendfacet\n")
        file.write("endsolid s\n")
    assert call("info", tmp_path / "dirty.stl", "--json") == 0
    out, err = capsys.readouterr()
    (text,) = as_parsed(out)["warnings"]
    assert err == f"adaptsize: warning: {text}\n"


@pytest.mark.parametrize("command", ["info", "check", "limit", "size"])
def test_quiet_prints_nothing(capsys, square, command):
    assert call(*command_line(command, square), "--quiet") == 0
    assert capsys.readouterr() == ("", "")


def test_quiet_prints_errors_and_json(capsys, square):
    assert call("info", "none.stl", "-q") == 1
    assert capsys.readouterr() == ("", "adaptsize: error: none.stl: No such file or directory\n")
    assert call("info", square, "-q", "--json") == 0
    out, err = capsys.readouterr()
    assert as_parsed(out)["n_cells"] == 2
    assert err == ""


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
    monkeypatch.setattr(steps_module, "time", clock)
    return clock


def test_each_step_is_a_line_once_a_command_takes_long(clock):
    lines, times = [], []
    with Steps(3, lines.append, times, NORMAL) as steps:
        steps.begin("reading")
        clock.now += 1.0
        steps.begin("sizes")
        assert lines == []
        clock.now += 9.0
        steps._talk()  # as the timer does
        clock.now += 10.0
        steps.report("limiting", 0.1)
        assert lines == ["step 2 of 3: sizes (after 10 s)"]
        clock.now += 21.0
        steps.report("limiting", 0.5)
        steps.begin("writing")
    assert lines[1:] == [
        "step 2 of 3: sizes, 40 s so far, about 40 s left",
        "step 3 of 3: writing (after 41 s)",
    ]
    assert times == [("reading", 1.0), ("sizes", 40.0), ("writing", 0.0)]


def test_texts_of_a_generator_are_parts_of_one_step(clock):
    lines, times = [], []
    with Steps(3, lines.append, times, NORMAL) as steps:
        steps._talk()
        steps.begin("sizes")
        report = steps.following(lambda text: None if text == "detail" else text)
        for text in ("detail", "first", "first", "detail", "second"):
            report(text, None)
            clock.now += 1.0
        steps.begin("writing")
    assert [line.split(" (")[0] for line in lines] == [
        "step 1 of 3: sizes",
        "step 2 of 3: first",
        "step 2 of 3: second",
        "step 3 of 3: writing",
    ]
    assert times == [("sizes", 1.0), ("first", 3.0), ("second", 1.0), ("writing", 0.0)]


def test_the_timer_prints_the_present_step(monkeypatch):
    monkeypatch.setattr(steps_module, "PATIENCE", 0.01)
    lines = []
    with Steps(2, lines.append, [], NORMAL) as steps:
        steps.begin("reading")
        until = time.monotonic() + 30.0
        while not lines and time.monotonic() < until:
            time.sleep(0.01)
    assert lines == ["step 1 of 2: reading"]


def test_limit_writes_and_lists_the_nodes_that_sizes_come_from(capsys, square):
    # Opposite corners: the size of 0.4 reaches nothing but its own node.
    write(square, read(square), fields={"h0": [0.1, np.inf, 0.4, np.inf]})
    output, sources = square.with_name("limited.vtu"), square.with_name("sources.vtu")
    words = ["--field", "h0", "-g", "0.3", "-o", output, "--sources", sources]
    assert call("limit", square, *words) == 0
    assert "75.0% of the nodes" in capsys.readouterr().out
    fields = read(sources).point_data
    np.testing.assert_array_equal(fields["source"], [0, 0, 2, 0])
    np.testing.assert_allclose(fields["h"], [0.1, 0.4, 0.4, 0.4], rtol=1e-12)


def test_limit_tells_when_the_method_knows_no_sources(refused, square):
    output, sources = square.with_name("limited.vtu"), square.with_name("sources.vtu")
    words = ["--field", "h0", "-g", "0.3", "-o", output, "--sources", sources]
    assert refused("limit", square, *words, "--method", "fast-marching") == (
        "adaptsize: error: --sources needs the exact method (a flat mesh, one gradient limit), "
        "got method 'fast-marching'\n"
    )
    assert not sources.exists()


@pytest.mark.parametrize("name", ["lshape.vtu", "bracket.stl"])
def test_size_is_read_and_size_function(tmp_path, name):
    output = tmp_path / "h.vtu"
    assert call("size", DATA / name, "-o", output, "--hmin", "1") == 0
    size = size_function(read(DATA / name), hmin=1.0)
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
    (failed,) = (i for i, line in enumerate(lines) if line.startswith("boundary  FAILED"))
    assert "within 0.01 of the diagonal, 0.001 allowed" in lines[failed]
    assert lines[failed + 1].strip() == "0.01732 at (1.01, 1.01, 1.01)"
    assert call(*words, "--tolerance", "0.02") == 0


def test_sizes_of_the_mesh_are_checked_if_there_are_any(capsys, cubes):
    write(cubes / "sized.vtu", CUBE, fields={"h": np.full(CUBE.n_points, 5.0)})
    assert call("check", str(cubes / "sized.vtu"), "--json") == 1
    result = json.loads(capsys.readouterr().out)
    assert [d["name"] for d in result["demands"] if not d["is_met"]] == ["edges"]
    assert result["is_met"] is False
    assert result["n_inverted"] == 0
    assert "error" not in result
    assert call("check", str(cubes / "cube.vtu"), "--field", "h") == 1
    assert "no nodal field 'h'" in capsys.readouterr().err


@pytest.fixture
def tetrahedron(tmp_path):
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    file = tmp_path / "part.stl"
    write(file, SimplexMesh(points, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    return file


def test_large_inputs_are_announced_and_too_large_ones_are_a_warning(
    capsys, tetrahedron, monkeypatch
):
    words = ["size", str(tetrahedron), "-o", str(tetrahedron.with_suffix(".vtu")), "--json"]
    monkeypatch.setattr(files, "_PER_TRIANGLE", 0.5e9)
    monkeypatch.setattr(files, "_installed_memory", lambda: 3e9)
    assert call(*words) == 0
    printed = capsys.readouterr()
    assert "the sizes of 4 triangles need about 2.0 GB of memory\n" in printed.err
    assert json.loads(printed.out)["warnings"] == []
    monkeypatch.setattr(files, "_installed_memory", lambda: 1e9)
    assert call(*words) == 0
    (text,) = json.loads(capsys.readouterr().out)["warnings"]
    assert text.endswith("need about 2.0 GB of memory; this machine has 1.0 GB")


def test_the_memory_of_a_mesh_is_announced_once_its_size_is_known(capsys, tetrahedron, monkeypatch):
    monkeypatch.setattr(files, "_PER_ELEMENT", 1e9)
    monkeypatch.setattr("adaptsize.remeshing.remesh", lambda mesh, size, **_: mesh)
    output = tetrahedron.with_suffix(".vtu")
    assert call("remesh", str(tetrahedron), "-o", str(output)) == 0
    assert "elements need about " in capsys.readouterr().err
