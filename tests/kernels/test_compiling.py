"""Compiling of kernels, and the cache, which notices edits in the files of other kernels."""

import gc
import math
import os
import re
import subprocess
import sys

import numba
import numpy as np
import pytest
from numba.core.caching import NullCache
from numba.core.types.functions import BaseFunction

from adaptsize._kernels import linking
from adaptsize._kernels.compiling import inlined, inner, kernel, lean, lean_kernel

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


@inner
def _plus_one(x):
    return x + 1


@lean
def _halved(x):
    return 0.5 * (x - 1)


@inner
def _through_two(x):
    return _plus_one(x) + 2.0 * _halved(x)


@kernel
def _doubled(x):
    return _through_two(x) + _halved(x) - _halved(x)


@kernel
def _doubled_again(x):
    return 2.0 * _doubled(x) + _plus_one(x)


@kernel
def _of_text(x):
    return _plus_one(x) + "text"


@numba.njit
def _by_others(x):
    return _through_two(x) + _plus_one(x)


@pytest.mark.parametrize("x", [3, 2.5])
def test_functions_that_kernels_call_give_the_same_through_kernels_and_functions_of_others(x):
    assert _doubled_again(x) == 4.0 * x + x + 1
    assert _doubled(x) == 2.0 * x
    assert _by_others(x) == 2.0 * x + x + 1


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_functions_that_only_kernels_call_have_no_machine_code():
    _doubled(3)
    part, whole = (next(iter(f.overloads.values())) for f in (_through_two, _doubled))
    assert part.library.get_pointer_to_function(part.fndesc.mangled_name) == 0
    assert whole.library.get_pointer_to_function(whole.fndesc.mangled_name) != 0


@inlined
def _long(x):
    """Compute so much that LLVM would not inline it by itself."""
    x = math.sin(x) + math.cos(x) * math.exp(x) - math.atan2(x, 2.0) * math.hypot(x, 3.0)
    x = math.tan(x) + math.cosh(x) * math.exp(x) - math.atan2(x, 4.0) * math.hypot(x, 5.0)
    x = math.sin(x) + math.cos(x) * math.erf(x) - math.atan2(x, 6.0) * math.hypot(x, 7.0)
    x = math.tan(x) + math.tanh(x) * math.erf(x) - math.atan2(x, 8.0) * math.hypot(x, 9.0)
    return math.sin(x) + math.cos(x) * math.erfc(x) - math.atan2(x, 1.0) * math.hypot(x, 2.0)


@lean_kernel
def _three_times(x):
    return _long(x) + _long(2.0 * x) + _long(3.0 * x)


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_functions_to_be_inlined_are_typed_once_and_called_nowhere(monkeypatch):
    monkeypatch.setattr(_three_times, "_cache", NullCache())
    expected = sum(_long.py_func(x) for x in (0.1, 0.2, 0.3))
    assert _three_times(0.1) == pytest.approx(expected, rel=1e-12)
    assert len(_long.signatures) == 1
    (code,) = _three_times.inspect_llvm().values()
    assert not re.search(r"\bcall\b.*5_long", code)  # as the name is mangled


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_compilation_leaves_numba_and_the_search_for_garbage_as_they_were():
    before = BaseFunction.get_call_type, gc.isenabled(), gc.get_freeze_count()
    with pytest.raises(numba.errors.TypingError):
        _of_text(1)
    assert (BaseFunction.get_call_type, gc.isenabled()) == before[:2]
    assert _doubled(numba.uint8(1)) == 2.0
    assert (BaseFunction.get_call_type, gc.isenabled()) == before[:2]
    # Thousands of objects are made; if they were frozen, none would be found as garbage.
    assert abs(gc.get_freeze_count() - before[2]) < 100


@inner
def _item(values, i, doubled):
    return 2.0 * values[i] if doubled else values[i]


@kernel
def _items(values, places, doubled):
    """Pass literals, a variable that begins as one, integers of 32 bits, and named arguments."""
    total, i = _item(values, 0, True), 0
    while i < 2:
        total += _item(values, i, False)
        i += 1
    for i in places:
        total += _item(values, i=i, doubled=doubled)
    return total


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_functions_are_compiled_once_for_all_integers(monkeypatch):
    monkeypatch.setattr(_items, "_cache", NullCache())  # what comes from it has not been compiled
    values = np.array([1.0, 10.0, 100.0])
    assert _items(values, np.array([2, 1], np.int32), False) == 2.0 + 11.0 + 110.0
    assert [args[1:] for args in _item.signatures] == [(numba.int64, numba.boolean)]


@pytest.mark.parametrize("seed", range(20))
def test_functions_are_linked_after_all_that_call_them(seed):
    random, parts = np.random.default_rng(seed), []
    for _ in range(12):  # a function calls some of those before it
        part = object.__new__(linking._Part)
        part._linking_libraries = [p for p in parts if random.random() < 0.3]
        random.shuffle(part._linking_libraries)
        parts.append(part)
    order = linking._all_called(parts[-1])
    assert len(set(map(id, order))) == len(order)
    place = {id(part): number for number, part in enumerate([parts[-1], *order])}
    for part in [parts[-1], *order]:
        assert all(place[id(part)] < place[id(called)] for called in part._linking_libraries)
