"""Whatever a generator does, the caller lives on and its directory stays clean."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fake_generators import FakeBackend
from shapes import block

from adaptsize.errors import BackendError, BackendTimeoutError
from adaptsize.remeshing import register_backend, registry, remesh
from adaptsize.remeshing.isolation import IsolatedRunner

SUPPORT = Path(__file__).parents[1] / "support"

posix_only = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
linux_only = pytest.mark.skipif(sys.platform != "linux", reason="sessions of processes")


@pytest.fixture
def fake(monkeypatch, tmp_path):
    """Return a function that remeshes a cube with a misbehaving generator."""
    monkeypatch.setattr(registry, "_BACKENDS", dict(registry._BACKENDS))
    monkeypatch.syspath_prepend(str(SUPPORT))
    monkeypatch.chdir(tmp_path)

    def run(function, *, options=(), **keywords):
        register_backend(FakeBackend(function, tuple(options)))
        return remesh(block(2), 0.5, backend="fake", **keywords)

    return run


@pytest.mark.parametrize(
    ("function", "message"),
    [
        pytest.param("crash", r"crashed \(SIGSEGV\)", marks=posix_only),
        pytest.param("abort", r"crashed \(SIGABRT\)", marks=posix_only),
        pytest.param(
            "killed", r"killed from outside \(SIGKILL\), perhaps .*memory", marks=posix_only
        ),
        ("fail", r"RuntimeError: no luck.*first the reason"),
        ("leave_early", "exit code 3"),
        ("chatter", "printed too much"),
    ],
)
def test_a_failure_is_an_error_with_the_reason_and_the_last_lines(fake, function, message):
    with pytest.raises(BackendError, match=message):
        fake(function)


@pytest.mark.parametrize(
    ("function", "error", "message"),
    [
        pytest.param("leave_children", None, "", marks=linux_only),
        pytest.param("crash_with_stray", BackendError, "SIGSEGV", marks=linux_only),
        pytest.param("hang_with_stray", BackendTimeoutError, "time limit", marks=linux_only),
        pytest.param("hang", BackendTimeoutError, "time limit of 3 s", marks=posix_only),
    ],
)
def test_what_a_generator_has_started_ends_with_it(fake, tmp_path, function, error, message):
    pid_file = tmp_path / "pids"
    started = time.monotonic()
    with contextlib.nullcontext() if error is None else pytest.raises(error, match=message):
        fake(function, options=[("pid_file", str(pid_file))], timeout=error and 3.0)
    assert time.monotonic() - started < 20.0
    assert len(pid_file.read_text().split()) == 2
    _assert_gone(pid_file)


@posix_only
def test_a_child_that_waits_is_stopped_later_on_a_busy_machine(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(SUPPORT))
    busy, stopped = iter([3.0, 3.0, 3.0, 0.0]), []
    run = IsolatedRunner(
        "fake", None, None, lambda *_: None, seconds=7.0, elapsed=1e3,
        crowding=lambda: stopped.append(next(busy)) or stopped[-1],
    )  # fmt: skip
    options = {"pid_file": str(tmp_path / "pids")}
    with pytest.raises(BackendTimeoutError, match=r"fake was stopped .* less than 7 s of proc"):
        run("misbehaving:hang", "faking", {}, options)
    assert stopped == [3.0, 3.0, 3.0, 0.0]  # asked again and again


def test_output_and_files_stay_in_the_child(fake, tmp_path, capfd):
    mesh = fake("litter")
    assert mesh.n_cells == block(2).n_cells
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


@posix_only
def test_an_exception_of_the_progress_callback_stops_the_generator(fake, tmp_path):
    pid_file = tmp_path / "pids"
    texts = []

    def stop(text, share):
        texts.append((text, share))
        if pid_file.exists() and len(pid_file.read_text().split()) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fake("hang", options=[("pid_file", str(pid_file))], progress=stop)
    assert texts[0] == ("faking", None)
    _assert_gone(pid_file)


@posix_only
def test_ctrl_c_stops_tetwild_and_python_lives_on(tmp_path):
    # fTetWild takes over SIGINT and kills Python when called in the same process.
    program = tmp_path / "program.py"
    program.write_text(
        "import sys, warnings\n"
        f"sys.path.insert(0, {str(SUPPORT)!r})\n"
        "from shapes import block\n"
        "from adaptsize.remeshing import remesh\n"
        "calls = []\n"
        "def report(text, share):\n"
        "    calls.append(text)\n"
        "    if len(calls) == 4: print('working', flush=True)\n"
        "try:\n"
        "    remesh(block(2).boundary().mesh, 0.03, backend='tetwild', progress=report)\n"
        "except KeyboardInterrupt:\n"
        "    print('alive')\n"
    )
    caller = subprocess.Popen(
        [sys.executable, str(program)], stdout=subprocess.PIPE, text=True, cwd=tmp_path
    )
    try:
        assert caller.stdout.readline() == "working\n"
        caller.send_signal(signal.SIGINT)
        out, _ = caller.communicate(timeout=30)
    finally:
        caller.kill()
        caller.wait()
    assert (caller.returncode, out) == (0, "alive\n")
    assert list(tmp_path.iterdir()) == [program]


@pytest.fixture(scope="module")
def forked_caller(tmp_path_factory):
    """A function that forks a process which waits for a generator; importing is done before.

    It returns the number of the process, and a function that waits for the end of the process.
    """
    program = tmp_path_factory.mktemp("parent") / "program.py"
    program.write_text(
        "import os, sys, tempfile\n"
        f"sys.path.insert(0, {str(SUPPORT)!r})\n"
        "from fake_generators import FakeBackend\n"
        "from shapes import block\n"
        "from adaptsize.remeshing import register_backend, remesh\n"
        "said = []\n"
        "def started(text, share):\n"
        "    if not said: said.append(print(os.getpid(), text, flush=True))\n"
        "for line in sys.stdin:\n"
        "    temporary, pid_file = line.split()\n"
        "    if (pid := os.fork()) == 0:\n"
        "        os.environ['TMPDIR'], tempfile.tempdir = temporary, None\n"
        "        register_backend(FakeBackend('hang_with_stray', (('pid_file', pid_file),)))\n"
        "        remesh(block(2), 0.5, backend='fake', progress=started)\n"
        "    os.waitpid(pid, 0)\n"
        "    print('ended', flush=True)\n"
    )
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    parent = subprocess.Popen([sys.executable, str(program)], **pipes)

    def fork(temporary, pid_file):
        print(temporary, pid_file, file=parent.stdin, flush=True)
        pid, text = parent.stdout.readline().split()
        assert text == "faking"
        return int(pid), parent.stdout.readline

    yield fork
    parent.kill()
    parent.communicate()


@linux_only
@pytest.mark.parametrize("delay", [0.0, 0.1, 0.5])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP])
def test_nothing_is_left_when_the_caller_is_killed(forked_caller, tmp_path, number, delay):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    caller, wait = forked_caller(temporary, tmp_path / "pids")
    time.sleep(delay)
    os.kill(caller, number)
    assert wait() == "ended\n"
    for _ in range(100):
        if not _working_below(temporary) and not list(temporary.iterdir()):
            break
        time.sleep(0.1)
    assert _working_below(temporary) == []
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize(
    ("function", "message"),
    [
        ("empty", "empty mesh"),
        ("not_finite", "not finite"),
        ("one_inverted", "1 inverted or flat cells"),
        ("one_far_away", "another domain: its bounding box is off by"),
        ("one_of_all", r"another domain: its boundary is off by [\d.]+ \(0\.33\d* of"),
        ("without_first_cells", r"another domain: its bounding box is off by [\d.]+ \(0\.2\d* of"),
        ("doubled", r"another domain: its measure differs by \+100%"),
    ],
)
def test_an_unusable_mesh_is_an_error(fake, function, message):
    with pytest.raises(BackendError, match=f"fake returned.*{message}"):
        fake(function)


def _working_below(folder):
    """Return the processes whose working directory is or was in a folder."""
    found = []
    for cwd in Path("/proc").glob("[0-9]*/cwd"):
        with contextlib.suppress(OSError):  # it has ended, or is another user's
            if os.readlink(cwd).startswith(str(folder)):
                found.append(int(cwd.parent.name))
    return found


def _assert_gone(pid_file):
    for pid in map(int, pid_file.read_text().split()):
        for _ in range(50):  # init may take a moment to bury an orphan
            if not _is_running(pid):
                break
            time.sleep(0.1)
        assert not _is_running(pid)


def _is_running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    stat = Path(f"/proc/{pid}/stat")
    return not (stat.exists() and stat.read_text().rsplit(")", 1)[1].split()[0] == "Z")


@posix_only
def test_a_limit_of_processor_time_of_the_caller_is_kept():
    code = (
        "import resource as r; from adaptsize._children import limits\n"
        "r.setrlimit(r.RLIMIT_CPU, (50, 50))\n"
        "with limits(1000.0): print(r.getrlimit(r.RLIMIT_CPU))"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "(50, 50)"
