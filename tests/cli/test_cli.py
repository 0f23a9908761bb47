"""The command line: what it prints where, its exit codes, the files it leaves."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from command_line import call

from adaptsize import read, size_function, write

DATA = Path(__file__).parents[2] / "data"


# --- exit codes and streams -------------------------------------------------------


@pytest.mark.parametrize(
    "arguments",
    [
        ["frob"],
        ["limit", "a.vtu", "-g", "0.3"],
        ["remesh", "a.stl", "-o", "b", "-g", "x"],
    ],
)
def test_wrong_usage_exits_2_and_says_so_on_stderr(capsys, arguments):
    assert call(*arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "Error:" in printed.err


def test_refused_input_is_one_plain_line_and_exit_1(capsys):
    assert call("info", "no-such-file.stl") == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err == "adaptsize: error: no-such-file.stl: No such file or directory\n"


def test_debug_adds_the_traceback(capsys):
    assert call("--debug", "info", "no-such-file.stl") == 1
    printed = capsys.readouterr().err
    assert printed.startswith("Traceback")
    assert printed.endswith("adaptsize: error: no-such-file.stl: No such file or directory\n")


# --- commands ---------------------------------------------------------------------


def test_info_tells_what_is_in_the_block(capsys):
    assert call("info", DATA / "block.vtu", "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["kind"] == "tetrahedra"
    assert printed["measure"] == pytest.approx(40 * 20 * 20)
    assert set(printed["cell_tags"]) == {"1", "2"}
    assert set(printed["facet_tags"]) == {"1", "2", "3", "10"}
    assert set(printed["point_fields"]) == {"temperature", "displacement", "h0"}
    assert printed["n_components"] == 1


def test_limit_adds_the_field_h(capsys, square):
    output = square.with_name("limited.vtu")
    assert call("limit", square, "--field", "h0", "-g", "0.3", "-o", output) == 0
    printed = capsys.readouterr()
    assert "3 of 4 nodes lowered" in printed.out
    assert printed.err == ""
    limited = read(output).point_data
    # Distances from the corner with 0.1: 1, sqrt 2, 1.
    expected = 0.1 + 0.3 * np.array([0.0, 1.0, np.sqrt(2.0), 1.0])
    np.testing.assert_allclose(limited["h"], expected, rtol=1e-12)
    assert "h0" in limited


def test_limit_writes_and_lists_the_nodes_that_sizes_come_from(capsys, square):
    # Opposite corners: the size of 0.4 reaches nothing but its own node.
    write(square, read(square), fields={"h0": [0.1, np.inf, 0.4, np.inf]})
    output, sources = square.with_name("limited.vtu"), square.with_name("sources.vtu")
    words = ["--field", "h0", "-g", "0.3", "-o", output, "--sources", sources]
    assert call("limit", square, *words) == 0
    printed = capsys.readouterr().out
    assert "exact: 2 of 4 nodes lowered" in printed
    assert "sizes come from 2 nodes, most of them from" in printed
    assert "node 0 at (0, 0" in printed
    assert "75.0% of the nodes" in printed
    assert str(sources) in printed
    fields = read(sources).point_data
    np.testing.assert_array_equal(fields["source"], [0, 0, 2, 0])
    np.testing.assert_allclose(fields["h"], [0.1, 0.4, 0.4, 0.4], rtol=1e-12)


def test_limit_tells_when_the_method_knows_no_sources(capsys, square):
    output, sources = square.with_name("limited.vtu"), square.with_name("sources.vtu")
    words = ["--field", "h0", "-g", "0.3", "-o", output, "--sources", sources]
    assert call("limit", square, *words, "--method", "fast-marching") == 1
    assert capsys.readouterr().err == (
        "adaptsize: error: --sources needs the exact method (a flat mesh, one gradient limit), "
        "got method 'fast-marching'\n"
    )
    assert not sources.exists()


def test_size_writes_limited_sizes_and_says_which(capsys, tmp_path):
    output = tmp_path / "sized.vtu"
    source = "ball:10,10,10,2=0.5"
    assert call("size", DATA / "block.vtu", "-o", output, "--hmax", "4", "--source", source) == 0
    printed = capsys.readouterr()
    assert "g = 0.25" in printed.err
    assert "hmax = 4" in printed.err
    mesh = read(output)
    h = mesh.point_data["h"]
    assert h.min() == pytest.approx(0.5)
    assert h.max() == pytest.approx(4.0)
    i, j = mesh.edges.T
    assert (np.abs(h[i] - h[j]) <= 0.25 * mesh.edge_lengths * (1 + 1e-6)).all()


@pytest.mark.parametrize("name", ["h.pos", "h.sol", "h.jig.msh"])
def test_size_writes_for_other_mesh_generators(tmp_path, name):
    assert call("size", DATA / "lshape.vtu", "-o", tmp_path / name, "--hmax", "0.1") == 0
    assert (tmp_path / name).stat().st_size > 1000


@pytest.mark.parametrize("name", ["lshape.vtu", "bracket.stl"])
def test_size_is_read_and_size_function(tmp_path, name):
    output = tmp_path / "h.vtu"
    assert call("size", DATA / name, "-o", output, "--hmin", "1") == 0
    size = size_function(read(DATA / name), hmin=1.0)
    # Iterations on surfaces amplify rounding, which may differ between two calls.
    np.testing.assert_allclose(read(output).point_data["h"], size.values, rtol=1e-6)


def test_missing_picture_is_told_and_the_result_is_written(capsys, monkeypatch, square):
    from adaptsize.errors import PlotError

    def refuse(*_, **__):
        raise PlotError("no way to draw here")

    monkeypatch.setattr("adaptsize.plot.plot_size", refuse)
    output = square.with_name("limited.vtu")
    words = ["--field", "h0", "-g", "0.3", "-o", output, "--plot", square.with_name("h.png")]
    assert call("limit", square, *words) == 0
    assert capsys.readouterr().err == "adaptsize: warning: no picture: no way to draw here\n"
    assert output.exists()


# --- as a program -----------------------------------------------------------------


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from adaptsize.cli.entry import run; run(['--help']);"
        "heavy = {'numba', 'scipy', 'meshio', 'trimesh', 'pyvista'} & set(sys.modules);"
        "print(heavy, file=sys.stderr)"
    )
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert child.stderr.strip() == "set()"


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_leaves_early_is_no_error(unbuffered):
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-c", "from adaptsize.cli import main; main()", "info"]
    child = subprocess.run(
        [*command, DATA / "lshape.vtu"],
        env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
        stdout=writer,
        stderr=subprocess.PIPE,
        check=False,
    )
    os.close(writer)
    assert child.returncode == 0
    assert all(b": step " in line for line in child.stderr.splitlines())  # if it took long


@pytest.mark.skipif(sys.platform == "win32", reason="signals differ")
def test_ctrl_c_ends_with_130_and_one_line(tmp_path):
    (tmp_path / "meshio.py").write_text(
        "import pathlib, time\n"
        "pathlib.Path(__file__).with_name('reading').touch()\n"
        "time.sleep(60)\n"
    )
    path = os.pathsep.join([str(tmp_path), *sys.path])
    child = subprocess.Popen(
        [sys.executable, "-m", "adaptsize", "info", DATA / "lshape.vtu"],
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    while not (tmp_path / "reading").exists():
        assert child.poll() is None
        time.sleep(0.01)
    child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=30)
    assert child.returncode == 130
    assert (out, err) == ("", "adaptsize: interrupted\n")


@pytest.mark.parametrize("module", ["typer", "adaptsize.cli.entry"])
def test_ctrl_c_during_the_imports_gives_no_traceback(tmp_path, module):
    (tmp_path / "sitecustomize.py").write_text(
        "import sys\n"
        "class Interrupt:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name == {module!r}: raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Interrupt())\n"
    )
    path = os.pathsep.join([str(tmp_path), *sys.path])
    command = [sys.executable, "-m", "adaptsize", "info", "a.vtu"]
    child = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": path}, capture_output=True, check=False
    )
    assert child.returncode == 130
    assert b"Traceback" not in child.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="a shell of POSIX")
@pytest.mark.parametrize("closed", [">&-", ">&- 2>&- <&-"])
def test_closed_streams_are_no_error(closed):
    command = f'"{sys.executable}" -m adaptsize info "{DATA / "lshape.vtu"}" {closed}'
    child = subprocess.run(command, shell=True, capture_output=True, check=False)
    assert (child.returncode, child.stderr) == (0, b"")
