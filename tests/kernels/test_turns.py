"""Processes with the same cache compile a kernel one after the other."""

import errno
import os
import subprocess
import sys
import time

import numba
import pytest
from numba.core.errors import TypingError

from adaptsize._kernels import turns
from adaptsize._kernels.compiling import kernel

pytestmark = [
    pytest.mark.skipif(sys.platform == "win32", reason="no locks of files as here"),
    pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled"),
]

TAKE = "import sys; from adaptsize._kernels.turns import take; take(sys.argv[1])"
MODULE = """
from adaptsize._kernels.compiling import kernel


@kernel
def sum_of(values):
    total = 0.0
    for value in values:
        total += value
    return total
"""
COMPILE = """
import numpy as np, sys
from module import sum_of

print("ready", flush=True)
sys.stdin.readline()
sum_of(np.arange(4.0))
sum_of(np.arange(4, dtype=sys.argv[1]))
print(sum(sum_of.stats.cache_hits.values()), sum_of(np.arange(4, dtype=sys.argv[1])))
"""


def in_a_process(code, *arguments, **environment):
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)],
        env=os.environ | environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def test_a_kernel_is_free_when_the_process_that_has_it_ends(tmp_path):
    one, two = tmp_path / "one.nbi", tmp_path / "two.nbi"
    code = f"{TAKE}; print('taken', flush=True); sys.stdin.read()"
    with in_a_process(code, one) as owner:
        assert owner.stdout.readline() == "taken\n"
        with in_a_process(f"{TAKE}; print('taken')", two) as other:
            assert other.communicate(timeout=60)[0] == "taken\n"  # another kernel
        with in_a_process(f"{TAKE}; print('taken')", one) as waiting:
            time.sleep(2.0)  # longer than it takes to start
            assert waiting.poll() is None
            owner.kill()
            assert waiting.communicate(timeout=60)[0] == "taken\n"


def test_processes_that_begin_together_compile_each_kernel_once(tmp_path):
    (tmp_path / "module.py").write_text(MODULE)
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    environment = {"PYTHONPATH": path, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    types = ("int32", "int64", "float32")
    processes = [in_a_process(COMPILE, kind, **environment) for kind in types]
    for process in processes:
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        process.stdin.write("\n")
        process.stdin.flush()
    printed = [process.communicate(timeout=120)[0].split() for process in processes]
    # float64 is compiled by one, and loaded by two; each of the other types has its own code.
    assert sum(int(hits) for hits, _ in printed) == len(types) - 1
    assert [float(total) for _, total in printed] == [6.0] * 3
    assert len(list(tmp_path.rglob("*.nbc"))) == len(types) + 1


@kernel
def _more(x):
    return x + 1


def test_a_kernel_is_given_up_after_success_and_failure():
    with pytest.raises(TypingError):
        _more("text")
    assert not turns._held
    assert _more(1) == 2
    assert not turns._held


def test_a_folder_that_cannot_be_written_to_is_no_obstacle(tmp_path):
    file = tmp_path / "file"
    file.touch()
    turns.take(str(file / "kernel.nbi"))
    assert not turns._held


def test_a_file_system_that_refuses_locks_is_no_obstacle(tmp_path, monkeypatch):
    import fcntl

    def refuse(*_):
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(fcntl, "lockf", refuse)
    monkeypatch.setattr(turns.time, "sleep", lambda _: pytest.fail("waits"))
    turns.take(str(tmp_path / "kernel.nbi"))
    assert not turns._held
