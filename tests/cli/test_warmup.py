"""Kernels are compiled once, with a word about it, or beforehand."""

import os
import subprocess
import sys
from pathlib import Path

from adaptsize.cli.entry import run

DATA = Path(__file__).parents[2] / "data"


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


def test_warmup_compiles_for_all_kinds_of_domains(capfd):
    assert run(["warmup"]) == 0
    printed = capfd.readouterr()
    assert printed.out.startswith("kernels compiled in ")
    assert printed.err.count("compiled for ") == 5
