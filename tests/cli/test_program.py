"""The program: exit codes and streams, interruption, compilation, and what it imports."""

import atexit
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numba
import numpy as np
import pytest
from command_line import call
from numba.core import event

import adaptsize as ads
from adaptsize._cores import cores
from adaptsize._kernels.interpolate import interpolate
from adaptsize.cli import entry, warmup
from adaptsize.limiting import inside

DATA = Path(__file__).parents[2] / "data"


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
    assert printed.err.startswith("adaptsize: error: ")
    assert printed.err.count("\n") == 1


def test_debug_adds_the_traceback(capsys):
    assert call("--debug", "info", "no-such-file.stl") == 1
    printed = capsys.readouterr().err
    assert printed.startswith("Traceback")
    assert printed.endswith("adaptsize: error: no-such-file.stl: No such file or directory\n")


def test_a_reader_that_leaves_early_is_no_error():
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-c", "from adaptsize.cli import main; main()", "info"]
    child = subprocess.run(
        [*command, DATA / "lshape.vtu"],
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
        stdout=writer,
        stderr=subprocess.PIPE,
        check=False,
    )
    os.close(writer)
    assert child.returncode == 0
    assert all(b": step " in line for line in child.stderr.splitlines())  # if it took long


@pytest.mark.skipif(sys.platform == "win32", reason="signals differ")
def test_ctrl_c_ends_with_130_and_one_line(tmp_path):
    (tmp_path / "vtkmodules.py").write_text(
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


@pytest.mark.skipif(sys.platform == "win32", reason="a shell of POSIX")
def test_closed_streams_are_no_error():
    command = f'"{sys.executable}" -m adaptsize info "{DATA / "lshape.vtu"}" >&- 2>&- <&-'
    child = subprocess.run(command, shell=True, capture_output=True, check=False)
    assert child.returncode == 0
    assert b"Error" not in child.stderr  # on a busy machine it holds the steps


@pytest.mark.skipif(sys.platform == "win32", reason="signals differ")
def test_a_stopped_command_leaves_nothing(tmp_path):
    # The writer is slow, and stopped in the middle of the file.  A signal just before a long sleep
    # would take effect after it.
    code = (
        "import sys, time; from adaptsize._formats import vtk; from adaptsize.cli import main\n"
        "def slow(path, *_, **__):\n"
        "    path.write_text('half'); print('writing', flush=True)\n"
        "    for _ in range(1200): time.sleep(0.05)\n"
        "vtk.write = slow\n"
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
    child.send_signal(signal.SIGHUP)
    err = child.communicate(timeout=30)[1]
    assert child.returncode == 128 + signal.SIGHUP
    assert err.splitlines()[-1] == "adaptsize: stopped by SIGHUP"
    assert list(tmp_path.iterdir()) == []


def info_in_a_process(cache):
    done = subprocess.run(
        [sys.executable, "-m", "adaptsize", "info", DATA / "slit.vtu"],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stderr


def test_the_first_command_says_that_it_compiles_and_later_ones_do_not(tmp_path):
    first = info_in_a_process(tmp_path / "cache")
    second = info_in_a_process(tmp_path / "cache")
    assert first.count("compiling kernels") == 1
    assert "compiling" not in second


def test_warmup_compiles_for_all_kinds_of_domains_and_says_what_it_did(capfd):
    assert call("warmup") == 0
    printed = capfd.readouterr()
    assert printed.err.count(" functions compiled, ") == 6
    assert "compiled" in printed.out
    folder = printed.out.strip().rpartition("the cache is ")[2]
    assert numba.config.DISABLE_JIT or list(Path(folder).glob("*.nbi"))


class Names(event.Listener):
    """Kernels that are compiled."""

    def __init__(self):
        self.found = []

    def on_start(self, started):
        self.found.append(started.data["dispatcher"].py_func.__name__)

    def on_end(self, ended):
        pass


def test_the_second_process_compiles_only_what_remesh_needs(tmp_path):
    whole = ads.CartesianGrid([0.0] * 3, 1.0, (5, 4, 4)).mesh
    middle = whole.points[whole.cells].mean(axis=1)
    notched = ads.SimplexMesh(whole.points, whole.cells[~(middle[:, :2] > 1.0).all(axis=1)])
    ads.write(tmp_path / "part.stl", notched.boundary().mesh)
    out = tmp_path / "out.vtu"
    assert call("remesh", tmp_path / "part.stl", "-o", out, "--max-elements", "2000") == 0
    names = Names()
    with event.install_listener("numba:compile", names):
        for task in warmup._LAST:
            task()
    assert names.found == []


def test_warmup_compiles_what_carries_sizes_around_corners(monkeypatch):
    calls, kernel = [], inside.carry

    def carry(*given):
        calls.append(given)
        kernel(*given)

    monkeypatch.setattr(inside, "carry", carry)
    warmup._through_solids()
    assert len(calls) == 1


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_interpolation_is_compiled_once_for_values_of_any_kind():
    mesh = ads.CartesianGrid([0.0] * 2, 1.0, (3, 3)).mesh
    values, points = np.arange(18.0).reshape(9, 2), np.array([[0.5, 1.25]])
    fixed = values[:, 0].copy()
    fixed.flags.writeable = False
    found, counts = [], []
    for nodal in (fixed, fixed.copy(), values[:, 0]):  # as of size functions, new, a column
        found.append(mesh.locator.interpolate(nodal, points)[0])
        counts.append(len(interpolate.signatures))
    assert found[0] == found[1] == found[2]
    assert counts[0] == counts[1] == counts[2]


def test_the_second_process_ends_when_the_first_one_does(monkeypatch):
    started = []
    monkeypatch.setattr(atexit, "register", lambda end, child: started.append((end, child)))
    warmup._start_another()
    assert len(started) == (cores() > 1 and sys.platform != "win32")
    for end, child in started:
        child.stdin.close()  # as the end of a process does
        assert child.wait(timeout=60) in (0, 1)
        end(child)


def test_the_second_process_ends_in_order_when_it_has_compiled_all():
    code = f"from {warmup.__name__} import compile_last; import {warmup.__name__} as w; "
    child = subprocess.Popen(
        [sys.executable, "-c", f"{code} w._LAST = (); compile_last()"], stdin=subprocess.PIPE
    )
    assert child.wait(timeout=60) == 0
    child.communicate()


def test_ctrl_c_during_the_imports_gives_no_traceback(tmp_path):
    (tmp_path / "sitecustomize.py").write_text(
        "import sys\n"
        "class Interrupt:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'typer': raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Interrupt())\n"
    )
    path = os.pathsep.join([str(tmp_path), *sys.path])
    command = [sys.executable, "-m", "adaptsize", "info", "a.vtu"]
    child = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": path}, capture_output=True, check=False
    )
    assert child.returncode == 130
    assert b"Traceback" not in child.stderr


@pytest.mark.parametrize("seconds", [0.0, 0.1])
def test_ctrl_c_where_python_ignores_exceptions_interrupts_nevertheless(
    monkeypatch, capsys, seconds
):
    start = threading.Thread.start

    def start_slowly(self):  # as on a busy machine
        start(self)
        time.sleep(seconds)

    class Ignored:
        def __del__(self):
            raise KeyboardInterrupt

    def command(arguments):
        Ignored()
        time.sleep(60)

    monkeypatch.setattr(entry, "run", command)
    monkeypatch.setattr(threading.Thread, "start", start_slowly)
    with pytest.raises(SystemExit) as stop:
        entry.main([])
    assert stop.value.code == entry.INTERRUPTED
    assert capsys.readouterr() == ("", "adaptsize: interrupted\n")


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_at_exit_changes_nothing(name):
    code = (
        "import atexit, os, signal, time\n"
        "from adaptsize.cli.entry import main\n"
        f"atexit.register(lambda: (os.kill(os.getpid(), signal.{name}), time.sleep(0.1)))\n"
        "main(['--version'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("adaptsize ")


@pytest.mark.skipif(sys.platform == "win32", reason="timers of POSIX")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_waits_until_an_import_has_ended(name, tmp_path):
    # Modules of VTK crash where an exception is raised while they load.
    module = (
        "import os, signal, time\n"
        f"os.kill(os.getpid(), signal.{name})\n"
        "time.sleep(0.05)\n"
        "print('imported')\n"
    )
    (tmp_path / "interrupted_module.py").write_text(module)
    code = (
        "import time\n"
        "import adaptsize.cli.commands\n"
        "from adaptsize.cli import entry\n"
        "class App:\n"
        "    def main(self, *_, **__):\n"
        "        import interrupted_module\n"
        "        time.sleep(10)\n"
        "import typer.main\n"
        "typer.main.get_command = lambda app: App()\n"
        "entry.main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    number = signal.Signals[name]
    reason = "interrupted" if name == "SIGINT" else f"stopped by {name}"
    assert (done.returncode, done.stdout) == (128 + number, "imported\n")
    assert done.stderr == f"adaptsize: {reason}\n"
