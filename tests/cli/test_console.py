"""JSON, quiet and verbose output, steps, help, completion and interruption."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from command_line import call

from adaptsize import SimplexMesh, __version__, write
from adaptsize.cli import entry
from adaptsize.cli import steps as steps_module
from adaptsize.cli.steps import Steps

DATA = Path(__file__).parents[2] / "data"


@pytest.fixture
def square(tmp_path):
    """A file with two triangles and the nodal fields h0 and h."""
    mesh = SimplexMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]])
    write(tmp_path / "square.vtu", mesh, fields={"h0": [0.1, np.inf, 5, 5], "h": np.ones(4)})
    return tmp_path / "square.vtu"


def as_parsed(text):
    """Parse strict JSON: no NaN and no Infinity."""

    def refuse(name):
        raise AssertionError(f"{name} in JSON")

    return json.loads(text, parse_constant=refuse)


# --- JSON -------------------------------------------------------------------------

SHARED = {"command", "version", "output", "warnings", "steps", "seconds", "units"}
KEYS = {
    "info": {"input", "n_points", "n_cells", "kind", "lower", "upper", "measure", "angle_min"},
    "check": {"input", "n_points", "n_cells", "edges", "radius_ratio_min", "angle_min"},
    "limit": {"input", "method", "g", "n_points", "n_lowered", "cell_gradient_quantiles"},
    "size": {"input", "size"},
}


def command_line(command, square):
    output = square.with_name("out.vtu")
    return {
        "info": ["info", square],
        "check": ["check", square],
        "limit": ["limit", square, "-o", output, "--field", "h0", "-g", "0.3"],
        "size": ["size", square, "-o", output, "--hmax", "0.5"],
    }[command]


@pytest.mark.parametrize("command", KEYS)
def test_json_is_one_object_with_the_documented_keys(capsys, square, command):
    assert call(*command_line(command, square), "--json") == 0
    result = as_parsed(capsys.readouterr().out)
    assert SHARED | KEYS[command] <= result.keys()
    assert (result["command"], result["version"]) == (command, __version__)
    assert result["input"] == str(square)
    assert all(step["seconds"] >= 0.0 for step in result["steps"])
    assert result["warnings"] == []
    if "-o" in command_line(command, square):
        (file,) = result["output"]
        assert file["file"] == str(square.with_name("out.vtu"))
        assert (file["n_points"], file["n_cells"]) == (4, 2)
        assert "h" in file["fields"]


def test_json_of_limit_has_numbers(capsys, square):
    sources = square.with_name("s.vtu")
    command = command_line("limit", square)
    assert call(*command, "--sources", sources, "--json") == 0
    result = as_parsed(capsys.readouterr().out)
    assert result["n_lowered"] == 3
    assert result["sources"]["n_nodes"] == 1
    assert result["sources"]["largest"] == [{"node": 0, "position": [0.0, 0.0], "share": 1.0}]
    assert [file["file"] for file in result["output"]][1] == str(sources)


def test_json_of_size_lists_parameters_and_causes(capsys, square):
    assert call(*command_line("size", square), "--json") == 0
    size = as_parsed(capsys.readouterr().out)["size"]
    assert (size["g"], size["hmax"], size["elements_per_radian"]) == (0.25, 0.5, 4.0)
    assert [cause["code"] for cause in size["causes"]] == list(range(len(size["causes"])))
    assert sum(cause["domain_share"] for cause in size["causes"]) == pytest.approx(1.0)
    assert {cause["name"] for cause in size["causes"]} >= {"hmin", "hmax"}


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


# --- quiet and verbose ------------------------------------------------------------


@pytest.mark.parametrize("command", KEYS)
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


def test_quiet_and_verbose_exclude_each_other(capsys, square):
    assert call("info", square, "-q", "-v") == 1
    assert "--quiet and --verbose exclude each other" in capsys.readouterr().err


# --- steps ------------------------------------------------------------------------


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
    with Steps(3, lines.append, times, shown=True, verbose=False) as steps:
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
    with Steps(3, lines.append, times, shown=True, verbose=False) as steps:
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


def test_a_step_that_fails_is_no_step(clock):
    times = []

    def fail():
        with Steps(1, print, times, shown=False, verbose=False) as steps:
            steps.begin("reading")
            raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        fail()
    assert times == []


def test_the_timer_prints_the_present_step(monkeypatch):
    monkeypatch.setattr(steps_module, "PATIENCE", 0.01)
    lines = []
    with Steps(2, lines.append, [], shown=True, verbose=False) as steps:
        steps.begin("reading")
        until = time.monotonic() + 30.0
        while not lines and time.monotonic() < until:
            time.sleep(0.01)
    assert lines == ["step 1 of 2: reading"]


# --- interruption -----------------------------------------------------------------


@pytest.mark.skipif(sys.platform == "win32", reason="signals differ")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_stopped_command_leaves_nothing(tmp_path, number):
    # The writer is slow, and stopped in the middle of the file.
    code = (
        "import sys, time; from adaptsize._formats import writers; from adaptsize.cli import main\n"
        "def slow(path, *_, **__):\n"
        "    path.write_text('half'); print('writing', flush=True); time.sleep(60)\n"
        "writers._write_with_meshio = slow\n"
        "main()"
    )
    words = ["limit", DATA / "slit.vtu", "-o", "out.vtu", "--field", "h0", "-g", "0.3"]
    child = subprocess.Popen(
        [sys.executable, "-c", code, *words],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert child.stdout.readline() == "writing\n"
    child.send_signal(number)
    err = child.communicate(timeout=30)[1]
    assert child.returncode == 128 + number
    assert err.splitlines()[-1] == f"adaptsize: stopped by {signal.Signals(number).name}"
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_where_python_ignores_exceptions_interrupts_nevertheless(monkeypatch, capsys):
    class Ignored:
        def __del__(self):
            raise KeyboardInterrupt

    def command(arguments):
        Ignored()
        time.sleep(60)

    monkeypatch.setattr(entry, "run", command)
    with pytest.raises(SystemExit) as stop:
        entry.main([])
    assert stop.value.code == entry.INTERRUPTED
    assert capsys.readouterr() == ("", "adaptsize: interrupted\n")
