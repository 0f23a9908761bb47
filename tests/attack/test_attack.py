"""A short attack with fixed seeds, and that the attack notices what it is to notice."""

import json
import subprocess
import sys
from inspect import signature
from pathlib import Path

import numpy as np
import pytest

import adaptsize as ads

from . import faults

ROOT = Path(__file__).parents[2]


def attack(*options, module="tests.attack"):
    command = [sys.executable, "-m", module, *map(str, options)]
    return subprocess.run(
        command, check=False, cwd=ROOT, capture_output=True, text=True, timeout=280
    )


# Few: continuous integration also runs 600 cases.  Each kind has a share in the numbers.
@pytest.mark.parametrize(
    ("only", "cases"),
    [("calls", 20), ("forms", 25), ("limiting", 20), ("files", 100), ("faults", 20)],
)
def test_survives_a_short_attack(only, cases, tmp_path):
    report = tmp_path / "report.jsonl"
    done = attack("--start", 20260214, "--cases", cases, "--only", only, "--report", report)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    assert report.read_text() == ""
    assert f"{only}: " in done.stdout


@pytest.mark.parametrize(
    ("number", "noticed"),
    [
        (-1, "the interpreter died: SIGSEGV"),
        (-2, "no end after 3 s of processor time"),
        (-3, "on purpose"),
        (-4, "MemoryError"),
    ],
)
def test_crashes_hangs_and_failures_are_reported(number, noticed, tmp_path):
    report = tmp_path / "report.jsonl"
    done = attack("--seed", number, "--report", report)
    assert done.returncode == 1
    (line,) = report.read_text().splitlines()
    outcome = json.loads(line)
    assert outcome["seed"] == number
    assert noticed in outcome["what"]


def test_a_result_that_depends_on_the_form_of_an_argument_is_noticed(monkeypatch, tmp_path):
    from attack import forms
    from attack.cases import Failure
    from attack.subjects import Subject

    def good(hmax: "float") -> np.ndarray:
        return np.full(3, float(hmax))

    def bad(hmax: "float") -> np.ndarray:
        return np.full(3, hmax)

    def outcomes(function):
        subject = Subject("function", "", function, dict(signature(function).parameters))
        monkeypatch.setattr(forms, "subjects", lambda: [subject])
        for seed in range(20):
            yield forms.run(np.random.default_rng(seed), tmp_path)

    assert len(list(outcomes(good))) == 20
    with pytest.raises(Failure, match="not float64"):
        list(outcomes(bad))


@pytest.mark.parametrize(("file", "is_ours"), [("__init__.py", False), ("cli/entry.py", True)])
def test_tracebacks_of_interrupts_count_once_the_command_runs(file, is_ours):
    package = "".join(f'  File "/x/adaptsize/{name}", line 7\n' for name in ("__init__.py", file))
    errors = f'Traceback (most recent call last):\n  File "<frozen runpy>"\n{package}'
    if is_ours:
        with pytest.raises(faults.Failure, match="a traceback"):
            faults._check_errors(errors + "KeyboardInterrupt\n")
    else:
        faults._check_errors(errors + "KeyboardInterrupt\n")
    with pytest.raises(faults.Failure, match="a traceback"):
        faults._check_errors(errors + "ValueError\n")


def test_no_case_starts_after_the_time_limit():
    done = attack("--start", 20260214, "--cases", 1000, "--only", "files", "--seconds", 0)
    assert done.returncode == 0
    assert "0 cases in 0 s" in done.stdout


def test_a_case_is_repeated_by_its_number():
    runs = [attack("--seed", 20260214).stdout.splitlines()[:4] for _ in range(2)]
    assert runs[0] == runs[1]
    assert runs[0][0] == "seed: 20260214"


def test_every_public_callable_is_attacked_or_left_out_with_a_reason():
    code = (
        "from tests.attack.subjects import LEFT_OUT, subjects\n"
        "import adaptsize as ads\n"
        "known = {s.name for s in subjects()} | set(LEFT_OUT)\n"
        "results = {'AdaptResult', 'LimitingInfo', 'SizeReport', 'SizeSources', '__version__'}\n"
        "print(sorted(set(ads.__all__) - known - results))\n"
        "print(sorted(s.name for s in subjects() if '.' in s.name))\n"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, check=True, cwd=ROOT, capture_output=True, text=True)
    missing, methods = done.stdout.splitlines()
    assert missing == "[]"
    assert "'SizeFunction.__call__'" in methods


def test_a_folder_of_surfaces_is_tabulated_and_resumed(tmp_path):
    corners = np.vstack([np.zeros(3), np.eye(3)])
    surface = ads.SimplexMesh(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    folder = tmp_path / "surfaces"
    folder.mkdir()
    ads.write(folder / "good.stl", surface)
    (folder / "bad.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n")
    options = (folder, "--output", tmp_path / "table.md", "--max-elements", 300)
    done = attack(*options, module="tests.attack.corpus")
    assert done.returncode == 0, done.stdout + done.stderr
    table = (tmp_path / "table.md").read_text()
    assert "| good.stl | 4 |" in table
    assert "2 files: 1 kept, 1 refused." in table
    # Half a line is left of a run that was interrupted.
    store = tmp_path / "table.md.jsonl"
    bad, good = store.read_text().splitlines()
    store.write_text(f"{good}\n{bad[:20]}")
    again = attack(*options, module="tests.attack.corpus")
    assert "bad.off" in again.stdout
    assert "good.stl" not in again.stdout
    assert "2 files: 1 kept, 1 refused." in (tmp_path / "table.md").read_text()


def test_nasty_surfaces_are_fixed_by_their_seed_and_tabulated_by_defect(tmp_path):
    from attack.nasty import write_surfaces

    folder, again = tmp_path / "nasty", tmp_path / "again"
    write_surfaces(folder, 20, 5)
    write_surfaces(again, 20, 5)
    files = sorted(folder.iterdir())
    assert [f.read_bytes() for f in files] == [f.read_bytes() for f in sorted(again.iterdir())]
    assert len({f.stem[4:] for f in files}) == 20
    assert {f.suffix for f in files} == {".off", ".stl"}
    rows = [
        {"file": f.name, "kind": "refused", "outcome": "", "CPU s": 1.0, "MB": 9} for f in files
    ]
    output = tmp_path / "table.md"
    store = tmp_path / "table.md.jsonl"
    store.write_text("".join(json.dumps(row) + "\n" for row in rows))
    options = (folder, "--nasty", 20, "--seed", 5, "--output", output)
    done = attack(*options, module="tests.attack.corpus")
    assert done.returncode == 0, done.stderr
    assert "| fins | 1 |  |  |  | 1 |  | 1 | 1 | 9 |" in output.read_text()
    assert "20 files: 20 refused." in output.read_text()


def test_a_case_of_the_corpus_that_computes_too_long_fails(tmp_path):
    corners = np.random.default_rng(6).random((3000, 3))
    surface = ads.SimplexMesh(corners, np.arange(3000).reshape(-1, 3))
    ads.write(tmp_path / "soup.off", surface)
    options = (tmp_path, "--output", tmp_path / "table.md", "--timeout", 1)
    done = attack(*options, module="tests.attack.corpus")
    assert done.returncode == 1
    assert "SIGXCPU" in done.stdout or "SIGKILL" in done.stdout
