"""A short attack with fixed seeds."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def attack(*options, module="tests.attack"):
    command = [sys.executable, "-m", module, *map(str, options)]
    return subprocess.run(
        command, check=False, cwd=ROOT, capture_output=True, text=True, timeout=280
    )


@pytest.mark.parametrize(
    ("only", "cases"), [("calls", 1200), ("limiting", 900), ("files", 700), ("faults", 400)]
)
def test_survives_a_short_attack(only, cases, tmp_path):
    report = tmp_path / "report.jsonl"
    done = attack("--start", 20260214, "--cases", cases, "--only", only, "--report", report)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    assert report.read_text() == ""
    assert f"{only}: " in done.stdout
