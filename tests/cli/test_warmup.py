"""Kernels are compiled once, with a word about it, or beforehand."""

import os
import subprocess
import sys
from pathlib import Path

from adaptsize.cli.entry import run

DATA = Path(__file__).parents[2] / "data"


def limit_in_a_process(cache, output):
    words = ["limit", str(DATA / "slit.vtu"), "--field", "h0", "-g", "0.3", "-o", str(output)]
    words += ["--method", "edge-based"]  # few kernels
    done = subprocess.run(
        [sys.executable, "-m", "adaptsize", *words],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stderr


def test_the_first_command_says_that_it_compiles_and_later_ones_do_not(tmp_path):
    first = limit_in_a_process(tmp_path / "cache", tmp_path / "h.vtu")
    second = limit_in_a_process(tmp_path / "cache", tmp_path / "h.vtu")
    assert first.count("compiling kernels") == 1
    assert "compiling" not in second


def test_warmup_compiles_for_all_kinds_of_domains(capfd):
    assert run(["warmup"]) == 0
    printed = capfd.readouterr()
    assert printed.out.startswith("kernels compiled in ")
    assert printed.err.count("compiled for ") == 5
