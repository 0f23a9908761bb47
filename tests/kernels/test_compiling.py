"""Compiling of kernels, and the cache, which notices edits in the files of other kernels."""

import gc
import os
import subprocess
import sys
from types import SimpleNamespace

import numba
import pytest

from adaptsize._kernels import compiling
from adaptsize._kernels.compiling import inner, kernel

OUTER = """
from adaptsize._kernels.compiling import kernel
from two.called import base


@kernel
def twice():
    return 2 * base()
"""
CALLED = """
from adaptsize._kernels.compiling import inner


@inner
def base():
    return {}
"""
RUN = "from two.outer import twice; print(twice(), sum(twice.stats.cache_hits.values()))"


@pytest.fixture
def package(tmp_path):
    """A package of a kernel and one that it calls, and how to run it in a fresh process."""
    (tmp_path / "two").mkdir()
    (tmp_path / "two" / "outer.py").write_text(OUTER)

    def run(number):
        (tmp_path / "two" / "called.py").write_text(CALLED.format(number))
        path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
        cache = str(tmp_path / "cache")
        environment = {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": cache}
        done = subprocess.run(
            [sys.executable, "-c", RUN], env=environment, check=True, capture_output=True, text=True
        )
        value, hits = map(int, done.stdout.split())
        return value, hits

    run.folder = tmp_path / "cache"
    return run


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_a_kernel_is_compiled_again_after_an_edit_of_one_that_it_calls(package):
    assert package(3) == (6, 0)
    assert package(3) == (6, 1)  # from the cache
    assert package(50) == (100, 0)
    assert package(50) == (100, 1)


def _cut(content):
    return content[: len(content) // 2]


def _flip(content):
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_damaged_files_of_the_cache_are_replaced(package):
    assert package(3) == (6, 0)
    for suffix, damage in (("nbi", _cut), ("nbc", _flip), ("nbc", lambda _: b"")):
        files = list(package.folder.rglob(f"*.{suffix}"))
        assert files
        for file in files:
            file.write_bytes(damage(file.read_bytes()))
        assert package(3) == (6, 0)  # compiled again
    assert package(3) == (6, 1)


@kernel
def _divided_by(a, b):
    return _quotient(a, b)


@inner
def _quotient(a, b):
    if b == 0.0:
        raise ValueError("zero")
    return a / b


def test_an_inner_function_may_raise():
    assert _divided_by(6.0, 3.0) == 2.0
    with pytest.raises(ValueError, match="zero"):
        _divided_by(6.0, 0.0)


@inner
def _untyped(a):
    return a.nothing


@kernel
def _calls_untyped(a):
    return _untyped(a)


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
@pytest.mark.parametrize("on", [True, False])
def test_garbage_is_collected_as_before_also_after_an_error(on, monkeypatch):
    module = "adaptsize._kernels.test"
    for dispatcher in (_untyped, _calls_untyped):
        monkeypatch.setattr(dispatcher.py_func, "__module__", module)
    was = gc.isenabled()
    try:
        (gc.enable if on else gc.disable)()
        with pytest.raises(numba.TypingError):
            _calls_untyped(1.0)
        assert gc.isenabled() == on
    finally:
        (gc.enable if was else gc.disable)()


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_garbage_is_not_collected_while_a_kernel_is_compiled(monkeypatch):
    seen = []
    listener = compiling._WithoutGarbageCollection()
    ours = SimpleNamespace(data={"dispatcher": _quotient})
    theirs = SimpleNamespace(data={"dispatcher": SimpleNamespace(py_func=os.getcwd)})
    monkeypatch.setattr(
        getattr(_quotient, "py_func", _quotient), "__module__", "adaptsize._kernels.a"
    )
    was = gc.isenabled()
    try:
        gc.enable()
        for event, step in [(theirs, "on_start"), (theirs, "on_end"), (ours, "on_start")]:
            getattr(listener, step)(event)
            seen.append(gc.isenabled())
        for event, step in [(theirs, "on_start"), (theirs, "on_end"), (ours, "on_end")]:
            getattr(listener, step)(event)
            seen.append(gc.isenabled())
    finally:
        (gc.enable if was else gc.disable)()
    assert seen == [True, True, False, False, False, True]
