"""Compiling of kernels, and the cache, which notices edits in the files of other kernels."""

import os
import subprocess
import sys

import numba
import pytest

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


def _cut(content):
    return content[: len(content) // 2]


def _flip(content):
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_a_kernel_is_compiled_again_after_an_edit_of_one_that_it_calls_and_after_damage(package):
    assert package(50) == (100, 0)
    assert package(3) == (6, 0)
    for suffix, damage in (("nbi", _cut), ("nbc", _flip)):
        files = list(package.folder.rglob(f"*.{suffix}"))
        assert files
        for file in files:
            file.write_bytes(damage(file.read_bytes()))
        assert package(3) == (6, 0)  # compiled again
    assert package(3) == (6, 1)
