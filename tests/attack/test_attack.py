"""A short attack with fixed seeds, and that the attack notices what it is to notice."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import adaptsize as ads

from . import forms
from .calls import n_sweep, sweep
from .cases import SHARES, Failure
from .subjects import LEFT_OUT, Subject, subjects
from .values import BAD

ROOT = Path(__file__).parents[2]


def attack(*options):
    command = [sys.executable, "-m", "tests.attack", "--jobs", "1", *map(str, options)]
    return subprocess.run(
        command, check=False, cwd=ROOT, capture_output=True, text=True, timeout=280
    )


# Few: continuous integration also runs 300 cases.
def test_survives_a_short_attack():
    done = attack("--start", 20260214, "--cases", 20, "--jobs", 0)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    assert all(f"{name}: " in done.stdout for name in SHARES)


@pytest.mark.parametrize(("name", "n"), [("sequences", 2), ("signals", 2)])
def test_survives_sequences_of_calls_and_signals(name, n):
    pytest.importorskip("mmgpy")
    done = attack("--only", name, "--start", 5, "--cases", n)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    assert f"{name}: {n} cases, 0 failed" in done.stdout


def test_crashes_hangs_and_failures_are_reported():
    done = attack("--start", -4, "--cases", 4)
    assert done.returncode == 1
    lines = filter(lambda line: line.startswith("{"), done.stdout.splitlines())
    outcomes = {line["seed"]: line["what"] for line in map(json.loads, lines)}
    assert outcomes[-1] == "the interpreter died: SIGSEGV"
    assert outcomes[-2] == "no end after 1 s of processor time"
    assert outcomes[-3] == "on purpose"
    assert "MemoryError" in outcomes[-4]


def test_a_result_that_depends_on_the_form_of_an_argument_is_noticed(monkeypatch, tmp_path):
    def run(function):
        monkeypatch.setattr(forms, "subjects", lambda: [Subject.of("function", function)])
        for seed in range(20):
            forms.run(np.random.default_rng(seed), tmp_path)

    def good(hmax: "float") -> np.ndarray:
        return np.full(3, float(hmax))

    def bad(hmax: "float") -> np.ndarray:
        return np.full(3, hmax)

    run(good)
    with pytest.raises(Failure, match="not float64"):
        run(bad)


def test_every_public_callable_is_attacked_or_left_out_with_a_reason():
    known = {subject.name for subject in subjects()}
    results = {"AdaptResult", "LimitingInfo", "SizeReport", "SizeSources", "__version__"}
    assert not set(ads.__all__) - known - set(LEFT_OUT) - results
    assert "SizeFunction.__call__" in known
    parameters = {subject.name: list(subject.parameters) for subject in subjects()}
    for name in known:
        assert parameters[name] == parameters[name.removesuffix(".with_info")]


def test_the_sweep_passes_every_bad_value_to_every_parameter():
    assert n_sweep() == len(BAD) * sum(len(subject.parameters) for subject in subjects())
    assert "=nan" in sweep(0, np.random.default_rng(1))
    # A stride that is no multiple of the number of values meets all of them.
    done = attack("--sweep", 2003, "--jobs", 0)
    assert done.returncode == 0, done.stdout[-3000:]
