"""Other packages read in a child process, which is replaced when it fails."""

import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from concurrent.futures import ThreadPoolExecutor

import pytest
from mesh_files import SQUARE, TWO_TRIANGLES

from adaptsize import SimplexMesh, read, write
from adaptsize._formats import limited

posix_only = pytest.mark.skipif(sys.platform == "win32", reason="signals and forks of POSIX")


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "square.vtu"
    write(path, SimplexMesh(SQUARE, TWO_TRIANGLES))
    return path


@posix_only
@pytest.mark.filterwarnings("ignore:.*multi-threaded.*:DeprecationWarning")
def test_a_fork_while_another_thread_reads_can_read(file):
    read(file)
    context = multiprocessing.get_context("fork")
    with limited._LOCK:  # as if another thread were reading
        child = context.Process(target=read, args=(file,))
        child.start()
        child.join(60.0)
        ended = child.exitcode
        child.kill()
    assert ended == 0
    assert read(file).n_cells == 2


@posix_only
def test_an_interrupt_ends_the_child(file):
    read(file)
    first = limited._CHILD
    os.kill(first.pid, signal.SIGSTOP)  # it will not answer
    threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        read(file)
    assert first.poll() is not None
    assert read(file).n_cells == 2


@posix_only
def test_the_child_ends_with_this_process(tmp_path, file):
    code = (
        f"import adaptsize as ads; from adaptsize._formats import limited; ads.read({str(file)!r});"
        "print(limited._CHILD.pid, flush=True); import os; os._exit(0)"
    )
    done = limited.subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    until = time.monotonic() + 10.0
    while os.path.exists(f"/proc/{int(done.stdout)}") and time.monotonic() < until:
        time.sleep(0.05)
    assert not os.path.exists(f"/proc/{int(done.stdout)}")


@posix_only
def test_a_child_that_has_ended_is_replaced(file, monkeypatch):
    read(file)
    first = limited._CHILD
    os.kill(first.pid, signal.SIGTERM)
    first.wait()
    first.returncode = 0  # as it ends after a time without work
    assert read(file).n_cells == 2
    assert limited._CHILD is not first


def test_many_threads_read_and_leave_the_filters_of_warnings_as_they_were(file):
    before = list(warnings.filters)
    with ThreadPoolExecutor(8) as pool:
        meshes = list(pool.map(read, [file] * 40))
    assert {mesh.n_cells for mesh in meshes} == {2}
    assert warnings.filters == before
